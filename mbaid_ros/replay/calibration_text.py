"""The result of a calibration: verdicts and warnings, and the sentences and tables of terminal and report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.calibration.result import Calibration, LinkResult
from mbaid_ros.cli import one_line
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.contracts import underestimated_text
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import BAND, PARAMETERS, rounded
from mbaid_ros.core.results.verdict import IDENTIFIABLE_STD, LARGEST_RESIDUAL
from mbaid_ros.core.robot.body import LENGTH
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.errors import listing
from mbaid_ros.replay.one_bag import BagMotions
from mbaid_ros.session.model_summary import ModelSummary, summarise, unmoved_joints

_FIRST, _SECOND = np.array([4, 4, 4, 7, 7, 9]), np.array([4, 7, 9, 7, 9, 9])
# Thresholds of warnings: relative standard deviation of the scale; standard deviations of the prior; of the estimate.
_LOOSE_SCALE, _UNLIKELY, _LARGE_CORRECTION = 0.01, 4.0, 3.0


@dataclass(frozen=True)
class Calibrated:
    """A calibration, the motions in each bag, the kernel with the unknown links, and the parameters."""

    calibration: Calibration
    motions: tuple[BagMotions, ...]
    kernel: MomentumKernel
    config: EstimatorConfig

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model: the result must not be trusted."""
        return self.calibration.residual > LARGEST_RESIDUAL

    @property
    def unsolvable(self) -> bool:
        """Whether the data contradict the model so far that there is no solution near it."""
        return not self.calibration.converged and (self.contradicted or bool(self.unmoved))

    @cached_property
    def model_summary(self) -> ModelSummary:
        """The model summary."""
        heard = {name for motion in self.motions for name in motion.heard}
        return summarise(self.kernel.model, heard=heard, unknown=[link.name for link in self.kernel.unknown])

    @property
    def unmoved(self) -> str:
        """The cause that joints of the messages do not move in the robot description; empty if all do."""
        heard = dict.fromkeys(name for motion in self.motions for name in motion.heard)
        return unmoved_joints(heard, self.kernel.model, self.config.wheels.names)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Notes to the user, one line each."""
        of_bags = [warning for motion in self.motions for warning in motion.warnings]
        priors = [underestimated_text(kind, size) for kind, size in self.calibration.prior_scales]
        own = (*_about_motion(self), *_about_values(self), *priors)
        return tuple(dict.fromkeys((*self.model_summary.warnings, *own, *of_bags)))


def why_not(result: Calibrated) -> str:
    """Return why there is no calibration, and the remedy; empty if there is one."""
    calibration = result.calibration
    if not calibration.converged:
        remedy = result.unmoved or 'correct its large errors, or set standard deviations as large as they are'
        model = 'the data contradict the model: ' if result.unsolvable else ''
        return f'{model}the iteration does not converge near the robot description; {remedy}'
    left_open = [
        f'{link.name}.{PARAMETERS[index]}'
        for link in calibration.links
        for index in np.flatnonzero(np.isinf(link.prior_std) & ~(link.std < IDENTIFIABLE_STD * _sizes(link)))
    ]
    if left_open:
        return (
            f'the data do not determine {listing(left_open, limit=6)}; give these links an <inertial>, or move more '
            'joints'
        )
    if calibration.determined == 0:
        return 'the data add nothing to the prior: move all joints while the base floats freely'
    return ''


def _sizes(link: LinkResult) -> Array:
    """Return the size that each standard deviation is relative to, for a CoM the radius of gyration."""
    values = link.cad if link.cad[0] > 0.0 else link.parameters
    gyration = float(np.sqrt(np.sum(values[[4, 7, 9]]) / 2.0 / values[0]))
    com = gyration if link.cad[0] > 0.0 else max(LENGTH, gyration)
    moments = np.sqrt(np.abs(link.parameters[_FIRST] * link.parameters[_SECOND]))
    return np.concatenate((np.abs(link.parameters[:1]), np.full(3, com), moments))


def _about_motion(result: Calibrated) -> list[str]:
    calibration = result.calibration
    model = result.kernel.model
    moving = [name for name in model.joint_names if name not in calibration.at_rest]
    notes = []
    if calibration.at_rest and (moving or calibration.located):
        only = f'only {listing(moving)} moves' if len(moving) == 1 else f'{listing(calibration.at_rest)} did not move'
        notes.append(f'{only}: bodies on both sides of a joint at rest count as one; move every joint')
    if not calibration.located and not moving:
        notes.append(
            'nothing locates the base, and no joint moves: mass, centre of mass and the scale of the inertia stay at '
            'CAD; the data determine its ratios'
        )
    if calibration.planar:
        notes.append('planar motion: CoM across the plane and all inertia but the moment about its normal stay at CAD')
    return notes


def _about_values(result: Calibrated) -> list[str]:
    calibration = result.calibration
    notes = []
    if result.contradicted:
        notes.append(f'residuals are {calibration.residual:.1f} times as large as the noise parameters explain')
        notes += [f'likely cause: {result.unmoved}'] if result.unmoved else []
    if calibration.scale_std > _LOOSE_SCALE:
        notes.append(
            f'the scale is known to {100.0 * calibration.scale_std:.2g} % only: all masses and inertias may '
            'be off by one factor; weigh the robot, and add known_links.total_mass'
        )
    for link in calibration.links:
        far = [name for name, moved in zip(PARAMETERS, link.shift_in_prior_stds, strict=True) if abs(moved) > _UNLIKELY]
        if far:
            notes.append(f'{link.name}: {listing(far)} moved further than the prior makes likely; check CAD and prior')
        if link.consistency_correction > _LARGE_CORRECTION:
            notes.append(
                f'{link.name} was {link.consistency_correction:.1f} standard deviations away from any real body'
            )
    return notes


def headline(result: Calibrated) -> str:
    """Return the result in one sentence."""
    calibration = result.calibration
    count = len(calibration.links)
    bodies = f'{count} {"body" if count == 1 else "bodies"}'
    data = f'{calibration.samples} samples, {calibration.span:.3g} s; residual {calibration.residual:.2f}'
    if result.contradicted:
        return f'the data contradict the model, so the values of {bodies} must not be trusted: {data}'
    return f'{bodies} calibrated from {data}'


def sentences(result: Calibrated) -> list[str]:
    """Return sentences on identifiability, scale, mount, thrusters and inertia ratios."""
    calibration = result.calibration
    determined = f'the data improve {calibration.determined} combinations of links, joints and mount over the prior'
    std = f'{100.0 * calibration.scale_std:.2g} %'
    lines = [determined, f'scale: total mass known to {std} (one standard deviation)']
    if np.any(calibration.stds[-6:]):
        mount = _beside(1e3 * calibration.mount[3:], 1e3 * calibration.stds[-3:])
        turn = _beside(1e3 * calibration.mount[:3], 1e3 * calibration.stds[-6:-3])
        lines.append(f'mount of the odometry, beside the URDF: {mount} mm, {turn} mrad (95 %)')
    for thruster in calibration.thrusters:
        strong = f'{thruster.scale:.4f} ± {BAND * thruster.scale_std:.2g} times as strong as commanded'
        turned = f'turned by {_beside(1e3 * thruster.turn, 1e3 * thruster.turn_std)} mrad'
        late = f'{1e3 * thruster.delay:+.1f} ± {1e3 * BAND * thruster.delay_std:.2g} ms late'
        lines.append(f'thruster {one_line(thruster.frame)}: {strong}, {turned}, {late} (95 %)')
    lines += [f'passive joint: {one_line(str(joint))}' for joint in calibration.flexible]
    return [*lines, *(_ratio_words(link) for link in calibration.links if link.ratios.clearer)]


def _ratio_words(link: LinkResult) -> str:
    """Return the known part of a body's inertia if its scale is unknown."""
    ratios = link.ratios
    each = zip(ratios.principal.tolist(), ratios.principal_std.tolist(), strict=True)
    parts = ', '.join(' ± '.join(rounded(value, std)) for value, std in each)
    return (
        f'inertia of {one_line(link.name)}: known up to a factor, ± {100.0 * BAND * ratios.scale_std:.2g} %; '
        f'principal moments over their sum: {parts} (95 %)'
    )


def _beside(values: Array, stds: Array) -> str:
    """Return values with their common 95 % band in a few words."""
    return f'{" ".join(f"{each:+.2f}" for each in values)} ± {BAND * float(np.max(stds)):.2g}'


JOINTS_HEAD = ('joint', 'zero ± 95 %, mrad (mm)', 'origin moved ± 95 %, mm', 'axis tilted ± 95 %, mrad')


def joint_rows(result: Calibrated) -> list[tuple[str, ...]]:
    """Return a line a joint: name, zero, shift of the frame, tilt of the axis, with their bands."""
    calibration = result.calibration
    stds = 1e3 * calibration.stds[len(calibration.theta) : -6].reshape(-1, 6)
    each = zip(calibration.kernel.model.joint_names, 1e3 * calibration.joints, stds, strict=True)
    parts = slice(0, 1), slice(1, 4), slice(4, 6)
    return [(one_line(name), *(_beside(values[part], std[part]) for part in parts)) for name, values, std in each]


def rows(result: Calibrated) -> list[tuple[str, str, str, str, str]]:
    """Return a line a body: name, mass, shift of the CoM, change of the inertia, parameters hardly better known."""
    return [_row(link) for link in result.calibration.links]


def _row(link: LinkResult) -> tuple[str, str, str, str, str]:
    stayed = [name for name, each in zip(PARAMETERS, link.is_prior, strict=True) if each]
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
    lines = [*map(one_line, result.model_summary.lines), '', headline(result), *map('  {}'.format, sentences(result))]
    lines += ['', *_columns([HEAD, *rows(result)])]
    joints = [JOINTS_HEAD, *joint_rows(result)]
    if len(joints) > 1 and np.any(result.calibration.stds[len(result.calibration.theta) : -6]):
        lines += ['', *_columns(joints)]
    return '\n'.join([*lines, *(f'  warning: {one_line(each)}' for each in result.warnings)])


def _columns(table: Sequence[Sequence[str]]) -> list[str]:
    """Return a table's rows, its columns one below the other."""
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    return ['  ' + '  '.join(f'{cell:{w}}' for cell, w in zip(row, widths, strict=True)).rstrip() for row in table]
