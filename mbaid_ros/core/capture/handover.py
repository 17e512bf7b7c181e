"""What goes on from before the capture to after it, and what the two together tell of the captured body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mbaid_ros.core.capture.known_momentum import Chaser
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples


@dataclass(frozen=True)
class Handover:
    """What a robot has learnt of itself before the capture, and the method that goes on with it.

    Attributes
    ----------
    kernel : with the calibrated bodies, and how far they may still be off
    after : the method
    again : makes that method anew
    chaser : the robot before the capture
    link_covariance : (10, 10) of the target link's own standard parameters, None where it counts as exact
    told : the calibration in a line
    """

    kernel: MomentumKernel
    after: Estimator
    again: Callable[[], Estimator]
    chaser: Chaser
    link_covariance: Array | None
    told: str


# From windows before the capture to what they tell of the robot's own bodies.
Calibrate = Callable[[list[Samples]], Handover]


@dataclass(frozen=True)
class Capture:
    """A capture and what it tells of the body that was captured.

    Attributes
    ----------
    time : s since the first sample
    chaser : the robot before it, None where nothing was measured
    momentum, covariance : (6,), (6, 6) of the captured body before it, as in Chaser; NaN where not known
    velocity, spin : (3,) m/s, rad/s of that body before it, its CoM's and its own, odometry axes; NaN where not known
    calibrated : what the robot has learnt of itself before it, in a line; empty where nothing
    """

    time: float
    chaser: Chaser | None
    momentum: Array
    covariance: Array
    velocity: Array
    spin: Array
    calibrated: str = ''
