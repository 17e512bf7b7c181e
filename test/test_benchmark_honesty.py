"""The instrument that says whether the estimator is silently wrong: its worlds, its sensors and its verdicts."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.special import ndtri

from benchmarks.data import motion
from benchmarks.honesty import readings, robots
from benchmarks.honesty.disturbed import CATALOGUE
from benchmarks.honesty.paths import sinusoids
from benchmarks.honesty.runs import Outcome, jointly, judged, run
from benchmarks.honesty.worlds import World, float_freely, swing
from mbaid_ros.core.geometry import Array, exp, rotation_from_quaternion
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.simulation import total_momentum


def outcome(status: list[str], error: Array, jointly: float = 0.0) -> Outcome:
    """Return runs with errors (R, 10) in standard deviations of 1."""
    none = np.zeros(len(status))
    causes = np.array(['a cause'] * len(status))
    return Outcome(
        np.array(status), error, np.ones_like(error), np.full(len(status), jointly), causes, causes, *(none,) * 6
    )


def test_the_base_floats_as_the_simulator_has_it() -> None:
    truth = float_freely(World(robots.servicer(), sinusoids(), seconds=20.0))
    expected = motion('servicer7')[: len(truth)]
    np.testing.assert_allclose(truth.joint_position, expected.joint_position, atol=1e-7)
    np.testing.assert_allclose(truth.base_position, expected.base_position, atol=1e-7)
    np.testing.assert_allclose(truth.base_orientation, expected.base_orientation, atol=1e-7)
    np.testing.assert_allclose(truth.base_angular_velocity, expected.base_angular_velocity, atol=1e-7)


@pytest.mark.parametrize(
    'name', ['a flexible panel of 0.3 Hz', 'fuel that sloshes at 0.1 Hz', 'a flexible joint of 2 Hz']
)
def test_springs_keep_the_momentum_and_swing_at_their_frequency(name: str) -> None:
    world = CATALOGUE[name].world(0)
    truth = swing(replace(world, seconds=20.0))
    robot = load_model(world.urdf)
    momentum = total_momentum(robot, truth)
    np.testing.assert_allclose(momentum - momentum[0], 0.0, atol=1e-4 * np.max(np.abs(momentum)))
    joint, spring = next(iter(world.springs.items()))
    deflection = truth.joint_position[:, robot.joint_names.index(joint)]
    assert deflection[0] == spring.deflection
    frequency = np.fft.rfftfreq(len(deflection), 1.0 / world.rate)
    spectrum = np.abs(np.fft.rfft(deflection)) * (frequency > 0.5 * spring.frequency)  # not what is slow
    # As the robot was at first; the spectrum has a line every 0.05 Hz.
    assert frequency[np.argmax(spectrum)] == pytest.approx(spring.frequency, rel=0.15, abs=0.051)


@pytest.mark.parametrize(
    'view',
    [
        partial(readings.mounted, np.array([0.1, -0.2, 0.3]), np.array([0.2, 0.1, -0.3])),
        partial(readings.in_orbit_frame, 0.01),
        partial(readings.scaled, 1.01),
    ],
)
def test_views_have_the_twist_of_their_poses(view: readings.View) -> None:
    seen = view(motion('servicer7')[:500])
    rotation = rotation_from_quaternion(seen.base_orientation)
    velocity = np.einsum('nij,nj->ni', rotation, seen.base_linear_velocity)
    np.testing.assert_allclose(np.gradient(seen.base_position, 0.01, axis=0)[1:-1], velocity[1:-1], atol=1e-6)
    middle = 0.01 * 0.5 * (seen.base_angular_velocity[1:] + seen.base_angular_velocity[:-1])
    np.testing.assert_allclose(rotation[:-1] @ exp(middle), rotation[1:], atol=1e-7)


def test_a_row_is_silently_wrong_by_error_or_by_coverage() -> None:
    right, off = np.full((2, 10), 0.5), np.full((2, 10), 0.5)
    off[1, 3] = -5.5
    few = np.full((2, 10), 0.5)
    few[:, :5] = 3.0
    assert not judged(outcome(['converged', 'estimating'], right)).silently_wrong
    assert judged(outcome(['converged', 'estimating'], off)).silently_wrong
    assert judged(outcome(['converged', 'estimating'], few)).covered == 0.5
    assert judged(outcome(['converged', 'estimating'], few)).silently_wrong
    assert judged(outcome(['converged'], right[:1], jointly=5.1)).silently_wrong
    assert not judged(outcome(['inconsistent'], right[:1], jointly=5.1)).silently_wrong
    # The run that is off says so.
    assert not judged(outcome(['converged', 'inconsistent'], off)).silently_wrong
    assert np.isnan(judged(outcome(['inconsistent', 'not_identifiable'], off)).largest)


def test_errors_together_are_measured_by_what_a_single_one_would_be_off_by() -> None:
    def last(*pairs: tuple[int, int, float]) -> Estimate:
        covariance = np.full((10, 10), np.nan)
        for row, column, value in pairs:
            covariance[row, column] = covariance[column, row] = value
        return Estimate('trajectory', 'converged', 1.0, 0, samples=1, parameters=np.zeros(10), covariance=covariance)

    both = last((0, 0, 4.0), (1, 1, 4.0), (0, 1, 0.99 * 4.0))
    # One standard deviation each, in opposite directions: 200 of chi-square with two degrees of freedom, exp(-100).
    sought = np.array([2.0, -2.0, *[0.0] * 8])
    assert jointly(both, sought) == pytest.approx(-ndtri(0.5 * np.exp(-100.0)))
    assert jointly(both, abs(sought)) == pytest.approx(-ndtri(0.5 * np.exp(-0.5 / 0.995)))
    assert jointly(last((0, 0, 4.0)), 3.0 * sought) == pytest.approx(3.0)
    assert np.isnan(jointly(last(), sought))


def test_a_run_of_a_condition_says_what_it_ends_with() -> None:
    told = run(('5 s of data', 'difference', 0))
    assert told.error.shape == told.std.shape == (10,)
    assert told.status in {'estimating', 'not_identifiable'}
    assert 0.0 <= max(told.worst, told.young) < 5.0
