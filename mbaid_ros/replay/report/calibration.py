"""The report of a calibration: for each body how far the data moved it, and what momentum can tell at all."""

from __future__ import annotations

import numpy as np

from mbaid_ros.calibration.result import LinkResult
from mbaid_ros.calibration.structure import base_parameter, formula
from mbaid_ros.cli import one_line
from mbaid_ros.core.results.parameters import PARAMETERS, UNITS
from mbaid_ros.replay.calibrated import Calibrated
from mbaid_ros.replay.calibrated_text import HEAD, JOINTS_HEAD, headline, joint_rows, rows, told
from mbaid_ros.replay.report.markup import listed, number, page, paragraph, table, text


def html(result: Calibrated) -> str:
    """Return a calibration as one HTML page that needs nothing else."""
    parts = [
        f'<h1>Calibration of {text(result.kernel.model.name)}</h1>',
        paragraph(', '.join(one_line(motion.bag) for motion in result.motions), 'note'),
        listed(result.survey.lines, 'model'),
        paragraph(headline(result), f'verdict {_look(result)}'),
        listed(result.warnings, 'warnings'),
        *(paragraph(each) for each in told(result)),
        '<h2>Bodies</h2>',
        table(HEAD, rows(result)),
        *(_body(link) for link in result.calibration.links),
        '<h2>Joints</h2>',
        paragraph('Beside the robot description, in the axes of each joint; the axis tilts about two normals of it.'),
        table(JOINTS_HEAD, joint_rows(result)),
        '<h2>What momentum can tell</h2>',
        paragraph('Each of these combinations has a value of its own; a body alone does not show.'),
        _combinations(result),
        '<h3>What cannot be told apart</h3>',
        paragraph('Taken from one body and given to the other, it changes no momentum: the prior alone divides it.'),
        table(('what', 'directions'), [(each.words, str(each.directions.shape[1])) for each in result.exchanges]),
    ]
    title = f'Calibration of {text(result.kernel.model.name)}'
    return page(title, parts)


def _look(result: Calibrated) -> str:
    if result.contradicted:
        return 'wrong'
    return 'bad' if result.warnings else 'good'


def _body(link: LinkResult) -> str:
    head = ('', 'CAD', 'std', 'calibrated', 'std', 'moved, prior std', 'learnt, %', 'unit')
    columns = zip(
        PARAMETERS, link.cad, link.prior_std, link.parameters, link.std, link.moved, link.learnt, UNITS, strict=True
    )
    cells = [
        (
            name,
            number(cad),
            number(before, 2),
            number(value),
            number(std, 2),
            number(moved, 2),
            f'{100 * learnt:.0f}',
            unit,
        )
        for name, cad, before, value, std, moved, learnt, unit in columns
    ]
    return f'<details><summary>{text(link.name)}</summary>{table(head, cells)}</details>'


def _combinations(result: Calibrated) -> str:
    calibration, links = result.calibration, result.kernel.unknown
    cells = []
    for each in result.base_parameters:
        factors = each.factors
        std = float(np.sqrt(factors @ calibration.covariance @ factors))
        cells.append(
            (
                base_parameter(calibration.mechanism, each),
                formula(links, factors),
                number(float(factors @ calibration.prior.mean)),
                number(float(factors @ calibration.theta)),
                number(std, 2),
            )
        )
    return table(('combination', 'of kg, kg m, kg m²', 'CAD', 'calibrated', 'std'), cells)
