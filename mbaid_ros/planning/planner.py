"""From the posterior of a run to the motion that determines the uncertain rest, within limits."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.verdict import Reporting
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.planning.assurance import RobustLimits, beyond_motion, single_joint
from mbaid_ros.planning.collisions import Collisions, ReadMesh, no_mesh
from mbaid_ros.planning.efforts import JointEfforts
from mbaid_ros.planning.information import Grid, Information
from mbaid_ros.planning.motions import Motions
from mbaid_ros.planning.planned_motion import BINDING, LIMITS, Plan
from mbaid_ros.planning.requirements import BaseLimits, Goal, joint_limits, speed_held
from mbaid_ros.planning.search import Candidate, Search
from mbaid_ros.planning.splines import Splines

_FIRST = 20.0  # s, of the motions that a search begins with
_OTHER = 1.3  # ratio of lengths from which the robot's uncertainty changes the base's motion differently
_MOVING = 5e-3  # rad/s or m/s, from which a joint counts as moving: above the noise of one at rest
_WINDOW, _KNOTS = 0.5, 10  # s; as the estimator has them
_CLOSE = 1.2  # ratio to the wanted precision, from which more than a little length is missing
_SMALL = 0.2  # of the duration of a motion that is lengthened for the fine windows

Progress = Callable[[int], bool]  # takes the number of motions compared; returns whether to go on


@dataclass(frozen=True)
class PlanSettings:
    """Goal and limits of a motion."""

    relative: Array  # (10,) relative standard deviations wanted
    # duration, longest: s; the first 0 for the shortest that reaches them
    duration: float = 0.0
    longest: float = 300.0
    # joint_velocity, joint_acceleration: that no joint exceeds, rad/s and rad/s^2, or m
    joint_velocity: float = np.inf
    joint_acceleration: float = 0.1
    base: BaseLimits = field(default_factory=BaseLimits)  # how far the base may be moved
    clearance: float = 0.02  # m, of collision shapes
    stuck: Collection[str] = ()  # joints that are not moved
    held: Collection[str] = ()  # joints that keep their speed; empty: wheels, as `joint_limits` knows them
    speeds: int = 32  # that each joint goes by, one after the other
    effort: int = 1200  # motions that are compared
    seed: int = 0  # the same gives the same motion
    window: float = _WINDOW  # s, of the estimator


class Planner:
    """Plans motions from the end of a run.

    Raises ParameterError: The parameters contradict each other or the robot.

    Parameters
    ----------
    posterior : of the run
    reporting : has the sizes that standard deviations are relative to
    mesh : reads collision meshes, as `Collisions` has it

    Attributes
    ----------
    information : the information that motions add
    """

    def __init__(
        self, posterior: Posterior, reporting: Reporting, settings: PlanSettings, mesh: ReadMesh = no_mesh
    ) -> None:
        self._settings, self._mesh = settings, mesh
        self.information = Information(posterior, reporting)
        self._wanted = Goal(settings.relative, self.information.determinable)
        model = posterior.layout.kernel.model
        independent = model.transmission.independent
        passive = (model.joint_names[joint] for joint in posterior.layout.kernel.springs.joints)
        limits = joint_limits(
            model,
            posterior.end.joint_position[independent],
            settings.joint_velocity,
            settings.joint_acceleration,
            (*settings.stuck, *passive),
            speed_held(model, posterior.end.joint_velocity[independent], settings.joint_velocity, settings.held),
        )
        length = settings.duration or min(_FIRST, settings.longest)
        self.motions = Motions(
            posterior=posterior,
            information=self.information,
            splines=Splines(settings.speeds, length),
            limits=limits,
            efforts=_efforts(posterior),
        )
        self.motions.require_hold()

    @cached_property
    def _collisions(self) -> Collisions:
        posterior = self.motions.posterior
        return Collisions(
            posterior.layout.kernel.model, self._settings.clearance, posterior.end.joint_position, self._mesh
        )

    @cached_property
    def _assurance(self) -> RobustLimits:
        settings = self._settings
        return RobustLimits(self.motions, self._wanted, settings.base, self._collisions, settings.seed)

    @property
    def ratio(self) -> float:
        """The largest ratio of a standard deviation to the one that is wanted, as it is now."""
        return float(self._wanted.ratio(self.information.relative))

    def plan(self, progress: Progress = lambda _compared: True) -> Plan:
        """Return the motion.

        Raises ParameterError: The wanted precision has been reached already, or no motion at all is allowed.
        Raises ModelError: A collision shape cannot be read.

        Parameters
        ----------
        progress : called with the work done; if it returns False, the best so far is taken
        """
        settings = self._settings
        if not settings.duration and self.ratio <= 1.0:
            raise ParameterError(
                'every parameter has the wanted precision already; accepted: a smaller plan.relative_std, or a '
                'plan.duration'
            )
        clear = self._assurance.clear_part
        search = Search(self.motions, self._wanted, settings.base, settings.seed, clear, settings.effort)
        if not np.isfinite(search.best.cost):
            raise ParameterError(
                'no motion of the joints, however small, keeps the collision shapes of the robot apart; accepted: a '
                'smaller plan.clearance, or a start with more distance between them'
            )
        search.base = self._assurance.tightened_limits(search.best)
        compared = 0
        steps = search.improve() if settings.duration else search.shortest(settings.longest)
        length = search.best.duration
        for count in steps:
            compared += count
            if not 1.0 / _OTHER < search.best.duration / length < _OTHER:
                search.base, length = self._assurance.tightened_limits(search.best), search.best.duration
            if not progress(min(compared, settings.effort)) or compared >= settings.effort:
                break
        found = search.best if settings.duration else search.reached or search.nearest
        return self._finished(self._lengthened(self._assurance.scaled_to_bounds(found)), search.base, compared)

    def advice(self) -> str:
        """Return which joint, moved by itself, would help most; empty where all is known as well as is wanted."""
        return single_joint(self.motions, self._wanted, self._settings.base)

    def _advice(self, candidate: Candidate) -> list[str]:
        """Return remedies beside this motion."""
        beyond = beyond_motion(candidate.motions, candidate.speeds, candidate.motions.coarse, self._wanted)
        return [line for line in (self.advice(), beyond) if line]

    def _notes(self) -> list[str]:
        """Return notes on the start of the motion."""
        notes, posterior = [], self.motions.posterior
        model = posterior.layout.kernel.model
        names, held = model.independent_joints, self.motions.limits.held
        rate = np.abs(posterior.end.joint_velocity[model.transmission.independent])
        moving, kept = ([names[each] for each in np.flatnonzero(which & (rate > _MOVING))] for which in (~held, held))
        if kept:
            notes.append(f'keep their speed: {listing(kept)}')
        if moving:
            notes.append(f'moved at the end of the run, and must rest before the motion begins: {listing(moving)}')
        if posterior.hypothesis.disturbed:
            notes.append(f'{posterior.hypothesis.name}: the motion is planned as if that went on')
        return notes

    def _lengthened(self, candidate: Candidate) -> Candidate:
        """Return a motion, made longer until it reaches the wanted precision in the estimator's windows."""
        if self._settings.duration or candidate.ratio > _CLOSE:
            return candidate
        first = candidate.duration
        for _ in range(4):
            ratio = float(self._wanted.ratio(self._std_course(candidate)[-1]))
            longer = candidate.duration * max(ratio, 1.0) ** 0.7 * 1.005
            if ratio <= 1.0 or longer > min((1.0 + _SMALL) * first, self._settings.longest):
                break
            candidate = self._assurance.scaled_to_bounds(candidate.with_duration(longer))
        return candidate

    def _grid(self, duration: float) -> Grid:
        return Grid.over(duration, self._settings.window, max(round(self._settings.window / (_WINDOW / _KNOTS)), 5))

    def _std_course(self, candidate: Candidate) -> Array:
        """Return the relative standard deviations (W, 10) on the way, in windows as the estimator has them."""
        grid = self._grid(candidate.duration)
        return candidate.motions.relative(candidate.speeds[None], grid, every=1)[:, 0]

    def _finished(self, candidate: Candidate, base: BaseLimits, compared: int) -> Plan:
        motions, settings = candidate.motions, self._settings
        relative = self._std_course(candidate)
        model = motions.posterior.layout.kernel.model
        names = model.independent_joints
        moved = np.flatnonzero(motions.limits.moved)
        bounds = self._assurance.bounds(candidate)
        use = np.concatenate(
            (
                motions.splines.limit_use(candidate.speeds, motions.start, motions.limits),
                motions.effort(candidate.speeds[None]),
            )
        )[:, moved]
        # The limit of the search: a motion that reaches it is at its limit.
        of_base = np.maximum(bounds.nominal / base.array, bounds.robust / settings.base.array)
        trajectory, grid = motions.trajectory(candidate.speeds), self._grid(candidate.duration)
        return Plan(
            trajectory=trajectory,
            target=motions.posterior.layout.kernel.target.name,
            std_before=self.information.relative,
            wanted=settings.relative,
            determinable=self.information.determinable,
            times=grid.ends,
            course=relative,
            bounds=bounds,
            base_limits=settings.base.array,
            use=use,
            binding=tuple(
                name
                for name, part in zip(LIMITS, [*use.max(axis=1), *of_base, candidate.part < 1.0], strict=True)
                if part > BINDING
            ),
            shortest=not settings.duration,
            longest=settings.longest,
            compared=compared,
            sampled_stds=relative[-1] * self._assurance.std_ratios(motions, trajectory),
            stuck=tuple(name for place, name in enumerate(names) if not (place in moved or motions.limits.held[place])),
            notes=(*self._advice(candidate), *self._notes(), *self._collisions.notes),
        )


def _efforts(posterior: Posterior) -> JointEfforts:
    """Return the efforts of the robot as it is known best."""
    point, model = posterior.point, posterior.layout.kernel.model
    kernel = point.nominal.kernel
    return JointEfforts(model, kernel.body_parameters(point.body), kernel.storage, posterior.end.stored)
