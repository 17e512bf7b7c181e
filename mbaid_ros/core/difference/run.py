"""A run, and what has disturbed it, as it is reported."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.difference.disturbances import Jump
from mbaid_ros.core.difference.effects import Axes
from mbaid_ros.core.difference.problem import Problem
from mbaid_ros.core.difference.steps import SteppedLikelihood
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.causes import PULSE, constant_force
from mbaid_ros.core.results.estimate import Event
from mbaid_ros.core.robot.kernel import MomentumKernel

_MOST_TOLD = 5  # events in the warnings
_LONG = 1.5  # s, from which a jump of the momentum is no pulse
# Chance of an estimate to be as large if there was nothing, from which on a jump is none, and a force is one.
_NOTHING, _CERTAIN = 1e-3, 1e-9
_ANYTHING = (
    'wrong known bodies (known_links.relative_std), order or sign of joints or twist frame, or a force that changes'
)


@dataclass
class Run:
    """What a run has led to: where it started, what its motion can tell, and the likelihood of that."""

    origin: Array
    problem: Problem
    likelihood: SteppedLikelihood
    started: float  # s since the first sample
    restarted: bool = False


@dataclass(frozen=True)
class Disturbances:
    """What has disturbed a run by an instant: events, warnings, (value, standard deviation) of a delay of the joints.

    `too_many` tells whether there are more than the model can be right with.
    """

    events: tuple[Event, ...]
    warnings: tuple[str, ...]
    delay: tuple[float, float]
    too_many: bool


def disturbances(run: Run) -> Disturbances:
    """Return what has disturbed a run by now."""
    events = (*_forces(run), *(_step(jump, run) for jump in run.likelihood.jumps))
    warnings = [str(event) for event in events[-_MOST_TOLD:]]
    too_many = run.likelihood.too_many
    if too_many:
        events = tuple(replace(event, cause=_ANYTHING) for event in events)
        warnings.append(f'the momentum seems to change all the time: {_ANYTHING}')
    late = delay(run)
    if late[1] > 0.0:
        warnings.append(f'JointState is stamped {1e3 * late[0]:.1f} ms late relative to Odometry; estimated along')
    return Disturbances(events, tuple(warnings), late, too_many=too_many)


def blamed(blame: Array, kernel: MomentumKernel) -> tuple[str, ...]:
    """Return the warning that (1 + b,) shares of the known bodies in the variance are worth: of all, and of each."""
    if blame[0] <= 0.5:
        return ()
    worst = int(np.argmax(blame[1:]))
    link = next(x.name for x in kernel.model.links if x.body == kernel.errors.bodies[worst])
    share, own = 100.0 * blame[0], 100.0 * blame[1 + worst]
    return (f'{share:.0f} % of the variance is due to the known bodies being uncertain, {own:.0f} % to {link} alone',)


def _step(jump: Jump, run: Run) -> Event:
    """Return a jump of the momentum as it is reported, about the odometry's origin."""
    change = run.problem.space.rows.T @ jump.value
    linear = change[:3]
    return Event(jump.start, 'step', linear, change[3:] + cross(run.origin, linear), _cause(jump))


def _cause(jump: Jump) -> str:
    """Return what may have made a jump of the momentum."""
    if not _tells(jump.value, jump.covariance, _NOTHING):
        return 'the momentum came back: a fault of the sensors, or two pulses that cancel'
    if jump.end - jump.start > _LONG:
        return f'a force or torque for {jump.end - jump.start:.1f} s: thrust or contact'
    return PULSE


def _forces(run: Run) -> tuple[Event, ...]:
    """Return the constant forces that act on the origin of the base link, if there are any."""
    found = [(item.place, item.kind) for item in run.likelihood.found if item.kind != 'delay']
    acting = found if run.problem.acting is None else [run.problem.acting]
    if not run.likelihood.ready:
        return ()
    return tuple(
        _force(axes, value, run)
        for value, covariance, axes in ((*run.likelihood.part(place), axes) for place, axes in acting)
        if len(found) == 1 or _tells(value, covariance, _CERTAIN)
    )


def _force(axes: Axes, value: Array, run: Run) -> Event:
    """Return a constant force and torque as it is reported."""
    wrench = run.problem.space.rows.T @ value
    cause = f'{constant_force(axes)}; estimated along, which widens the intervals'
    return Event(run.started, 'ramp', wrench[:3], wrench[3:], cause)


def delay(run: Run) -> tuple[float, float]:
    """Return how late the joints are stamped and its standard deviation, s; NaN where that was not found."""
    for found in run.likelihood.found:
        if found.kind == 'delay':
            value, covariance = run.likelihood.part(found.place)
            return float(value[0]), float(np.sqrt(covariance[0, 0]))
    return np.nan, np.nan


def _tells(value: Array, covariance: Array, chance: float) -> bool:
    """Return whether an estimate would be so far from zero by chance less often than that."""
    return bool(float(value @ np.linalg.solve(covariance, value)) > chi_square.limit(chance, len(value)))
