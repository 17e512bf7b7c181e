"""Estimates as messages."""

from __future__ import annotations

import numpy as np

from mbaid_ros.bags import deserialize, serialize
from mbaid_ros.core.results.estimate import Debris, Estimate, Event, PassiveJoint
from mbaid_ros.core.results.parameters import ErrorBudget
from mbaid_ros.outgoing import Frames, debris_message, estimate_message
from mbaid_ros.replay.run import BAG_TYPES

FRAMES = Frames(target_link='link7', odometry='odom')
PANEL = PassiveJoint('panel', 0.3, 0.001, 0.01, 0.002, deflection=0.02, resolved=True)


def example() -> Estimate:
    covariance = np.linspace(0.0, 99.0, 100, dtype=np.float64).reshape(10, 10)
    return Estimate(
        method='trajectory',
        status='converged',
        time=1.25,
        stamp=1_700_000_000_123_456_789,
        parameters=np.linspace(1.0, 10.0, 10, dtype=np.float64),
        covariance=covariance,
        identifiable=np.arange(10) != 3,
        momentum=np.arange(6.0, dtype=np.float64),
        momentum_covariance=np.eye(6),
        residual=1.1,
        samples=125,
        stage='trajectory',
        budget=ErrorBudget(
            ('sensor noise', 'mount'), np.column_stack((np.linspace(0.0, 0.9, 10), np.linspace(1.0, 0.1, 10)))
        ),
        events=(Event(1.0, 'step', np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), 'a thruster'),),
        warnings=('of the estimate',),
        flexible=(PANEL,),
    )


def test_an_estimate_survives_the_wire_in_full() -> None:
    estimate = example()
    message = estimate_message(estimate, BAG_TYPES, FRAMES, ['of the run'])
    type_name = 'mbaid_msgs/msg/InertiaEstimate'
    read = deserialize(serialize(message, type_name), type_name)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert (read.header.frame_id, read.momentum_frame) == ('link7', 'odom')
    assert (read.method, read.stage, read.status, read.samples) == ('trajectory', 'trajectory', 'converged', 125)
    inertia = read.inertia
    assert (inertia.m, inertia.com.x, inertia.com.y, inertia.com.z) == (1.0, 2.0, 3.0, 4.0)
    assert (inertia.ixx, inertia.ixy, inertia.ixz) == (5.0, 6.0, 7.0)
    assert (inertia.iyy, inertia.iyz, inertia.izz) == (8.0, 9.0, 10.0)
    np.testing.assert_array_equal(read.covariance.reshape(10, 10), estimate.covariance)
    np.testing.assert_array_equal(read.identifiable, estimate.identifiable)
    np.testing.assert_array_equal(read.standard_deviation, estimate.std)
    assert estimate.budget is not None
    assert read.budget_causes == ['sensor noise', 'mount']
    np.testing.assert_array_equal(read.budget_shares.reshape(10, 2), estimate.budget.shares)
    assert (read.angular_momentum.x, read.angular_momentum.z) == (3.0, 5.0)
    np.testing.assert_array_equal(read.momentum_covariance.reshape(6, 6), np.eye(6))
    assert (read.span.sec, read.span.nanosec) == (1, 250_000_000)
    assert (read.phase, read.stale) == ('post_capture', False)
    (event,) = read.events
    assert (event.kind, event.time, event.cause) == ('step', 1.0, 'a thruster')
    assert (event.linear.x, event.angular.z) == (1.0, 6.0)
    # A quarter of a second before the last sample.
    assert (event.stamp.sec, event.stamp.nanosec) == (1_699_999_999, 873_456_789)
    assert np.isnan(read.time_offset)
    assert read.warnings == ['of the estimate', 'of the run', str(PANEL)]


def test_an_estimate_of_nothing_is_nan() -> None:
    message = estimate_message(Estimate(method='difference', status='waiting'), BAG_TYPES, FRAMES)
    assert np.isnan(message.inertia.m)
    assert not np.any(message.identifiable)
    assert np.all(np.isnan(message.standard_deviation))
    assert (message.stage, message.budget_causes, len(message.budget_shares)) == ('', [], 0)


def test_the_captured_body_alone_has_its_own_standard_deviations_and_no_budget() -> None:
    estimate = example()
    alone = Debris(estimate.parameters, 4.0 * estimate.covariance)
    message = debris_message(alone, estimate, BAG_TYPES, FRAMES)
    np.testing.assert_allclose(message.standard_deviation, 2.0 * estimate.std)
    assert (message.stage, message.budget_causes) == ('trajectory', [])
