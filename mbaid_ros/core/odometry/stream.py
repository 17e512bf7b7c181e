"""Odometry, poses and transforms as one stream of base poses: covariances, attached frames, interpolation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array, Flags, cross, exp, log, rotate, rotate_back, rotation_from_quaternion, skew
from mbaid_ros.core.outliers import Channels
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import (
    BAD_QUATERNION,
    LOST_TRACKING,
    NOT_FINITE,
    NOT_REAL,
    ODOMETRY_TYPE,
    POSE_COVARIANCE,
    TWIST_COVARIANCE,
    WRONG_CHILD_FRAME,
    BasePose,
    BaseStream,
    Cursor,
    ImuStream,
    JointStream,
    PacketLayout,
    Packets,
    Samples,
    SensorNoise,
    Source,
    Stamps,
    block_std,
    number_of,
    stamp_of,
    stamps_of,
)

# Variances that a sensor may report, SI units: none is as small or large, and products keep their digits.
_SMALLEST, _LARGEST = 1e-24, 1e12
POSE = (
    Channels(
        lambda base: base.position[:, None],
        1.0,
        lambda base: block_std(base.pose_covariance)[:, :1],
        lambda base: (base.position - base.position[0])[:, None],
    ),
    # A turn's length is that of the change of the matrix over the square root of two.
    Channels(
        lambda base: base.rotation.reshape(-1, 1, 9),
        np.sqrt(2.0),
        lambda base: block_std(base.pose_covariance)[:, 1:],
        lambda base: log(base.rotation[0].T @ base.rotation)[:, None],
    ),
)
_POSE, _TWIST = slice(0, 7), slice(43, 49)  # in the numbers of an Odometry: pose, covariance, twist, covariance
_POSE_COVARIANCE, _TWIST_COVARIANCE = slice(7, 43), slice(49, 85)
_NUMBERS = 85  # of an Odometry: pose 7 and twist 6, with a covariance of 36 each
_NO_TWIST = (np.nan,) * 6  # of poses alone
_NOT_SET = np.zeros(36)
_ORIGIN = SimpleNamespace(x=0.0, y=0.0, z=0.0)  # of an orientation alone
_LARGEST_POSITION = 1e12  # m: beyond the planets
_LARGEST_VELOCITY = 1e6  # m/s, rad/s
QUATERNION_TOLERANCE = 0.1  # of the length of a quaternion from 1: rounding is far below, a wrong field far above
_REMEMBERED = 5  # frames
_FIELDS = {'position of the base': slice(0, 3), 'orientation of the base': slice(3, 7)}  # columns of an Odometry
_Columns = tuple[Stamps, Array, Array, Array]
OTHER_SOURCE = 'the pose of the base comes from another source'


def hermite(
    joints: JointStream, base: BaseStream, ends: tuple[Stamps, Stamps], maximum_gap: int, time: Array, weight: Array
) -> Samples:
    """Interpolate pose by cubics with the velocities at both ends, and velocities linearly.

    The derivative of the pose's cubic would be smoother, but turns position noise into velocity noise. Without a
    velocity the pose follows a parabola through the one before: a straight line has a systematic error.
    """
    left, right = ends
    length = (base.stamp[right] - base.stamp[left]) * 1e-9
    fraction = (joints.stamp - base.stamp[left]) * 1e-9 / np.where(length > 0.0, length, 1.0)
    s, h = fraction[:, None], length[:, None]
    to_end = s * s * (3.0 - 2.0 * s)
    from_start = s * (1.0 - s) ** 2 * h
    from_end = -s * s * (1.0 - s) * h
    start, step = base.position[left], base.position[right] - base.position[left]
    # Orientation: the same cubic in the rotation vector from the left sample, in its axes.
    rotation = base.rotation[left]
    turn = log(np.swapaxes(rotation, -1, -2) @ base.rotation[right])
    velocity, rate = _slopes(base, ends, step, turn, maximum_gap)
    position = start + to_end * step + from_start * velocity[0] + from_end * velocity[1]
    turned = rotation @ exp(to_end * turn + from_start * rate[0] + from_end * rate[1])
    linear, angular = (
        part[left] + s * (part[right] - part[left]) for part in (base.linear_velocity, base.angular_velocity)
    )
    return Samples(
        time=time,
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=position,
        base_rotation=np.where(length[:, None, None] == 0.0, rotation, turned),
        base_linear_velocity=linear,
        base_angular_velocity=angular,
        pose_covariance=_blended(base.pose_covariance, ends, s, weight),
        twist_covariance=_blended(base.twist_covariance, ends, s, weight),
        stored=joints.stored,
    )


def _slopes(
    base: BaseStream, ends: tuple[Stamps, Stamps], step: Array, turn: Array, maximum_gap: int
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the slopes at both ends of the positions and of the rotation vectors from the left sample.

    `step` and `turn` (N, 3) lead from the left sample to the right one.
    """
    left, right = ends
    back = np.swapaxes(base.rotation[left], -1, -2)
    velocity = base.linear_velocity[left], base.linear_velocity[right]
    rate = (
        rotate_back(base.rotation[left], base.angular_velocity[left]),
        rotate_back(base.rotation[left], base.angular_velocity[right]),
    )
    rate = rate[0], rate[1] - 0.5 * cross(turn, rate[1])  # derivative of the rotation vector, to first order in it
    if np.all(np.isfinite(np.concatenate((*velocity, *rate)))):
        return velocity, rate
    before = np.maximum(left - 1, 0)
    length, earlier = base.stamp[right] - base.stamp[left], base.stamp[left] - base.stamp[before]
    times = length * 1e-9, np.where(earlier <= maximum_gap, earlier * 1e-9, 0.0)
    steps = _parabola(step, base.position[left] - base.position[before], *times)
    turns = _parabola(turn, -log(back @ base.rotation[before]), *times)
    return _finite_or(velocity, steps), _finite_or(rate, turns)


def _parabola(step: Array, before: Array, length: Array, earlier: Array) -> tuple[Array, Array]:
    """Return the slopes (N, 3) at both ends of steps (N, 3) after earlier ones; durations (N,) s, 0 for none."""
    h, h_before = length[:, None], earlier[:, None]
    mean = step / np.where(h > 0.0, h, np.inf)
    bend = np.where(h_before > 0.0, mean - before / np.where(h_before > 0.0, h_before, np.inf), 0.0)
    half = np.where(h > 0.0, h / np.maximum(h + h_before, 1e-9), 0.0) * bend
    return mean - half, mean + half


def _finite_or(slopes: tuple[Array, Array], others: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return slopes, and others in their place where they are not finite."""
    start, end = (np.where(np.isfinite(one), one, other) for one, other in zip(slopes, others, strict=True))
    return start, end


def _blended(covariance: Array, ends: tuple[Stamps, Stamps], fraction: Array, weight: Array) -> Array:
    """Return (N, 6, 6) covariances at fractions (N, 1) between the base's, weighted (N,); in place, they are large."""
    blend = fraction[..., None]
    start, end = (np.take(covariance, places, axis=0) for places in ends)
    start *= 1.0 - blend
    end *= blend
    start += end
    start *= weight[:, None, None]
    return start


@dataclass(frozen=True, eq=False)
class AttachedFrame:
    """A frame on the base (a marker, a sensor): rotation (3, 3) and origin (3,) m in the base link's frame."""

    rotation: Array
    position: Array

    @property
    def is_base(self) -> bool:
        """Whether it is the base link's own frame."""
        return bool(np.array_equal(self.rotation, np.eye(3)) and not np.any(self.position))

    def to_base(self, measured: BaseStream) -> BaseStream:
        """Return the base link's stream from that of this frame, whose twist covariance is in its own axes."""
        # In products of matrices, batch sizes show in the last bit: here sums over axes do the work.
        rotation = np.einsum('nij,kj->nik', measured.rotation, self.rotation)
        lever = rotate(rotation, self.position)  # from the base's origin to the frame's, odometry axes
        pose = np.zeros((len(rotation), 6, 6))
        pose[:] = np.eye(6)
        pose[:, :3, 3:] = skew(lever)  # p = p_frame - lever: an error of orientation turns the lever
        twist = np.zeros((6, 6))
        twist[:3, :3] = twist[3:, 3:] = self.rotation
        twist[:3, 3:] = skew(self.position) @ self.rotation  # v = v_frame - w x lever
        return replace(
            measured,
            position=measured.position - lever,
            rotation=rotation,
            linear_velocity=measured.linear_velocity - cross(measured.angular_velocity, lever),
            pose_covariance=pose @ measured.pose_covariance @ np.swapaxes(pose, -1, -2),
            twist_covariance=twist @ measured.twist_covariance @ twist.T,
        )


def orientation_only(stamp: Stamps, rotation: Array, covariance: Array | None = None) -> BaseStream:
    """Return N orientations (N, 3, 3) as those of a base in a frame that stays with the common centre of mass.

    `covariance` (N, 3, 3) rad^2 is in odometry axes; None if the orientation is no measurement either.
    """
    count = len(stamp)
    unknown, pose = np.full((count, 3), np.nan), np.full((count, 6, 6), np.nan)
    if covariance is not None:
        pose[:, 3:, 3:] = covariance
    return BaseStream(stamp, np.zeros((count, 3)), rotation, unknown, unknown, pose, np.tile(np.eye(6), (count, 1, 1)))


def measured_orientation(imu: ImuStream | None) -> BaseStream | None:
    """Return the orientations of the base that an IMU measures; None if it measures none."""
    if imu is None:
        return None
    measured = np.isfinite(imu.rotation).all(axis=(1, 2))
    if not np.any(measured):
        return None
    base = orientation_only(imu.stamp[measured], imu.rotation[measured], imu.rotation_covariance[measured])
    declared = base.declared.copy()
    declared[:, 1] = imu.declared[measured]
    return replace(base, declared=declared)


class UsableCovariance(NamedTuple):
    """A covariance (6, 6) that can weight data."""

    matrix: Array
    is_given: tuple[bool, bool]  # whether its linear and its angular block are as given
    wrong: bool  # whether a given block was not used; zeros mean not set


def usable_covariance(given: Array, default: Array) -> UsableCovariance:
    """Return a covariance that can weight data from one (6, 6) that may be unset.

    A block (linear or angular) that is not finite, symmetric, of a possible size and positive definite is replaced by
    the default's, without correlation between the two.
    """
    if _is_covariance(given):
        return UsableCovariance(given, (True, True), wrong=False)
    used, kept = default.copy(), np.zeros((6, 6))
    blocks = slice(0, 3), slice(3, 6)
    linear, angular = (_is_covariance(given[block, block]) for block in blocks)
    for block, good in zip(blocks, (linear, angular), strict=True):
        if good:
            used[block, block] = kept[block, block] = given[block, block]
    return UsableCovariance(used, (linear, angular), wrong=not np.array_equal(kept, given))


def _is_covariance(matrix: Array) -> bool:
    if not np.all(np.isfinite(matrix)) or np.max(np.abs(matrix)) > _LARGEST:
        return False
    scale = np.sqrt(np.abs(np.diag(matrix)))
    if np.any(np.diag(matrix) < _SMALLEST):
        return False
    correlation = matrix / scale / scale[:, None]
    if np.max(np.abs(correlation - correlation.T)) > 1e-6:
        return False
    return bool(np.linalg.eigvalsh(correlation)[0] > 1e-9)


class OdometryLayout(PacketLayout):
    """The layout of a nav_msgs/Odometry with the names of its frames.

    Raises MisfitError where its bytes are not understood.
    """

    type_name: ClassVar[str] = ODOMETRY_TYPE

    def __init__(self, data: bytes) -> None:
        cursor = Cursor(data)
        self.frame_id, self.child_frame_id = cursor.string(), cursor.string()
        super().__init__(data, cursor, {'numbers': (cursor.doubles(_NUMBERS), _NUMBERS)})

    def columns(self, messages: Sequence[Packets[Any]]) -> tuple[Stamps, Array, Array, Array]:
        """Return stamps (N,), ns, numbers (N, 13) and covariances (N, 36) of pose and twist of N such messages.

        The numbers are position (3), orientation (4), linear and angular velocity (3 each).
        """
        stamp, records = self._read(messages)
        given = records['numbers'].astype(float, 'C')
        numbers = np.concatenate((given[:, _POSE], given[:, _TWIST]), axis=1)
        return stamp, numbers, given[:, _POSE_COVARIANCE], given[:, _TWIST_COVARIANCE]


class BasePoseShape(NamedTuple):
    """The frames that several poses share."""

    frame_id: str
    child_frame_id: str

    def columns(self, messages: Sequence[BasePose]) -> tuple[Stamps, Array, Array, Array]:
        """Return stamps (N,), ns, numbers (N, 13) and covariances (N, 36) of pose and twist, as of Odometry."""
        numbers = np.array([(*message.numbers, *_NO_TWIST) for message in messages])
        covariances = np.array([message.covariance for message in messages], dtype=float).reshape(-1, 36)
        return np.array([message.stamp for message in messages]), numbers, covariances, np.zeros_like(covariances)


def source_of(message: Any) -> Source:
    """Return which kind of source a message that locates the base is from."""
    if isinstance(message, Packets) or hasattr(message, 'twist'):
        return 'odom'
    return 'tf' if hasattr(message, 'transforms') else 'pose'


class PoseReader:
    """Makes poses of the base of messages that are no Odometry.

    Parameters
    ----------
    frame : name of the frame on the base that a PoseStamped locates; a transform locates its child frame
    tf_child : child frame of the transform that locates the base, which has one parent in a tree

    Attributes
    ----------
    others : parent and child frames of transforms with other children, the first few
    """

    def __init__(self, frame: str, tf_child: str) -> None:
        self._frame = frame
        self._tf_child = tf_child.lstrip('/')
        self.others: dict[tuple[str, str], None] = {}

    def read(self, message: Any) -> Iterator[BasePose]:
        """Yield the poses of a PoseStamped or one with covariance, of transforms, or of a QuaternionStamped."""
        if hasattr(message, 'transforms'):
            for each in message.transforms:
                frames = each.header.frame_id.lstrip('/'), each.child_frame_id.lstrip('/')
                if frames[1] == self._tf_child:
                    yield self._transform(each)
                elif len(self.others) < _REMEMBERED:
                    self.others[frames] = None
        elif hasattr(message, 'transform'):
            yield self._transform(message)
        elif hasattr(message, 'quaternion'):
            yield _pose(message, self._frame, _ORIGIN, message.quaternion, _NOT_SET)
        else:
            pose, covariance = message.pose, _NOT_SET
            if hasattr(pose, 'pose'):
                pose, covariance = pose.pose, pose.covariance
            yield _pose(message, self._frame, pose.position, pose.orientation, covariance)

    def _transform(self, message: Any) -> BasePose:
        transform = message.transform
        return _pose(message, message.child_frame_id, transform.translation, transform.rotation, _NOT_SET)


def _pose(message: Any, frame: str, position: Any, turn: Any, covariance: Any) -> BasePose:
    numbers = (position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w)
    return BasePose(stamp_of(message), message.header.frame_id, frame, numbers, covariance)


def numbers_of(message: Any) -> tuple[float, ...]:
    """Return position (3), orientation (4), linear and angular velocity (3 each) of an Odometry."""
    pose, twist = message.pose.pose, message.twist.twist
    position, orientation = pose.position, pose.orientation
    linear, angular = twist.linear, twist.angular
    return (
        *(position.x, position.y, position.z),
        *(orientation.x, orientation.y, orientation.z, orientation.w),
        *(linear.x, linear.y, linear.z),
        *(angular.x, angular.y, angular.z),
    )


class OdometryShape(NamedTuple):
    """The frames that several Odometry messages share."""

    frame_id: str
    child_frame_id: str

    def columns(self, messages: Sequence[Any]) -> tuple[Stamps, Array, Array, Array]:
        """Return stamps (N,), ns, numbers (N, 13) and covariances (N, 36) of pose and twist of N such messages."""
        numbers = np.array([numbers_of(message) for message in messages])
        return stamps_of(messages), numbers, _covariances(messages, 'pose'), _covariances(messages, 'twist')


def odometry_shape(message: Any) -> OdometryShape | OdometryLayout | BasePoseShape:
    """Return the shape of an Odometry, of packets together, or of a pose in its place."""
    if isinstance(message, Packets):
        return message.layout
    if isinstance(message, BasePose):
        return BasePoseShape(message.frame_id, message.child_frame_id)
    return OdometryShape(message.header.frame_id, message.child_frame_id)


def _covariances(messages: Sequence[Any], part: str) -> Array:
    return np.array([getattr(message, part).covariance for message in messages], dtype=float).reshape(-1, 36)


_Shape = OdometryShape | OdometryLayout | BasePoseShape


class OdometryReader:
    """Reads Odometry messages: pose of a frame on the base in the odometry frame, twist in the declared frame.

    Parameters
    ----------
    attached : the accepted child frames, by name: those of the links of the base
    marker : pose on the base of a child frame that is no link of the robot; None refuses such frames
    links : names of all links of the robot
    twist_frame : 'child' (the ROS convention) or 'inertial'
    noise : standard deviations for messages without a usable covariance

    Attributes
    ----------
    replaced : number of messages whose covariance was unusable
    frame, frames : frame_id of the latest message, and the first few of all
    other_child_frame, other_parent_frame : child_frame_id and frame_id of the latest message of no frame on the base
    """

    def __init__(
        self,
        attached: Mapping[str, AttachedFrame],
        marker: AttachedFrame | None,
        links: Collection[str],
        twist_frame: str,
        noise: SensorNoise,
    ) -> None:
        self._attached = attached
        self._marker = marker
        self._links = links
        self._inertial = twist_frame == 'inertial'
        self._pose_default = noise.pose_covariance()
        self._twist_default = noise.twist_covariance()
        self.other_child_frame = self.other_parent_frame = ''
        self.frame = ''
        self.frames: list[str] = []
        self.replaced: Counter[str] = Counter()
        self.not_finite: Counter[str] = Counter()  # messages with a NaN or infinite value, by field
        self._tracked = False  # whether a pose has been read that is not the placeholder of a lost one

    def read(self, messages: Sequence[Any]) -> tuple[BaseStream | None, Counter[str]]:
        """Return the measurements, and dropped messages by cause; a missing twist is NaN, packets may be together."""
        dropped: Counter[str] = Counter()
        read = [(group.places, *self._measured(group, dropped)) for group in self._accepted(messages, dropped)]
        parts = [(places[good], stream) for places, good, stream in read if np.any(good)]
        if len(parts) < 2:
            return parts[0][1] if parts else None, +dropped
        places, streams = zip(*parts, strict=True)
        return BaseStream.concatenate(list(streams))[np.argsort(np.concatenate(places))], +dropped

    def _measured(self, group: _Group, dropped: Counter[str]) -> tuple[Flags, BaseStream]:
        """Return which messages of a frame are usable, and the base link's measurements; the others are counted."""
        stamp, numbers, pose, twist = group.columns
        good = self._usable(numbers, dropped)
        pose, of_pose, wrong_pose = self._covariances(pose, self._pose_default)
        twist, of_twist, wrong_twist = self._covariances(twist, self._twist_default)
        for cause, wrong in ((POSE_COVARIANCE, wrong_pose), (TWIST_COVARIANCE, wrong_twist)):
            self.replaced[cause] += int(np.sum(wrong & good))
        declared = np.concatenate((of_pose, of_twist), axis=1)
        if not np.all(good):
            stamp, numbers, pose, twist = stamp[good], numbers[good], pose[good], twist[good]
            declared = declared[good]
        stream = self._stream(stamp, numbers, pose, twist, declared)
        return good, stream if group.frame.is_base else group.frame.to_base(stream)

    def _accepted(self, messages: Sequence[Any], dropped: Counter[str]) -> list[_Group]:
        """Return the messages of frames on the base, by their shapes; the others are counted."""
        alike: dict[_Shape, list[Any]] = {}
        places: dict[_Shape, list[range]] = {}
        begin = 0
        for shape, group in groupby(messages, key=odometry_shape):
            run = list(group)
            end = begin + number_of(run)
            alike.setdefault(shape, []).extend(run)
            places.setdefault(shape, []).append(range(begin, end))
            begin = end
        accepted: list[_Group] = []
        for shape in sorted(places, key=lambda shape: places[shape][-1].stop):  # so that the last remains
            frame = self._frame(shape.child_frame_id)
            if frame is None:
                self.other_child_frame, self.other_parent_frame = shape.child_frame_id, shape.frame_id
                dropped[WRONG_CHILD_FRAME] += sum(map(len, places[shape]))
            else:
                self.frame = shape.frame_id
                self._remember(shape.frame_id.lstrip('/'))
                accepted.append(_Group(frame, np.concatenate(places[shape]), shape.columns(alike[shape])))
        return accepted

    def _remember(self, frame: str) -> None:
        if frame not in self.frames and len(self.frames) < _REMEMBERED:
            self.frames.append(frame)

    def _frame(self, name: str) -> AttachedFrame | None:
        """Return where the frame of that name is on the base, None if that is not known."""
        name = name.lstrip('/')
        return self._attached.get(name) or (self._marker if name not in self._links else None)

    def _usable(self, numbers: Array, dropped: Counter[str]) -> Flags:
        """Return which messages have a pose; the others are counted.

        A tracker that has lost the base publishes zeros, with a quaternion of zeros or the identity.
        """
        finite = np.all(np.isfinite(numbers[:, :7]), axis=1)
        for field, columns in _FIELDS.items():
            lacking = int(np.sum(~np.all(np.isfinite(numbers[:, columns]), axis=1)))
            self.not_finite.update({field: lacking} if lacking else {})
        empty = ~np.any(numbers[:, 3:7], axis=1)
        placeholder = empty | ~np.any(numbers[:, :6], axis=1)
        tracked = self._tracked | np.logical_or.accumulate(finite & ~placeholder)
        self._tracked = bool(tracked[-1])
        lost = finite & (empty | (placeholder & tracked))
        dropped[LOST_TRACKING] += int(np.sum(lost))
        finite_pose = finite & ~lost
        with np.errstate(over='ignore', invalid='ignore'):
            length = np.sqrt(np.sum(numbers[:, 3:7] ** 2, axis=1))
            unit = np.abs(length - 1.0) < QUATERNION_TOLERANCE
            real = np.all(np.abs(numbers[:, :3]) < _LARGEST_POSITION, axis=1)
        dropped[NOT_FINITE] += int(np.sum(~finite))
        dropped[BAD_QUATERNION] += int(np.sum(finite_pose & ~unit))
        dropped[NOT_REAL] += int(np.sum(finite_pose & unit & ~real))
        return np.asarray(finite_pose & unit & real)

    def _stream(self, stamp: Stamps, numbers: Array, pose: Array, twist: Array, declared: Flags) -> BaseStream:
        rotation = rotation_from_quaternion(numbers[:, 3:7])
        linear, angular = numbers[:, 7:10], numbers[:, 10:13]
        with np.errstate(invalid='ignore'):
            linear, angular = (
                np.where(np.all(np.abs(part) < _LARGEST_VELOCITY, axis=1, keepdims=True), part, np.nan)
                for part in (linear, angular)
            )
        if self._inertial:
            both = np.zeros((len(stamp), 6, 6))
            both[:, :3, :3] = both[:, 3:, 3:] = np.swapaxes(rotation, -1, -2)
            twist = both @ twist @ np.swapaxes(both, -1, -2)
        else:
            linear, angular = rotate(rotation, linear), rotate(rotation, angular)
        return BaseStream(stamp, numbers[:, :3], rotation, linear, angular, pose, twist, declared)

    def _covariances(self, rows: Array, default: Array) -> tuple[Array, Flags, Flags]:
        """Return (N, 6, 6) covariances, of which blocks they are the messages', (N, 2), and which messages' are none.

        They are the messages' (N, 36), or the default where they are not set or not usable.
        """
        # Publishers mostly repeat one covariance: check each distinct one once.
        if np.all(rows == rows[0]):
            distinct, which = rows[:1], np.zeros(len(rows), dtype=np.intp)
        else:
            distinct, inverse = np.unique(rows, axis=0, return_inverse=True)
            which = inverse.ravel()
        checked = [_checked(row.tobytes(), default.tobytes()) for row in distinct]
        matrices, own, wrong = (np.array(each)[which] for each in zip(*checked, strict=True))
        return matrices, own, wrong


@lru_cache(maxsize=64)
def _checked(given: bytes, default: bytes) -> UsableCovariance:
    """Return the covariance to use where one is given."""
    return usable_covariance(np.frombuffer(given).reshape(6, 6), np.frombuffer(default).reshape(6, 6))


class _Group(NamedTuple):
    """Messages of the same frames: where the child frame is, their places among all messages, their numbers."""

    frame: AttachedFrame
    places: npt.NDArray[np.intp]
    columns: _Columns


def odometry_reader(
    model: RobotModel, prefix: str, marker: AttachedFrame | None, twist_frame: str, noise: SensorNoise
) -> OdometryReader:
    """Return the reader of poses and twists of the base, for the frames on it; `noise` is that of unmarked messages."""
    links = model.links
    attached = {prefix + link.name: AttachedFrame(link.rotation, link.position) for link in links if link.body == 0}
    names = frozenset(prefix + link.name for link in links)
    return OdometryReader(attached, marker, names, twist_frame, noise)


class BaseSource:
    """The messages that locate the base: of the source that comes first, or of the one that the parameters name.

    Attributes
    ----------
    kind, dropped : of the source, None before the first message; number of messages of other sources
    other_transforms : as `PoseReader.others`

    Parameters
    ----------
    frame : of poses without a name; empty for one that is no link's
    child_frame : of transforms that are the source; empty where they are none
    needed : whether any source is used
    """

    def __init__(self, frame: str, child_frame: str, *, needed: bool) -> None:
        self._poses = PoseReader(frame, child_frame)
        self.other_transforms = self._poses.others
        self._needed = needed
        self.kind: Source | None = 'tf' if child_frame else None
        self.dropped: Counter[str] = Counter()

    def poses(self, messages: Sequence[Any]) -> Sequence[Any]:
        """Return the messages of any source as Odometry or as poses."""
        if isinstance(messages, Packets):
            return messages
        each = ([message] if source_of(message) == 'odom' else self._poses.read(message) for message in messages)
        return [pose for poses in each for pose in poses]

    def accepts(self, messages: Sequence[Any]) -> bool:
        """Return whether messages are all of the source that is used."""
        return all(self._is_used(kind) for kind in _kinds(messages))

    def accepted(self, messages: Sequence[Any]) -> Sequence[Any]:
        """Return the messages of the used source as Odometry or as poses; the others are counted as dropped."""
        for kind in _kinds(messages):
            if self.kind is None and kind != 'tf':
                self.kind = kind
        if isinstance(messages, Packets):
            used: Sequence[Any] = messages if self._is_used('odom') else []
        else:
            used = [message for message in messages if self._is_used(source_of(message))]
        self.dropped[OTHER_SOURCE] += len(messages) - len(used)
        return self.poses(used)

    def _is_used(self, kind: Source) -> bool:
        return self._needed and (kind == self.kind or (self.kind is None and kind != 'tf'))


def _kinds(messages: Sequence[Any]) -> set[Source]:
    return {'odom'} if isinstance(messages, Packets) else {source_of(message) for message in messages}
