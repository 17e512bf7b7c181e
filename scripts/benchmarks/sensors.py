"""Runs with two kinds of sensors beside the encoders, and with the first one of them alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.data import CONFIG, LEVELS, START, simulator_config, target
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.config.parameter_files import read_robot_description
from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, rotation_from_quaternion
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.parameters import build, topic_of
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun

ROBOT, HAND = 'servicer7', 'link6'
_MOUNT, _DELAY = 2e-3, 5e-3  # m and rad, s: as the estimator takes them by default
_BIAS, _SCALE, _TURN = 5e-3, 3e-3, 1e-2  # rad/s, relative, rad
_LENGTHS, _DRIFT = 1e-3, 1e-6  # relative, rad/s: as the estimator takes them of poses by default
_AT_ONCE = 2000  # messages
_ALONE: Mapping[str, object] = {'poses.alone': True}
Values = Mapping[str, object]
Spoil = Callable[[str, float, Any], Any]  # of topic, time (s) and message, the message that arrives; None is none


class Drawn(NamedTuple):
    """A sensor whose errors are drawn: name of its parameters, and these, of the simulator and of the estimator."""

    name: str
    made: Values
    used: Values
    read: Callable[[Any, float], None] | None = None  # makes of a message and its time, s, what else is drawn of it


@dataclass(frozen=True)
class Ends:
    """Errors and standard deviations (10,), NaN where withheld, and the status."""

    error: Array
    std: Array
    status: str


def gyro(name: str, rate: float, density: float, *, rng: np.random.Generator, link: str = '') -> Drawn:
    """Return a gyro, whose errors are drawn, by the name of its parameters."""
    bias, scale, turn = (size * rng.standard_normal(3) for size in (_BIAS, _SCALE, _TURN))
    made = {'rate': rate, 'noise_density': density, 'link': link, 'delay': float(_DELAY * rng.standard_normal())}
    made |= {'bias': bias.tolist(), 'scale': scale.tolist(), 'turn': turn.tolist(), 'bias_walk': 2e-5}
    used = {'noise_density': density, 'bias_std': _BIAS, 'scale_std': _SCALE, 'orientation_std': _TURN, 'frame': link}
    return Drawn(name, made, used)


def pose(
    name: str,
    rate: float,
    noise: tuple[float, float],
    *,
    rng: np.random.Generator,
    measures: str = 'both',
    link: str = '',
) -> Drawn:
    """Return a sensor of poses, whose mount and delay are drawn; noise in m and rad."""
    place, turn = (_MOUNT * rng.standard_normal(3) for _ in range(2))
    made = {'rate': rate, 'measures': measures, 'link': link, 'delay': float(_DELAY * rng.standard_normal())}
    made |= {'position': place.tolist(), 'turn': turn.tolist()}
    made |= {'position_noise': noise[0], 'orientation_noise': noise[1]}
    used = {'measures': measures, 'frame': link or 'base_link', 'same_world': measures != 'orientation'}
    used |= {'position_std': noise[0], 'orientation_std': noise[1]}
    lengths, drift = 1.0 + _LENGTHS * float(rng.standard_normal()), _DRIFT * rng.standard_normal(3)

    def read(message: Any, time: float) -> None:
        position, turned = pose_in(message)
        turn = exp(time * drift)
        if position is not None:
            set_in(position, turn @ (lengths * numbers_in(position)))
        if turned is not None:
            rotation = rotation_from_quaternion(numbers_in(turned, 'xyzw')[None])
            set_in(turned, quaternion_from_rotation(turn @ rotation)[0], 'xyzw')

    return Drawn(f'poses.{name}', made, used, read)


def pose_in(message: Any) -> tuple[Any, Any]:
    """Return position and orientation in a message of any type, None where it has none."""
    found = getattr(message, 'pose', getattr(message, 'transform', message))
    found = getattr(found, 'pose', found)
    position = getattr(found, 'translation', getattr(found, 'position', None))
    turned = getattr(found, 'rotation', getattr(found, 'orientation', getattr(found, 'quaternion', None)))
    return position, turned


def numbers_in(part: Any, names: str = 'xyz') -> Array:
    """Return the fields of a part of a message."""
    return np.array([getattr(part, name) for name in names])


def set_in(part: Any, values: Array, names: str = 'xyz') -> None:
    """Set the fields of a part of a message."""
    for name, value in zip(names, values.tolist(), strict=True):
        setattr(part, name, value)


@dataclass(frozen=True)
class Pair:
    """The first kind of sensor, and a second one beside it."""

    name: str
    first: tuple[Callable[..., Drawn], ...] = field(hash=False, compare=False)
    second: tuple[Callable[..., Drawn], ...] = field(hash=False, compare=False)
    odometry: bool = False  # whether poses of odom locate the base, at 10 Hz and without a twist
    # of the estimator, with the first kind alone, and with both
    alone: Values = field(default_factory=dict, hash=False, compare=False)
    both: Values = field(default_factory=dict, hash=False, compare=False)


_IMU = partial(gyro, 'imu', 100.0, 1e-4)
_TRACKER = partial(pose, 'tracker', 2.0, (1.0, 2e-5), measures='orientation')
_OF_HAND = partial(gyro, 'gyros.hand', 100.0, 1e-4, link=HAND)
PAIRS = (
    Pair(
        'gyro on the base, and on the hand',
        (_IMU,),
        (partial(gyro, 'gyros.hand', 100.0, 1e-4, link=HAND),),
        odometry=True,
    ),
    Pair('gyro 100 Hz, and star tracker 2 Hz', (_IMU,), (_TRACKER,), alone={'imu.alone': True}, both=_ALONE),
    Pair(
        'star tracker 2 Hz with gyro, and camera 5 Hz for positions',
        (_IMU, _TRACKER),
        (partial(pose, 'camera', 5.0, (1e-3, 1.0), measures='position'),),
        alone=_ALONE,
        both=_ALONE,
    ),
    Pair(
        'motion capture of the base, and of the hand',
        (partial(pose, 'body', 100.0, (3e-4, 3e-4)),),
        (partial(pose, 'hand', 100.0, (3e-4, 3e-4), link=HAND),),
        alone=_ALONE,
        both=_ALONE,
    ),
)


def drawn(pair: Pair, seed: int, *, both: bool) -> list[Drawn]:
    """Return the sensors of a run; the errors of the first kind are the same with both."""
    rng = np.random.default_rng([seed, 66])
    return [sensor(rng=rng) for sensor in (*pair.first, *(pair.second if both else ()))]


def estimates(
    pair: Pair,
    seed: int,
    *,
    both: bool,
    seconds: float,
    spoil: Spoil | None = None,
    simulated: Values | None = None,
    declared: Values | None = None,
) -> tuple[Session, list[Estimate]]:
    """Return the session and the estimates of a run; the errors of the first kind are the same in both."""
    sensors = drawn(pair, seed, both=both)
    level = LEVELS['mid']
    noise = {f'noise.{name}': value for name, value in vars(level).items() if value}
    made: dict[str, object] = {**noise, 'seed': seed, 'odometry_rate': 10.0, 'pose_only': True}
    used: dict[str, object] = {**EXACT, **noise, **(pair.both if both else pair.alone), 'maximum_gap': 0.25}
    for sensor in sensors:
        made |= {f'{sensor.name}.{key}': value for key, value in sensor.made.items()}
        used |= {f'{sensor.name}.{key}': value for key, value in sensor.used.items()}
    for group in ('gyros', 'poses'):
        names = [each.name.partition('.')[2] for each in sensors if each.name.startswith(f'{group}.')]
        made, used = made | {f'{group}.names': names}, used | {f'{group}.names': names}
    made, used = {**made, **(simulated or {})}, used | dict(declared or {})
    topics = {topic_of(each.name): each.name for each in sensors}
    errors = {topic_of(each.name): each.read for each in sensors}
    text = read_robot_description(CONFIG / f'{ROBOT}.urdf')
    session = Session(build(EstimatorConfig, used), text)
    run = SimulatedRun(simulator_config(ROBOT, made), text, BAG_TYPES)
    run.start = START
    found: list[Estimate] = []
    for count, said in enumerate(run.read(seconds), start=1):
        message = said.message
        if (read := errors.get(said.topic)) is not None:
            read(message, said.time)
        message = message if spoil is None else spoil(said.topic, said.time, message)
        if message is None or (said.topic == 'pose' and not pair.odometry):
            continue
        if said.topic in topics:
            session.add_named(message, topics[said.topic])
        else:
            (session.add_joint_state if said.topic == 'joint_states' else session.add_odometry)(message)
        if count % _AT_ONCE == 0:
            found += session.process()
    return session, [*found, *session.process(), *session.finish()]


def run(row: tuple[Pair, bool, float], seed: int) -> Ends:
    """Return the end of a run of a pair, with both kinds or the first alone, after so many seconds."""
    pair, both, seconds = row
    last = estimates(pair, seed, both=both, seconds=seconds)[1][-1]
    given = last.identifiable & (last.status in {'estimating', 'converged'})
    error = np.where(given, last.parameters - target(ROBOT), np.nan)
    return Ends(error, np.where(given, last.std, np.nan), last.status)
