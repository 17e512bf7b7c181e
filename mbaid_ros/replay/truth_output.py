"""The truth of a simulated run as JSON, beside its bag."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mbaid_ros.config.parameters import values_of
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.files import write_text
from mbaid_ros.simulated_run import SimulatedRun


def write_truth(path: Path, run: SimulatedRun) -> None:
    """Write what is to be found, what the robot has more than its URDF says, and what the run was made with."""
    truth = {
        'robot': run.model.name,
        'target_link': run.target.name,
        **_body(run.target_inertia),
        # With thrust, or in orbit, it is not one momentum.
        'momentum': None
        if run.pulse is not None or run.config.orbit.mean_motion > 0.0
        else {'linear': run.momentum[:3].tolist(), 'angular': run.momentum[3:].tolist()},
        'capture': _captured(run),
        'model_errors': _model_errors(run),
        'seed': run.config.seed,
        'parameters': values_of(run.config),
    }
    write_text(path, json.dumps(truth, indent=2) + '\n')


def _body(parameters: Array) -> dict[str, object]:
    """Return (10,) mass, CoM and inertia about it by name."""
    value = dict(zip(PARAMETERS, parameters.tolist(), strict=True))
    return {
        'mass': value['mass'],
        'com': [value[name] for name in ('com_x', 'com_y', 'com_z')],
        'inertia': {name: value[name] for name in PARAMETERS[4:]},
    }


def _captured(run: SimulatedRun) -> dict[str, object] | None:
    """Return what is captured, its momentum before, and when; None where nothing is."""
    target = run.captured
    if target is None:
        return None
    return {
        't': target.time,
        **_body(target.body),
        'target_linear_momentum': run.brought[:3].tolist(),
        'target_angular_momentum': run.brought[3:].tolist(),
        'target_linear_velocity': target.velocity.tolist(),
        'target_angular_velocity': target.spin.tolist(),
    }


def _model_errors(run: SimulatedRun) -> dict[str, object] | None:
    """Return what the robot has more than its URDF says, link by link and joint by joint; None for nothing."""
    errors = run.errors
    if errors.exact:
        return None
    links = zip(run.robot.links, run.model.links, strict=True)
    joints = zip(run.model.joint_names, errors.zeros, errors.origins, errors.tilts, strict=True)
    return {
        'links': {
            link.name: _body(physical(link.parameters) - physical(before.parameters))
            for link, before in links
            if not np.array_equal(link.parameters, before.parameters)
        },
        'joints': {
            name: {'zero': float(zero), 'origin': origin.tolist(), 'axis': tilt.tolist()}
            for name, zero, origin, tilt in joints
        },
        'mount': {'position': errors.mount[3:].tolist(), 'orientation': errors.mount[:3].tolist()},
    }
