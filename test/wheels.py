"""The servicer with a pyramid of four reaction wheels that spin up while the arm moves."""

from __future__ import annotations

from functools import cache

import numpy as np

from benchmarks.honesty.disturbed import AXES
from benchmarks.honesty.disturbed import wheeled as with_wheels
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.motion import Sinusoids

# Speeding up to 100 rad/s in 20 s, at a quarter of a slow sine.
TOP, FREQUENCY = 200.0, 1.0 / 240.0


@cache
def urdf() -> str:
    """Return the servicer with a pyramid of four wheels."""
    return with_wheels(*((-0.2 * axis[0], -0.2 * axis[1], 0.1) for axis in AXES))


def unaware() -> str:
    """Return the same to someone who knows nothing of the wheels' speeds."""
    return urdf().replace('type="continuous"', 'type="fixed"')


@cache
def wheeled() -> MomentumKernel:
    """Return its momentum, with what the last link holds unknown."""
    return MomentumKernel(load_model(urdf()), 'link7')


def spinning(joints: Sinusoids) -> Sinusoids:
    """Return the arm's motion with the wheels' beside it, in the order of the model's joints."""
    arm = [index for index, name in enumerate(wheeled().model.joint_names) if not name.startswith('wheel')]
    count, terms = wheeled().model.joints, joints.amplitude.shape[1]

    def spread(values: Array, wheel: float) -> Array:
        whole = np.zeros((count, terms))
        whole[:, 0] = wheel
        whole[arm] = values
        return whole

    start = np.zeros(count)
    start[arm] = joints.start
    return Sinusoids(
        start=start,
        amplitude=spread(joints.amplitude, TOP / (2.0 * np.pi * FREQUENCY)),
        frequency=spread(joints.frequency, FREQUENCY),
        phase=spread(joints.phase, -0.5 * np.pi),
    )
