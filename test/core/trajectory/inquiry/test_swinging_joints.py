"""Joints whose far side swings: as noise of one joint's reading alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.encoders import size, swinging
from mbaid_ros.core.filter.state import Layout
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.simulation.simulation import Truth
from observed import MID, kernel, observe
from windowed import JOINT as JOINT_NOISE
from windowed import window_model, window_of

SPACING, JOINT, TIMES = 0.05, 3, 30.0


@pytest.fixture(scope='module')
def robot() -> MomentumKernel:
    return kernel('servicer7')


@pytest.fixture(scope='module')
def window(servicer: Truth) -> Window:
    return window_of(observe(servicer, MID), SPACING)


def covariances(robot: MomentumKernel, window: Window) -> tuple[Array, Array]:
    """Return those of the means of a window's pose and twist, at rest and with the body that is described."""
    layout = Layout.of(robot, ())
    point = layout.point(np.concatenate((np.zeros(12), robot.target.parameters)))
    model = window_model(layout, window, point)
    return model.pose_covariance, model.twist_covariance


def test_a_joint_that_swings_moves_the_base_in_one_direction(robot: MomentumKernel, window: Window) -> None:
    (loose,) = swinging([window], JOINT, TIMES, robot.model.joints)
    for before, after in zip(covariances(robot, window), covariances(robot, loose), strict=True):
        sizes = np.linalg.eigvalsh(after - before)
        assert sizes[-1] > 0.0
        assert np.abs(sizes[:-1]).max() < 1e-9 * sizes[-1]


def test_joints_that_are_all_alike_are_as_noisy_as_with_one_number(robot: MomentumKernel, window: Window) -> None:
    noise = replace(window.noise, joint_position=np.full(robot.model.joints, window.noise.joint_position))
    for one, each in zip(covariances(robot, window), covariances(robot, replace(window, noise=noise)), strict=True):
        assert np.array_equal(one, each)


def test_the_size_is_that_of_a_windows_mean(window: Window, robot: MomentumKernel) -> None:
    (loose,) = swinging([window], JOINT, TIMES, robot.model.joints)
    assert loose.noise.joint_position == pytest.approx(
        JOINT_NOISE * np.where(np.arange(robot.model.joints) == JOINT, TIMES, 1.0)
    )
    assert size([window], TIMES) == pytest.approx(TIMES * JOINT_NOISE / np.sqrt(window.noise.samples))
