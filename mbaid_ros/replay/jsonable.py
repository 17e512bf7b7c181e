"""Results as JSON takes them: plain numbers in the shapes that scripts rely on, None for what is not known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbaid_ros.core.capture import Capture
from mbaid_ros.core.geometry import Array, quaternion_from_rotation
from mbaid_ros.core.results.parameters import PARAMETERS, ErrorBudget
from mbaid_ros.core.results.publication import Debris
from mbaid_ros.core.sensors.levels import CHANNELS, SensorLevels


def number(value: float) -> float | None:
    """Return a number."""
    return float(value) if math.isfinite(value) else None


def numbers(values: Array) -> list[float | None]:
    """Return the numbers of a vector."""
    return [number(value) for value in values]


def shaped(values: list[Any]) -> dict[str, Any]:
    """Return ten values in the order of PARAMETERS as mass, com and inertia."""
    return {'mass': values[0], 'com': values[1:4], 'inertia': dict(zip(PARAMETERS[4:], values[4:], strict=True))}


def shaped_std(std: Array) -> dict[str, Any] | None:
    """Return ten standard deviations, None where there is none."""
    return None if np.all(np.isnan(std)) else shaped(numbers(std))


def matrix(covariance: Array) -> list[list[float | None]] | None:
    """Return the rows of a covariance, None where there is none."""
    return None if np.all(np.isnan(covariance)) else [numbers(row) for row in covariance]


def shaped_budget(budget: ErrorBudget) -> dict[str, dict[str, float] | None]:
    """Return of each parameter the share of each cause, the largest first, without the least; None where not known."""
    return {name: budget.of(name) or None for name in PARAMETERS}


def shaped_momentum(momentum: Array, covariance: Array) -> dict[str, Any]:
    """Return a (6,) momentum with its standard deviations."""
    values, stds = numbers(momentum), numbers(np.sqrt(np.diag(covariance)))
    return {'linear': values[:3], 'angular': values[3:], 'linear_std': stds[:3], 'angular_std': stds[3:]}


def shaped_noise(levels: SensorLevels) -> dict[str, Any]:
    """Return how noisy the sensors are declared to be, and have turned out to be."""
    each = zip(CHANNELS, levels.declared, levels.found, levels.assumed, levels.used, strict=True)
    return {
        **{
            name: {
                'declared': number(declared),
                'found': number(found),
                'assumed': number(assumed),
                'found_is_used': bool(used),
            }
            for name, declared, found, assumed, used in each
        },
        'base_correlation_time': levels.correlation_time,
        'found_is_used': bool(np.any(levels.used)),
    }


def shaped_debris(alone: Debris) -> dict[str, Any]:
    """Return the captured body with its frame, which is given in the target link's."""
    frame = alone.frame
    return {
        **shaped(numbers(alone.parameters)),
        'std': shaped_std(alone.std),
        'covariance': matrix(alone.covariance),
        'frame': {
            'name': frame.name,
            'position': numbers(frame.position),
            'orientation': numbers(quaternion_from_rotation(frame.rotation)),
        },
    }


def shaped_capture(capture: Capture) -> dict[str, Any]:
    """Return what a capture tells."""
    own, chaser = shaped_momentum(capture.momentum, capture.covariance), None
    if capture.chaser is not None:
        chaser = {
            **shaped_momentum(capture.chaser.momentum, capture.chaser.covariance),
            'residual': number(capture.chaser.residual),
            'samples': capture.chaser.samples,
        }
    return {
        't': capture.time,
        'target_linear_momentum': own['linear'],
        'target_angular_momentum': own['angular'],
        'target_linear_momentum_std': own['linear_std'],
        'target_angular_momentum_std': own['angular_std'],
        'target_linear_velocity': numbers(capture.velocity),
        'target_angular_velocity': numbers(capture.spin),
        'chaser': chaser,
        'calibrated': capture.calibrated or None,
    }
