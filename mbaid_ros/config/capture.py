"""The parameters of the estimator about the capture, the bodies on either side of it, and what disturbs them."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.config.model_errors import LinkPriorConfig
from mbaid_ros.config.parameters import parameter

CONSTANT_FORCES = ('none', 'inertial', 'body')
PHASES = ('post_capture', 'pre_capture')


@dataclass(frozen=True)
class DebrisConfig:
    """The captured body alone."""

    report: bool = parameter(
        default=False,
        description="Also report the captured body alone: what is identified less the target link's <inertial>.",
    )
    frame: str = parameter(
        '',
        'Frame it is given in: a link fixed to the target link, or principal for its own principal axes through its '
        "centre of mass; empty is the target link's.",
    )


@dataclass(frozen=True)
class DisturbanceConfig:
    """What acts on the robot from outside."""

    constant: str = parameter(
        'none',
        'Axes of a constant external force and torque that trajectory estimates along: body, on the base link, or '
        'inertial, as on a tilted table; none estimates one where the data ask for it.',
        choices=CONSTANT_FORCES,
    )
    torque_std: float = parameter(
        0.0,
        'Standard deviation of a torque from outside about each axis of the base, constant in these and another one in '
        'every motion, as that of the air on a thrown body; 0 is none.',
        unit='N m',
        minimum=0.0,
    )


@dataclass(frozen=True)
class ThrustConfig:
    """The commanded thrust, where there is a topic of it."""

    hold: float = parameter(
        1.0,
        'Longest time that a commanded wrench is taken to act after its stamp; the next one in its frame ends it.',
        unit='s',
        minimum=0.0,
        exclusive_minimum=True,
    )
    scale_std: float = parameter(
        0.0,
        'Relative standard deviation of how strong a thruster is, constant, estimated along (trajectory); 0 takes '
        'commands as exact.',
        minimum=0.0,
    )
    direction_std: float = parameter(
        0.0,
        'Standard deviation of how its direction is turned about each axis of its frame, constant; 0 is exact.',
        unit='rad',
        minimum=0.0,
    )
    frames: tuple[str, ...] = parameter(
        (),
        'Frames of the thrusters that these are about, each with its own; empty is the base link, if a scale or a '
        'direction is uncertain, or else none.',
    )


@dataclass(frozen=True)
class CaptureConfig:
    """The capture, where the data begin before it."""

    phase: str = parameter(
        'post_capture',
        'Phase to begin in: post_capture identifies from the first sample on; pre_capture checks the known model until '
        '~/capture is called.',
        choices=PHASES,
    )
    time: float = parameter(
        0.0,
        'Time of the capture after the first sample, where it is known beforehand; 0 leaves it to phase.',
        unit='s',
        minimum=0.0,
    )
    detect: bool = parameter(
        default=False,
        description='Take a jump of the momentum for the capture, once pre_capture has lasted some five seconds.',
    )
    margin: float = parameter(
        0.5,
        'Time before and after the capture in which bodies touch and slip: windows with a sample in it are not used.',
        unit='s',
        minimum=0.0,
    )


@dataclass(frozen=True)
class SelfCalibrationConfig(LinkPriorConfig):
    """What a run that begins before the capture learns of the robot's own bodies."""

    enabled: bool = parameter(
        default=False,
        description='At the capture, calibrate links, joints and the mount of the odometry from the latest 600 windows '
        'before it, as calibrate does, and go on with what that says of them and leaves uncertain. How well joints and '
        'mount are known before is what known_joints and odometry_mount say.',
    )
    weighed_links: tuple[str, ...] = parameter(
        (), 'Links whose mass is known better, in the order of calibration.weighed_stds: one fixes the scale.'
    )
    weighed_stds: tuple[float, ...] = parameter(
        (), 'Relative standard deviation of the mass of each link in calibration.weighed_links.', minimum=0.0
    )
