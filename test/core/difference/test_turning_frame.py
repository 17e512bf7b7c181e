"""A frame of the odometry that turns with an orbit contradicts a constant momentum; method trajectory names it."""

from __future__ import annotations

import pytest

from mbaid_ros.core.results.estimate import Estimate
from orbiting import AWAY, MEAN_MOTION, declared, session, simulated

SECONDS = 40.0
LOOKS_LIKE = 'looks like gravity gradient or an orbit-fixed frame'


def identified(method: str, seed: int) -> Estimate:
    parameters = {name.replace('.', '__'): value for name, value in declared('lvlh').items()}
    into = session(method=method)
    for timed in simulated(SECONDS, seed=seed, initial__base_position=AWAY, **parameters).read(SECONDS):
        if timed.topic in {'joint_states', 'odom'}:
            (into.add_joint_state if timed.topic == 'joint_states' else into.add_odometry)(timed.message)
    return into.process()[-1]


@pytest.mark.parametrize('seed', range(3))
def test_a_low_orbit_contradicts_a_constant_momentum(seed: int) -> None:
    assert identified('difference', seed).status == 'inconsistent'


@pytest.mark.long
def test_a_low_orbit_is_named_first() -> None:
    last = identified('trajectory', 0)
    assert last.status == 'inconsistent'
    assert LOOKS_LIKE in last.causes[0][0]
    told = float(last.causes[0][0].split(' at about ')[1].split()[0])
    assert told == pytest.approx(MEAN_MOTION, rel=0.3)
