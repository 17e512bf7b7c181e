"""Runs of the simulator with what it alone has: wheels inside the servicer, and a thruster that is off its command."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from benchmarks.data import CONFIG, model
from benchmarks.honesty.paths import ROBOT
from benchmarks.honesty.runs import history
from benchmarks.orbit.runs import DURATIONS, NOISE, RATE, Kept, sensors, told
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.session import Session
from mbaid_ros.simulated_run import SimulatedRun

Parameters = Mapping[str, object]

STRONGER, TURN = 1.1, 5.0  # times the command; degrees from it, about x
_SECONDS = DURATIONS[0]
_AXES = [1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 1.0]
_WHEELS: dict[str, object] = {
    'wheels.names': ['rw1', 'rw2', 'rw3', 'rw4'],
    'wheels.axes': _AXES,
    'wheels.spin_inertias': [0.05] * 4,
}
_OFF = {'wheels.spin_inertias': [0.0525, 0.0475, 0.0525, 0.0475]}  # 5 %
_THRUST: dict[str, object] = {
    'thrust.time': 20.0,
    'thrust.duration': 6.0,
    'thrust.force': [0.0, 1.0, 0.0],
    'thrust.torque': [0.0, 0.0, 0.6],
}
_AS_IT_IS: dict[str, object] = {'thrust.scale': STRONGER, 'thrust.turn': [float(np.radians(TURN)), 0.0, 0.0]}
_PRIOR: dict[str, object] = {'thrust.scale_std': 0.15, 'thrust.direction_std': 0.1}


def wheels(seed: int, kept: Kept) -> Iterator[dict[str, Any]]:
    """Yield what comes of four wheels that run up to 5 N m s each, by how they are read."""
    names: dict[str, dict[str, object]] = {
        '': {},
        'names': _WHEELS,
        'stored': {'wheels.momentum_frame': 'base_link'},
        'unread': {},
    }
    with_prior = {**_WHEELS, **_OFF, 'wheels.spin_inertia_relative_std': 0.05}
    for how, parameters in {**names, 'off': with_prior, 'off, exact': {**_WHEELS, **_OFF}}.items():
        if ('wheels', '', how, '', seed) not in kept:
            publish = {'stored': 'stored_momentum', 'unread': 'none'}.get(how, 'joint_states')
            turning = {**_WHEELS, 'wheels.accelerations': [1.7, -1.7, 1.5, 1.6], 'wheels.publish': publish}
            found = _identified(seed, {**turning, 'wheels.speed_noise': 0.05} if how else {}, parameters)
            yield {'pace': '', 'frame': how, 'place': '', **told(found, _SECONDS)}


def thruster(seed: int, kept: Kept) -> Iterator[dict[str, Any]]:
    """Yield what comes of a thruster of 1 N that fires for six seconds, by how it is and what is said of it."""
    off = {**_THRUST, **_AS_IT_IS}
    ways: dict[str, tuple[Parameters, Parameters]] = {
        '': ({}, {}),
        'right': (_THRUST, {}),
        'right, prior': (_THRUST, _PRIOR),
        'off, prior': (off, _PRIOR),
        'off': (off, {}),
    }
    for how, (simulated, parameters) in ways.items():
        if ('thruster', '', how, '', seed) not in kept:
            found = _identified(seed, simulated, parameters)
            last = {'pace': '', 'frame': how, 'place': '', **told(found, _SECONDS)}
            for one in found[-1].thrusters:
                last |= {'scale': one.scale, 'scale_std': one.scale_std}
                last |= {'turn': one.turn.tolist(), 'turn_std': one.turn_std.tolist()}
            yield last


def _identified(seed: int, simulated: Parameters, parameters: Parameters) -> list[Estimate]:
    """Return what is estimated of a simulated minute."""
    values = load_parameter_file(CONFIG / f'{ROBOT}_simulator.yaml', 'simulator')
    values |= {'duration': _SECONDS, 'joint_rate': RATE, 'odometry_rate': RATE, 'seed': seed, 'step': 0.05}
    values |= {f'noise.{name}': value for name, value in vars(NOISE).items() if not name.endswith('time')}
    run = SimulatedRun(build(SimulatorConfig, {**values, **simulated}), model(ROBOT).urdf, BAG_TYPES)
    session = Session(build(EstimatorConfig, {**EXACT, **sensors(), **parameters}), model(ROBOT).urdf)
    take = {
        'joint_states': session.add_joint_state,
        'odom': session.add_odometry,
        'stored_momentum': session.add_stored_momentum,
        'thrust': session.add_thrust,
    }
    return history(session, ((take[each.topic], each.message) for each in run.read(_SECONDS)))
