"""The report of a planned motion: what it tells, how the joints move, what it does to the base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.planning.plan import Plan
from mbaid_ros.replay.report.canvas import FAINT, FIRST, INK, SECOND, SERIES, THIRD, entitle, legend, new_axes, svg
from mbaid_ros.replay.report.markup import NO_NUMBER, figure, listed, number, page, paragraph, table, text

_POSES = 7  # of the robot, from the begin of the motion to its end
_INSTANTS = 200  # of a curve
_TIME = 'time [s]'
_MOST = 3  # joints in one diagram: as many as lines are told apart
_DEGREES = float(np.degrees(1.0))
_BASE = (('turned by [deg]', _DEGREES), ('displaced by [m]', 1.0), ('turned faster or slower by [deg/s]', _DEGREES))
_VIEWS = (('from above', (0, 1)), ('from the right', (0, 2)), ('from the front', (1, 2)))


def html(plan: Plan, model: RobotModel, start: Array, made_by: Sequence[str]) -> str:
    """Return a plan as one HTML page that needs nothing else.

    Parameters
    ----------
    plan : Plan
    model : of the robot
    start : (n,) where its joints are at the begin
    made_by : by what, a line each
    """
    title = f'Planned motion of {text(model.name)}'
    trajectory = plan.trajectory
    parts = [
        f'<h1>{title}</h1>',
        paragraph(
            f'{len(trajectory.joints)} joints, {trajectory.duration:.4g} s, to tell the inertia of {plan.target}',
            'note',
        ),
        paragraph(plan.verdict, f'verdict {"good" if plan.reached else "bad"}'),
        listed(plan.notes, 'warnings'),
        '<h2>What it tells</h2>',
        table(('', 'now', 'after the motion', 'as the body may be', 'wanted'), _told(plan)),
        paragraph(
            'One standard deviation: of the mass relative to it, of the centre of mass to convergence.length, of the '
            f'inertia to its moments. As the body may be: after the motion, for {len(plan.may_be)} bodies drawn from '
            'what is known now.',
            'note',
        ),
        figure(_course(plan), 'Predicted standard deviations, relative to what is wanted: the motion has done at 1.'),
        '<h2>What the joints do</h2>',
        figure(_joints(plan), 'Away from where they begin; the points are those of the trajectory.'),
        table(('', 'of its range', 'of its velocity', 'of its acceleration', 'of its effort'), _use(plan)),
        figure(
            _poses(plan, model, start), 'The arm at equal times, in base axes: blue at the begin, green at the end.'
        ),
        '<h2>What it does to the base</h2>',
        table(('', 'most', 'for certain below', 'limit'), _excursions(plan)),
        paragraph(
            'From where the base would be with the joints at rest; for certain is five standard deviations, and all '
            'of the robots that were drawn.',
            'note',
        ),
        figure(_base(plan), 'Away from where the base would be with the joints at rest; dashed: the limit.'),
        listed((f'best of {plan.compared} motions', *made_by), 'model'),
    ]
    return page(title, parts)


def _percent(value: float) -> str:
    return f'{number(100.0 * value, 3)} %'


def _told(plan: Plan) -> list[tuple[str, ...]]:
    columns = zip(PARAMETERS, plan.before, plan.after, *plan.between, plan.wanted, plan.asked, strict=True)
    return [
        (name, _percent(now), _percent(then), f'{_percent(least)} to {_percent(most)}', _percent(wanted))
        if asked
        else (name, NO_NUMBER, 'by no motion of this robot', NO_NUMBER, NO_NUMBER)
        for name, now, then, least, most, wanted, asked in columns
    ]


def _use(plan: Plan) -> list[tuple[str, ...]]:
    rows = zip(plan.trajectory.joints, *plan.use, strict=True)
    moved = [(name, *(f'{100.0 * part:.0f} %' for part in parts)) for name, *parts in rows]
    return [*moved, *((name, 'not moved', '', '', '') for name in plan.stuck)]


def _excursions(plan: Plan) -> list[tuple[str, ...]]:
    rows = zip(_BASE, plan.bounds.nominal, plan.bounds.sure, plan.base_limits, strict=True)
    found = [(name, *(size * value for value in values)) for (name, size), *values in rows]
    return [
        (name, number(most, 3), number(sure, 3), number(limit, 3) if np.isfinite(limit) else 'none')
        for name, most, sure, limit in found
    ]


def _course(plan: Plan) -> str:
    chart, (axis,) = new_axes(1, 1, 2.6)
    time = np.insert(plan.course.time, 0, 0.0)
    ratios = np.concatenate((plan.before[None], plan.course.value)) / plan.wanted
    worst = PARAMETERS.index(plan.worst)
    for index, name in enumerate(PARAMETERS):
        if plan.asked[index]:
            colour, width = (FIRST, 1.8) if index == worst else (FAINT, 0.9)
            axis.semilogy(time, ratios[:, index], color=colour, linewidth=width, zorder=3 if index == worst else 2)
            axis.annotate(f' {name}', (time[-1], ratios[-1, index]), color=colour, fontsize=7, va='center')
    axis.axhline(1.0, color=SECOND, linestyle='--', linewidth=1.2)
    axis.set_xlim(0.0, 1.06 * time[-1])
    entitle(axis, 'standard deviation over the one that is wanted')
    axis.set_xlabel(_TIME, color=INK, fontsize=8)
    return svg(chart, 'course', 'Predicted standard deviations over time')


def _joints(plan: Plan) -> str:
    trajectory = plan.trajectory
    count = -(-len(trajectory.joints) // _MOST)
    chart, axes = new_axes(count, 1, 2.0, sharex=True)
    times = np.linspace(0.0, trajectory.duration, _INSTANTS)
    begin = trajectory.position[0]
    position = np.degrees(trajectory.at(times)[0] - begin)
    points = np.degrees(trajectory.position - begin)
    for place, axis in enumerate(axes):
        names = trajectory.joints[place * _MOST : (place + 1) * _MOST]
        for index, (name, (colour, line)) in enumerate(zip(names, SERIES, strict=False), start=place * _MOST):
            axis.plot(times, position[:, index], color=colour, linestyle=line, linewidth=1.4, label=name)
            axis.plot(trajectory.time, points[:, index], 'o', color=colour, markersize=3)
        entitle(axis, f'{", ".join(names)} [deg]')
        axis.tick_params(labelbottom=True)
        legend(axis, _MOST)
    axes[-1].set_xlim(0.0, trajectory.duration)
    axes[-1].set_xlabel(_TIME, color=INK, fontsize=8)
    return svg(chart, 'joints', 'Joint positions over time')


def _base(plan: Plan) -> str:
    chart, axes = new_axes(1, 3, 2.2)
    for index, (axis, (name, size)) in enumerate(zip(axes, _BASE, strict=True)):
        axis.plot(plan.base.time, size * plan.base.value[:, index], color=FIRST, linewidth=1.4)
        if np.isfinite(plan.base_limits[index]):
            axis.axhline(size * plan.base_limits[index], color=SECOND, linestyle='--', linewidth=1.2)
        axis.set_ylim(bottom=0.0)
        axis.set_xlim(0.0, plan.base.time[-1])
        entitle(axis, name)
        axis.set_xlabel(_TIME, color=INK, fontsize=8)
    return svg(chart, 'base', 'How far the motion moves the base')


def _poses(plan: Plan, model: RobotModel, start: Array) -> str:
    """Return the arm at several instants, in three views."""
    chains = _chains(plan, model, start)
    chart, axes = new_axes(1, 3, 3.2)
    for axis, (title, (right, up)) in zip(axes, _VIEWS, strict=True):
        for place, bones in enumerate(chains):
            part = place / (_POSES - 1)
            colour = FIRST if place == 0 else THIRD if place == _POSES - 1 else FAINT
            _draw(axis, bones[:, :, [right, up]], colour, 1.8 if part in {0.0, 1.0} else 0.8)
        axis.plot(0.0, 0.0, marker='s', markersize=6, color=INK)
        axis.set_aspect('equal', adjustable='datalim')
        entitle(axis, f'{title}: {"xyz"[right]}, {"xyz"[up]} [m]')
    return svg(chart, 'poses', 'The arm along the motion')


def _draw(axis: Axes, bones: Array, colour: str, width: float) -> None:
    for bone in bones:
        axis.plot(*bone.T, color=colour, linewidth=width, solid_capstyle='round', zorder=4 if width > 1.0 else 3)


def _chains(plan: Plan, model: RobotModel, start: Array) -> Array:
    """Return the arm's straight lines at instants, (T, b, 2, 3) m from the base's origin, base axes."""
    times = np.linspace(0.0, plan.trajectory.duration, _POSES)
    moved = model.transmission
    position = np.tile(start[moved.independent], (_POSES, 1))
    places = [model.independent_joints.index(name) for name in plan.trajectory.joints]
    position[:, places] = plan.trajectory.at(times)[0]
    upright = np.broadcast_to(np.eye(3), (_POSES, 3, 3))
    placed = Kinematics(model).configure(upright, moved.positions(position))
    bones = [
        np.stack((placed.position[:, parent], placed.position[:, joint + 1]), axis=1)
        for joint, parent in enumerate(model.parents)
    ]
    target = model.link(plan.target)
    centre = placed.link(target)[1]
    return np.stack([*bones, np.stack((placed.position[:, target.body], centre), axis=1)], axis=1)
