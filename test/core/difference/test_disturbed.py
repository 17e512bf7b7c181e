"""What disturbs a run of the servicer: found, named, survived; and nothing found where nothing is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.stats import chi2

from floating import float_freely, pushing, true_momentum
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.difference.effects import ConstantForces
from mbaid_ros.core.equations.window_rows import joined
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.known_errors import body_sizes
from mbaid_ros.core.simulation.motion import Sinusoids
from mbaid_ros.core.simulation.run import Truth, total_momentum
from mbaid_ros.simulated_run import make_motion
from observed import MID, configured_motion, estimator, identify, kernel, nees, observe, true_body, windows
from simulated import CONFIG

SECONDS = 16.0
PULSED = 9.2  # s
PULSE = np.array([1.8, -1.8, 1.5, 0.9, 0.8, -0.9])  # N s, N m s
FORCE = np.array([0.3, -0.25, 0.28, -0.15, 0.13, 0.16])  # N, N m
# Ten parameters, one run in a thousand; errors are a little larger than the covariance of first order says.
LIMIT = 1.25 * float(chi2.isf(1e-3, 10))

Float = Callable[..., Truth]


@pytest.fixture(scope='module')
def robot() -> MomentumKernel:
    return kernel('servicer7')


@pytest.fixture(scope='module')
def floating(robot: MomentumKernel) -> Float:
    config = build(SimulatorConfig, load_parameter_file(CONFIG / 'servicer7_simulator.yaml', 'simulator'))
    motion = make_motion(config, robot.model)
    assert isinstance(motion, Sinusoids)
    start = total_momentum(robot.model, configured_motion('servicer7', 0.1, 20.0, 0.05)[:1])[0]
    # Every fourth sample: 25 a second are enough.
    return lambda **disturbed: float_freely(robot, motion, start, SECONDS, **disturbed)[::4]


@pytest.fixture(scope='module')
def free(floating: Float) -> Truth:
    return floating()


@pytest.fixture(scope='module')
def pushed(floating: Float) -> dict[str, Truth]:
    return {axes: floating(push=pushing(FORCE, axes)) for axes in ('inertial', 'body')}


def test_a_pulse(robot: MomentumKernel, floating: Float) -> None:
    truth = floating(pulse=(PULSED, PULSE))
    for seed in range(2):
        estimates = identify(robot, truth, MID, seed)
        last = estimates[-1]
        (event,) = last.events
        assert event.kind == 'step'
        assert PULSED - 0.5 <= event.time <= PULSED + 0.5
        assert event.cause == 'thrust pulse or contact'
        assert event.linear == pytest.approx(PULSE[:3], abs=0.7)
        assert event.angular == pytest.approx(PULSE[3:], abs=1.3)
        assert any('momentum jumped at 9' in warning for warning in last.warnings)
        # Within a second, and with as good an estimate as ever.
        assert next(estimate.time for estimate in estimates if estimate.events) < PULSED + 1.0
        assert nees(last, true_body(robot)) < LIMIT
        assert last.status in {'estimating', 'converged'}
        after = true_momentum(robot, observe(truth, MID)[-1:])[0]
        error = last.momentum - after
        assert float(error @ np.linalg.solve(last.momentum_covariance, error)) < 1.25 * chi2.isf(1e-3, 6)


def test_nothing_disturbs_an_undisturbed_run(robot: MomentumKernel, free: Truth) -> None:
    for seed in range(2):
        last = identify(robot, free, MID, seed)[-1]
        assert not last.events
        assert not last.warnings


@pytest.mark.parametrize('axes', ['inertial', 'body'])
@pytest.mark.parametrize('given', [False, True])
def test_a_constant_force(robot: MomentumKernel, pushed: dict[str, Truth], axes: str, given: bool) -> None:
    parameters = {'disturbance__constant': axes} if given else {}
    for seed in range(2):
        last = identify(robot, pushed[axes], MID, seed, **parameters)[-1]
        assert {event.kind for event in last.events} == {'ramp'}
        # A base that hardly turns does not tell the two kinds of axes apart, nor are they different for it.
        if given:
            (event,) = last.events
            assert f'constant in {"base" if axes == "body" else axes} axes' in event.cause
            assert np.concatenate((event.linear, event.angular)) == pytest.approx(FORCE, abs=0.2)
        assert nees(last, true_body(robot)) < LIMIT
        # The momentum is that of the present.
        error = last.momentum - true_momentum(robot, observe(pushed[axes], MID)[-1:])[0]
        assert float(error @ np.linalg.solve(last.momentum_covariance, error)) < 1.25 * chi2.isf(1e-3, 6)


def test_a_force_that_is_not_there_only_widens_the_intervals(robot: MomentumKernel, free: Truth) -> None:
    plain, wider = (identify(robot, free, MID, 3, disturbance__constant=axes)[-1] for axes in ('none', 'inertial'))
    assert not wider.events
    assert np.all(wider.std > 0.99 * plain.std)
    assert nees(wider, true_body(robot)) < LIMIT


def wrong(robot: MomentumKernel, truth: Truth, seed: int, relative: float, **parameters: object) -> Estimate:
    """Return the estimate with known bodies that are off by a relative standard deviation."""
    rng = np.random.default_rng([seed, 1])
    sizes = np.array([body_sizes(body) if body[0] > 0.0 else np.zeros(10) for body in robot.known])
    off = robot.corrected(relative * rng.normal(size=sizes.shape) * sizes)
    return estimator(off, MID, **parameters).update(windows(observe(truth, MID, seed)), 0)[-1]


def test_known_bodies_that_are_uncertain(robot: MomentumKernel, free: Truth) -> None:
    true = true_body(robot)
    exact, allowed = [], []
    for seed in range(3):
        exact.append(nees(wrong(robot, free, seed, 0.01), true))
        last = wrong(robot, free, seed, 0.01, known_links__relative_std=0.01)
        assert not last.events
        assert last.status == 'estimating'
        assert 'to base_link alone' in last.warnings[-1]
        allowed.append(nees(last, true))
    assert sum(allowed) < 1.25 * chi2.isf(1e-3, 30)
    assert min(exact) > 2.0 * LIMIT


def test_errors_of_known_bodies_estimated_along(robot: MomentumKernel, free: Truth) -> None:
    given: dict[str, object] = {'known_links__relative_std': 0.01}
    considered, estimated = (
        wrong(robot, free, 5, 0.01, **given, known_links__mode=mode) for mode in ('consider', 'estimate')
    )
    assert nees(estimated, true_body(robot)) < LIMIT
    known = considered.identifiable
    # The data tell much of them.
    assert np.all(estimated.std[known] < 0.7 * considered.std[known])


def test_links_of_their_own_uncertainty(robot: MomentumKernel, free: Truth) -> None:
    part = free[free.time < 8.0]
    base, all_alike, arm = (
        identify(robot, part, MID, 6, **given)[-1].std[0]
        for given in (
            {'known_links__names': ('base_link',), 'known_links__stds': (0.01,)},
            {'known_links__relative_std': 0.01},
            {'known_links__relative_std': 0.01, 'known_links__names': ('base_link',), 'known_links__stds': (0.0,)},
        )
    )
    assert all_alike > base > arm


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'known_links__names': ('base_link',)}, 'known_links.stds'),
        ({'known_links__names': ('arm',), 'known_links__stds': (0.1,)}, "'arm'; accepted: base_link"),
        ({'known_links__relative_std': -0.1}, 'known_links.relative_std'),
        ({'disturbance__constant': 'world'}, 'none, inertial, body'),
    ],
)
def test_parameters_that_cannot_be(robot: MomentumKernel, parameters: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        estimator(robot, MID, **parameters)


@pytest.mark.parametrize('axes', ['inertial', 'body'])
def test_what_a_force_does_to_the_momentum(robot: MomentumKernel, pushed: dict[str, Truth], axes: str) -> None:
    samples = observe(pushed[axes], MID)
    origin = samples.base_position[0]
    acting = ConstantForces(('body' if axes == 'body' else 'inertial',), origin)
    momentum = true_momentum(robot, samples)
    about = momentum - np.concatenate((np.zeros((len(samples), 3)), np.cross(origin, momentum[:, :3])), axis=1)
    for window in windows(samples):
        columns, gains = acting.columns(*joined([window]))
        place = np.searchsorted(samples.time, window.time)
        change = about[place] - about[0]
        change[:, 3:] -= np.cross(window.base_position - origin, change[:, :3])
        assert -columns[0, 0] @ FORCE == pytest.approx(np.mean(change, axis=0), abs=1e-4)
        assert gains[0, 0] @ FORCE == pytest.approx(about[place[-1]] - about[0], abs=1e-4)


@pytest.mark.parametrize('constant', ['none', 'inertial'])
def test_a_force_is_the_same_however_the_windows_come(
    robot: MomentumKernel, pushed: dict[str, Truth], constant: str
) -> None:
    given = windows(observe(pushed['inertial'], MID, 3))
    together = estimator(robot, MID, disturbance__constant=constant).update(given, 0)
    alone = estimator(robot, MID, disturbance__constant=constant)
    one_by_one = [alone.update([window], 0)[0] for window in given]
    assert any(estimate.events for estimate in together)
    for one, other in zip(one_by_one, together, strict=True):
        assert np.array_equal(one.parameters, other.parameters, equal_nan=True)
        assert np.array_equal(one.momentum, other.momentum)
        assert np.array_equal(one.momentum_covariance, other.momentum_covariance)


def test_joints_that_are_late(robot: MomentumKernel, free: Truth) -> None:
    late = 0.02  # s
    position, velocity = (CubicSpline(free.time, values) for values in (free.joint_position, free.joint_velocity))
    truth = replace(free, joint_position=position(free.time - late), joint_velocity=velocity(free.time - late))
    last = identify(robot, truth, MID, 7)[-1]
    assert last.time_offset == pytest.approx(late, abs=3.0 * last.time_offset_std)
    assert nees(last, true_body(robot)) < LIMIT
    assert any('stamped' in warning for warning in last.warnings)
    assert last.status in {'estimating', 'converged'}
    taken = identify(robot, truth, MID, 7, time_offset__estimate=False)[-1]
    assert np.isnan(taken.time_offset)
    assert nees(last, true_body(robot)) < 0.1 * nees(taken, true_body(robot))
