"""The function `identify`: arrays in, mass properties out, without ROS and without files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mbaid_ros import limits
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import read_robot_description
from mbaid_ros.core.geometry import Array, Flags, unvec
from mbaid_ros.core.gyro import IMU
from mbaid_ros.core.odometry.stream import QUATERNION_TOLERANCE
from mbaid_ros.core.repair import Repair
from mbaid_ros.core.results.estimate import Status
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import Stamps
from mbaid_ros.errors import MbaidError, ParameterError, listing
from mbaid_ros.estimate_messages import MessageTypes
from mbaid_ros.files import write_text
from mbaid_ros.parameters import build
from mbaid_ros.replay.json_output import as_json
from mbaid_ros.replay.provenance import made_by
from mbaid_ros.replay.run_of_session import Kept
from mbaid_ros.replay.text import summary
from mbaid_ros.replay.whole_run import Run, TopicStatistics
from mbaid_ros.sensor_messages import Imu, Joints, Poses, Readings, in_order
from mbaid_ros.session.explanation import intake_warnings
from mbaid_ros.session.session import Session

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# Messages of plain objects: the readers look at names of fields alone.
_TYPES = MessageTypes(lambda _: SimpleNamespace, lambda flags: flags)
_AT_ONCE = 4_000  # messages between two calls, which makes no difference to the numbers
_NAME = 'arrays'  # of the data, where a bag has its path
_LATEST = 4e9  # s: stamps of ROS have 32 bits


class History(NamedTuple):
    """K estimates in order, of each window at first and of each relinearisation; NaN where not determined."""

    time: Array
    """(K,) s since the first sample."""
    status: tuple[Status, ...]
    """Status of each."""
    parameters: Array
    """(K, 10) mass, centre of mass, inertia (xx, xy, xz, yy, yz, zz)."""
    std: Array
    """(K, 10) standard deviations."""


@dataclass(frozen=True)
class Identification:
    """The mass properties of the target link, with its load; `print` shows them as a table.

    SI units. The centre of mass is in the target link's frame; the inertia is about the centre of mass, in the axes of
    the link. Ten numbers are in the order mass, com (x, y, z), inertia (xx, xy, xz, yy, yz, zz). NaN: not determined.
    """

    run: Run  # as `replay` has it

    @property
    def status(self) -> Status:
        """Status of the estimate, one of converged, estimating, not_identifiable, inconsistent and waiting."""
        return self.run.final.status

    @property
    def target_link(self) -> str:
        """Name of the identified link."""
        return self.run.target_link

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return float(self.run.final.parameters[0])

    @property
    def com(self) -> Array:
        """Centre of mass (3,), m."""
        return self.run.final.parameters[1:4].copy()

    @property
    def inertia(self) -> Array:
        """Inertia (3, 3), kg m^2; off the diagonal are the elements of the matrix, as in a URDF."""
        return unvec(self.run.final.parameters[4:])

    @property
    def std(self) -> Array:
        """Standard deviations (10,)."""
        return self.run.final.std.copy()

    @property
    def covariance(self) -> Array:
        """Covariance (10, 10)."""
        return self.run.final.covariance.copy()

    @property
    def identifiable(self) -> Flags:
        """Which of the ten the data determine, (10,)."""
        return self.run.final.identifiable.copy()

    @property
    def momentum(self) -> Array:
        """Linear momentum (N s) and angular momentum about the origin (N m s) of the whole system, (6,)."""
        return self.run.final.momentum.copy()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on the data and the result, a line each."""
        return tuple(self.run.all_warnings)

    @property
    def causes(self) -> tuple[tuple[str, float], ...]:
        """Likely causes of a contradiction with the gain in log-likelihood of each, the likeliest first."""
        return tuple(self.run.final.likely_causes)

    @property
    def repairs(self) -> tuple[Repair, ...]:
        """Causes that the result takes into account, where the parameter `repair` is true."""
        return tuple(self.run.final.repairs)

    @property
    def history(self) -> History:
        """The estimates as they converged."""
        every = self.run.history
        return History(
            np.array([each.time for each in every]),
            tuple(each.status for each in every),
            np.array([each.parameters for each in every]).reshape(-1, 10),
            np.array([each.std for each in every]).reshape(-1, 10),
        )

    def __str__(self) -> str:
        """Return the result as a table for a terminal."""
        return summary(self.run)

    def report(self, path: str | Path) -> None:
        """Write the HTML report of `replay`.

        Raises OSError: The file cannot be written.
        Raises ModuleNotFoundError: Matplotlib, which draws the curves, is not installed.
        """
        from mbaid_ros.replay.report.page import html  # noqa: PLC0415 - only a report needs matplotlib

        write_text(str(path), html([self.run]))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the JSON file of `replay`: plain numbers, None where not determined."""
        return as_json(self.run)

    def to_urdf(self) -> str:
        """Return the robot description with the identified link.

        Raises ValueError: The data contradict the model, determine fewer than ten numbers, or no body has these.
        """
        from mbaid_ros.replay.export import identified_urdf  # noqa: PLC0415 - takes a while

        try:
            return identified_urdf(self.run)
        except MbaidError as error:
            raise ValueError(f'to_urdf: {error}') from error


def identify(  # noqa: PLR0913 - one argument for each measured quantity
    urdf: str | Path,
    joint_time: ArrayLike,
    joint_position: ArrayLike,
    base_time: ArrayLike,
    base_position: ArrayLike,
    base_orientation: ArrayLike,
    *,
    joint_names: Sequence[str] | None = None,
    joint_velocity: ArrayLike | None = None,
    base_twist: ArrayLike | None = None,
    gyro: tuple[ArrayLike, ArrayLike] | None = None,
    target_link: str = '',
    parameters: Mapping[str, object] | None = None,
) -> Identification:
    """Return the mass properties of a link and its load, from recorded joints and base poses.

    The numbers are those of `replay`, to the bit. Joints and base may have different rates and need no common stamps.

    Parameters
    ----------
    urdf : robot description: its text, or the path of its file
    joint_time : (N,) s, increasing, or of type datetime64[ns]: floats of seconds since 1970 have steps of 0.2 us
    joint_position : (N, n) rad, m for a prismatic joint
    base_time : (M,) s, as `joint_time`
    base_position : (M, 3) m of the base link in an inertial frame, or of the marker that the parameters declare; NaN or
        zeros in a row: not measured
    base_orientation : (M, 4) unit quaternions x, y, z, w, of the same
    joint_names : names of the n columns; default: the moving joints of the robot, in the order of the URDF
    joint_velocity : (N, n) rad/s (m/s)
    base_twist : (M, 6) linear and angular velocity in the axes of the base, m/s and rad/s
    gyro : times (K,) s and angular velocities (K, 3) rad/s in the axes of the base link, or of `imu.frame`;
        `parameters` must have `imu.noise_density`
    target_link : link to identify; default: the last one with an inertia, furthest from the base
    parameters : of the estimator, by dotted names, as in its parameter file

    Raises
    ------
    ValueError
        An argument cannot be used: one line with its name, its shape or value, and the accepted ones.

    Examples
    --------
    >>> from mbaid_ros import identify
    >>> result = identify('robot.urdf', t, q, t_base, position, quaternion)  # doctest: +SKIP
    >>> result.mass, result.com, result.inertia  # doctest: +SKIP
    """
    text = _robot_description(urdf)
    config = _config(parameters, target_link)
    session = _session(config, text, target_link)
    rates = None if gyro is None else _pair(session, gyro)
    times = _times(joint_time, base_time, rates)
    readings: list[Readings] = [
        _joints(session, joint_names, times['joint_time'], joint_position, joint_velocity),
        _poses(session, times['base_time'], base_position, base_orientation, base_twist),
    ]
    if rates is not None:
        readings.append(_gyro(session, times['gyro[0]'], rates[1]))
    run = _run(session, config, readings)
    path = str(urdf) if text != urdf else ''
    return Identification(replace(run, made_by=made_by('identify', (), path, text)))


def _run(session: Session, config: EstimatorConfig, readings: Sequence[Readings]) -> Run:
    """Return the result of readings, in the order of their times."""
    kept = Kept(session, config)
    add = {Joints.topic: session.add_joint_state, Poses.topic: session.add_odometry, Imu.topic: session.add_named}
    messages = in_order(readings, _TYPES, lambda _, time: round(time * 1e9))
    for begin in range(0, len(messages), _AT_ONCE):
        part = messages[begin : begin + _AT_ONCE]
        of = {topic: [message for _, name, message in part if name == topic] for topic in add}
        if not session.add_at_once(of[Joints.topic], of[Poses.topic], {IMU: of[Imu.topic]}):
            for _, topic, message in part:
                add[topic](message)
        kept.add(session.process())
    kept.add(session.finish())
    model = session.model_summary()
    topics = tuple(_statistics(each) for each in readings)
    return kept.run(_NAME, topics, model, (*model.warnings, *intake_warnings(session)))


def _statistics(readings: Readings) -> TopicStatistics:
    count, span = len(readings.time), float(readings.time[-1] - readings.time[0])
    return TopicStatistics(readings.topic, 'array', count, (count - 1) / span if span > 0.0 else float('nan'))


# -- Arguments


def _robot_description(urdf: object) -> str:
    if not isinstance(urdf, str | Path):
        raise ValueError(f'urdf is of type {type(urdf).__name__}; accepted: the text of a URDF, or a path')
    if isinstance(urdf, str) and '<' in urdf:
        return urdf
    try:
        return read_robot_description(urdf)
    except MbaidError as error:
        raise ValueError(f'urdf: {error}') from error


def _config(parameters: object, target_link: object) -> EstimatorConfig:
    if parameters is not None and not isinstance(parameters, Mapping):
        raise ValueError(f'parameters is of type {type(parameters).__name__}; accepted: a dict of dotted names')
    if not isinstance(target_link, str):
        raise ValueError(f'target_link is of type {type(target_link).__name__}; accepted: the name of a link')
    values = dict(parameters or {})
    if target_link:
        values['target_link'] = target_link
    try:
        return build(EstimatorConfig, values)
    except ParameterError as error:
        raise ValueError(f'parameters: {error}') from error


def _session(config: EstimatorConfig, text: str, target_link: str) -> Session:
    """Return a session; an error names the argument that is wrong."""
    try:
        known = [link.name for link in load_model(text, config.base_link).links]
        if target_link and target_link not in known:
            raise ValueError(f"target_link is '{target_link}', no link of the robot; accepted: {listing(known)}")
        session = Session(config, text)
    except ParameterError as error:
        raise ValueError(f'parameters: {error}') from error
    except MbaidError as error:
        raise ValueError(f'urdf: {error}') from error
    further = [name for name in session.named if name != IMU]
    if further:
        raise ValueError(f'parameters has {listing(further)}, whose readings no argument holds; accepted: imu alone')
    return session


def _joints(session: Session, names: object, time: Array, position: ArrayLike, velocity: ArrayLike | None) -> Joints:
    """Return the readings of the joints: those of the robot that report, and wheels."""
    config, model = session.config, session.robot.model
    moving = [model.joint_names[place] for place in model.transmission.independent]
    wanted = [*(name for name in moving if name not in config.flexible.joints), *config.wheels.names]
    given = _names(names, wanted, [*model.joint_names, *config.wheels.names])
    columns = f'(N, {len(given)}) with N = {len(time)}, a column for each of {listing(given)}'
    shape = len(time), len(given)
    rates = None if velocity is None else _array('joint_velocity', velocity, shape, columns)
    return Joints(given, time, _array('joint_position', position, shape, columns), rates)


def _names(names: object, wanted: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the columns."""
    if names is None:
        return tuple(wanted)
    if isinstance(names, str) or not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise ValueError(f'joint_names is of type {type(names).__name__}; accepted: a list of names, {listing(known)}')
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f'joint_names has {listing(unknown)}, no joint of the robot; accepted: {listing(known)}')
    missing = [name for name in wanted if name not in names]
    if missing:
        raise ValueError(f'joint_names lacks {listing(missing)}; accepted: every joint of {listing(wanted)}')
    if len(set(names)) < len(names):
        raise ValueError('joint_names has a name twice; accepted: each name once')
    return tuple(names)


def _poses(
    session: Session, time: Array, position: ArrayLike, orientation: ArrayLike, twist: ArrayLike | None
) -> Poses:
    count = len(time)
    turn = _array('base_orientation', orientation, (count, 4), f'(M, 4) with M = {count}: x, y, z, w')
    with np.errstate(over='ignore', invalid='ignore'):
        length = np.sqrt(np.sum(turn**2, axis=1))
        wrong = (length > 0.0) & (np.abs(length - 1.0) > QUATERNION_TOLERANCE)  # zeros: a tracker lost the base
    if np.any(wrong):
        row = int(np.argmax(wrong))
        raise ValueError(
            f'base_orientation[{row}] has the length {length[row]:.3g}; accepted: unit quaternions x, y, z, w'
        )
    where = _array('base_position', position, (count, 3), f'(M, 3) with M = {count}')
    given = np.full((count, 6), np.nan) if twist is None else twist
    motion = _array('base_twist', given, (count, 6), f'(M, 6) with M = {count}: linear, then angular velocity')
    robot, prefix = session.robot, session.config.frame_prefix
    frame = '' if robot.marker is not None else prefix + robot.model.base_link
    return Poses(time, where, turn, motion, frame)


def _pair(session: Session, gyro: object) -> tuple[ArrayLike, ArrayLike]:
    if not isinstance(gyro, tuple | list) or len(gyro) != 2:
        raise ValueError(f'gyro is of type {type(gyro).__name__}; accepted: a pair of times (K,) and rates (K, 3)')
    if not session.config.imu.noise_density:
        raise ValueError("gyro is given without its noise; accepted: 'imu.noise_density' in parameters, rad/s/sqrt(Hz)")
    return gyro[0], gyro[1]


def _gyro(session: Session, time: Array, rate: ArrayLike) -> Imu:
    rates = _array('gyro[1]', rate, (len(time), 3), f'(K, 3) with K = {len(time)}')
    frame = session.config.frame_prefix + session.robot.model.base_link
    return Imu(time, rates, np.zeros((len(time), 0)), frame)


def _times(joints: ArrayLike, base: ArrayLike, gyro: tuple[ArrayLike, ArrayLike] | None) -> dict[str, Array]:
    """Return the times of all readings, s since the first of them, by the names of the arguments."""
    given = {'joint_time': joints, 'base_time': base} | ({} if gyro is None else {'gyro[0]': gyro[0]})
    stamps = {name: _stamps(name, value) for name, value in given.items()}
    spans = [f'{name} is from {each[0] * 1e-9:g} to {each[-1] * 1e-9:g} s' for name, each in stamps.items()]
    first, last = min(each[0] for each in stamps.values()), max(each[-1] for each in stamps.values())
    if max(each[0] for each in stamps.values()) >= min(each[-1] for each in stamps.values()):
        raise ValueError(f'{" and ".join(spans)}; accepted: times of one clock that overlap')
    if (last - first) * 1e-9 > limits.TIME:
        raise ValueError(f'{" and ".join(spans)}; accepted: at most {limits.TIME:g} s in all')
    return {name: (each - first) * 1e-9 for name, each in stamps.items()}


def _stamps(name: str, value: ArrayLike) -> Stamps:
    """Return times in ns, (N,)."""
    if isinstance(value, np.ndarray) and value.dtype.kind == 'M':
        stamps = value.astype('datetime64[ns]').astype(np.int64)
    else:
        time = _numbers(name, value)
        wrong = ~(np.abs(time) <= _LATEST)
        if np.any(wrong):
            raise ValueError(f'{name} has {time[wrong].flat[0]:g}; accepted: seconds, of a size up to {_LATEST:g}')
        stamps = np.rint(time * 1e9).astype(np.int64)
    if stamps.ndim != 1 or len(stamps) < 2:
        raise ValueError(f'{name} has the shape {stamps.shape}; accepted: (N,) with N >= 2, in s')
    back = np.flatnonzero(np.diff(stamps) <= 0)
    if len(back):
        raise ValueError(f'{name}[{back[0] + 1}] is not later than the one before; accepted: increasing times')
    return stamps


def _array(name: str, value: ArrayLike, shape: tuple[int, int], accepted: str) -> Array:
    array = _numbers(name, value)
    if array.shape != shape:
        raise ValueError(f'{name} has the shape {array.shape}; accepted: {accepted}')
    return array


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        raw = np.asarray(value)
    except ValueError as error:
        raise ValueError(f'{name} has rows of different lengths; accepted: an array of numbers') from error
    if raw.dtype.kind not in 'iuf':
        raise ValueError(f'{name} is of type {raw.dtype}; accepted: an array of real numbers')
    return np.ascontiguousarray(raw, dtype=float)
