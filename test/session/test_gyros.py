"""Several gyros by name: a second one on the same link or on one that joints move, and names that cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.data import simulator_config
from gyros import DENSITY, KNOWN, messages, normalised
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.gyro import IMU, Gyro
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.session.explanation import intake_warnings
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.robot import KnownRobot, nominal_model
from mbaid_ros.session.session import MakeEstimator, Session
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from sessions import NOISE, fed
from streams import urdf
from unchanged import Unchanged

ROBOT = 'servicer7'
ARM = {'gyros.names': ['arm'], 'gyros.arm.noise_density': DENSITY, 'gyros.arm.frame': 'link3'}
ARM |= {f'gyros.arm.{name}': KNOWN[f'imu.{name}'] for name in ('bias_std', 'scale_std')}


def with_second(first: tuple[TimedMessage, ...], second: tuple[TimedMessage, ...]) -> list[TimedMessage]:
    """Return all messages of a run, and the IMU's of another one as those of a gyro named arm."""
    others = [replace(each, topic='gyros.arm') for each in second if each.topic == IMU]
    return sorted((*first, *others), key=lambda each: each.time)


def last(said: list[TimedMessage], parameters: Mapping[str, object], make: MakeEstimator | None = None) -> Estimate:
    session = Session(build(EstimatorConfig, parameters), urdf(ROBOT), make)
    return fed(session, ((each.topic, each.message) for each in said))[-1]


@cache
def without_errors() -> tuple[TimedMessage, ...]:
    """Return a run whose gyro has no errors but noise."""
    own = {**NOISE, 'imu.rate': 100.0, 'imu.noise_density': DENSITY, 'imu.link': 'link3', 'odometry_rate': 20.0}
    run = SimulatedRun(simulator_config(ROBOT, {**own, 'joint_rate': 50.0}), urdf(ROBOT), BAG_TYPES)
    return tuple(run.read(8.0))


def make_exact(config: EstimatorConfig, kernel: MomentumKernel, known: KnownRobot | None) -> Estimator:
    """Return the method with gyros that have no errors but noise."""
    robot = known or nominal_model(config, kernel)
    unknowns = tuple(each for each in robot.declared.unknowns if not isinstance(each, Gyro))
    return make_estimator(config, kernel, replace(robot, declared=replace(robot.declared, unknowns=unknowns)))


def test_two_gyros_of_twice_the_variance_are_one() -> None:
    said, size = without_errors(), np.sqrt(2.0)
    # Noise is declared larger than it is: a misfit by chance would widen the intervals of fewer numbers by more.
    declared = {**KNOWN, **{name: 1.5 * float(value) for name, value in NOISE.items()}, 'imu.frame': 'link3'}
    one = last([*said], {**declared, 'imu.noise_density': 1.5 * DENSITY}, make_exact)
    density = {'imu.noise_density': size * 1.5 * DENSITY, 'gyros.arm.noise_density': size * 1.5 * DENSITY}
    two = last(with_second(said, said), {**declared, **ARM, **density}, make_exact)
    assert one.identifiable.all()
    assert two.parameters == pytest.approx(one.parameters, abs=1e-6 * float(np.min(one.std)))
    assert two.std == pytest.approx(one.std, rel=1e-6)


def test_a_gyro_on_the_arm_beside_one_on_the_base(unchanged: Unchanged) -> None:
    """Errors of the estimates have the size of the standard deviations, and the second gyro makes these smaller."""
    errors = []
    for seed in range(3):
        said = messages(ROBOT, 12.0, seed)
        both = last(with_second(said, messages(ROBOT, 12.0, 50 + seed, link='link3')), {**KNOWN, **ARM})
        unchanged(both)
        assert both.status in {'estimating', 'converged'}
        errors.append(normalised(both, ROBOT))
        if not seed:
            alone = last([*said], KNOWN)
            seen = alone.identifiable & both.identifiable
            assert np.all(both.std[seen] < alone.std[seen])
    found = np.concatenate(errors)
    assert np.sqrt(np.mean(found**2)) < 1.5
    assert np.abs(found).max() < 4.0


@pytest.mark.parametrize(
    ('parameters', 'problem'),
    [
        ({'gyros.names': ['odom'], 'gyros.odom.noise_density': 1e-4}, "'gyros.names' has 'odom'"),
        ({'gyros.names': ['arm', 'arm'], 'gyros.arm.noise_density': 1e-4}, 'each name once'),
        ({'gyros.names': ['a/b'], 'gyros.a/b.noise_density': 1e-4}, "'gyros.names' has 'a/b'"),
        ({'gyros.names': ['arm']}, "'gyros.arm.noise_density' is 0"),
        ({'gyros.arm.noise_density': 1e-4}, "'gyros.arm' is of no gyro"),
        ({**ARM, 'gyros.arm.frame': 'link9'}, "'gyros.arm.frame' is 'link9'"),
    ],
)
def test_gyros_that_cannot_be_used(parameters: Mapping[str, object], problem: str) -> None:
    with pytest.raises(ParameterError, match=problem):
        Session(build(EstimatorConfig, {**KNOWN, **parameters}), urdf(ROBOT))


def test_a_gyro_that_never_speaks_is_named_and_the_run_goes_on() -> None:
    session = Session(build(EstimatorConfig, {**KNOWN, **ARM}), urdf(ROBOT))
    estimates = fed(session, ((each.topic, each.message) for each in messages(ROBOT, 6.0, 0)))
    assert estimates
    assert 'gyros.arm.noise_density is set, and nothing comes on arm' in ' '.join(intake_warnings(session))
