"""A planned motion: its trajectory, its precision, its use of the limits, and all of it in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.joint_trajectory import JointTrajectory

_WHOLE = 0.95  # of the longest motion that is looked for, from which one counts as that long
_MARGIN = 1.02  # ratio to the wanted precision, from which a plan is reported to possibly miss it
BINDING = 0.9  # part of a limit from which a motion is at it
# In order: limits of the joints, of base and passive joints, and the clearance of the robot from itself.
LIMITS = (
    'the position limits of the joints',
    'the velocity limits of the joints',
    'plan.joint_acceleration',
    'the effort limits of the joints',
    'plan.base_rotation',
    'plan.base_translation',
    'plan.base_rate',
    'plan.deflection',
    'plan.clearance',
)
# Name, unit and words of the effects of a motion on the base and on passive joints.
_EFFECTS = (
    ('rotation', 'rad', 'base turned by'),
    ('translation', 'm', 'base displaced by'),
    ('rate', 'rad/s', 'base turned faster or slower by'),
    ('deflection', 'rad (m)', 'passive joints swung by'),
)


@dataclass(frozen=True, eq=False)
class Bounds:
    """How far a motion moves base and passive joints at most from where they would coast, (4,): rad, m, rad/s, rad."""

    nominal: Array  # of the robot as it is known best
    robust: Array  # of robots as they may be as well, five standard deviations and more


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion."""

    trajectory: JointTrajectory  # of the joints that are moved
    target: str  # the link that is identified
    # before, wanted: (10,) relative standard deviations now, and as they are wanted
    std_before: Array
    wanted: Array
    determinable: Flags  # (10,) which of them a motion can determine
    # times, course: (W,) s since the begin of the motion, (W, 10) relative standard deviations then
    times: Array
    course: Array
    bounds: Bounds  # of the displacement of base and passive joints from their coasting motion
    base_limits: Array  # (4,) its limits, infinite where there is none
    use: Array  # (4, k) share of position, velocity, acceleration and effort limits that the joints use; 1 is all
    binding: tuple[str, ...]  # names of the limits that it is at
    shortest: bool  # whether the search was for the shortest that reaches the wanted precision
    longest: float  # s, that was looked for
    compared: int  # motions
    sampled_stds: Array  # relative standard deviations after the motion for bodies as the target may be, (D, 10)
    stuck: tuple[str, ...]  # joints that are not moved
    notes: tuple[str, ...]  # further notes, a line each

    @property
    def std_after(self) -> Array:
        """Relative standard deviations after the motion, (10,)."""
        return self.course[-1]

    @property
    def std_range(self) -> Array:
        """The smallest and the largest that these are for bodies as the target may be, (2, 10)."""
        every = np.concatenate((self.sampled_stds, self.std_after[None]))
        return np.stack((every.min(axis=0), every.max(axis=0)))

    @property
    def ratio(self) -> float:
        """The largest of them relative to the wanted precision, of those a motion can determine."""
        return float((self.std_after / self.wanted)[self.determinable].max())

    @property
    def reached(self) -> bool:
        """Whether the wanted precision is reached."""
        return self.ratio <= 1.0

    @property
    def worst(self) -> str:
        """Name of the parameter that is furthest from the wanted precision."""
        return PARAMETERS[int(np.argmax(np.where(self.determinable, self.std_after / self.wanted, -np.inf)))]

    @property
    def verdict(self) -> str:
        """The plan in one sentence: the precision it reaches, or the limit that prevents the wanted one."""
        place = PARAMETERS.index(self.worst)
        now, then, wanted = (f'{100.0 * each[place]:.3g} %' for each in (self.std_before, self.std_after, self.wanted))
        length = f'{self.trajectory.duration:.1f} s'
        known = f'{self.worst} of {self.target}'
        if self.reached:
            most = (self.std_range[1] / self.wanted)[self.determinable].max()
            margin = f' (up to {most:.2f} times it with the body as it may be)' if most > _MARGIN else ''
            return (
                f'{length} of motion bring every parameter of {self.target} below the wanted value{margin}; now '
                f'{known}: {now}'
            )
        at = f'; the motion is at {", ".join(self.binding)}' if self.binding else ''
        if self.shortest and self.trajectory.duration < _WHOLE * self.longest:
            return (
                f'none of {self.compared} motions brings {known} to {wanted}; {length} reach {then}, now {now}{at}; '
                'more plan.effort may find one'
            )
        if self.shortest:
            return (
                f'{wanted} is out of reach within {self.longest:g} s{at}; {length} reach {then} for {known}, now {now}'
            )
        return f'{length} of motion bring {known} from {now} to {then}, not to the wanted {wanted}{at}'

    @property
    def effects(self) -> Iterator[tuple[tuple[str, str, str], tuple[float, float, float]]]:
        """Those on base and passive joints, if there are any: name, unit, words; most, for certain, limit."""
        values = zip(self.bounds.nominal.tolist(), self.bounds.robust.tolist(), self.base_limits.tolist(), strict=True)
        return (each for each in zip(_EFFECTS, values, strict=True) if each[0][0] != 'deflection' or each[1][1] > 0.0)

    @property
    def excursions(self) -> tuple[str, ...]:
        """The effects of the motion on base and passive joints, a line each."""
        lines = []
        for (_, unit, words), (value, sure, limit) in self.effects:
            most = f' of {limit:.3g}' if np.isfinite(limit) else ''
            degrees = f' ({np.degrees(sure):.2g} deg{unit[3:]})' if unit in {'rad', 'rad/s'} else ''
            lines.append(f'{words} {value:.3g} {unit}, for certain below {sure:.3g}{most} {unit}{degrees}')
        return tuple(lines)
