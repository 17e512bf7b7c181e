"""A replay's result as JSON, which scripts rely on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import yaml

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.capture import Capture
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.noise import CHANNELS, NoiseLevels
from mbaid_ros.core.repair import Repair
from mbaid_ros.core.results.estimate import PARAMETERS, PassiveJoint
from mbaid_ros.core.target import Debris, TargetAtCapture
from mbaid_ros.parameters import values_of
from mbaid_ros.replay.whole_run import Run
from mbaid_ros.session.continuation import continuation_as_json

_NOT_ALONE = '# This file alone does not give the same result: readings or the robot description were converted, too.'


# -- JSON: plain numbers in the shapes that scripts rely on, None for unknown values


def plain(value: Any) -> Any:
    """Return numbers, arrays, sequences and mappings as JSON has them: None for a number that is not finite."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, list | tuple) else value


def shaped(values: Array | Flags) -> dict[str, Any]:
    """Return ten values in the order of PARAMETERS as mass, com and inertia."""
    mass, *ten = plain(values)
    return {'mass': mass, 'com': ten[:3], 'inertia': dict(zip(PARAMETERS[4:], ten[3:], strict=True))}


def shaped_std(std: Array) -> dict[str, Any] | None:
    """Return ten standard deviations, None where there is none."""
    return None if np.all(np.isnan(std)) else shaped(std)


def matrix(covariance: Array) -> list[list[float | None]] | None:
    """Return the rows of a covariance, None where there is none."""
    return None if np.all(np.isnan(covariance)) else plain(covariance)


def shaped_momentum(momentum: Array, covariance: Array) -> dict[str, Any]:
    """Return a (6,) momentum with its standard deviations."""
    values, stds = plain(momentum), plain(np.sqrt(np.diag(covariance)))
    return {'linear': values[:3], 'angular': values[3:], 'linear_std': stds[:3], 'angular_std': stds[3:]}


def as_json(run: Run) -> dict[str, Any]:
    """Return the run as scripts read it."""
    final, budget = run.final, run.final.budget
    return {
        'bag': run.bag,
        'method': final.method,
        'stage': final.stage or None,
        'target_link': run.target_link,
        'status': final.status,
        'estimate': shaped(final.parameters),
        'std': shaped_std(final.std),
        'covariance': matrix(final.covariance),
        'error_budget': None if budget is None else {name: budget.shares_of(name) or None for name in PARAMETERS},
        'unchecked': None if budget is None else budget.unobservable() or None,
        'identifiable': shaped(final.identifiable),
        'momentum': shaped_momentum(final.momentum, final.momentum_covariance),
        'time_offset': None
        if math.isnan(final.time_offset)
        else {'value': final.time_offset, 'std': plain(final.time_offset_std)},
        'noise': None if final.noise is None else _noise(final.noise),
        'flexible': passive_joints(final.flexible),
        'thrusters': [plain(vars(thruster)) for thruster in final.thrusters],
        'events': events(run),
        'residual': plain(final.residual),
        'holdout': None
        if run.holdout is None
        else {'fraction': run.holdout.fraction, 'ratio': plain(run.holdout.ratio)},
        'causes': [{'cause': cause, 'gain': gain} for cause, gain in final.likely_causes],
        'repairs': [_repair(each) for each in final.repairs],
        'sensors': [plain(vars(each)) for each in run.sensors],
        'capture': None if run.capture is None else _capture(run.capture),
        'debris': None if run.debris is None else _debris(run.debris),
        'samples': final.samples,
        'span_s': final.time,
        'warnings': run.all_warnings,
        'model': None if run.model_summary is None else asdict(run.model_summary),
        'made_by': run.made_by and {**run.made_by, 'parameters': dict(run.settings), 'bag_sha256': dict(run.files)},
        'advice': run.advice or None,
        'continuation': None
        if run.posterior is None or run.contradicted or final.repairs
        else continuation_as_json(
            run.posterior.continuation, run.urdf, str(run.settings.get('known_links.calibration', ''))
        ),
        'history': [
            {
                't': estimate.time,
                'status': estimate.status,
                'estimate': shaped(estimate.parameters),
                'std': shaped_std(estimate.std),
            }
            for estimate in run.history
        ],
    }


def _repair(repair: Repair) -> dict[str, Any]:
    """Return a cause that the run takes into account; `parameters` is None where they alone cannot do it."""
    numbers = {name: plain(getattr(repair, name)) for name in ('value', 'std', 'unit', 'since')}
    parameters = plain(repair.parameters) if repair.by_parameters else None
    return {'cause': repair.cause, 'parameters': parameters, **numbers}


def parameter_file(run: Run) -> str:
    """Return the parameters of a run, those of its repairs in place of its declarations, as a ROS parameter file."""
    values, defaults = dict(run.settings), values_of(EstimatorConfig())
    values['repair'] = False
    for each in run.final.repairs:
        values |= each.parameters or {}
    given = {name: plain(value) for name, value in values.items() if name not in defaults or value != defaults[name]}
    lines = [f'# {each}' for each in map(str, run.final.repairs)]
    lines += [] if all(each.by_parameters for each in run.final.repairs) else [_NOT_ALONE]
    content = yaml.safe_dump({'/**': {'ros__parameters': given}}, sort_keys=False, allow_unicode=True)
    return '\n'.join([*lines, content])


def passive_joints(joints: Sequence[PassiveJoint]) -> dict[str, dict[str, Any]] | None:
    """Return the numbers of each passive joint by its name; None where none is declared."""
    names = 'frequency', 'frequency_std', 'damping', 'damping_std', 'deflection', 'resolved'
    return {joint.joint: {name: plain(getattr(joint, name)) for name in names} for joint in joints} or None


def events(run: Run) -> list[dict[str, Any]]:
    """Return the steps and ramps of the momentum: t, kind, linear, angular, cause."""
    names = 'kind', 'linear', 'angular', 'cause'
    return [{'t': each.time, **{name: plain(getattr(each, name)) for name in names}} for each in run.final.events]


def _noise(levels: NoiseLevels) -> dict[str, Any]:
    """Return the declared and the estimated noise of each sensor."""
    names = 'declared', 'found', 'assumed', 'found_is_used'
    rows = zip(levels.declared, levels.estimated, levels.assumed, levels.used.astype(bool), strict=True)
    return {
        **{channel: dict(zip(names, plain(row), strict=True)) for channel, row in zip(CHANNELS, rows, strict=True)},
        'base_correlation_time': levels.correlation_time,
        'base_twist_correlation_time': levels.twist_correlation_time,
        'found_is_used': bool(np.any(levels.used)),
    }


def _debris(alone: Debris) -> dict[str, Any]:
    """Return the captured body in the target link's frame."""
    return {**shaped(alone.parameters), 'std': shaped_std(alone.std), 'covariance': matrix(alone.covariance)}


def _capture(capture: Capture) -> dict[str, Any]:
    momentum, chaser = shaped_momentum(capture.momentum, capture.covariance), capture.chaser
    return {
        't': capture.time,
        'target_linear_momentum': momentum['linear'],
        'target_angular_momentum': momentum['angular'],
        'target_linear_momentum_std': momentum['linear_std'],
        'target_angular_momentum_std': momentum['angular_std'],
        'target_linear_velocity': plain(capture.velocity),
        'target_angular_velocity': plain(capture.spin),
        'chaser': None
        if chaser is None
        else {
            **shaped_momentum(chaser.momentum, chaser.covariance),
            'residual': plain(chaser.residual),
            'samples': chaser.samples,
        },
        'tracked': None if capture.tracked is None else _tracked(capture.tracked, capture.misfit),
    }


def _tracked(target: TargetAtCapture, misfit: tuple[float, int]) -> dict[str, Any]:
    """Return the motion of a target that was tracked before its capture, and how well the estimate agrees with it."""
    flight, (velocity, velocity_std, spin, spin_std) = target.flight, target.motion()
    return {
        'poses': flight.used,
        'dropped': flight.dropped,
        'position_std': flight.noise.position,
        'orientation_std': flight.noise.orientation,
        'correlation_times': list(flight.noise.correlation_times),
        'linear_velocity': plain(velocity),
        'linear_velocity_std': plain(velocity_std),
        'angular_velocity': plain(spin),
        'angular_velocity_std': plain(spin_std),
        'chi_square': misfit[0] if misfit[1] else None,
        'numbers': misfit[1],
    }
