"""The pages of a calibration and of a planned motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from mbaid_ros.calibration.result import LinkResult
from mbaid_ros.calibration.structure import base_parameter, formula
from mbaid_ros.cli import one_line
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS, UNITS
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.planning.plan import Plan
from mbaid_ros.replay.calibrated import HEAD, JOINTS_HEAD, Calibrated, headline, joint_rows, rows, sentences
from mbaid_ros.replay.report.markup import (
    NO_NUMBER,
    SERIES,
    TIME,
    Colour,
    entitle,
    figure,
    folded,
    legend,
    level,
    listed,
    new_axes,
    number,
    page,
    paragraph,
    svg,
    table,
)

_POSES = 7  # of the robot, from the begin of the motion to its end
_INSTANTS = 200  # of a curve
_MOST = 3  # joints in one diagram: as many as lines can be distinguished
_DEGREES = float(np.degrees(1.0))
_BASE = (('turned by [deg]', _DEGREES), ('displaced by [m]', 1.0), ('turned faster or slower by [deg/s]', _DEGREES))
_VIEWS = (('from above', (0, 1)), ('from the right', (0, 2)), ('from the front', (1, 2)))


def calibration_page(result: Calibrated) -> str:
    """Return the page of a calibration: for each body how far the data moved it, and the observable combinations."""
    look = 'wrong' if result.contradicted else 'bad' if result.warnings else 'good'
    parts = [
        paragraph(', '.join(one_line(motion.bag) for motion in result.motions), 'note'),
        listed(result.survey.lines, 'model'),
        paragraph(headline(result), f'verdict {look}'),
        listed(result.warnings, 'warnings'),
        *(paragraph(each) for each in sentences(result)),
        '<h2>Bodies</h2>',
        table(HEAD, rows(result)),
        *(_body(link) for link in result.calibration.links),
        '<h2>Joints</h2>',
        paragraph('Beside the robot description, in the axes of each joint; the axis tilts about two normals of it.'),
        table(JOINTS_HEAD, joint_rows(result)),
        '<h2>Observable combinations</h2>',
        paragraph('Only these combinations are observable, not each body alone.'),
        _combinations(result),
    ]
    return page(f'Calibration of {result.kernel.model.name}', parts)


def _body(link: LinkResult) -> str:
    head = ('', 'CAD', 'std', 'calibrated', 'std', 'moved, prior std', 'learnt, %', 'unit')
    columns = link.cad, link.prior_std, link.parameters, link.std, link.moved
    cells = [
        (name, *map(number, values, (6, 2, 6, 2, 2)), f'{100 * learnt:.0f}', unit)
        for name, *values, learnt, unit in zip(PARAMETERS, *columns, link.learnt, UNITS, strict=True)
    ]
    return folded(link.name, table(head, cells))


def _combinations(result: Calibrated) -> str:
    calibration = result.calibration
    cells = []
    for each in result.base_parameters:
        factors = each.factors
        std = float(np.sqrt(factors @ calibration.covariance @ factors))
        cad, value = number(float(factors @ calibration.prior.mean)), number(float(factors @ calibration.theta))
        words = base_parameter(calibration.mechanism, each), formula(result.kernel.unknown, factors)
        cells.append((*words, cad, value, number(std, 2)))
    return table(('combination', 'of kg, kg m, kg m²', 'CAD', 'calibrated', 'std'), cells)


def plan_page(plan: Plan, model: RobotModel, start: Array, made_by: Sequence[str]) -> str:
    """Return the page of a plan: the precision it reaches, the motion of joints and base, and its origin, a line each.

    `start` is (n,), where the robot's joints are at the begin.
    """
    trajectory = plan.trajectory
    parts = [
        paragraph(
            f'{len(trajectory.joints)} joints, {trajectory.duration:.4g} s, to identify the inertia of {plan.target}',
            'note',
        ),
        paragraph(plan.verdict, f'verdict {"good" if plan.reached else "bad"}'),
        listed(plan.notes, 'warnings'),
        '<h2>Precision</h2>',
        table(('', 'now', 'after the motion', 'over the posterior', 'wanted'), _precision(plan)),
        paragraph(
            'One standard deviation: of the mass relative to it, of the centre of mass to convergence.length, of the '
            f'inertia to its moments. Over the posterior: after the motion, for {len(plan.may_be)} bodies drawn from '
            'it.',
            'note',
        ),
        figure(_curves(plan), 'Predicted standard deviations, relative to the wanted ones: the motion suffices at 1.'),
        '<h2>Motion of the joints</h2>',
        figure(_joints(plan), 'Relative to the start; the points are those of the trajectory.'),
        table(('', 'of its range', 'of its velocity', 'of its acceleration', 'of its effort'), _use(plan)),
        figure(
            _poses(plan, model, start), 'The arm at equal times, in base axes: blue at the begin, green at the end.'
        ),
        '<h2>Motion of the base</h2>',
        table(('', 'most', 'for certain below', 'limit'), _excursions(plan)),
        paragraph(
            'Relative to the base with the joints at rest. "For certain" covers five standard deviations, and all '
            'robots that were drawn.',
            'note',
        ),
        figure(_base(plan), 'Relative to the base with the joints at rest; dashed: the limit.'),
        listed((f'best of {plan.compared} motions', *made_by), 'model'),
    ]
    return page(f'Planned motion of {model.name}', parts)


def _precision(plan: Plan) -> list[tuple[str, ...]]:
    columns = zip(PARAMETERS, plan.before, plan.after, *plan.between, plan.wanted, plan.asked, strict=True)
    cells: list[tuple[str, ...]] = []
    for name, *values, asked in columns:
        now, then, least, most, wanted = (f'{number(100.0 * value, 3)} %' for value in values)
        none = (name, NO_NUMBER, 'by no motion of this robot', NO_NUMBER, NO_NUMBER)
        cells.append((name, now, then, f'{least} to {most}', wanted) if asked else none)
    return cells


def _use(plan: Plan) -> list[tuple[str, ...]]:
    columns = zip(plan.trajectory.joints, *plan.use, strict=True)
    moved = [(name, *(f'{100.0 * part:.0f} %' for part in parts)) for name, *parts in columns]
    return [*moved, *((name, 'not moved', '', '', '') for name in plan.stuck)]


def _excursions(plan: Plan) -> list[tuple[str, ...]]:
    cells: list[tuple[str, ...]] = []
    for (name, size), *values in zip(_BASE, plan.bounds.nominal, plan.bounds.sure, plan.base_limits, strict=True):
        most, sure, limit = (size * value for value in values)
        cells.append((name, number(most, 3), number(sure, 3), number(limit, 3) if np.isfinite(limit) else 'none'))
    return cells


def _curves(plan: Plan) -> str:
    chart, (axis,) = new_axes(1, 1, 2.6)
    time = np.insert(plan.course.time, 0, 0.0)
    ratios = np.concatenate((plan.before[None], plan.course.value)) / plan.wanted
    worst = PARAMETERS.index(plan.worst)
    for index, name in enumerate(PARAMETERS):
        if plan.asked[index]:
            colour, width = (Colour.FIRST, 1.8) if index == worst else (Colour.FAINT, 0.9)
            axis.semilogy(time, ratios[:, index], color=colour, linewidth=width, zorder=3 if index == worst else 2)
            axis.annotate(f' {name}', (time[-1], ratios[-1, index]), color=colour, fontsize=7, va='center')
    level(axis, 1.0, Colour.SECOND, '--', 1.2)
    axis.set_xlim(0.0, 1.06 * time[-1])
    entitle(axis, 'standard deviation over the wanted one', TIME)
    return svg(chart, 'course', 'Predicted standard deviations over time')


def _joints(plan: Plan) -> str:
    trajectory = plan.trajectory
    chart, axes = new_axes(-(-len(trajectory.joints) // _MOST), 1, 2.0, sharex=True)
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
    axes[-1].set_xlabel(TIME, color=Colour.INK, fontsize=8)
    return svg(chart, 'joints', 'Joint positions over time')


def _base(plan: Plan) -> str:
    chart, axes = new_axes(1, 3, 2.2)
    for index, (axis, (name, size)) in enumerate(zip(axes, _BASE, strict=True)):
        axis.plot(plan.base.time, size * plan.base.value[:, index], color=Colour.FIRST, linewidth=1.4)
        if np.isfinite(plan.base_limits[index]):
            level(axis, size * plan.base_limits[index], Colour.SECOND, '--', 1.2)
        axis.set_ylim(bottom=0.0)
        axis.set_xlim(0.0, plan.base.time[-1])
        entitle(axis, name, TIME)
    return svg(chart, 'base', 'How far the motion moves the base')


def _poses(plan: Plan, model: RobotModel, start: Array) -> str:
    """Return the arm at several instants, in three views."""
    chains = _chains(plan, model, start)
    chart, axes = new_axes(1, 3, 3.2)
    for axis, (title, (right, up)) in zip(axes, _VIEWS, strict=True):
        for place, bones in enumerate(chains):
            colour = Colour.FIRST if place == 0 else Colour.THIRD if place == _POSES - 1 else Colour.FAINT
            _draw(axis, bones[:, :, [right, up]], colour, 0.8 if colour == Colour.FAINT else 1.8)
        axis.plot(0.0, 0.0, marker='s', markersize=6, color=Colour.INK)
        axis.set_aspect('equal', adjustable='datalim')
        entitle(axis, f'{title}: {"xyz"[right]}, {"xyz"[up]} [m]')
    return svg(chart, 'poses', 'The arm along the motion')


def _draw(axis: Axes, bones: Array, colour: str, width: float) -> None:
    for bone in bones:
        axis.plot(*bone.T, color=colour, linewidth=width, solid_capstyle='round', zorder=4 if width > 1.0 else 3)


def _chains(plan: Plan, model: RobotModel, start: Array) -> Array:
    """Return the arm's straight lines at instants, (T, b, 2, 3) m from the base's origin, base axes."""
    times = np.linspace(0.0, plan.trajectory.duration, _POSES)
    transmission = model.transmission
    position = np.tile(start[transmission.independent], (_POSES, 1))
    places = [model.independent_joints.index(name) for name in plan.trajectory.joints]
    position[:, places] = plan.trajectory.at(times)[0]
    upright = np.broadcast_to(np.eye(3), (_POSES, 3, 3))
    placed = Kinematics(model).configure(upright, transmission.positions(position))
    bones = [
        np.stack((placed.position[:, parent], placed.position[:, joint + 1]), axis=1)
        for joint, parent in enumerate(model.parents)
    ]
    target = model.link(plan.target)
    centre = placed.link(target)[1]
    return np.stack([*bones, np.stack((placed.position[:, target.body], centre), axis=1)], axis=1)
