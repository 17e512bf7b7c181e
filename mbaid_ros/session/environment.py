"""From parameters to the orbit, and to what stores momentum inside the robot and how well that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mbaid_ros.config.capture import ThrustConfig
from mbaid_ros.config.environment import (
    OrbitConfig,
    WheelsConfig,
    make_orbit,
    make_storage,
)
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import Storage
from mbaid_ros.core.sensors.external_momentum import FallingFrame
from mbaid_ros.core.unknowns.environment import Circle


def uncertain_circle(config: OrbitConfig) -> Circle | None:
    """Return the orbit where it may be no circle, None where it is known or there is none.

    Who says how eccentric it is, or when it was where, knows it.
    """
    orbit = make_orbit(config)
    if orbit is None or config.eccentricity > 0.0 or config.epoch > 0.0 or config.undeclared_eccentricity == 0.0:
        return None
    return Circle(orbit, config.undeclared_eccentricity, config.twist == 'relative')


def falling_frame(config: OrbitConfig, model: RobotModel) -> FallingFrame | None:
    """Return what takes the odometry to the frame that falls along, None where there is no orbit.

    Raises
    ------
    ParameterError
        The directions do not make an orbit.
    """
    orbit = make_orbit(config)
    if orbit is None:
        return None
    epoch = round(config.epoch * 1e9) if config.epoch > 0.0 else None
    return FallingFrame(orbit, model, relative_twist=config.twist == 'relative', epoch=epoch)


def uncertain_thrusters(config: ThrustConfig, model: RobotModel) -> tuple[str, ...]:
    """Return the frames of thrusters that may be off their commands.

    Raises
    ------
    ModelError, ParameterError
        A frame is no link, or named twice.
    """
    if config.scale_std == config.direction_std == 0.0 and not config.frames:
        return ()
    if len(set(config.frames)) < len(config.frames):
        raise ParameterError(
            f"parameter 'thrust.frames' is {listing(config.frames)}; accepted: links of the robot, each once"
        )
    return tuple(model.link(name).name for name in config.frames or (model.base_link,))


def suspecting(estimates: list[Estimate], others: Sequence[str]) -> list[Estimate]:
    """Return estimates, of which those that contradict the data say what JointState holds beside the joints.

    It comes second among the causes: nobody knows what turns there.
    """
    if not others:
        return estimates
    text = f'joint states hold {listing(others)}, no joints of the robot: if they are wheels, set wheels.names'

    def told(estimate: Estimate) -> Estimate:
        causes = estimate.causes
        gain = causes[0][1] if causes else 0.0
        return replace(estimate, causes=(*causes[:1], (text, gain), *causes[1:]))

    return [told(each) if each.contradicted else each for each in estimates]


def storage(config: WheelsConfig, model: RobotModel) -> Storage:
    """Return the wheels by name, then the momentum that is told.

    Raises
    ------
    ModelError, ParameterError
        Names, axes and spin inertias differ in number, an axis is zero, or a name is a joint's or no link's.
    """
    wheels = make_storage(config.names, config.axes, config.spin_inertias, model, config.speed_std)
    if not config.momentum_frame:
        return wheels
    return wheels + Storage.published(model.link(config.momentum_frame), config.momentum_std)


def spin_deviations(config: WheelsConfig) -> tuple[float, ...]:
    """Return the standard deviation of each spin inertia, kg m^2; what is told is no product of one."""
    wheels = (config.spin_inertia_relative_std * inertia for inertia in config.spin_inertias)
    return (*wheels, *((0.0,) * 3 if config.momentum_frame else ()))
