"""Passive joints, from the simulator's messages to estimates: estimated within their intervals, or reported."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.appendages import (
    PANELS,
    SLOSH,
    with_fuel,
    with_grasp,
    with_mast,
    with_panel_on_the_target,
    with_panels,
)
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from sessions import NOISE, fed, feed
from simulated import CONFIG
from unchanged import Unchanged

FAR = 4.0  # standard deviations of a frequency: one in 16 000
# Of each robot: URDF, passive joints, frequencies (Hz), deflections at the start (rad or m).
ROBOTS = {
    'panels': (with_panels(), PANELS, (0.3, 0.31), (0.02, -0.01)),
    'stiff panels': (with_panels(), PANELS, (1.0, 1.03), (0.005, -0.003)),
    'mast': (with_mast(), ('mast',), (1.0,), (0.05,)),
    'soft panels': (with_panels(), PANELS, (0.1, 0.103), (0.02, -0.01)),
    'panel on the target': (with_panel_on_the_target(), PANELS[:1], (0.3,), (0.02,)),
    'propellant': (with_fuel(20.0), SLOSH, (0.1, 0.1, 0.1), (0.02, 0.0, 0.01)),
    'compliant grasp': (with_grasp(), ('grasp',), (1.0,), (0.005,)),
}
TARGETS = {'compliant grasp': 'target'}


@cache
def simulated(
    name: str, seed: int, seconds: float, rate: float = 50.0
) -> tuple[SimulatedRun, tuple[TimedMessage, ...]]:
    urdf, joints, frequencies, deflections = ROBOTS[name]
    values = load_parameter_file(CONFIG / 'servicer7_simulator.yaml', 'simulator')
    start = [*(0.4, 0.7, -0.3, 0.9, 0.5, -0.6, 0.2), *deflections]
    values |= {'joint_rate': rate, 'odometry_rate': rate, **NOISE, 'seed': seed}
    values['target_link'] = TARGETS.get(name, 'link7')
    values |= {'initial.joint_positions': start, 'flexible.joints': list(joints)}
    values |= {f'flexible.{joint}.frequency': each for joint, each in zip(joints, frequencies, strict=True)}
    run = SimulatedRun(build(SimulatorConfig, values), urdf, BAG_TYPES)
    return run, tuple(run.read(seconds))


def session(urdf: str, **parameters: object) -> Session:
    return Session(build(EstimatorConfig, {**EXACT, **NOISE, 'target_link': 'link7', **parameters}), urdf)


def declared(name: str, wrong: float, **more: object) -> dict[str, object]:
    """Return parameters with all frequencies wrong by as much, relative."""
    _, joints, frequencies, _ = ROBOTS[name]
    each = {f'flexible.{joint}.frequency': (1.0 + wrong) * own for joint, own in zip(joints, frequencies, strict=True)}
    return {'flexible.joints': list(joints), **each, **more}


@pytest.mark.parametrize(
    ('name', 'seeds'),
    [
        ('panels', 2),
        *(
            pytest.param(name, 3, marks=pytest.mark.long)
            for name in ('stiff panels', 'soft panels', 'panel on the target', 'propellant')
        ),
    ],
)
def test_what_swings_is_found_along(name: str, seeds: int, unchanged: Unchanged) -> None:
    urdf, joints, frequencies, _ = ROBOTS[name]
    surprises = []
    for seed in range(1, 1 + seeds):
        run, messages = simulated(name, seed, 25.0)
        last = feed(messages, session(urdf, **declared(name, 0.04 * (-1.0) ** seed)))[-1]
        unchanged(last)
        assert last.status in {'estimating', 'converged'}, last.warnings
        assert last.identifiable.all()
        error = last.parameters - run.target_inertia
        surprises.append(float(error @ np.linalg.solve(last.covariance, error)))
        assert last.std[0] < 0.002 * last.parameters[0]
        assert [each.joint for each in last.flexible] == list(joints)
        for found, frequency in zip(last.flexible, frequencies, strict=True):
            assert abs(found.frequency - frequency) < FAR * found.frequency_std
            assert found.frequency_std < 0.01 * frequency
            assert abs(found.damping - 0.01) < FAR * found.damping_std
            assert -found.deflection <= found.swing[0] < found.swing[1] <= found.deflection
    assert sum(surprises) < chi2.isf(1e-3, 10 * seeds)


def test_joints_that_messages_hold_all_the_same_are_not_read() -> None:
    _, messages = simulated('panels', 1, 8.0)
    alone = feed(messages, session(ROBOTS['panels'][0], **declared('panels', 0.02)))[-1]
    beside = session(ROBOTS['panels'][0], **declared('panels', 0.02))
    for each in messages:
        if each.topic == 'odom':
            beside.add_odometry(each.message)
            continue
        given, find = each.message, BAG_TYPES.find
        beside.add_joint_state(
            find('sensor_msgs/msg/JointState')(
                header=given.header,
                name=[*given.name, *PANELS],
                position=np.append(given.position, [np.nan, 0.0]),
                velocity=np.append(given.velocity, [0.0, np.nan]),
                effort=np.append(given.effort, [0.0, 0.0]),
            )
        )
    assert beside.process()[-1].parameters == pytest.approx(alone.parameters, rel=1e-12)


def test_the_joint_states_of_the_simulator_leave_them_out() -> None:
    run, messages = simulated('panels', 1, 8.0)
    names = {tuple(each.message.name) for each in messages if each.topic == 'joint_states'}
    assert names == {tuple(name for name in run.model.joint_names if name not in PANELS)}


@pytest.mark.long
def test_a_compliant_grasp_is_identified_with_windows_of_its_period() -> None:
    run, messages = simulated('compliant grasp', 1, 40.0)
    parameters = declared('compliant grasp', 0.04, target_link='target')
    assert session(with_grasp(), **parameters, window=1.0).config.window == 1.0
    own = session(with_grasp(), **parameters)
    assert own.config.window == 1.0  # by default 0.5 s, half a period
    last = feed(messages, own)[-1]
    assert last.status in {'estimating', 'converged'}, last.warnings
    error = last.parameters - run.target_inertia
    assert error @ np.linalg.solve(last.covariance, error) < chi2.isf(1e-3, 10)


@pytest.mark.long
def test_a_mast_that_turns_the_satellite_far_is_followed_from_a_wrong_frequency() -> None:
    run, messages = simulated('mast', 1, 12.0, rate=100.0)
    config = build(EstimatorConfig, {**NOISE, 'target_link': 'link7', **declared('mast', 0.1)})
    last = feed(messages, Session(config, ROBOTS['mast'][0]))[-1]
    assert last.status in {'estimating', 'converged'}, last.warnings
    assert np.all(np.abs(last.parameters - run.target_inertia) < FAR * last.std)
    assert abs(last.flexible[0].frequency - 1.0) < FAR * last.flexible[0].frequency_std < 0.02


@pytest.mark.long
def test_a_frequency_far_from_its_declaration_contradicts() -> None:
    _, messages = simulated('panels', 1, 25.0)
    exact = {f'flexible.{joint}.frequency_relative_std': 0.01 for joint in PANELS}
    last = feed(messages, session(ROBOTS['panels'][0], **declared('panels', 0.06, **exact)))[-1]
    assert last.contradicted
    assert any('flexible.panel' in text for text in last.warnings)


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'flexible.joints': ['boom']}, "has 'boom'"),
        ({'flexible.joints': ['panel_left']}, 'flexible.panel_left.frequency'),
        ({'flexible.boom.frequency': 0.3}, "'flexible.boom' is of no joint"),
    ],
)
def test_what_is_declared_has_to_fit_the_robot(parameters: dict[str, object], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        session(ROBOTS['panels'][0], **parameters)


def test_calls_make_no_difference_to_what_swings() -> None:
    urdf, *_ = ROBOTS['panels']
    _, messages = simulated('panels', 1, 14.0)
    said = [(each.topic, each.message) for each in messages]
    ends = [fed(session(urdf, **declared('panels', 0.02)), said, count)[-1] for count in (100_000, 40)]
    assert ends[0].identifiable.any()
    assert ends[0].parameters.tolist() == ends[1].parameters.tolist()
    assert ends[0].std.tolist() == ends[1].std.tolist()
