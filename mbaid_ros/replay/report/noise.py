"""How noisy the sensors have turned out to be, for the report."""

from __future__ import annotations

import math

from mbaid_ros.core.sensors.levels import CHANNELS, UNITS, SensorLevels
from mbaid_ros.replay.report.markup import listed, table


def section(levels: SensorLevels | None) -> str:
    """Return what is declared and found of each sensor, and in words what is not as declared; nothing of no run."""
    if levels is None:
        return ''
    rows = [
        (name.replace('_', ' '), *('' if math.isnan(each) else f'{each:.2g}' for each in (declared, found)), unit)
        for name, declared, found, unit in zip(CHANNELS, levels.declared, levels.found, UNITS, strict=True)
    ]
    return '<h3>Noise of a reading</h3>' + table(('sensor', 'declared', 'found', 'unit'), rows) + listed(levels.told())
