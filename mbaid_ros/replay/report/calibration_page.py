"""The page of a calibration."""

from __future__ import annotations

from mbaid_ros.calibration.result import LinkResult
from mbaid_ros.cli import one_line
from mbaid_ros.core.results.estimate import PARAMETERS, UNITS
from mbaid_ros.replay.calibration_text import HEAD, JOINTS_HEAD, Calibrated, headline, joint_rows, rows, sentences
from mbaid_ros.replay.report.markup import folded, listed, number, page, paragraph, table


def calibration_page(result: Calibrated) -> str:
    """Return the page of a calibration: for each body how far the data moved it."""
    look = 'wrong' if result.contradicted else 'bad' if result.warnings else 'good'
    parts = [
        paragraph(', '.join(one_line(motion.bag) for motion in result.motions), 'note'),
        listed(result.model_summary.lines, 'model'),
        paragraph(headline(result), f'verdict {look}'),
        listed(result.warnings, 'warnings'),
        *(paragraph(each) for each in sentences(result)),
        '<h2>Bodies</h2>',
        table(HEAD, rows(result)),
        *(_body(link) for link in result.calibration.links),
        '<h2>Joints</h2>',
        paragraph('Beside the robot description, in the axes of each joint; the axis tilts about two normals of it.'),
        table(JOINTS_HEAD, joint_rows(result)),
    ]
    return page(f'Calibration of {result.kernel.model.name}', parts)


def _body(link: LinkResult) -> str:
    head = ('', 'CAD', 'std', 'calibrated', 'std', 'moved, prior std', 'learnt, %', 'unit')
    columns = link.cad, link.prior_std, link.parameters, link.std, link.shift_in_prior_stds
    cells = [
        (name, *map(number, values, (6, 2, 6, 2, 2)), f'{100 * learnt:.0f}', unit)
        for name, *values, learnt, unit in zip(PARAMETERS, *columns, link.variance_reduction, UNITS, strict=True)
    ]
    return folded(link.name, table(head, cells))
