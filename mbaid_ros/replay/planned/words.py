"""A plan for a terminal, and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbaid_ros.cli import one_line
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.planning.plan import Plan

_UNITS = ('rad', 'm', 'rad/s')
_OF_BASE = ('rotation', 'translation', 'rate')


def summary(plan: Plan) -> str:
    """Return a plan as a table for a terminal."""
    rows = [plan.verdict, '', '             now        after      wanted     as the body may be']
    rows += [
        f'  {name:6} {"  ".join(map(_percent, (now, then, wanted, least)))} to {_percent(most).strip()}'
        if asked
        else f'  {name:6} not told by any motion of this robot'
        for name, now, then, wanted, least, most, asked in zip(
            PARAMETERS, plan.before, plan.after, plan.wanted, *plan.between, plan.asked, strict=True
        )
    ]
    rows += [
        '  one standard deviation, as convergence.relative_std has it',
        f'  as the body may be: after the motion, for {len(plan.may_be)} bodies drawn from what is known now',
        *(f'  {line}' for line in plan.excursions),
        f'  {len(plan.trajectory.joints)} joints: {", ".join(plan.trajectory.joints)}',
    ]
    if plan.stuck:
        rows.append(f'  not moved: {", ".join(plan.stuck)}')
    if plan.binding:
        rows.append(f'  at its limit: {", ".join(plan.binding)}')
    rows.append(f'  best of {plan.compared} motions')
    return '\n'.join(map(one_line_kept, [*rows, *(f'  note: {note}' for note in plan.notes)]))


def one_line_kept(text: str) -> str:
    """Return a line fit for a terminal with the spaces it begins with and has within."""
    return text if text.isprintable() else one_line(text)


def _percent(value: float) -> str:
    return f'{100.0 * value:8.3g} %'


def as_json(plan: Plan) -> dict[str, Any]:
    """Return a plan as scripts read it; standard deviations are relative."""
    trajectory, limits = plan.trajectory, plan.base_limits
    return {
        'target_link': plan.target,
        'reached': plan.reached,
        'verdict': plan.verdict,
        'duration': trajectory.duration,
        'relative_std': {
            name: {'now': now, 'after': then, 'wanted': wanted, 'least': least, 'most': most} if asked else None
            for name, now, then, wanted, least, most, asked in zip(
                PARAMETERS,
                plan.before.tolist(),
                plan.after.tolist(),
                plan.wanted.tolist(),
                *plan.between.tolist(),
                plan.asked.tolist(),
                strict=True,
            )
        },
        'course': {'t': plan.course.time.tolist(), 'relative_std': plan.course.value.tolist()},
        'base': {
            name: {
                'unit': unit,
                'most': float(plan.bounds.nominal[place]),
                'certain': float(plan.bounds.sure[place]),
                'limit': float(limits[place]) if np.isfinite(limits[place]) else None,
            }
            for place, (name, unit) in enumerate(zip(_OF_BASE, _UNITS, strict=True))
        },
        'binding': list(plan.binding),
        'stuck': list(plan.stuck),
        'notes': list(plan.notes),
        'compared': plan.compared,
        'trajectory': {
            'joint_names': list(trajectory.joints),
            'time_from_start': trajectory.time.tolist(),
            'positions': trajectory.position.tolist(),
            'velocities': trajectory.velocity.tolist(),
            'accelerations': trajectory.acceleration.tolist(),
        },
    }
