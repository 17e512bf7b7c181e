"""What disturbs a run of the difference form makes it inconsistent; and nothing is found where nothing is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from floating import float_freely, pushing
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import WITHHELD, Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import body_sizes
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth, total_momentum
from observed import MID, configured_motion, estimator, identify, kernel, nees, observe, true_body, windows

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
def floating(robot: MomentumKernel, joints: Sinusoids) -> Float:
    start = total_momentum(robot.model, configured_motion('servicer7', 0.1, 20.0)[:1])[0]
    # Every fourth sample: 25 a second are enough.
    return lambda **disturbed: float_freely(robot, joints, start, SECONDS, **disturbed)[::4]


@pytest.fixture(scope='module')
def free(floating: Float) -> Truth:
    return floating()


@pytest.fixture(scope='module')
def pushed(floating: Float) -> dict[str, Truth]:
    return {axes: floating(push=pushing(FORCE, axes)) for axes in ('inertial', 'body')}


def honest(estimates: list[Estimate], true: Array) -> bool:
    return estimates[-1].status == 'inconsistent' or nees(estimates[-1], true) < LIMIT


def test_a_pulse(robot: MomentumKernel, floating: Float) -> None:
    truth = floating(pulse=(PULSED, PULSE))
    for seed in range(2):
        estimates = identify(robot, truth, MID, seed)
        (event,) = estimates[-1].events
        assert event.kind == 'step'
        assert PULSED - 0.5 <= event.time <= PULSED + 0.5
        assert event.linear == pytest.approx(PULSE[:3], abs=0.7)
        assert event.angular == pytest.approx(PULSE[3:], abs=1.3)
        assert any('the momentum is not constant: momentum jumped at 9' in x for x in estimates[-1].warnings)
        # Within a second, and from then on.
        at_once = next(estimate for estimate in estimates if estimate.events)
        assert at_once.time < PULSED + 1.0
        assert {x.status for x in estimates if x.time >= at_once.time} == {'inconsistent'}
        assert 'inconsistent' not in {x.status for x in estimates if x.time < at_once.time}


def test_where_nothing_is_told_the_pulse_is(robot: MomentumKernel, floating: Float) -> None:
    samples = observe(floating(pulse=(PULSED, 300.0 * PULSE)), MID, 0)
    last = estimator(robot, MID, known_links__relative_std=1.0).update(windows(samples), 0)[-1]
    assert last.status == 'not_identifiable'
    assert last.contradicted
    assert WITHHELD in last.warnings
    resting = replace(samples[:1], time=samples.time[:1])
    assert not estimator(robot, MID).update(windows(resting), 0)[-1].contradicted


@pytest.mark.parametrize('turned', [0.0003, 0.05])
def test_a_slip_of_the_grasp(robot: MomentumKernel, free: Truth, turned: float) -> None:
    """The body turns in the grasp, about the last joint: the momentum stays, the identified parameters do not."""
    position = free.joint_position.copy()
    position[free.time >= PULSED, -1] += turned
    assert honest(identify(robot, replace(free, joint_position=position), MID, 0), true_body(robot))


@pytest.mark.parametrize('axes', ['inertial', 'body'])
def test_a_constant_force(robot: MomentumKernel, pushed: dict[str, Truth], axes: str) -> None:
    for seed in range(2):
        last = identify(robot, pushed[axes], MID, seed)[-1]
        assert last.status == 'inconsistent'
        assert any('a force that lasts' in warning for warning in last.warnings)


def test_noise_that_is_larger_than_declared(robot: MomentumKernel, free: Truth) -> None:
    samples = observe(free, SensorNoise(*(3.0 * value for value in vars(MID).values())), 0)
    samples = replace(
        samples, pose_covariance=samples.pose_covariance / 9.0, twist_covariance=samples.twist_covariance / 9.0
    )
    last = estimator(robot, MID).update(windows(samples), 0)[-1]
    assert last.status == 'inconsistent'
    assert not last.events
    assert any('(mean normalised innovation squared)' in warning for warning in last.warnings)
    assert any(
        'residuals are 3.0 times' in warning or 'residuals are 2.9 times' in warning for warning in last.warnings
    )


def test_nothing_disturbs_an_undisturbed_run(robot: MomentumKernel, free: Truth) -> None:
    for seed in range(2):
        last = identify(robot, free, MID, seed)[-1]
        assert not last.events
        assert not last.warnings
        assert np.isnan(last.time_offset)


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
        assert 'of the variance is due to the uncertainty of the robot model' in last.warnings[-1]
        allowed.append(nees(last, true))
    assert sum(allowed) < 1.25 * chi2.isf(1e-3, 30)
    assert min(exact) > 2.0 * LIMIT


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'known_links.arm.com_std': 0.1}, "'known_links.arm' is of no known link with mass; accepted: base_link"),
        (
            {'known_links.link7.com_std': 0.1},
            "'known_links.link7' is of the link that is identified.*target_prior.mass",
        ),
        ({'known_links.base_link.stds': 0.1}, 'unknown parameter'),
        ({'disturbance__constant': 'body'}, "'body' with method difference.*accepted: none, or method trajectory"),
    ],
)
def test_parameters_that_cannot_be(robot: MomentumKernel, parameters: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        estimator(robot, MID, **parameters)
