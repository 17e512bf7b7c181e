"""What a calibration of bags leads to: its verdicts, and its JSON form, which scripts rely on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbaid_ros.calibration.result import Calibration, LinkResult
from mbaid_ros.calibration.structure import (
    BaseParameter,
    Exchange,
    base_parameter,
    exchanges,
    formula,
    parameter,
)
from mbaid_ros.calibration.unknowns import OF_A_JOINT, OF_THE_MOUNT
from mbaid_ros.config.calibration import CalibrationParameters
from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.results.physical_consistency import InertiaRatios
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model_errors import displaced
from mbaid_ros.core.unknowns.words import of_size
from mbaid_ros.replay.motions import BagMotions
from mbaid_ros.replay.result_json import shaped_thruster
from mbaid_ros.session import ModelSummary, summarise

CALIBRATED, INCONSISTENT = 'calibrated', 'inconsistent'
_INERTIA = PARAMETERS[4:]
_FIRST, _SECOND = np.array([4, 4, 4, 7, 7, 9]), np.array([4, 7, 9, 7, 9, 9])
# What a user should look at: a scale known worse, values further off than the prior makes likely, bent estimates.
_LOOSE_SCALE = 0.01
_UNLIKELY = 4.0
_LARGE_CORRECTION = 3.0
# By kind of what is further off than its prior says, where that is declared.
_DECLARED = {
    'link': 'prior.mass_relative_std, .com_std, .inertia_relative_std',
    'mass': 'prior.mass_relative_std',
    'zero': 'prior.zero_std',
    'origin': 'prior.origin_std',
    'axis': 'prior.axis_std',
    'mount': 'prior.mount_position_std, .mount_orientation_std',
}
_PRIORS = ('prior.mass_relative_std', *('prior.com_std',) * 3, *('prior.inertia_relative_std',) * 6)


@dataclass(frozen=True)
class Calibrated:
    """A calibration and where it comes from.

    Attributes
    ----------
    calibration : Calibration
    motions : of each bag
    kernel : with the unknown links
    parameters : what `calibrate` was told
    """

    calibration: Calibration
    motions: tuple[BagMotions, ...]
    kernel: MomentumKernel
    parameters: CalibrationParameters

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model: what comes out must not be trusted."""
        return self.calibration.residual > self.parameters.estimator.convergence.largest_residual

    @cached_property
    def exchanges(self) -> tuple[Exchange, ...]:
        """What cannot be told apart."""
        return exchanges(self.calibration.mechanism, self.calibration.structure)

    @cached_property
    def base_parameters(self) -> tuple[BaseParameter, ...]:
        """What momentum determines."""
        return self.calibration.structure.base_parameters()

    @cached_property
    def survey(self) -> ModelSummary:
        """What the calibration takes the robot for."""
        heard = {name for motion in self.motions for name in motion.heard}
        return summarise(self.kernel.model, heard=heard, unknown=[link.name for link in self.kernel.unknown])

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know, one line each."""
        told = [warning for motion in self.motions for warning in motion.warnings]
        about = (*_about_motion(self), *_about_values(self), *_about_priors(self))
        return tuple(dict.fromkeys((*self.survey.warnings, *about, *told)))


def why_not(result: Calibrated) -> str:
    """Return why there is no calibration, and what to add; empty if there is one."""
    calibration = result.calibration
    if not calibration.settled:
        return (
            'the data lead to no solution that stays near the robot description; correct what is far off in it, or '
            'give priors that are as wide'
        )
    limit = result.parameters.estimator.convergence.identifiable_std
    left_open: dict[str, list[str]] = {}
    for link in calibration.links:
        size = _sizes(link, result.parameters.estimator.convergence.length)
        for index in np.flatnonzero(np.isinf(link.prior_std) & ~(link.std < limit * size)):
            left_open.setdefault(_PRIORS[index], []).append(f'{link.name}.{PARAMETERS[index]}')
    if left_open:
        names = listing((name for group in left_open.values() for name in group), limit=6)
        return (
            f'the data leave {names} open, and no prior speaks of them; add {listing(left_open)}, or move more joints'
        )
    if calibration.determined == 0:
        return (
            'the data say nothing that the prior does not: move the joints, all of them, while the base floats freely'
        )
    return ''


def _sizes(link: LinkResult, length: float) -> Array:
    """Return what the standard deviation of each value is taken relative to, for a CoM the radius of gyration."""
    values = link.cad if link.cad[0] > 0.0 else link.parameters
    gyration = float(np.sqrt(np.sum(values[[4, 7, 9]]) / 2.0 / values[0]))
    com = gyration if link.cad[0] > 0.0 else max(length, gyration)
    moments = np.sqrt(np.abs(link.parameters[_FIRST] * link.parameters[_SECOND]))
    return np.concatenate((np.abs(link.parameters[:1]), np.full(3, com), moments))


def _about_priors(result: Calibrated) -> list[str]:
    return [of_size(kind, size, _DECLARED) for kind, size in result.calibration.further_off]


def _about_motion(result: Calibrated) -> list[str]:
    calibration = result.calibration
    model = result.kernel.model
    moving = [name for name in model.joint_names if name not in calibration.still]
    told = []
    if calibration.still and (moving or calibration.located):
        only = f'only {listing(moving)} moves' if len(moving) == 1 else f'{listing(calibration.still)} did not move'
        told.append(f'{only}: bodies on both sides of a joint at rest count as one; move every joint')
    if not calibration.located and not moving:
        told.append(
            'nothing locates the base, and no joint moves: mass, centre of mass and the scale of the inertia stay at '
            'CAD; the data tell its ratios'
        )
    if calibration.planar:
        told.append('planar motion: CoM across the plane and all inertia but the moment about its normal stay at CAD')
    return told


def _about_values(result: Calibrated) -> list[str]:
    calibration = result.calibration
    told = []
    if result.contradicted:
        told.append(f'residuals are {calibration.residual:.1f} times what the noise parameters explain')
    if calibration.scale.relative_std > _LOOSE_SCALE:
        told.append(
            f'the scale is known to {100.0 * calibration.scale.relative_std:.2g} % only: all masses and inertias may '
            'be off by one factor; add prior.links.<link>.mass_relative_std of a body that was weighed'
        )
    for link in calibration.links:
        far = [name for name, moved in zip(PARAMETERS, link.moved, strict=True) if abs(moved) > _UNLIKELY]
        if far:
            told.append(f'{link.name}: {listing(far)} moved further than the prior makes likely; look at CAD and prior')
        if link.consistency_correction > _LARGE_CORRECTION:
            told.append(
                f'{link.name} was {link.consistency_correction:.1f} standard deviations away from any real body'
            )
    return told


def as_json(result: Calibrated) -> dict[str, Any]:
    """Return the result as scripts read it; what is not known is None."""
    calibration = result.calibration
    model, links = result.kernel.model, result.kernel.unknown
    bags = [motion.bag for motion in result.motions for _ in motion.runs]
    return {
        'status': INCONSISTENT if result.contradicted else CALIBRATED,
        'bags': [motion.bag for motion in result.motions],
        'links': {link.name: _link(link) for link in calibration.links},
        'joints': _joints(calibration),
        'odometry_mount': {
            'orientation': calibration.mount[:3].tolist(),
            'orientation_std': calibration.stds[-6:-3].tolist(),
            'position': calibration.mount[3:].tolist(),
            'position_std': calibration.stds[-3:].tolist(),
        },
        'thrusters': [shaped_thruster(each) for each in calibration.thrusters],
        'covariance': {
            'order': [
                *(parameter(links, index) for index in range(len(calibration.theta))),
                *(f'{name}.{number}' for name in model.joint_names for number in OF_A_JOINT),
                *(f'odometry_mount.{number}' for number in OF_THE_MOUNT),
            ],
            'values': calibration.values.tolist(),
            'matrix': calibration.block_covariance.tolist(),
        },
        'identifiability': {
            'unknowns': calibration.structure.unknowns,
            'rank': calibration.structure.rank,
            'determined': calibration.determined,
            'cannot_be_told_apart': [
                {'words': each.words, 'directions': each.directions.shape[1]} for each in result.exchanges
            ],
            'base_parameters': [_base_parameter(result, each) for each in result.base_parameters],
        },
        'scale': {
            'relative_std': calibration.scale.relative_std,
            'fixed_by': [{'name': name, 'share': share} for name, share in calibration.scale.fixed_by],
        },
        'momentum': [
            _momentum(*each) for each in zip(bags, calibration.momentum, calibration.momentum_covariance, strict=True)
        ],
        'residual': calibration.residual,
        'samples': calibration.samples,
        'span_s': calibration.span,
        'planar': calibration.planar,
        'joints_at_rest': list(calibration.still),
        'warnings': list(result.warnings),
    }


def _link(link: LinkResult) -> dict[str, Any]:
    return {
        'cad': shaped(link.cad),
        'estimate': shaped(link.parameters),
        'std': shaped(link.std),
        'prior_std': shaped(link.prior_std),
        'learnt': shaped(link.learnt),
        'moved': shaped(link.moved),
        'inertia_ratios': _ratios(link.ratios),
        'stayed_at_cad': [name for name, stayed in zip(PARAMETERS, link.stayed, strict=True) if stayed],
        'consistency_correction': link.consistency_correction,
    }


def _ratios(ratios: InertiaRatios) -> dict[str, Any]:
    """Return the inertia over its trace, element by element, and the principal moments over it."""
    return {
        'of_trace': dict(zip(_INERTIA, ratios.elements.tolist(), strict=True)),
        'std': dict(zip(_INERTIA, ratios.std.tolist(), strict=True)),
        'principal': ratios.principal.tolist(),
        'principal_std': ratios.principal_std.tolist(),
        'scale_relative_std': ratios.scale_std,
    }


def _joints(calibration: Calibration) -> dict[str, Any]:
    """Return each joint: what it has beside the URDF, and where its frame then is on the body that carries it."""
    before = calibration.mechanism.kernel.model
    after = displaced(before, *calibration.displacements)
    stds = calibration.stds[len(calibration.theta) : -6].reshape(-1, 6)
    return {
        name: {
            'zero': float(calibration.joints[index, 0]),
            'zero_std': float(stds[index, 0]),
            'origin_moved': calibration.displacements[0][index].tolist(),
            'origin_std': stds[index, 1:4].tolist(),
            'axis_tilted': calibration.displacements[1][index].tolist(),
            'axis_std': stds[index, 4:].tolist(),
            'position': after.positions[index].tolist(),
            'rotation': after.rotations[index].tolist(),
        }
        for index, name in enumerate(before.joint_names)
    }


def _base_parameter(result: Calibrated, combination: BaseParameter) -> dict[str, Any]:
    calibration, links = result.calibration, result.kernel.unknown
    factors = combination.factors
    return {
        'words': base_parameter(calibration.mechanism, combination),
        'formula': formula(links, factors),
        'factors': {parameter(links, int(index)): float(factors[index]) for index in np.flatnonzero(factors)},
        'cad': float(factors @ calibration.prior.mean),
        'value': float(factors @ calibration.theta),
        'std': float(np.sqrt(factors @ calibration.covariance @ factors)),
        'prior_std': float(np.sqrt(factors @ calibration.prior.covariance @ factors)),
    }


def _momentum(bag: str, value: Array, covariance: Array) -> dict[str, Any]:
    std = np.sqrt(np.diag(covariance)).tolist()
    numbers = value.tolist()
    return {
        'bag': bag,
        'linear': numbers[:3],
        'angular': numbers[3:],
        'linear_std': std[:3],
        'angular_std': std[3:],
    }


def shaped(values: Array) -> dict[str, Any]:
    """Return ten values in the order of PARAMETERS as mass, com and inertia; None where there is no number."""
    numbers = [float(value) if math.isfinite(value) else None for value in values]
    return {'mass': numbers[0], 'com': numbers[1:4], 'inertia': dict(zip(_INERTIA, numbers[4:], strict=True))}
