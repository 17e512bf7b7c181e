"""What a calibration of bags leads to, as text: sentences and tables, for a terminal and for the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.calibration.result import LinkResult
from mbaid_ros.cli import one_line
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import BAND, PARAMETERS, rounded
from mbaid_ros.replay.calibrated import Calibrated


def headline(result: Calibrated) -> str:
    """Return the result in one sentence."""
    calibration = result.calibration
    count = len(calibration.links)
    bodies = f'{count} {"body" if count == 1 else "bodies"}'
    data = f'{calibration.samples} samples, {calibration.span:.3g} s; residual {calibration.residual:.2f}'
    if result.contradicted:
        return f'the data contradict the model, so the values of {bodies} must not be trusted: {data}'
    return f'{bodies} calibrated from {data}'


def told(result: Calibrated) -> list[str]:
    """Return what is determined and what fixes the scale, a sentence each."""
    calibration = result.calibration
    shares = ', '.join(f'{name} ({100.0 * share:.0f} %)' for name, share in calibration.scale.fixed_by[:3])
    structure = calibration.structure
    determined = (
        f'momentum can determine {structure.rank} combinations of {structure.unknowns} parameters; of '
        f'{calibration.determined}, joints and mount among them, the data say more than the prior'
    )
    std = f'{100.0 * calibration.scale.relative_std:.2g} %'
    lines = [determined, f'scale: total mass known to {std} (one standard deviation), fixed by {shares or "nothing"}']
    if np.any(calibration.stds[-6:]):
        mount = _beside(1e3 * calibration.mount[3:], 1e3 * calibration.stds[-3:])
        turn = _beside(1e3 * calibration.mount[:3], 1e3 * calibration.stds[-6:-3])
        lines.append(f'mount of the odometry, beside the URDF: {mount} mm, {turn} mrad (95 %)')
    for thruster in calibration.thrusters:
        strong = f'{thruster.scale:.4f} ± {BAND * thruster.scale_std:.2g} times as strong as commanded'
        turned = f'turned by {_beside(1e3 * thruster.turn, 1e3 * thruster.turn_std)} mrad'
        late = f'{1e3 * thruster.delay:+.1f} ± {1e3 * BAND * thruster.delay_std:.2g} ms late'
        lines.append(f'thruster {one_line(thruster.frame)}: {strong}, {turned}, {late} (95 %)')
    return [*lines, *(_ratios(link) for link in calibration.links if link.ratios.clearer)]


def _ratios(link: LinkResult) -> str:
    """Return what is known of a body's inertia where its scale is not."""
    ratios = link.ratios
    each = zip(ratios.principal.tolist(), ratios.principal_std.tolist(), strict=True)
    parts = ', '.join(' ± '.join(rounded(value, std)) for value, std in each)
    return (
        f'inertia of {one_line(link.name)}: known but for a factor, {100.0 * BAND * ratios.scale_std:.2g} % either '
        f'way; principal moments over their sum: {parts} (95 %)'
    )


def _beside(values: Array, stds: Array) -> str:
    """Return values with their common 95 % band in a few words."""
    return f'{" ".join(f"{each:+.2f}" for each in values)} ± {BAND * float(np.max(stds)):.2g}'


JOINTS_HEAD = ('joint', 'zero ± 95 %, mrad (mm)', 'origin moved ± 95 %, mm', 'axis tilted ± 95 %, mrad')


def joint_rows(result: Calibrated) -> list[tuple[str, str, str, str]]:
    """Return a line a joint: name, what is added to its reading, where its frame has moved, how it has turned."""
    calibration = result.calibration
    stds = 1e3 * calibration.stds[len(calibration.theta) : -6].reshape(-1, 6)
    each = zip(calibration.mechanism.kernel.model.joint_names, 1e3 * calibration.joints, stds, strict=True)
    return [
        (
            one_line(name),
            _beside(values[:1], std[:1]),
            _beside(values[1:4], std[1:4]),
            _beside(values[4:], std[4:]),
        )
        for name, values, std in each
    ]


def rows(result: Calibrated) -> list[tuple[str, str, str, str, str]]:
    """Return a line a body: name, mass, shift of the CoM, change of the inertia, what is hardly better known."""
    return [_row(link) for link in result.calibration.links]


def _row(link: LinkResult) -> tuple[str, str, str, str, str]:
    stayed = [name for name, each in zip(PARAMETERS, link.stayed, strict=True) if each]
    mass = ' ± '.join(rounded(float(link.parameters[0]), float(link.std[0])))
    before, com, moments = 'none', '-', '-'
    if link.cad[0] > 0.0:
        before = f'{link.cad[0]:.6g}'
        com = ' '.join(f'{1e3 * each:+.1f}' for each in (link.parameters - link.cad)[1:4])
        moments = f'{100.0 * (np.sum(link.parameters[[4, 7, 9]]) / np.sum(link.cad[[4, 7, 9]]) - 1.0):+.1f}'
    kept = 'all' if len(stayed) == 10 else ', '.join(stayed) or 'nothing'
    return one_line(link.name), f'{before} -> {mass}', com, moments, kept


HEAD = ('body', 'mass ± 95 %, kg', 'CoM moved, mm', 'moments, %', 'known no better than before')


def summary(result: Calibrated) -> str:
    """Return the result as a table for a terminal."""
    lines = [
        *map(one_line, result.survey.lines),
        '',
        headline(result),
        *(f'  {each}' for each in told(result)),
        '',
        *_columns([HEAD, *rows(result)]),
    ]
    joints = [JOINTS_HEAD, *joint_rows(result)]
    if len(joints) > 1 and np.any(result.calibration.stds[len(result.calibration.theta) : -6]):
        lines += ['', *_columns(joints)]
    return '\n'.join([*lines, *(f'  warning: {one_line(each)}' for each in result.warnings)])


def _columns(table: Sequence[Sequence[str]]) -> list[str]:
    """Return a table's rows, its columns one below the other."""
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    return ['  ' + '  '.join(f'{cell:{w}}' for cell, w in zip(row, widths, strict=True)).rstrip() for row in table]
