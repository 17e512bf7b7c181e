"""Robust limits of a motion over the posterior of the robot, and the most informative single joint."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.core.state import Point
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.planning.collisions import INSTANTS, Collisions
from mbaid_ros.planning.floating import FloatingRobot
from mbaid_ros.planning.information import Grid
from mbaid_ros.planning.motions import Motions
from mbaid_ros.planning.planned_motion import Bounds
from mbaid_ros.planning.requirements import BaseLimits, Goal
from mbaid_ros.planning.search import Candidate
from mbaid_ros.planning.splines import Splines

_DRAWS, _MORE_DRAWS = 12, 32  # robots as they may be as well: on the way, and of the motion that is taken
_COMPARED = 8  # of these, for which the plan reports the precision
_SURE = 5.0  # standard deviations of the base's motion that are kept from its limits
_PARTS = (1.0, 0.85, 0.7, 0.5, 0.35, 0.2, 0.1, 0.05)  # to which motions are made smaller, for the robot to stay apart


class RobustLimits:
    """Scales motions down to their limits for all likely robots.

    Parameters
    ----------
    motions : from where the run ended, of any length
    wanted : their goal
    base : limits of the base's motion
    collisions : between the shapes of the robot
    seed : of the robots that are drawn
    """

    def __init__(self, motions: Motions, wanted: Goal, base: BaseLimits, collisions: Collisions, seed: int) -> None:
        self._motions, self._wanted, self._base, self._collisions = motions, wanted, base, collisions
        self._seed = seed

    @cached_property
    def _points(self) -> list[Point]:
        return self._motions.posterior.drawn(_MORE_DRAWS, self._seed)

    @cached_property
    def _draws(self) -> list[FloatingRobot]:
        return [self._motions.at_point(point) for point in self._points]

    def clear_part(self, motions: Motions, speeds: Array) -> float:
        """Return the largest part of its size that keeps a motion (K, k) clear of the robot; 0 where none does."""
        if not self._collisions.pairs:
            return 1.0
        times = np.linspace(0.0, motions.splines.duration, INSTANTS)
        return next(
            (part for part in _PARTS if self._collisions.clear(motions.joints(part * speeds[None], times)[0][:, 0])),
            0.0,
        )

    def bounds(self, candidate: Candidate, draws: int = _MORE_DRAWS) -> Bounds:
        """Return the largest motion of the base, of the best estimate of the robot and of samples of its posterior."""
        nominal = candidate.motions.excursions(candidate.speeds[None])[0]
        every = candidate.motions.excursions_of(self._draws[:draws], candidate.speeds)
        spread = np.sqrt(np.mean((every - nominal) ** 2, axis=0))
        return Bounds(nominal, np.maximum(every.max(axis=0), nominal + _SURE * spread))

    def tightened_limits(self, candidate: Candidate) -> BaseLimits:
        """Return limits of the nominal robot that keep all samples within their own."""
        limits = self._base.array
        if not np.isfinite(limits).any():
            return self._base
        bounds = self.bounds(candidate, _DRAWS)
        part = np.clip(bounds.nominal / np.maximum(bounds.robust, 1e-300), 0.05, 1.0)
        return BaseLimits(*(limits * part).tolist())

    def scaled_to_bounds(self, candidate: Candidate) -> Candidate:
        """Return a motion scaled down to the limits of efforts, collision shapes and the base."""
        for _ in range(4):
            use = float((self.bounds(candidate).robust / self._base.array).max())
            effort = candidate.motions.effort(candidate.speeds[None])
            use = max(use, float(candidate.motions.beside_holding(effort).max()))
            if use <= 1.0:
                break
            candidate = self._evaluated(candidate, candidate.speeds * 0.98 / use)
        if (part := self.clear_part(candidate.motions, candidate.speeds)) < 1.0:
            candidate = replace(self._evaluated(candidate, candidate.speeds * part), part=part)
        return candidate

    def _evaluated(self, candidate: Candidate, speeds: Array) -> Candidate:
        relative = candidate.motions.relative(speeds[None], candidate.motions.coarse)[0]
        ratio, cost = float(self._wanted.ratio(relative)), float(self._wanted.cost(relative))
        return replace(candidate, speeds=speeds, cost=cost, ratio=ratio)

    def std_ratios(self, motions: Motions, trajectory: JointTrajectory) -> Array:
        """Return standard deviations after a motion relative to the nominal body's, (_COMPARED, 10)."""
        points = (motions.posterior.point, *self._points[:_COMPARED])
        # For a ratio the search's few windows are as good as the estimator's.
        known, *others = (motions.relative_along(trajectory, motions.coarse, point) for point in points)
        return np.stack(others) / known


_LENGTH = 10.0  # s, of a joint's motion there and back
_TURN, _SLIDE = np.radians(20.0), 0.2  # rad, m, that it takes where its limits allow
_WAY = 8  # speeds of a way there, and as many of the way back
_AND_BACK = np.repeat([1.0, -1.0], _WAY)
_MOSTLY = 0.5  # share of a variance, from which one cause is reported
_LITTLE = 0.95  # of a standard deviation that a motion leaves, from which it improves nothing to speak of


def single_joint(motions: Motions, wanted: Goal, base: BaseLimits) -> str:
    """Return the single joint whose motion there and back improves the worst parameter most.

    Empty where everything is known as well as is wanted.
    """
    information, model = motions.information, motions.posterior.layout.kernel.model
    if wanted.ratio(information.relative) <= 1.0:
        return ''
    alone = replace(motions, splines=Splines(2 * _WAY, _LENGTH))
    there = alone.splines.basis(np.array([0.5 * _LENGTH]))[0] @ _AND_BACK
    independent = model.transmission.independent
    size = np.where(np.array(model.prismatic)[independent], _SLIDE, _TURN)
    moved = np.flatnonzero(motions.limits.moved)
    speeds: Array = np.zeros((len(moved), 2 * _WAY, len(size)))
    # Towards the middle of its range: there is more room.
    limits = motions.limits
    bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    centre = np.full(len(size), np.inf)
    centre[bounded] = 0.5 * (limits.lower[bounded] + limits.upper[bounded])
    towards = size / there * np.where(motions.start > centre, -1.0, 1.0)
    speeds[np.arange(len(moved)), :, moved] = towards[moved, None] * _AND_BACK
    speeds = alone.scaled_to_limits(alone.limited(speeds), base)
    after = alone.relative(speeds, alone.coarse)
    worst = int(np.argmax(np.where(wanted.determinable, information.relative / wanted.relative, -np.inf)))
    best = int(np.argmin(after[:, worst]))
    joint = int(moved[best])
    amount = abs(float(speeds[best, 0, joint])) * there
    turn = f'{amount:.2g} m' if model.prismatic[independent[joint]] else f'{np.degrees(amount):.2g} deg'
    before, then = (f'{100.0 * value:.3g} %' for value in (information.relative[worst], after[best, worst]))
    if after[best, worst] > _LITTLE * information.relative[worst]:
        instead = beyond_motion(alone, speeds[best], alone.coarse, wanted)
        return f'no single joint improves {PARAMETERS[worst]}, known to {before}' + (f': {instead}' if instead else '')
    return (
        f'best single joint: {model.independent_joints[joint]}, {turn} there and back in {_LENGTH:g} s reduce '
        f'{PARAMETERS[worst]} from {before} to {then}'
    )


def beyond_motion(motions: Motions, speeds: Array, grid: Grid, wanted: Goal) -> str:
    """Return the main source of the uncertainty that a motion (K, k) leaves, if it is no sensor's noise.

    Empty if the motion reaches the wanted precision, or no cause dominates the rest.
    """
    position, rate = motions.joints(speeds[None], grid.half_steps)
    base = motions.floating.base_motion(position, rate, grid.spacing)
    seen = (position[::2], rate[::2])
    after = motions.information.std_after(grid, seen, base)[0]
    if wanted.ratio(after) <= 1.0:
        return ''
    worst = int(np.argmax(np.where(wanted.determinable, after / wanted.relative, -np.inf)))
    causes, shares = motions.information.shares(grid, seen, base)
    if not causes or shares[worst].max() < _MOSTLY:
        return ''
    cause = int(np.argmax(shares[worst]))
    return (
        f'{100.0 * shares[worst, cause]:.0f} % of the remaining variance of {PARAMETERS[worst]} comes from '
        f'{causes[cause]}: calibrate or weigh it, because more motion hardly helps'
    )
