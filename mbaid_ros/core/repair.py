"""A repair: how a run takes a cause into account, by parameters that the user could have set, or by other readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import (
    Array,
    Flags,
    exp,
    mirror,
    quaternion_from_rotation,
    rotate,
    rotation_from_quaternion,
)
from mbaid_ros.core.robot.urdf import InertiaMeaning
from mbaid_ros.core.samples import BaseStream, JointStream, Stamps

Setting = bool | float | str | tuple[float, ...] | tuple[str, ...]  # the value of a parameter
PoseMeaning = Literal['as read', 'inverse', 'turned round', 'w first', 'mirrored x', 'mirrored y', 'mirrored z']
_MARGIN = 1.5  # times the size found, that a specified standard deviation is at least
_STEPS = np.array([1.0, 2.0, 5.0, 10.0])  # of specified standard deviations in a decade: round numbers
# Share of the leading gain, and log-likelihood, within which another cause is as likely.
_RIVAL_SHARE, _RIVAL_GAIN = 0.02, 10.0
# rad, deviation from which a wider prior is no repair: columns of small angles are wrong, another fault is likely.
_LARGEST_ANGLE = 0.5
_VARYING = {'disturbance.torque_std', 'disturbance.force_std'}  # of a force that varies
_MOST_RIVALS = 3  # causes of one repair: if more of them are as likely, nothing is known of the cause


@dataclass(frozen=True)
class Conversion:
    """Readings, or the robot description, as they are meant, where that is not as they are read.

    A joint is its factor times the reading under the name of its column, plus its zero.
    """

    factors: Mapping[str, float] = field(default_factory=dict)  # by name
    columns: Mapping[str, str] = field(default_factory=dict)  # by name, that under which a joint is read
    zeros: Mapping[str, float] = field(default_factory=dict)  # by name, rad or m
    delay: float = 0.0  # s, by which the joints' stamps are late
    clock: float = 1.0  # s by the joints' stamps in a second of the poses', since the first sample
    pose: PoseMeaning = 'as read'
    mount: tuple[float, ...] = ()  # (6,) rad and m, of the base in what the poses locate
    scale: float = 1.0  # m in a unit of the positions
    with_twist: bool = True
    # A joint's reading that has jumped: its name, the stamp (ns) of the first reading after that, rad or m.
    steps: tuple[tuple[str, int, float], ...] = ()
    left_out: tuple[tuple[float, float], ...] = ()  # s since the first sample: joint readings in between
    masses: Mapping[str, float] = field(default_factory=dict)  # factors of links' masses and inertias, by name
    lengths: float = 1.0  # m in a unit of the robot description's lengths
    inertias: InertiaMeaning = 'as read'  # the tensors of the robot description
    origin: int = field(default=0, compare=False)  # ns, stamp of the first sample of the run that it was found in

    @property
    def of_description(self) -> bool:
        """Whether the robot description is not as it is read."""
        return bool(self.masses) or self.lengths != 1.0 or self.inertias != 'as read'

    @property
    def of_poses(self) -> bool:
        """Whether poses are not as they are read."""
        return self.pose != 'as read' or bool(self.mount) or self.scale != 1.0

    def joints(
        self, streams: Mapping[tuple[int, ...], JointStream], names: Sequence[str], joints: int
    ) -> dict[tuple[int, ...], JointStream]:
        """Return the joints' readings as they are meant.

        Parameters
        ----------
        streams : by the indices of their joints
        names : of all inputs
        joints : how many of them, from the first on, are joints
        """
        origin = self.origin
        place = {name: index for index, name in enumerate(names)}
        meant_by = {place[column]: place[name] for name, column in self.columns.items()}
        found = {}
        for key, stream in streams.items():
            meant = [meant_by.get(joint, joint) for joint in key]
            order = np.argsort(meant)
            own = [names[meant[row]] for row in order]
            scale, zero = (np.array([part.get(name, other) for name in own]) for part, other in self._scales)
            position = stream.position - self._jumped(stream, [names[joint] for joint in key])
            stamp, velocity = stream.stamp - round(1e9 * self.delay), stream.velocity[:, order] * scale
            if self.clock != 1.0:  # velocities may be by either clock
                stamp = origin + np.round((stamp - origin) / self.clock).astype(np.int64)
                velocity = np.where(np.sort(meant) < joints, np.nan, velocity)
            changed = JointStream(stamp, position[:, order] * scale + zero, velocity)
            found[tuple(sorted(meant))] = changed[self._kept(changed.stamp - origin)]
        return found

    def base(self, stream: BaseStream | None) -> BaseStream | None:
        """Return the readings of the base as they are meant."""
        if stream is None or (self.with_twist and not self.of_poses):
            return stream
        unknown = np.full(stream.linear_velocity.shape, np.nan)
        rotation, position = stream.rotation, self.scale * stream.position
        if self.pose == 'w first':
            rotation = rotation_from_quaternion(np.roll(quaternion_from_rotation(rotation), -1, axis=-1))
        elif self.pose.startswith('mirrored'):
            axis = 'xyz'.index(self.pose[-1])
            rotation, position = mirror(rotation, axis), np.where(np.arange(3) == axis, -1.0, 1.0) * position
        elif self.pose != 'as read':
            rotation = np.ascontiguousarray(np.swapaxes(rotation, -1, -2))
        if self.pose == 'turned round':
            position = -rotate(rotation, position)
        if self.mount:
            turn, lever = np.split(np.array(self.mount), 2)
            rotation, position = rotation @ exp(turn), position + rotation @ lever
        # A twist is in the axes of poses as they were read.
        return replace(stream, rotation=rotation, position=position, linear_velocity=unknown, angular_velocity=unknown)

    @property
    def _scales(self) -> tuple[tuple[Mapping[str, float], float], ...]:
        return (self.factors, 1.0), (self.zeros, 0.0)

    def _jumped(self, stream: JointStream, names: Sequence[str]) -> Array:
        jumped = np.zeros(stream.position.shape)
        for name, since, size in self.steps:
            jumped[:, [place for place, each in enumerate(names) if each == name]] += np.where(
                stream.stamp >= since, size, 0.0
            )[:, None]
        return jumped

    def _kept(self, since: Stamps) -> Flags:
        kept: Flags = np.ones(len(since), dtype=bool)
        for begin, end in self.left_out:
            kept &= (since < round(1e9 * begin)) | (since > round(1e9 * end))
        return kept


@dataclass(frozen=True)
class Repair:
    """How a run takes a cause into account.

    Attributes
    ----------
    cause : in words, with the value and its 95 % interval where there is one
    parameters : by dotted name, as the user could have set them; None where parameters cannot do it
    conversion : of readings; None where parameters do it
    value, std : of the deviation, in SI; None where it has none
    unit : of the value
    since : s since the first sample, from which the cause acts; None for all of the run
    """

    cause: str
    parameters: Mapping[str, Setting] | None = None
    conversion: Conversion | None = None
    value: float | tuple[float, ...] | None = None
    std: float | tuple[float, ...] | None = None
    unit: str = ''
    since: float | None = None

    def __str__(self) -> str:
        """Return it as it is published."""
        return f'repaired: {self.cause} ({self.how})'

    @property
    def by_parameters(self) -> bool:
        """Whether parameters alone take the cause into account."""
        return self.parameters is not None and self.conversion is None

    def since_sample(self, origin: int) -> Repair:
        """Return it with its times counted from the stamp (ns) of a run's first sample."""
        if self.conversion is None:
            return self
        since = self.since
        for _, jumped, _ in self.conversion.steps:
            since = 1e-9 * (jumped - origin)
        return replace(self, conversion=replace(self.conversion, origin=origin), since=since)

    @property
    def leaves_out(self) -> bool:
        """Whether it leaves out a sensor by name."""
        return self.conversion is None and bool(self.parameters) and not any((self.parameters or {}).values())

    @property
    def rescales(self) -> bool:
        """Whether it takes positions for those in another unit."""
        return self.conversion is not None and self.conversion.scale != 1.0

    def corrects_twist(self, other: Repair) -> bool:
        """Return whether it converts the poses that the twist, which the other leaves out, seems to contradict."""
        of_twist = other.conversion == Conversion(with_twist=False)
        return of_twist and self.conversion is not None and self.conversion.of_poses

    def replaces_force(self, other: Repair) -> bool:
        """Return whether it is a conversion, and the other a force that varies, which follows any fault."""
        return self.conversion is not None and not _VARYING.isdisjoint(other.parameters or {})

    @property
    def how(self) -> str:
        """The declaration or conversion, in words."""
        set_to = ', '.join(f'{name} were {shown(value)}' for name, value in (self.parameters or {}).items())
        parts = [f'as if {set_to}'] if set_to else []
        if self.conversion is not None:
            parts.insert(
                0, f'{"the robot description is" if self.conversion.of_description else "readings are"} converted'
            )
        return ', '.join(parts)

    @property
    def plausible(self) -> bool:
        """Whether the deviation is one that a wider prior can take into account; a conversion may be of any size."""
        if self.conversion is not None or self.value is None or not self.unit.startswith('rad'):
            return True
        angles = np.atleast_1d(self.value)[:3]
        return self.unit == 'rad/s' or bool(np.max(np.abs(angles)) < _LARGEST_ANGLE)

    def beyond(self, settings: Mapping[str, Setting]) -> Repair | None:
        """Return the part of it that given parameters lack; None where they have all of it."""
        if self.parameters is None:
            return self
        new = {
            name: value for name, value in self.parameters.items() if not _covers(_given(settings, name), name, value)
        }
        return replace(self, parameters=new) if new or self.conversion is not None else None


def joined(repairs: Sequence[Repair], further: Repair) -> tuple[Repair, ...]:
    """Return repairs with a further one, and without those that only its cause had called for."""
    left = (each for each in repairs if not (further.corrects_twist(each) or further.replaces_force(each)))
    return (*left, further)


def shown(value: Setting) -> str:
    """Return the value of a parameter as a parameter file has it."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, float):
        return f'{value:.6g}'
    return value if isinstance(value, str) else f'[{", ".join(map(shown, value))}]'


def _given(settings: Mapping[str, Setting], name: str) -> Setting | None:
    """Return the value of a parameter; one of a joint that has none of its own has that of all joints."""
    group, _, rest = name.partition('.')
    return settings.get(name, settings.get(f'{group}.{rest.rpartition(".")[2]}') if group == 'known_joints' else None)


def _covers(given: Setting | None, name: str, value: Setting) -> bool:
    """Return whether a given parameter is as wide as the one asked for."""
    if name.endswith('_std') and isinstance(given, float) and isinstance(value, float):
        return given >= value
    return given == value


def widened(size: float, most: float = np.inf) -> float:
    """Return a standard deviation, 1, 2 or 5 of a decade, that is larger than a size found by half or more."""
    if not size > 0.0:
        return 0.0
    wanted = _MARGIN * size
    decade = 10.0 ** np.floor(np.log10(wanted))
    step = _STEPS[np.searchsorted(_STEPS, wanted / decade * (1.0 - 1e-12))]
    return min(float(f'{step * decade:.1g}'), most)


def numbers(values: Array) -> float | tuple[float, ...]:
    """Return a number as it is, and several as a tuple."""
    return float(values[0]) if len(values) == 1 else tuple(map(float, values))


def wider_prior(cause: str, parameter: str, value: Array, std: Array, unit: str = '', most: float = np.inf) -> Repair:
    """Return the repair that declares a parameter, a standard deviation, as large as a deviation (k,) that was found.

    Parameters
    ----------
    value, std : (k,) of the deviation, SI
    most : largest value of the parameter
    """
    wider = widened(float(np.max(np.abs(value))), most)
    return Repair(cause, {parameter: wider}, value=numbers(value), std=numbers(std), unit=unit)


def as_likely(gain: float) -> float:
    """Return the gain from which a cause is as likely as one with this gain: the data do not distinguish them."""
    return gain - max(_RIVAL_GAIN, _RIVAL_SHARE * gain)


def leading_repair(
    causes: Sequence[tuple[str, float]], remedies: Mapping[str, Repair], *, several: bool = True
) -> Repair | None:
    """Return how the leading cause is taken into account, together with all that are as likely.

    Of causes that the data cannot tell apart the declarations of all are made: the wider of them, not the narrower.
    None where one of them has no repair, or an implausible one, or conversions of readings contradict each other.

    Parameters
    ----------
    causes : the likeliest first, with the gain in log-likelihood of each
    remedies : by the text of a cause
    several : whether to take several causes that are as likely; else None is returned for these
    """
    if not causes:
        return None
    first, most = causes[0]
    units = {text for text, _ in causes if text in remedies and remedies[text].rescales}
    # Of several units one is right, though each explains nearly as much.
    others = units - {first} if first in units else set()
    texts = [text for text, gain in causes if gain >= (most - _RIVAL_GAIN if text in others else as_likely(most))]
    found = [remedies[text] for text in texts if text in remedies and remedies[text].plausible]
    if len(found) < len(texts) or len(found) > _MOST_RIVALS:
        return None
    if len(found) == 1:
        return found[0]
    converted = [each.conversion for each in found if each.conversion is not None]
    # The unit of a link goes with a wider prior of that link; readings are what they are.
    if not several or len(converted) > 1 or not all(each.masses for each in converted):
        return None
    together: dict[str, Setting] = {}
    for each in found:
        for name, value in (each.parameters or {}).items():
            if not _covers(together.get(name), name, value):
                together[name] = value
    return replace(
        found[0],
        cause=', or '.join(each.cause for each in found),
        parameters=together,
        conversion=next(iter(converted), None),
    )
