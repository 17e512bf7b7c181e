"""How the momentum equations depend on what the odometry reads wrongly, and the readings on it: finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from checked import assert_derivative, generic, some
from mbaid_ros.core.contracts import Linear, Motion
from mbaid_ros.core.geometry import Array, cross, exp, rotate
from mbaid_ros.core.odometry.model import OdometryMount, odometry_mount, odometry_scale, twist_bias, vibration
from mbaid_ros.core.robot.momentum import MomentumKernel
from random_robots import spatial


class Robot:
    """A robot in a state in which nothing is zero or parallel, with the momentum of its bodies."""

    def __init__(self, seed: int) -> None:
        model = spatial(seed)
        kernel = MomentumKernel(model, model.last_link)
        target = np.zeros_like(kernel.known)
        target[kernel.target.body] = model.body_parameters()[kernel.target.body]
        self.kernel = kernel.with_body_changes(target)
        self.rotation, self.twist = exp(generic(seed, 1, 3)), generic(seed + 10, 1, 6)
        self.joints, self.rates = generic(seed + 20, 2, 1, model.joints)
        self.states = self.kernel.states_of(self.rotation, self.joints, self.rates, self.twist)

    def momentum(self, rotation: Array, twist: Array) -> Array:
        """Return the momentum about the base's origin of a base with another orientation and twist."""
        return self.kernel.states_of(rotation, self.joints, self.rates, twist).known_momentum[0]


@pytest.mark.parametrize('seed', range(3))
def test_a_mount_turns_the_robot_but_not_its_twist_and_moves_its_origin(seed: int) -> None:
    here = Robot(seed)

    def equations(mount: Array) -> Array:
        away = rotate(here.rotation, mount[None, 3:])
        twist = here.twist + np.concatenate((cross(here.twist[:, 3:], away), np.zeros((1, 3))), axis=1)
        total = here.momentum(here.rotation @ exp(mount[None, :3]), twist)
        # About where the base is read to be: L + a x P.
        return total + np.concatenate((np.zeros(3), np.cross(away[0], total[:3])))

    unknown = odometry_mount(1e-3, 1e-3)
    assert isinstance(unknown, OdometryMount)
    assert_derivative(unknown.equation_columns(here.kernel, here.states)[0], equations, np.zeros(6))


def read_too_far(here: Robot, scale: Array) -> Array:
    """Return the twist of a base whose lengths are read too long."""
    return np.concatenate((here.twist[:, :3] / (1.0 + scale), here.twist[:, 3:]), axis=1)


def biased(here: Robot, bias: Array) -> Array:
    """Return the twist less a bias in base axes, angular first."""
    angular, linear = (rotate(here.rotation, part[None]) for part in np.split(bias, 2))
    return here.twist - np.concatenate((linear, angular), axis=1)


@pytest.mark.parametrize(
    ('unknown', 'corrected', 'count'),
    [(odometry_scale(1e-3), read_too_far, 1), (twist_bias(1e-3, 1e-3), biased, 6)],
    ids=['scale', 'bias'],
)
def test_a_wrong_twist_makes_a_wrong_momentum(
    unknown: Linear, corrected: Callable[[Robot, Array], Array], count: int
) -> None:
    here = Robot(5)

    def equations(value: Array) -> Array:
        return here.momentum(here.rotation, corrected(here, value))

    assert_derivative(unknown.equation_columns(here.kernel, here.states)[0], equations, np.zeros(count))


def at(time: Array) -> Motion:
    """Return a motion at some times: vibrations depend on these alone."""
    count = len(time)
    nothing, place = np.zeros((count, 6)), np.zeros((count, 3))
    return Motion(time, np.zeros(3), place, np.zeros((count, 3, 3)), nothing, nothing, nothing)


def test_a_vibration_reads_as_velocity_what_its_pose_changes_by() -> None:
    unknown, time = vibration(0.3), 41.7

    def pose(later: Array) -> Array:
        return some(unknown.measured('pose', at(time + later)))[0]

    rates = some(unknown.measured('twist', at(np.array([time]))))
    assert_derivative(rates[0][..., None], pose, np.zeros(1), step=1e-4)
