"""The parameters of the estimator about the capture, the bodies before and after it, and disturbances."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.config.parameters import parameter

CONSTANT_FORCES = ('none', 'inertial', 'body')
PHASES = ('post_capture', 'pre_capture')


@dataclass(frozen=True)
class DebrisConfig:
    """The captured body alone."""

    report: bool = parameter(default=False)
    """Also report the captured body alone: the estimate minus the target link's <inertial>, which known_links.<link>
    then declares, as in calibrate."""


@dataclass(frozen=True)
class DisturbanceConfig:
    """External forces and torques."""

    constant: str = parameter('none', choices=CONSTANT_FORCES)
    """Constant external force and torque that trajectory estimates: body (axes of the base link), inertial (on the base
    or at the common centre of mass, as the data show), or none (only if the data show one)."""
    torque_std: float = parameter(0.0, 'N m', minimum=0.0)
    """Standard deviation of an external torque about each axis of the base, different in every motion, as from air on a
    thrown body; 0: none."""
    torque_time: float = parameter(0.0, 's', minimum=0.0)
    """Time constant of the external torque within a motion, a Gauss-Markov process: drag and venting vary in minutes;
    0: constant."""
    force_std: float = parameter(0.0, 'N', minimum=0.0)
    """Standard deviation of an external force along each axis of the base, through the common centre of mass, different
    in every motion; 0: none."""
    force_time: float = parameter(0.0, 's', minimum=0.0)
    """Time constant of the external force within a motion; 0: constant."""


@dataclass(frozen=True)
class ThrustConfig:
    """The commanded thrust on the topic thrust."""

    scale_std: float = parameter(0.0, minimum=0.0)
    """Relative standard deviation of the strength of a thruster, constant, estimated by trajectory; 0: commands are
    exact."""
    direction_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of a thruster's constant misalignment about each axis of its frame; 0: exact."""
    delay_std: float = parameter(0.02, 's', minimum=0.0, maximum=1.0)
    """Standard deviation of a thruster's constant delay after the stamps of its commands; 0: in time."""
    frames: tuple[str, ...] = parameter(())
    """Frames of the thrusters that have such errors, each its own; empty: the base link if a scale or a direction is
    uncertain, otherwise none."""


@dataclass(frozen=True)
class CaptureConfig:
    """The capture, in data that begin before it."""

    phase: str = parameter('post_capture', choices=PHASES)
    """First phase: post_capture identifies from the first sample on; pre_capture checks the known model until ~/capture
    is called."""
    time: float = parameter(0.0, 's', minimum=0.0)
    """Time of the capture after the first sample, if known beforehand; 0: phase decides."""
    detect: bool = parameter(default=False)
    """Interpret a jump of the momentum as the capture, once pre_capture has lasted five seconds."""
