"""The steps of poses and rates against each other: their noise, on white noise of a base at rest."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from mbaid_ros.core.geometry import exp
from mbaid_ros.core.gyro import _turn_of_gyro, gyro_sensor
from mbaid_ros.core.odometry.faults import RateCheck, RateMotion, SensorChecks, _twist_motion, spread
from mbaid_ros.core.results.verdict import Reason
from mbaid_ros.core.robot.model import Kinematics
from mbaid_ros.core.samples import Samples
from simulated import robot

WINDOWS, COUNT, STEP = 500, 30, 0.02  # samples of a window, and s between them


def resting(position: float, orientation: float, velocity: float, rate: float) -> list[Samples]:
    """Return windows of a base at rest whose sensors have white noise of these standard deviations, as declared."""
    rng, found = np.random.default_rng(0), []
    pose = np.diag(np.repeat([position, orientation], 3)) ** 2
    twist = np.diag(np.repeat([velocity, rate], 3)) ** 2
    for _ in range(WINDOWS):
        noise = rng.normal(size=(4, COUNT, 3))
        found.append(
            Samples(
                STEP * np.arange(COUNT),
                np.zeros((COUNT, 1)),
                np.zeros((COUNT, 1)),
                position * noise[0],
                exp(orientation * noise[1]),
                velocity * noise[2],
                rate * noise[3],
                np.broadcast_to(pose, (COUNT, 6, 6)),
                np.broadcast_to(twist, (COUNT, 6, 6)),
                further=np.zeros((COUNT, 3)),
            )
        )
    return found


@pytest.mark.parametrize(
    'sizes', [(1e-3, 1e-5, 1e-7, 1e-7), (1e-5, 1e-3, 1e-7, 1e-7), (1e-7, 1e-7, 1e-3, 1e-5), (1e-7, 1e-7, 1e-5, 1e-3)]
)
def test_twists_are_as_far_from_the_steps_of_the_poses_as_their_noise_makes_them(
    sizes: tuple[float, float, float, float],
) -> None:
    """Angular and linear ones, by the noise of the poses, and by that of the twist."""
    motions = RateMotion.concatenate([motion for each in resting(*sizes) if (motion := _twist_motion(each))])
    normalised = (motions.step - motions.read) / motions.noise
    for part in np.split(normalised, 2, axis=1):
        # Of 1500 numbers a mean square is known to 3.7 %; weights of the twist are those of trapezoids, nearly.
        assert np.mean(part**2) == pytest.approx(1.0, abs=0.2)
    assert motions.misfit(motions.read) == pytest.approx(1.0, abs=0.15)


def test_a_gyro_is_as_far_from_the_steps_of_the_poses_as_their_noise_makes_it() -> None:
    model = robot('servicer7')
    sensor = gyro_sensor('imu', 1e-4, model)
    found = [
        motion for each in resting(1e-1, 1e-4, 1.0, 1.0) if (motion := _turn_of_gyro(each, sensor, Kinematics(model)))
    ]
    motions = RateMotion.concatenate(found)
    assert motions.misfit(motions.read) == pytest.approx(1.0, abs=0.15)


def test_the_noise_in_any_axes_is_that_of_the_worst_one() -> None:
    """The mean over the samples of each axis, the largest of each three, angular ones first."""
    covariance = np.array([np.diag([1.0, 2.0, 3.0, 4.0, 9.0, 6.0]), np.diag([3.0, 4.0, 7.0, 8.0, 1.0, 8.0])])
    assert spread(covariance) == pytest.approx([7.0, 7.0, 7.0, 5.0, 5.0, 5.0])


class Told:
    """A check of a sensor that says the same of each window."""

    def __init__(self, gain: float | None) -> None:
        self.reason = None if gain is None else Reason(f'wrong by {gain:g}', 'conflict', gain)

    def update(self, _window: Samples) -> Reason | None:
        """Return it."""
        return self.reason


@pytest.mark.parametrize(
    ('gains', 'text'),
    [
        ((None, None), ''),
        ((7.0,), 'wrong by 7'),
        ((None, 7.0), 'wrong by 7'),
        ((5.0, 7.0, None, None), 'wrong by 7'),
        ((5.0, 7.0), '2 of 2 sensors contradict the poses'),
        ((None, 5.0, 7.0), '2 of 3 sensors contradict the poses'),
    ],
)
def test_poses_that_most_sensors_contradict_are_looked_at_first(gains: tuple[float | None, ...], text: str) -> None:
    (window, *_) = resting(1e-3, 1e-4, 1.0, 1.0)
    found = SensorChecks(cast('list[RateCheck]', [Told(gain) for gain in gains])).update(window)
    assert (found.text if found else '').startswith(text)
    assert bool(found) == bool(text)
    if found:
        assert (found.severity, found.gain is None) == ('conflict', 'contradict' in text)
