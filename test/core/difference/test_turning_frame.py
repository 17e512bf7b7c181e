"""What a frame of the odometry that turns with an orbit is told by, and what is not taken for one."""

from __future__ import annotations

import pytest

from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.session import Session
from mbaid_ros.simulated_run import SimulatedRun
from orbiting import AWAY, MEAN_MOTION, declared, session, simulated

SECONDS = 40.0
LOOKS_LIKE = 'looks like gravity gradient or an orbit-fixed frame'
PUSH: dict[str, object] = {
    'thrust.publish': False,
    'thrust.force': [0.05, -0.03, 0.02],
    'thrust.torque': [0.03, 0.02, -0.01],
}
WHEELS: dict[str, object] = {
    'wheels.publish': 'none',
    'wheels.names': ['a', 'b'],
    'wheels.axes': [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    'wheels.spin_inertias': [0.05, 0.05],
}
OTHERS: dict[str, dict[str, object]] = {
    'a pulse': {**PUSH, 'thrust.time': 15.0, 'thrust.duration': 2.0, 'thrust.force': [0.5, -0.3, 0.2]},
    'a constant force': {**PUSH, 'thrust.duration': SECONDS, 'thrust.link': 'odom'},
    'a leak': {**PUSH, 'thrust.duration': SECONDS},
    'wheels that spin up': {**WHEELS, 'wheels.accelerations': [2.0, -1.0]},
    'wheels that are held': {**WHEELS, 'wheels.speeds': [80.0, -100.0]},
    'wrong links': {'model_errors.links_relative_std': 0.03, 'model_errors.zero_std': 3e-3},
}


def identify(run: SimulatedRun, into: Session) -> Estimate:
    for timed in run.read(SECONDS):
        if timed.topic in {'joint_states', 'odom'}:
            (into.add_joint_state if timed.topic == 'joint_states' else into.add_odometry)(timed.message)
    return into.process()[-1]


def underlined(parameters: dict[str, object]) -> dict[str, object]:
    return {name.replace('.', '__'): value for name, value in parameters.items()}


@pytest.mark.parametrize(
    ('method', 'seed'),
    [('difference', 0), ('difference', 1), ('difference', 2), pytest.param('trajectory', 0, marks=pytest.mark.long)],
)
def test_a_low_orbit_is_named_first(method: str, seed: int) -> None:
    run = simulated(SECONDS, seed=seed, initial__base_position=AWAY, **underlined(declared('lvlh')))
    last = identify(run, session(method=method))
    assert last.status == 'inconsistent'
    assert LOOKS_LIKE in last.causes[0][0]
    told = float(last.causes[0][0].split(' at about ')[1].split()[0])
    assert told == pytest.approx(MEAN_MOTION, rel=0.3)


@pytest.mark.parametrize('what', OTHERS)
def test_what_else_acts_is_not_taken_for_an_orbit(what: str) -> None:
    last = identify(simulated(SECONDS, **underlined(OTHERS[what])), session(method='difference'))
    assert last.status == 'inconsistent'
    assert not any(LOOKS_LIKE in cause for cause, _ in last.causes)


def test_a_known_orbit_is_not_suspected() -> None:
    around = underlined(declared('lvlh'))
    push = underlined({**PUSH, 'thrust.time': 15.0, 'thrust.duration': 2.0, 'thrust.force': [0.5, -0.3, 0.2]})
    last = identify(simulated(SECONDS, **around, **push), session(method='difference', **around))
    assert last.status == 'inconsistent'
    assert not last.causes
