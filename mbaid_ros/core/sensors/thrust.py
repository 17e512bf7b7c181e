"""Commanded thrust: what it has brought to the momentum by each sample.

A wrench (F, T) about the origin of a frame with axes R at p changes (P, L) about the odometry origin by (R F, p x R F
+ R T) a second. Each command holds until the next of its frame, or for a while. Between two samples the commands are
integrated exactly, the pose is that of both on average: its noise averages out.
"""

from __future__ import annotations

from bisect import insort
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.orbit import OF_A_THRUSTER
from mbaid_ros.core.samples import Samples

NOT_FINITE_THRUST = 'thrust with a NaN or infinite value'
UNKNOWN_FRAME = 'thrust in a frame that is no link'
FAR_THRUST = 'thrust stamped far from the samples'
LATE_THRUST = 'thrust was told after samples that it acts on had been used: its impulse counts from then on'
EXACT_THRUST = (
    'thrust is taken as exactly as commanded: weaker, turned or late, it leaves intervals that are too narrow; give '
    'thrust.scale_std and thrust.direction_std'
)

_FAR = 10_000_000_000  # ns, from the newest sample: a command further away is by another clock
_REMEMBERED = 4 * _FAR  # ns, for commands that come late


def _off_the_command() -> Array:
    """Return what a unit of scale, and of turn about each axis, makes of a wrench, (4, 6, 6)."""
    maps = np.zeros((4, 6, 6))
    maps[0] = np.eye(6)
    maps[1:, :3, :3] = maps[1:, 3:, 3:] = skew(np.eye(3))
    return maps


_OFF = _off_the_command()


@dataclass(order=True)
class _Command:
    """A wrench from a stamp (ns) on."""

    stamp: int
    wrench: Array = field(compare=False)


class _Part(NamedTuple):
    """A window, and the one before it."""

    before: Samples
    window: Samples

    @property
    def end(self) -> float:
        """Time of the last sample, s."""
        return float(self.window.time[-1])

    def joined(self) -> Samples:
        """Return the window's samples after the last one before it."""
        return Samples.concatenate([self.before[-1:], self.window])


class Thrust:
    """Adds up what commanded thrust does to the momentum.

    Parameters
    ----------
    model : RobotModel
    hold : ns, longest time that a command counts
    uncertain : frames of thrusters that may be off their commands

    Attributes
    ----------
    odometry_frame : name of the frame whose axes are the inertial ones; empty while it is not known
    brought : (6,) change of (P, L) since the first sample, odometry frame, L about its origin
    commands : number of those that were taken
    late : whether one came after samples that it acts on
    exact : whether one was taken as exactly as commanded
    dropped : commands that were not used, by cause
    """

    def __init__(self, model: RobotModel, hold: int, uncertain: Sequence[str] = ()) -> None:
        self._kinematics = Kinematics(model)
        self._links = {link.name: link for link in model.links}
        self._hold = hold
        self._uncertain = {frame: index for index, frame in enumerate(uncertain)}
        self._columns: Array = np.zeros((len(uncertain), 6, OF_A_THRUSTER))  # what has been brought, by how each is off
        self._commands: dict[str, list[_Command]] = {}
        self._origin = 0
        self._past: deque[_Part] = deque()  # windows that were used, of the last seconds
        self.odometry_frame = ''
        self.brought: Array = np.zeros(6)
        self.commands = 0
        self.late = False
        self.exact = False
        self.dropped: Counter[str] = Counter()

    def changes(self, frame: str, stamp: int, wrench: Array, newest: int | None) -> bool:
        """Tell whether a command is any news: whether samples up to the newest stamp may depend on when it came."""
        earlier = self._commands.get(frame, [])
        before = earlier[-1] if earlier else _Command(stamp, np.zeros(6))
        over = newest is not None and newest >= before.stamp + self._hold and bool(np.any(wrench))
        return over or stamp < before.stamp or not np.array_equal(wrench, before.wrench)

    def command(self, frame: str, stamp: int, wrench: Array, newest: int | None) -> None:
        """Take a command.

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
            self._take(frame, _Command(stamp, wrench))

    def applied(self, window: Samples, origin: int) -> Samples:
        """Return a window with what thrust has brought until each of its samples.

        Parameters
        ----------
        window : Samples, after those before
        origin : ns, stamp at time 0
        """
        self._origin = origin
        part = _Part(self._past[-1].window if self._past else window[:1], window)
        self._past.append(part)
        while window.time[-1] - self._past[0].end > _FAR * 1e-9:
            self._past.popleft()
        if not self.commands:
            return replace(window, thrust=self._brought_by_each(len(window))) if self._uncertain else window
        joined = part.joined()
        columns = self._brought_by_each(len(window)).reshape(len(window), *self._columns.shape)
        total = np.tile(self.brought, (len(window), 1))
        for frame in list(self._commands):
            if frame not in self._links and frame != self.odometry_frame:
                self.dropped[UNKNOWN_FRAME] += len(self._commands.pop(frame))
                continue
            total += np.cumsum(self._pulses(frame, joined), axis=0)
            if frame in self._uncertain:
                columns[:, self._uncertain[frame]] += np.cumsum(self._pulses(frame, joined, off=True), axis=0)
            self._forget(frame, origin + round(float(window.time[-1]) * 1e9) - _REMEMBERED)
        self.brought, self._columns = total[-1], columns[-1].copy()
        return replace(window, impulse=total, thrust=columns.reshape(len(window), -1))

    def _take(self, frame: str, command: _Command) -> None:
        time = (command.stamp - self._origin) * 1e-9
        missed = [part.joined() for part in self._past if part.end > time]
        before = self._in(frame, missed)
        before_by_each = self._in(frame, missed, off=True)
        insort(self._commands.setdefault(frame, []), command)
        self.commands += 1
        self.exact = self.exact or (frame not in self._uncertain and bool(np.any(command.wrench)))
        more = self._in(frame, missed) - before
        self.brought = self.brought + more
        if frame in self._uncertain:
            self._columns[self._uncertain[frame]] += self._in(frame, missed, off=True) - before_by_each
        self.late = self.late or bool(np.any(more))

    def _brought_by_each(self, count: int) -> Array:
        """Return what has been brought until now, by how each thruster is off, for so many samples, (N, 30 f)."""
        return np.tile(self._columns.ravel(), (count, 1))

    def _in(self, frame: str, parts: list[Samples], *, off: bool = False) -> Array:
        """Return what the commands of a frame bring in all of some windows, as `_pulses` has it."""
        nothing = np.zeros((6, OF_A_THRUSTER) if off else 6)
        return sum((np.sum(self._pulses(frame, part, off=off), axis=0) for part in parts), nothing)

    def _pulses(self, frame: str, samples: Samples, *, off: bool = False) -> Array:
        """Return what the commands of a frame bring from each of N samples to the next, (N - 1, 6).

        If asked for, what more they would bring by each number of a thruster that is off them, (N - 1, 6, 5).
        """
        impulses = np.diff(self._impulse(frame, samples.time), axis=0)
        if off:
            late = -np.diff(self._wrench(frame, samples.time), axis=0)  # what begins or ends is missing or left over
            impulses = np.concatenate((np.einsum('kij,nj->nik', _OFF, impulses), late[..., None]), axis=2)
        if not np.any(impulses):
            return impulses
        gain = self._gain(frame, samples)
        mean = 0.5 * (gain[1:] + gain[:-1])
        return mean @ impulses if off else np.einsum('nij,nj->ni', mean, impulses)

    def _wrench(self, frame: str, time: Array) -> Array:
        """Return the wrench (N, 6) that has been commanded in a frame until just before N times, s."""
        start, length, wrenches = self._course(frame)
        return np.asarray(((time[:, None] > start) & (time[:, None] <= start + length)) @ wrenches)

    def _impulse(self, frame: str, time: Array) -> Array:
        """Return the impulses (N, 6), in the frame's axes, of its commands from the first sample until N times, s."""
        start, length, wrenches = self._course(frame)
        # What acted before the first sample is in the momentum that the run begins with.
        passed = np.clip(time[:, None] - start, 0.0, length) - np.clip(-start, 0.0, length)
        return np.asarray(passed @ wrenches)

    def _course(self, frame: str) -> tuple[Array, Array, Array]:
        """Return when the commands of a frame begin, s, how long each of them holds, s, and their wrenches (c, 6)."""
        commands = self._commands.get(frame, [])
        start = np.array([command.stamp - self._origin for command in commands]) * 1e-9
        length = np.minimum(np.diff(start, append=np.inf), self._hold * 1e-9)
        return start, length, np.array([command.wrench for command in commands]).reshape(-1, 6)

    def _gain(self, frame: str, samples: Samples) -> Array:
        """Return what a wrench makes of (P, L) a second, (N, 6, 6)."""
        gain = np.zeros((len(samples), 6, 6))
        gain[:] = np.eye(6)
        link = self._links.get(frame)
        if link is None:
            return gain
        configuration = self._kinematics.configure(samples.base_rotation, samples.joint_position)
        rotation, position = configuration.link(link)
        gain[:, :3, :3] = gain[:, 3:, 3:] = rotation
        gain[:, 3:, :3] = skew(samples.base_position + position) @ rotation
        return gain

    def _forget(self, frame: str, oldest: int) -> None:
        """Drop commands that nothing depends on any more: those whose successor came before a stamp, ns."""
        known = self._commands[frame]
        while len(known) > 1 and known[1].stamp < oldest:
            del known[0]
