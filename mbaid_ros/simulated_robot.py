"""The parts of a simulated run by its parameters: joints, initial state, thrust, and the captured body."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from mbaid_ros.config.motion_files import read_trajectory
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.orbit import make_orbit
from mbaid_ros.core.robot.body import is_physical, standard
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.wheels import make_storage
from mbaid_ros.errors import DataError, ParameterError, listing
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.changes import CaptureSimulation, Pulse, Target, ThrustSimulation
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Environment, Springs, Wheels
from mbaid_ros.simulation.motion import (
    Driven,
    Motion,
    Passive,
    random_sinusoids,
    sinusoids,
    with_mimic_joints,
    with_resting_joints,
    within_limits,
)
from mbaid_ros.simulation.sensors import Imu, ImuErrors, PoseErrors, PoseTracker
from mbaid_ros.simulation.simulation import (
    PiecewiseSimulation,
    Simulation,
    Truth,
    seen_from_orbit,
    without_linear_momentum,
)
from mbaid_ros.simulation.steered import SteeredMotion, TrajectoryMotion, motion_along
from mbaid_ros.simulation.true_robot import ErrorStds, ModelErrors, draw, generator
from mbaid_ros.simulation.tumbling import FreeMotion, GraspedMotion, TargetCamera, TrackedMotion, Tracking

_QUATERNION_TOLERANCE = 1e-3
_NOT_OF_LINKS = ('seed', 'frequency_relative_std')  # of the model errors
_FREQUENCIES = 2_000_003  # beside the seed of the model errors: a stream of its own


def make_motion(config: SimulatorConfig, model: RobotModel) -> Motion:
    """Return the motion of the joints that the parameters ask for.

    Raises ParameterError: The parameters do not fit the robot.
    """
    motion, moved, driven = config.motion, model.transmission, driven_joints(config, model)
    start = _joint_values('initial.joint_positions', config.initial.joint_positions, model, driven)
    if motion.kind == 'passive' and moved.direct:
        return Passive()
    if motion.kind == 'sinusoids':
        given = (np.array(values) for values in (motion.amplitudes, motion.frequencies, motion.phases))
        return with_mimic_joints(with_resting_joints(driven, sinusoids(start[driven], *given), start), moved)
    if motion.kind == 'trajectory':
        return _followed_file(config, model)
    shape = (motion.seed, motion.terms, motion.amplitude, motion.period_min, motion.period_max)
    drawn = with_resting_joints(driven, random_sinusoids(start[driven], *shape), start)
    if motion.within_limits:
        drawn = within_limits(drawn, model, start_given=bool(config.initial.joint_positions))
    return with_mimic_joints(drawn, moved)


def _followed_file(config: SimulatorConfig, model: RobotModel) -> TrajectoryMotion:
    """Return the motion along the trajectory of a file."""
    motion, given = config.motion, config.initial.joint_positions
    if not motion.trajectory_file:
        raise ParameterError(
            "parameter 'motion.trajectory_file' is empty; accepted: a file, as motion.kind asks for one"
        )
    trajectory = read_trajectory(motion.trajectory_file)
    driven = driven_joints(config, model)
    named = 'initial.joint_positions', given
    start = model.transmission.positions(_joint_values(*named, model, driven)) if given else None
    try:
        return motion_along(trajectory, model, start, motion.trajectory_begin)
    except DataError as error:
        raise ParameterError(f"'{motion.trajectory_file}': {error}") from error


def make_pulse(config: SimulatorConfig, model: RobotModel) -> Pulse | None:
    """Return the pulse of thrust, None where there is none.

    Raises ModelError: It acts on a link that the robot does not have.
    Raises ParameterError: There is a capture, too.
    """
    thrust = config.thrust
    if thrust.duration == 0.0:
        return None
    if config.capture.time > 0.0:
        raise ParameterError(
            f"parameter 'thrust.duration' is {thrust.duration:g} s with capture.time {config.capture.time:g} s; "
            'accepted: one of them, the other 0'
        )
    link = None if thrust.link == config.odom_frame else model.link(thrust.link or model.base_link)
    wrench = np.array([*thrust.force, *thrust.torque])
    end = thrust.time + thrust.duration
    return Pulse(thrust.time, end, link, wrench, thrust.scale, np.array(thrust.turn), thrust.delay)


def make_target(config: SimulatorConfig, link: Link, motion: Motion) -> Target | None:
    """Return the captured body, None if there is none.

    Raises ParameterError: The parameters do not make a body, or the joints are not driven.
    """
    capture = config.capture
    if capture.time == 0.0:
        return None
    if isinstance(motion, Passive):
        raise ParameterError(
            f"parameter 'capture.time' is {capture.time:g} s with motion.kind '{config.motion.kind}'; accepted: 0, or "
            'joints that are driven: sinusoids, random, trajectory'
        )
    body = np.array([capture.mass, *capture.com, *(capture.inertia or (0.0,) * 6)])
    if not capture.mass > 0.0 or not is_physical(standard(body)):
        raise ParameterError(
            f"parameters 'capture.mass' {capture.mass:g} kg and 'capture.inertia' {list(capture.inertia)} kg m^2 make "
            'no body; accepted: a mass > 0 and principal moments > 0, none larger than the sum of the other two'
        )
    velocities = np.array(capture.linear_velocity), np.array(capture.angular_velocity)
    return Target(capture.time, link.name, body, *velocities, capture.settling)


def make_initial_state(config: SimulatorConfig, model: RobotModel, motion: Motion) -> State:
    """Return the state at time 0.

    Raises ParameterError: The parameters do not fit the robot, the motion, or each other.
    """
    initial = config.initial
    driven = driven_joints(config, model)
    rates = _joint_values('initial.joint_velocities', initial.joint_velocities, model, driven)
    if isinstance(motion, Driven):
        if rates.any():
            raise ParameterError(
                f"parameter 'initial.joint_velocities' is {list(initial.joint_velocities)}; with motion.kind "
                f"'{config.motion.kind}' the motion gives the velocities: empty is accepted"
            )
        rates = motion.reference(0.0)[1].copy()
    orientation = np.array(initial.base_orientation)
    length = float(np.linalg.norm(orientation))
    if abs(length - 1.0) > _QUATERNION_TOLERANCE:
        raise ParameterError(
            f"parameter 'initial.base_orientation' has length {length:g}; accepted: a quaternion x, y, z, w of length 1"
        )
    orientation /= length
    back = quaternions.conjugate(orientation)
    twist = (initial.base_linear_velocity, initial.base_angular_velocity)
    linear, angular = (quaternions.rotate(back, np.array(values)) for values in twist)
    given = _joint_values('initial.joint_positions', initial.joint_positions, model, driven)
    positions = motion.reference(0.0)[0] if isinstance(motion, Driven) else given
    swinging = [model.joint_names.index(name) for name in config.flexible.passive(model.joint_names)]
    if swinging and isinstance(motion, Driven):  # nothing drives them: they start where they are asked to, at rest
        positions = positions.copy()
        positions[swinging], rates[swinging] = model.transmission.positions(given)[swinging], 0.0
    state = State(np.array(initial.base_position), orientation, positions, np.concatenate((linear, angular, rates)))
    if not initial.zero_linear_momentum:
        return state
    if linear.any():
        raise ParameterError(
            f"parameter 'initial.base_linear_velocity' is {list(initial.base_linear_velocity)} m/s; with "
            'initial.zero_linear_momentum it follows from the other velocities: zero is accepted'
        )
    return without_linear_momentum(model, state)


def driven_joints(config: SimulatorConfig, model: RobotModel) -> Flags:
    """Return which of the k independent joints are not passive, (k,)."""
    passive = config.flexible.passive(model.joint_names)
    return np.array([name not in passive for name in model.independent_joints], dtype=bool)


def _joint_values(name: str, values: tuple[float, ...], model: RobotModel, driven: Flags) -> Array:
    """Return values of the k independent joints, from those of all, of the driven ones, or of none."""
    names = model.independent_joints
    if values and len(values) == np.count_nonzero(driven):
        every = np.zeros(len(names))
        every[driven] = values
        return every
    if values and len(values) != len(names):
        raise ParameterError(
            f"parameter '{name}' has {len(values)} numbers; accepted: none or {len(names)}, for {listing(names)}"
        )
    return np.array(values or (0.0,) * len(names))


def make_model_errors(config: SimulatorConfig, model: RobotModel) -> ModelErrors:
    """Return the deviations of the moving robot from its URDF, drawn by the parameters.

    Raises ModelError: There is no body near one of the URDF's.
    """
    sizes = {name: size for name, size in vars(config.model_errors).items() if name not in _NOT_OF_LINKS}
    rng = generator(config.model_errors.seed)
    return draw(model, config.target_link or model.last_link, ErrorStds(**sizes), rng)


def steerable(motion: Motion) -> Motion:
    """Return a motion to which trajectories can be added, where the joints are driven."""
    return SteeredMotion(motion) if isinstance(motion, Driven) else motion


def make_simulation(
    config: SimulatorConfig, model: RobotModel, motion: Motion | None = None
) -> Simulation | PiecewiseSimulation:
    """Return a robot in motion, as the parameters ask for, without sensors; `model` is the robot that moves.

    Raises ModelError: The robot cannot be simulated, or lacks a link that the parameters name.
    Raises ParameterError: The parameters do not fit the robot, or each other.

    Parameters
    ----------
    motion : of its joints; None for the one that the parameters ask for
    """
    motion = make_motion(config, model) if motion is None else motion
    start = make_initial_state(config, model, motion)
    target = make_target(config, model.link(config.target_link or model.last_link), motion)
    pulse = make_pulse(config, model)
    around = Environment(make_wheels(config, model), make_orbit(config.orbit), make_springs(config, model))
    if pulse is not None:
        return ThrustSimulation(model, motion, start, pulse, around)
    if target is not None and isinstance(motion, Driven):
        return CaptureSimulation(model, motion, start, target, around)
    return Simulation(model, motion, start, environment=around)


def make_target_camera(
    config: SimulatorConfig, model: RobotModel, simulation: Simulation | PiecewiseSimulation
) -> TargetCamera | None:
    """Return what tracks the target before its capture, and maybe after it; None without one.

    Raises ParameterError: Nothing is captured.
    """
    tracked = config.target_pose
    if tracked.rate == 0.0:
        return None
    if not isinstance(simulation, CaptureSimulation):
        raise ParameterError(
            f"parameter 'target_pose.rate' is {tracked.rate:g} Hz with capture.time {config.capture.time:g} s; "
            'accepted: a capture'
        )
    orbit = make_orbit(config.orbit)
    free, time = FreeMotion(simulation.target, *simulation.link_pose, orbit), simulation.target.time
    until, grasped = time + tracked.after, None
    if tracked.after > 0.0:  # by a run of its own, which is asked for other instants
        again = make_simulation(config, model)
        assert isinstance(again, CaptureSimulation), 'as the first'
        grasped = GraspedMotion(again, model)
    motion = TrackedMotion(free, grasped, orbit if orbit is not None and orbit.is_rotating else None)
    noise = tracked.position_noise, tracked.orientation_noise
    tracking = Tracking(np.array(tracked.position), tracked.rate, *noise, tracked.missing)
    return TargetCamera(motion, time, tracking, config.seed, until)


def make_springs(config: SimulatorConfig, model: RobotModel) -> Springs | None:
    """Return the springs of passive joints, None where there are none.

    Raises ParameterError: A name is no joint's, or a joint has no frequency.
    """
    passive = config.flexible.passive(model.joint_names)
    if not passive:
        return None
    joints, errors = passive.values(), config.model_errors
    away = errors.frequency_relative_std * generator(errors.seed + _FREQUENCIES).standard_normal(len(passive))
    frequencies = np.exp(away) * [joint.frequency for joint in joints]
    return Springs.from_frequencies(model, list(passive), frequencies.tolist(), [joint.damping for joint in joints])


def make_view(config: SimulatorConfig) -> Callable[[Truth], Truth] | None:
    """Return the view of a motion from the frame of the odometry; None for one that falls along.

    Raises ParameterError: The directions do not make an orbit.
    """
    orbit = make_orbit(config.orbit)
    if orbit is None or not orbit.is_rotating:
        return None
    return partial(seen_from_orbit, orbit, relative_twist=config.orbit.twist == 'relative')


def make_further(config: SimulatorConfig, robot: RobotModel) -> dict[str, Imu | PoseTracker]:
    """Return gyros and sensors of poses by their topics; their noise is none of the other sensors'.

    Raises ModelError: There is no such link.
    Raises ParameterError: A name cannot be that of a sensor.
    """
    found: dict[str, Imu | PoseTracker] = {}
    for name, own in config.further_gyros.items():
        errors = ImuErrors(own.noise_density, own.bias, own.bias_walk, own.scale, own.orientation_noise, own.turn)
        seed = config.seed + 1_000_003 if name == 'imu' else (config.seed, *name.encode())
        found[name] = Imu(own.rate, errors, seed, *((robot, robot.link(own.link)) if own.link else ()))
    for name, each in config.further_poses.items():
        noise = each.position_noise, each.orientation_noise, each.correlation_time
        located = PoseErrors(each.measures, each.position, each.turn, *noise, each.world_turn, each.world_position)
        link, view = robot.link(each.link or robot.base_link), make_view(config)
        found[name] = PoseTracker(each.rate, located, (config.seed, *name.encode()), robot, link, view)
    return found


def make_wheels(config: SimulatorConfig, model: RobotModel) -> Wheels | None:
    """Return the wheels inside the base, None where there are none.

    Raises ParameterError: Their numbers do not fit each other or the robot.
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
    return Wheels(wheels.names, stored.axes, stored.inertias, *speeds)
