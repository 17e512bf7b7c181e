"""The motion that follows the first of a campaign's run: planned from what is known by then, or drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbaid_ros.config.campaign import PLANNED
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array, Flags, cross
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.planning.planner import Planner
from mbaid_ros.planning.unplanned import simple_motion
from mbaid_ros.replay.jsonable import number
from mbaid_ros.session import Session
from mbaid_ros.session.planning import make_planner, plan_settings
from mbaid_ros.simulated_run import SimulatedRun

STOP, REST = 3.0, 0.5  # s, in which the joints come to rest before it, and rest after it


@dataclass(frozen=True, eq=False)
class Then:
    """A motion, and what it begins from.

    Attributes
    ----------
    kind : 'planned', or of the simple ones
    trajectory : JointTrajectory
    before : the largest relative standard deviation where it begins
    base : (2,) rad and m, by which it truly turns and displaces the base from where this would coast
    asked : (10,) which parameters can be known at all, as in a plane some cannot
    """

    kind: str
    trajectory: JointTrajectory
    before: float
    base: Array
    asked: Flags

    def told(self, final: Estimate, sizes: Array) -> dict[str, object]:
        """Return what came of it, by the last estimate and the sizes (10,) that standard deviations are relative to."""
        after = float(np.max((final.std / sizes)[self.asked]))  # NaN where one of them is not determined
        return {
            'motion': self.kind,
            'seconds': self.trajectory.duration,
            'before': number(self.before),
            'after': number(after),
            'turned': number(self.base[0]),
            'displaced': number(self.base[1]),
        }


@dataclass(frozen=True)
class ThenStatistics:
    """What the motions that follow come to, the medians over runs.

    Attributes
    ----------
    seconds : length
    before, after : largest relative standard deviation where it begins, and in the end; that of the runs in which every
        parameter is determined then
    halvings : of that, a minute of the motion
    turned, displaced : by which it moves the base, rad and m; the most of all runs
    """

    seconds: float
    before: float
    after: float
    halvings: float
    turned: float
    displaced: float

    @staticmethod
    def of(told: Sequence[Mapping[str, Any]]) -> ThenStatistics | None:
        """Return the statistics of what runs told; None of none."""
        if not told:
            return None
        names = ('seconds', 'before', 'after', 'turned', 'displaced')
        columns = {name: np.array([each[name] for each in told], dtype=float) for name in names}
        columns['halvings'] = np.log2(columns['before'] / columns['after']) / columns['seconds'] * 60.0
        most = {name: float(np.nanmax(columns.pop(name))) for name in ('turned', 'displaced')}
        return ThenStatistics(**{name: _median(column) for name, column in columns.items()}, **most)

    def as_json(self) -> dict[str, float | None]:
        """Return them as scripts read them."""
        return {name: number(value) for name, value in vars(self).items()}

    def __str__(self) -> str:
        """Return them in a line."""
        return (
            f'then {self.seconds:.1f} s: the least known {self._improved}; base turned by '
            f'{np.degrees(self.turned):.2f} deg, displaced by {self.displaced:.3g} m at most'
        )

    @property
    def _improved(self) -> str:
        begin = f'from {100.0 * self.before:.3g}'
        if np.isnan(self.after):
            return f'{begin} % to not determined'
        return f'{begin} to {100.0 * self.after:.3g} %, halved {self.halvings:.1f} times a minute'


def motion_of(kind: str, session: Session, simulated: SimulatedRun, seed: int) -> Then:
    """Return the motion that follows.

    Raises
    ------
    DataError
        Nothing is known to begin from.
    ParameterError
        No motion is possible.
    """
    knowledge = session.posterior()
    if knowledge is None:
        raise DataError('the first motion leads to no solution of method trajectory that another could begin from')
    planner = make_planner(session.config, knowledge)
    if kind == PLANNED:
        trajectory = planner.plan().trajectory
    else:
        trajectory = simple_motion(kind, planner.motions, plan_settings(session.config).base, seed)
    asked = planner.information.asked
    before = float(planner.information.relative[asked].max())
    return Then(kind, trajectory, before, _excursion(planner, knowledge, simulated, trajectory), asked)


def _median(values: Array) -> float:
    """Return the median of what is known of values; NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan


def _excursion(planner: Planner, knowledge: Posterior, simulated: SimulatedRun, trajectory: JointTrajectory) -> Array:
    """Return how far the motion turns and displaces the base of the robot as it truly is, rad and m."""
    state = knowledge.state
    layout, momentum = knowledge.layout, simulated.momentum.copy()
    momentum[3:] -= cross(knowledge.end.origin, momentum[:3])
    state[6:12], state[12:22] = momentum, simulated.target.parameters
    floating = planner.motions.as_if(layout.point(state, knowledge.deviation))
    return planner.motions.excursion_along(trajectory, floating)[:2]
