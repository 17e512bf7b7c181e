"""Orientations by a gyro, between poses and alone; momentum that is published; windows that wait for their noise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import assert_derivative, generic, some
from mbaid_ros.core.forces import Thrust
from mbaid_ros.core.geometry import Array, exp, log, rotate
from mbaid_ros.core.gyro import IMU, DeadReckoning, RateIntegrator
from mbaid_ros.core.noise import NoiseEstimator
from mbaid_ros.core.odometry.stream import measured_orientation
from mbaid_ros.core.pipeline import Synchroniser
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, Samples
from mbaid_ros.core.wheels import StoredMomentum
from observed import MID, configured_motion, observe
from simulated import robot

SECOND = 1_000_000_000
AXIS = generic(0, 3) / np.linalg.norm(generic(0, 3))


def angle(time: Array) -> Array:
    """Return an angle that swings faster than poses follow it, rad."""
    return np.asarray(0.1 * np.sin(2.0 * np.pi * 6.0 * time)[:, None] * AXIS)


def stamps(time: Array) -> Any:
    return SECOND + np.round(SECOND * time).astype(np.int64)


def between_poses(bias: Array) -> tuple[Array, Array]:
    """Return the rotations of samples between poses, as read with a gyro, and the true ones."""
    often, seldom, joints = np.arange(0.0, 1.0, 1e-3), np.arange(0.0, 1.0, 0.1), np.arange(0.0, 0.9, 0.013)
    count = len(seldom)
    unknown, covariance = np.full((count, 3), np.nan), np.tile(0.01 * np.eye(6), (count, 1, 1))
    base = BaseStream(
        stamps(seldom), np.zeros((count, 3)), exp(angle(seldom)), unknown, unknown, covariance, covariance
    )
    rate = 0.1 * 2.0 * np.pi * 6.0 * np.cos(2.0 * np.pi * 6.0 * often)[:, None] * AXIS
    imu = ImuStream(stamps(often), rate + bias)
    way = np.linspace(0.0, 1.0, len(joints))[:, None]
    read = JointStream(stamps(joints), way, np.ones_like(way))
    found = some(Synchroniser(1.0, followers={IMU: RateIntegrator(100_000_000)}).push(read, base, {IMU: imu}))
    return found.base_rotation, exp(angle(found.time + joints[0]))


@pytest.mark.parametrize('bias', [0.0, 0.02])
def test_between_poses_the_gyro_shows_how_the_base_turns(bias: float) -> None:
    """The error of its integral is spread evenly, so that a bias hardly matters."""
    found, true = between_poses(bias * AXIS)
    assert len(found) > 50
    assert np.abs(log(np.swapaxes(true, 1, 2) @ found)).max() < 3e-5
    askew = between_poses(bias * np.cross(AXIS, [1.0, 0.0, 0.0]))
    assert np.abs(log(np.swapaxes(askew[1], 1, 2) @ askew[0])).max() < 1e-3 * (bias > 0.0) + 3e-5


def evenly(time: Array) -> Array:
    """Return a rate that changes evenly, about another axis than it points along."""
    return np.asarray(generic(1, 3) + time[:, None] * generic(2, 3))


@pytest.mark.parametrize('pieces', [1, 7])
def test_an_orientation_is_integrated_to_fourth_order(pieces: int) -> None:
    time = np.arange(0.0, 4.0, 0.01)
    imu = ImuStream(stamps(time), evenly(time))
    reckoning = DeadReckoning()
    assert reckoning.push(None) is None
    parts = [some(reckoning.push(imu[piece])).rotation for piece in np.array_split(np.arange(len(time)), pieces)]
    found = np.concatenate(parts)
    rotation, fine = np.eye(3), 1e-4
    for step in exp(fine * evenly(np.arange(0.0, 0.1, fine) + 0.5 * fine)):  # a hundred times as fine
        rotation = rotation @ step
    assert found[0].tolist() == np.eye(3).tolist()
    assert np.abs(log(rotation.T @ found[10])).max() < 2e-8
    assert found[-1] @ found[-1].T == pytest.approx(np.eye(3), abs=1e-13)


def test_an_imu_that_measures_orientations_reads_them_alone() -> None:
    rotation, covariance = exp(generic(0, 3, 3)), np.tile(np.diag([1.0, 2.0, 3.0]), (3, 1, 1))
    imu = ImuStream(
        stamps(np.arange(3.0)), np.zeros((3, 3)), rotation.copy(), covariance, np.array([True, True, False])
    )
    imu.rotation[1] = np.nan
    base = some(measured_orientation(imu))
    assert base.stamp.tolist() == imu.stamp[[0, 2]].tolist()
    assert np.array_equal(base.rotation, rotation[[0, 2]])
    assert np.array_equal(base.pose_covariance[:, 3:, 3:], covariance[[0, 2]])
    assert np.isnan(base.pose_covariance[:, :3]).all()
    assert np.isnan(base.linear_velocity).all()
    assert base.declared.tolist() == [[True, True, True, True], [True, False, True, True]]
    assert measured_orientation(None) is None
    assert measured_orientation(ImuStream(imu.stamp, imu.angular_velocity)) is None


def test_published_momentum_is_in_the_axes_that_are_asked_for() -> None:
    model, vector = robot('servicer7'), generic(0, 3)
    body = model.link('link3')
    turned = replace(body, name='turned', rotation=exp(generic(1, 3)) @ body.rotation)
    stored = StoredMomentum(replace(model, links=(*model.links, turned)), 'link3')
    stored.add_sample('link3', 5, vector)
    stored.add_sample('turned', 7, vector)
    stored.add_sample('link4', 8, vector)
    stored.add_sample('link3', 9, vector * np.nan)
    stream = some(stored.stream())
    assert stream.stamp.tolist() == [5, 7]
    assert stream.velocity[0] == pytest.approx(vector)
    assert rotate(body.rotation, stream.velocity[1]) == pytest.approx(rotate(turned.rotation, vector))
    assert (stored.used, stored.other_frame, sum(stored.dropped.values())) == (2, 'link4', 2)
    assert stored.stream() is None
    unasked = StoredMomentum(model, '')
    unasked.add_sample('link3', 5, vector)
    assert (unasked.used, sum(unasked.dropped.values())) == (0, 1)


ON, OFF = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(6)


@pytest.mark.parametrize(
    ('stamp', 'wrench', 'newest', 'affects'),
    [
        (1.9, ON, 1.9, False),  # the same goes on
        (1.9, OFF, 1.9, True),
        (0.5, ON, 1.9, True),  # before the last one
        (9.0, ON, 9.0, True),  # after the last one has died down
        (9.0, ON, None, False),
    ],
)
def test_a_command_matters_to_samples_where_it_changes_what_acts(
    stamp: float, wrench: Array, newest: float | None, affects: bool
) -> None:
    thrust = Thrust(robot('servicer7'))
    thrust.add_command('base_link', SECOND, ON, SECOND)
    seen = None if newest is None else round(newest * SECOND)
    assert thrust.affects_samples('base_link', round(stamp * SECOND), wrench, seen) is affects


def impulse(samples: Samples, errors: Array, late: bool) -> tuple[Array, Array]:
    """Return the impulse of a thruster with errors of scale, turn and delay, and the derivatives by them."""
    thrust = Thrust(robot('servicer7'), uncertain=('link3',))
    scale, turn, delay = errors[0], errors[1:4], errors[4]
    rotation = (1.0 + scale) * exp(turn)
    commands = [
        (
            'link3',
            stamp + round(delay * SECOND),
            np.concatenate([rotate(rotation, part) for part in np.split(wrench, 2)]),
        )
        for stamp, wrench in ((SECOND // 5, generic(1, 6)), (SECOND // 2, OFF))
    ]
    whole = thrust.with_momentum(samples, 0) if late else samples
    for frame, stamp, wrench in commands:
        thrust.add_command(frame, stamp, wrench, SECOND)
    columns = (thrust._columns if late else thrust.with_momentum(whole, 0).thrust[-1]).reshape(6, THRUSTER_ERRORS)
    return thrust.impulse, columns


@pytest.mark.parametrize('late', [False, True])
def test_the_impulse_depends_on_the_errors_of_a_thruster_as_its_columns_say(late: bool) -> None:
    samples = observe(configured_motion('servicer7', 1.0, 20.0), MID)

    def function(errors: Array) -> Array:
        return impulse(samples, errors, late)[0]

    found, step = impulse(samples, np.zeros(5), late)[1], 1e-6
    assert_derivative(found[:, :4], lambda errors: function(np.append(errors, 0.0)), np.zeros(4), step=step)
    # A command begins and ends between two samples: the lever changes by a hundredth meanwhile.
    later = (function(np.array([0.0, 0.0, 0.0, 0.0, 1e-3])) - function(np.zeros(5))) / 1e-3
    assert found[:, 4] == pytest.approx(later, abs=0.05 * np.abs(generic(1, 6)).max())


class Waiting(NoiseEstimator):
    """An estimator that has its levels as declared from some time on."""

    clear_from = np.inf

    def with_noise(self, window: Any, origin: int, until: float | None = None) -> Any:
        """Return a window with the time until which its noise is estimated."""
        until = float(window.time[-1]) if until is None else until
        return window.time[0] + origin, SimpleNamespace(as_declared=until >= self.clear_from, until=until)


@pytest.mark.parametrize(
    ('clear_from', 'apart', 'first'),
    [(0.0, 0.01, 1.0), (2.5, 0.01, 3.0), (np.inf, 0.01, 5.0), (np.inf, 0.1, 9.0), (np.inf, 1.0, 11.0)],
)
def test_the_first_windows_wait_until_their_noise_is_known(clear_from: float, apart: float, first: float) -> None:
    """For four seconds, or eighty poses, or ten seconds at most; a second each."""
    estimator = Waiting(MID, 1)
    estimator.clear_from = clear_from
    windows: Any = [
        SimpleNamespace(time=np.array([begin, begin + 1.0]), apart=np.full(3, apart)) for begin in np.arange(15.0)
    ]
    released: list[tuple[Any, Any]] = []
    when = []
    for window in windows:
        new = estimator.windows_with_noise([window], 0)
        when += [float(window.time[-1])] * len(new)
        released += new
    assert [begin for begin, _ in released] == [*np.arange(15.0)]
    assert when[0] == first
    assert [levels.until for _, levels in released] == when
    rest = Waiting(MID, 1)
    assert rest.windows_with_noise(windows[:2], 0) == []
    left: list[tuple[Any, Any]] = [*rest.windows_with_noise([], 0, last=True)]
    assert [begin for begin, _ in left] == [0.0, 1.0]
