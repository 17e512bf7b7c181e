"""The JSON form of what a replay leads to, which scripts rely on."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from mbaid_ros.core.results.estimate import Thruster
from mbaid_ros.replay import provenance
from mbaid_ros.replay.jsonable import (
    matrix,
    number,
    numbers,
    shaped,
    shaped_budget,
    shaped_capture,
    shaped_debris,
    shaped_momentum,
    shaped_noise,
    shaped_std,
)
from mbaid_ros.replay.results import Run


def as_json(run: Run) -> dict[str, Any]:
    """Return the run as scripts read it; what is not known is None."""
    final = run.final
    return {
        'bag': run.bag,
        'method': final.method,
        'stage': final.stage or None,
        'target_link': run.target_link,
        'status': final.status,
        'estimate': shaped(numbers(final.parameters)),
        'std': shaped_std(final.std),
        'covariance': matrix(final.covariance),
        'error_budget': None if final.budget is None else shaped_budget(final.budget),
        'unchecked': None if final.budget is None else final.budget.resting() or None,
        'identifiable': shaped([bool(flag) for flag in final.identifiable]),
        'momentum': shaped_momentum(final.momentum, final.momentum_covariance),
        'time_offset': None
        if math.isnan(final.time_offset)
        else {'value': final.time_offset, 'std': number(final.time_offset_std)},
        'noise': None if final.noise is None else shaped_noise(final.noise),
        'thrusters': [shaped_thruster(thruster) for thruster in final.thrusters],
        'events': events(run),
        'residual': number(final.residual),
        'causes': [{'cause': cause, 'gain': gain} for cause, gain in run.likeliest],
        'capture': None if run.capture is None else shaped_capture(run.capture),
        'debris': None if run.debris is None else shaped_debris(run.debris),
        'samples': final.samples,
        'span_s': final.time,
        'warnings': run.all_warnings,
        'model': None if run.survey is None else asdict(run.survey),
        'made_by': None if run.made_by is None else provenance.as_json(run.made_by, run.settings, run.files),
        'state': run.state,
        'advice': run.advice or None,
        'history': [
            {
                't': estimate.time,
                'status': estimate.status,
                'estimate': shaped(numbers(estimate.parameters)),
                'std': shaped_std(estimate.std),
            }
            for estimate in run.history
        ],
    }


def shaped_thruster(found: Thruster) -> dict[str, Any]:
    """Return by how much a thruster is off its command."""
    return {
        'frame': found.frame,
        'scale': found.scale,
        'scale_std': found.scale_std,
        'turn': found.turn.tolist(),
        'turn_std': found.turn_std.tolist(),
        'delay': found.delay,
        'delay_std': found.delay_std,
    }


def events(run: Run) -> list[dict[str, Any]]:
    """Return the steps and ramps of the momentum that were found: t, kind, linear, angular, cause."""
    return [
        {
            't': event.time,
            'kind': event.kind,
            'linear': numbers(event.linear),
            'angular': numbers(event.angular),
            'cause': event.cause,
        }
        for event in run.final.events
    ]
