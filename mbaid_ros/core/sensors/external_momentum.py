"""Known changes of the momentum up to each sample: commanded thrust, an orbit's gravity, and stored momentum.

A wrench (F, T) about the origin of a frame with axes R at p changes (P, L) about the odometry origin by (R F, p x R F
+ R T) a second. Each command holds until the next of its frame, or for a while. Between two samples the commands are
integrated exactly, the pose is that of both on average: its noise averages out.
"""

from __future__ import annotations

from bisect import insort
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS
from mbaid_ros.core.samples import JointStream, Samples

NOT_FINITE_THRUST = 'thrust with a NaN or infinite value'
UNKNOWN_FRAME = 'thrust in a frame that is no link'
FAR_THRUST = 'thrust stamped far from the samples'
LATE_THRUST = 'a thrust command arrived after its samples had been used: its impulse counts from then on'
EXACT_THRUST = (
    'thrust counts as exactly as commanded: if it is weaker, misaligned or late, the intervals are too narrow; set '
    'thrust.scale_std, thrust.direction_std and thrust.delay_std'
)
SHARED_THRUST = (
    'thrust in {} changes to and fro between two commands, as of two publishers, of which each ends the other: give '
    'each a frame of its own, such as a link that is fixed to this one'
)
NOT_FINITE_MOMENTUM = 'stored momentum with a NaN or infinite value'
OTHER_MOMENTUM_FRAME = 'stored momentum in another frame'
NOT_ASKED_FOR = 'stored momentum is published but not used: set wheels.momentum_frame'

HOLD = 1_000_000_000  # ns, longest time that a command acts: drivers repeat theirs several times a second
_FAR = 10_000_000_000  # ns, from the newest sample: a command further away is by another clock
_SHARED = 10  # commands between two with other components, from which they are another publisher's
_REMEMBERED = 4 * _FAR  # ns, for commands that come late
# Derivatives of a wrench by a thruster's scale, and by its turn about each axis, (4, 6, 6).
_BY_ERROR = np.zeros((4, 6, 6))
_BY_ERROR[0] = np.eye(6)
_BY_ERROR[1:, :3, :3] = _BY_ERROR[1:, 3:, 3:] = skew(np.eye(3))


@dataclass(order=True)
class _Command:
    """A wrench from a stamp (ns) on."""

    stamp: int
    wrench: Array = field(compare=False)


class Thrust:
    """Integrates commanded thrust to momentum.

    Parameters
    ----------
    uncertain : frames of thrusters whose thrust may differ from the command

    Attributes
    ----------
    odometry_frame : name of the frame with the inertial axes; empty while unknown
    impulse : (6,) change of (P, L) since the first sample, odometry frame, L about its origin
    commands : number of those used
    late : whether one came after samples that it acts on
    exact : whether one counted as exactly as commanded
    dropped : commands that were not used, by cause
    shared : frame that two publishers seem to command; empty for none
    """

    def __init__(self, model: RobotModel, uncertain: Sequence[str] = ()) -> None:
        self._kinematics = Kinematics(model)
        self._links = {link.name: link for link in model.links}
        self._uncertain = {frame: index for index, frame in enumerate(uncertain)}
        self._columns: Array = np.zeros((len(uncertain), 6, THRUSTER_ERRORS))  # derivatives of `impulse` by the errors
        self._commands: dict[str, list[_Command]] = {}
        self._origin = 0
        self._past: deque[Samples] = deque()  # windows that were used, of the last seconds and the one before
        self.odometry_frame = ''
        self.impulse: Array = np.zeros(6)
        self.commands = 0
        self.late = False
        self.exact = False
        self.dropped: Counter[str] = Counter()
        self.shared = ''
        self._between: Counter[str] = Counter()  # by frame, commands between two of another publisher
        self._components: dict[str, tuple[set[int], set[int]]] = {}  # of its last two commands, those that are not zero

    def affects_samples(self, frame: str, stamp: int, wrench: Array, newest: int | None) -> bool:
        """Return whether samples up to the newest stamp may depend on the arrival of a command."""
        earlier = self._commands.get(frame, [])
        before = earlier[-1] if earlier else _Command(stamp, np.zeros(6))
        over = newest is not None and newest >= before.stamp + HOLD and bool(np.any(wrench))
        return over or stamp < before.stamp or not np.array_equal(wrench, before.wrench)

    def add_command(self, frame: str, stamp: int, wrench: Array, newest: int | None) -> None:
        """Add a command.

        Parameters
        ----------
        frame : a link, or the odometry frame
        stamp : ns, from when on
        wrench : (6,) force, N, and torque about the frame's origin, N m, in its axes
        newest : ns, latest stamp of the other inputs; None before the first
        """
        if not np.all(np.isfinite(wrench)):
            self.dropped[NOT_FINITE_THRUST] += 1
        elif newest is not None and abs(stamp - newest) > _FAR:
            self.dropped[FAR_THRUST] += 1
        elif frame not in self._links and self.odometry_frame not in {'', frame}:
            self.dropped[UNKNOWN_FRAME] += 1
        else:
            self._detect_shared_frame(frame, wrench)
            self._insert(frame, _Command(stamp, wrench))

    def _detect_shared_frame(self, frame: str, wrench: Array) -> None:
        """Detect a frame with alternating forces and torques, without any command of both."""
        before, between = self._components.get(frame, (set(), set()))
        after = set(np.flatnonzero(wrench).tolist())
        self._components[frame] = between, after
        if after and between and before == after and not between & after:
            self._between[frame] += 1
            self.shared = frame if self._between[frame] >= _SHARED else self.shared

    def with_momentum(self, window: Samples, origin: int) -> Samples:
        """Return the next window with the impulse of thrust until each of its samples; `origin` is ns at time 0."""
        self._origin = origin
        self._past.extend([window] if self._past else [window[:1], window])
        while window.time[-1] - self._past[1].time[-1] > _FAR * 1e-9:
            self._past.popleft()
        columns = np.tile(self._columns, (len(window), 1, 1, 1))
        if not self.commands:
            return replace(window, thrust=columns.reshape(len(window), -1)) if self._uncertain else window
        joined = self._joined(self._past[-2], window)
        total = np.tile(self.impulse, (len(window), 1))
        for frame in list(self._commands):
            if frame not in self._links and frame != self.odometry_frame:
                self.dropped[UNKNOWN_FRAME] += len(self._commands.pop(frame))
                continue
            by_errors = np.cumsum(self._pulses(frame, joined), axis=0)
            total += by_errors[..., 0]
            if frame in self._uncertain:
                columns[:, self._uncertain[frame]] += by_errors
            known, oldest = self._commands[frame], origin + round(float(window.time[-1]) * 1e9) - _REMEMBERED
            while len(known) > 1 and known[1].stamp < oldest:  # nothing depends on it any more
                del known[0]
        self.impulse, self._columns = total[-1], columns[-1].copy()
        return replace(window, impulse=total, thrust=columns.reshape(len(window), -1))

    def _insert(self, frame: str, command: _Command) -> None:
        """Add a command, and correct the impulse of windows that were used already."""
        time = (command.stamp - self._origin) * 1e-9
        missed = [self._joined(before, window) for before, window in pairwise(self._past) if window.time[-1] > time]

        def total() -> Array:
            return sum((np.sum(self._pulses(frame, part), axis=0) for part in missed), np.zeros((6, THRUSTER_ERRORS)))

        before = total()
        insort(self._commands.setdefault(frame, []), command)
        self.commands += 1
        self.exact = self.exact or (frame not in self._uncertain and bool(np.any(command.wrench)))
        more = total() - before
        self.impulse = self.impulse + more[:, 0]
        if frame in self._uncertain:
            self._columns[self._uncertain[frame]] += more
        self.late = self.late or bool(np.any(more[:, 0]))

    @staticmethod
    def _joined(before: Samples, window: Samples) -> Samples:
        """Return the last sample before a window, and its samples."""
        return Samples.concatenate([before[-1:], window])

    def _pulses(self, frame: str, samples: Samples) -> Array:
        """Return the changes of (P, L) from each of N samples to the next by the errors of a thruster, (N - 1, 6, 5).

        Scale, turn and delay: the change by the scale is that by the commands themselves.
        """
        impulses = np.diff(self._impulse(frame, samples.time), axis=0)
        delayed = -np.diff(self._wrench(frame, samples.time), axis=0)  # lacking at a late begin, surplus at a late end
        columns = np.concatenate((np.einsum('kij,nj->nik', _BY_ERROR, impulses), delayed[..., None]), axis=2)
        return self._mean_gain(frame, samples) @ columns if np.any(columns) else columns

    def _wrench(self, frame: str, time: Array) -> Array:
        """Return the commanded wrench (N, 6) of a frame just before N times, s."""
        start, length, wrenches = self._schedule(frame)
        return np.asarray(((time[:, None] > start) & (time[:, None] <= start + length)) @ wrenches)

    def _impulse(self, frame: str, time: Array) -> Array:
        """Return the impulses (N, 6), in the frame's axes, of its commands from the first sample until N times, s."""
        start, length, wrenches = self._schedule(frame)
        # The initial momentum of the run includes impulses before the first sample.
        passed = np.clip(time[:, None] - start, 0.0, length) - np.clip(-start, 0.0, length)
        return np.asarray(passed @ wrenches)

    def _schedule(self, frame: str) -> tuple[Array, Array, Array]:
        """Return when the commands of a frame begin, s, how long each of them holds, s, and their wrenches (c, 6)."""
        commands = self._commands.get(frame, [])
        start = np.array([command.stamp - self._origin for command in commands]) * 1e-9
        length = np.minimum(np.diff(start, append=np.inf), HOLD * 1e-9)
        return start, length, np.array([command.wrench for command in commands]).reshape(-1, 6)

    def _mean_gain(self, frame: str, samples: Samples) -> Array:
        """Return d(P, L)/dt by a wrench in a frame, mean over each of N samples and the next, (N - 1, 6, 6)."""
        gain = np.zeros((len(samples), 6, 6))
        gain[:] = np.eye(6)
        link = self._links.get(frame)
        if link is not None:
            configuration = self._kinematics.configure(samples.base_rotation, samples.joint_position)
            rotation, position = configuration.link_pose(link)
            gain[:, :3, :3] = gain[:, 3:, 3:] = rotation
            gain[:, 3:, :3] = skew(samples.base_position + position) @ rotation
        return np.asarray(0.5 * (gain[1:] + gain[:-1]))


class StoredMomentum:
    """Collects published stored momentum (wheels) until `stream` returns it.

    Parameters
    ----------
    frame : name of the link whose axes are used; links fixed to it are accepted as well. Empty accepts nothing

    Attributes
    ----------
    used : number of messages used
    dropped : those not used, by cause
    other_frame : frame of the last one in another
    """

    def __init__(self, model: RobotModel, frame: str) -> None:
        self._rotations: dict[str, Array] = {}
        if frame:
            wanted = model.link(frame)
            same = (link for link in model.links if link.body == wanted.body)
            self._rotations = {link.name: wanted.rotation.T @ link.rotation for link in same}
        self._stamps: list[int] = []
        self._vectors: list[Array] = []
        self.used = 0
        self.dropped: Counter[str] = Counter()
        self.other_frame = ''

    def add_sample(self, frame: str, stamp: int, momentum: Array) -> None:
        """Add a (3,) momentum, N m s, in a frame's axes at a stamp, ns."""
        if not self._rotations:
            self.dropped[NOT_ASKED_FOR] += 1
        elif frame not in self._rotations:
            self.other_frame = frame
            self.dropped[OTHER_MOMENTUM_FRAME] += 1
        elif not np.all(np.isfinite(momentum)):
            self.dropped[NOT_FINITE_MOMENTUM] += 1
        else:
            self.used += 1
            self._stamps.append(stamp)
            self._vectors.append(self._rotations[frame] @ momentum)

    def stream(self) -> JointStream | None:
        """Return all momenta since the last call, as rates of three joints without positions; None for none."""
        if not self._stamps:
            return None
        stamps, vectors = np.array(self._stamps, dtype=np.int64), np.array(self._vectors)
        self._stamps, self._vectors = [], []
        return JointStream(stamps, np.zeros_like(vectors), vectors)
