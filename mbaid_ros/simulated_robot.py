"""The robot of a simulated run, as its parameters ask for: how it differs from its URDF, what it carries and senses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.config.surroundings import make_orbit, make_storage
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.simulation.capture import CaptureSimulation
from mbaid_ros.core.simulation.drawn import ErrorSizes, draw, generator
from mbaid_ros.core.simulation.imu import Imu, ImuErrors
from mbaid_ros.core.simulation.motion import Motion
from mbaid_ros.core.simulation.orbital_view import seen_from_orbit
from mbaid_ros.core.simulation.run import Simulation, Truth
from mbaid_ros.core.simulation.steered import Steered
from mbaid_ros.core.simulation.surroundings import Surroundings
from mbaid_ros.core.simulation.thrust import ThrustSimulation
from mbaid_ros.core.simulation.wheels import Wheels
from mbaid_ros.simulated_setup import is_driven, make_initial_state, make_motion, make_pulse, make_target


def make_model_errors(config: SimulatorConfig, model: RobotModel) -> ModelErrors:
    """Return what the robot that moves has more than its URDF says, drawn as the parameters ask for.

    Raises
    ------
    ModelError
        There is no body near one of the URDF's.
    """
    sizes = {name: size for name, size in vars(config.model_errors).items() if name != 'seed'}
    rng = generator(config.model_errors.seed)
    return draw(model, config.target_link or model.last_link, ErrorSizes(**sizes), rng)


def steered(motion: Motion) -> Motion:
    """Return a motion that takes trajectories on the way, where the joints are driven at all."""
    return Steered(motion) if is_driven(motion) else motion


def make_simulation(
    config: SimulatorConfig, model: RobotModel, motion: Motion | None = None
) -> Simulation | CaptureSimulation | ThrustSimulation:
    """Return a robot in motion, as the parameters ask for, without sensors; `model` is the robot that moves.

    Parameters
    ----------
    config : SimulatorConfig
    model : RobotModel
    motion : of its joints; None for the one that the parameters ask for

    Raises
    ------
    ModelError
        The robot cannot be simulated, or lacks a link that the parameters name.
    ParameterError
        The parameters do not fit the robot, or each other.
    """
    motion = make_motion(config, model) if motion is None else motion
    start = make_initial_state(config, model, motion)
    target = make_target(config, model.link(config.target_link or model.last_link), motion)
    pulse = make_pulse(config, model)
    around = Surroundings(make_wheels(config, model), make_orbit(config.orbit))
    if pulse is not None:
        return ThrustSimulation(model, motion, start, config.step, pulse, around)
    if target is not None and is_driven(motion):
        return CaptureSimulation(model, motion, start, config.step, target, around)
    return Simulation(model, motion, start, config.step, surroundings=around)


def make_view(config: SimulatorConfig) -> Callable[[Truth], Truth] | None:
    """Return what the frame of the odometry makes of a motion; None for one that falls along.

    Raises
    ------
    ParameterError
        The directions do not make an orbit.
    """
    orbit = make_orbit(config.orbit)
    if orbit is None or not orbit.turning:
        return None
    return partial(seen_from_orbit, orbit, relative_twist=config.orbit.twist == 'relative')


def make_imu(config: SimulatorConfig, robot: RobotModel) -> Imu | None:
    """Return the IMU on a link, None where there is none.

    Raises
    ------
    ModelError
        There is no such link.
    """
    own = config.imu
    if own.rate == 0.0:
        return None
    errors = ImuErrors(own.noise_density, own.bias, own.bias_walk, own.scale, own.orientation_noise)
    # Its noise is none of the other sensors'.
    return Imu(own.rate, errors, config.seed + 1_000_003, *((robot, robot.link(own.link)) if own.link else ()))


def make_wheels(config: SimulatorConfig, model: RobotModel) -> Wheels | None:
    """Return the wheels inside the base, None where there are none.

    Raises
    ------
    ParameterError
        Their numbers do not fit each other or the robot.
    """
    wheels = config.wheels
    count = len(wheels.names)
    stored = make_storage(wheels.names, wheels.axes, wheels.spin_inertias, model)
    for name in ('speeds', 'accelerations'):
        given = len(getattr(wheels, name))
        if given not in {0, count}:
            raise ParameterError(
                f"parameter 'wheels.{name}' has {given} numbers; accepted: none or {count}, for 'wheels.names'"
            )
    if not count:
        return None
    speeds = np.array(wheels.speeds or (0.0,) * count), np.array(wheels.accelerations or (0.0,) * count)
    return Wheels.drawn(wheels.names, stored.axes, stored.inertias, speeds, (wheels.wander, wheels.seed))
