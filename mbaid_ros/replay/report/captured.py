"""The captured body alone, and what the capture tells of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.core.capture import Capture
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS, rounded
from mbaid_ros.replay.report import figures
from mbaid_ros.replay.report.markup import NO_NUMBER, PLUS_MINUS, number, paragraph, table
from mbaid_ros.replay.results import Run

MOMENTUM = ('linear x', 'linear y', 'linear z', 'angular x', 'angular y', 'angular z')
MOMENTUM_UNITS = (*('N s',) * 3, *('N m s',) * 3)
_MOTION = ('velocity x', 'velocity y', 'velocity z', 'spin x', 'spin y', 'spin z')
_MOTION_UNITS = (*('m/s',) * 3, *('rad/s',) * 3)


def captured_body(run: Run) -> str:
    """Return the captured body alone, where that was asked for."""
    if run.debris is None:
        return ''
    rows = [
        (name, *rounded(value, std, NO_NUMBER), unit)
        for name, unit, value, std in zip(
            PARAMETERS, figures.SHOWN_UNITS, run.debris.parameters, run.debris.std, strict=True
        )
    ]
    note = (
        f"The captured body alone, in frame '{run.debris.frame.name}': what is identified, less what the robot "
        f"description says of link '{run.target_link}' itself."
    )
    return (
        '<h3>Captured body</h3>' + table(('parameter', 'estimate', PLUS_MINUS, 'unit'), rows) + paragraph(note, 'note')
    )


def before_the_capture(run: Run) -> str:
    """Return the momentum of robot and captured body before the capture, where the bag holds one."""
    capture = run.capture
    if capture is None:
        return ''
    head = ('before the capture', 'captured body', PLUS_MINUS, 'robot alone', PLUS_MINUS, 'unit')
    own = _bands(capture.momentum, capture.covariance)
    robot = [('', '')] * 6 if capture.chaser is None else _bands(capture.chaser.momentum, capture.chaser.covariance)
    rows = [
        (name, *ours, *theirs, unit)
        for name, ours, theirs, unit in zip(MOMENTUM, own, robot, MOMENTUM_UNITS, strict=True)
    ]
    content = '<h3>Capture</h3>' + table(head, rows) + paragraph(_sentence(capture), 'note')
    motion = np.concatenate((capture.velocity, capture.spin))
    if not np.all(np.isfinite(motion)):
        return content
    moved = [(name, number(value, 4), unit) for name, value, unit in zip(_MOTION, motion, _MOTION_UNITS, strict=True)]
    note = 'Velocity of its centre of mass and its spin before the capture, from its momentum and what was identified.'
    return content + table(('captured body', 'estimate', 'unit'), moved) + paragraph(note, 'note')


def _bands(momentum: Array, covariance: Array) -> Sequence[tuple[str, str]]:
    stds = np.sqrt(np.diag(covariance))
    return [rounded(value, std, NO_NUMBER) for value, std in zip(momentum, stds, strict=True)]


def _sentence(capture: Capture) -> str:
    told = f'Captured at {capture.time:.4g} s. In the odometry frame, angular about its origin.'
    if capture.chaser is None:
        return f'{told} Nothing was measured before it.'
    return (
        f'{told} Until then the momentum of the known model was constant with a residual of '
        f'{capture.chaser.residual:.2f} standard deviations, over {capture.chaser.samples} samples.'
    )
