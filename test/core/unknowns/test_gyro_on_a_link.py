"""An IMU that joints move: what the joints turn it by is taken off, with their noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from floating import float_freely
from mbaid_ros.core.filter.chain import WindowModel
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.geometry import Array, crossed, exp, rotate_back
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.unknowns.sensors import GyroErrors, gyro
from mbaid_ros.simulation.motion import Sinusoids
from observed import MID, observe
from windowed import JOINT, residuals, window_model, window_of

LINK = 'link4'
SIZES = np.full(13, 1e-3)  # rad/s; relative, rad, relative; s


@pytest.fixture(scope='module')
def exact(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> Samples:
    return observe(float_freely(servicer7, joints, start, 6.0), MID)


def measured(kernel: MomentumKernel, exact: Samples, value: Array) -> Samples:
    """Return samples with what a gyro on the link reads that has these errors."""
    link, kinematics = kernel.model.link(LINK), kernel.kinematics
    placed = kinematics.configure(exact.base_rotation, exact.joint_position)
    base = np.concatenate((np.zeros_like(exact.base_angular_velocity), exact.base_angular_velocity), axis=1)
    bodies = kinematics.body_twists(placed, exact.joint_velocity, base)
    rate = CubicSpline(exact.time, rotate_back(placed.link(link)[0], bodies[:, link.body, 3:]))
    late = CubicSpline(exact.time, rate(exact.time - value[12]) @ exp(value[6:9]))
    mixed = np.diag(1.0 + value[3:6]) + crossed(value[9:12])
    turned = late.antiderivative()(exact.time) @ mixed + exact.time[:, None] * value[:3]
    return replace(exact, gyro=turned)


def model_of(kernel: MomentumKernel, samples: Samples, start: Array, known: Array) -> tuple[WindowModel, Array]:
    """Return a window's model where some of the errors are known, and the state."""
    errors = GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0, link=kernel.model.link(LINK))
    layout = replace(Layout.of(kernel, (gyro(errors),)), imu=errors.link)
    state = np.concatenate((np.zeros(6), start, kernel.target.parameters, known))
    assert len(state) == BODY.stop + 13
    return window_model(layout, window_of(samples, 0.05), layout.point(state)), state


def left(kernel: MomentumKernel, exact: Samples, start: Array, value: Array, known: Array) -> Array:
    """Return what is left of the readings where some of the errors are known."""
    return residuals(*model_of(kernel, measured(kernel, exact, value), start, known))[1][6:]


def test_exact_readings_leave_nothing(servicer7: MomentumKernel, exact: Samples, start: Array) -> None:
    assert np.abs(left(servicer7, exact, start, np.zeros(13), np.zeros(13))).max() < 1e-6


@pytest.mark.parametrize('component', range(13))
def test_readings_are_off_as_the_columns_say(
    servicer7: MomentumKernel, exact: Samples, start: Array, component: int
) -> None:
    value = np.zeros(13)
    value[component] = SIZES[component]
    none = left(servicer7, exact, start, np.zeros(13), np.zeros(13))
    off = left(servicer7, exact, start, value, np.zeros(13))
    rest = left(servicer7, exact, start, value, value)
    assert np.abs(off).max() > 1e-6
    assert np.abs(rest - none).max() < 1e-2 * np.abs(off).max()


def test_the_joints_noise_is_in_the_readings_as_the_covariance_says(
    servicer7: MomentumKernel, exact: Samples, start: Array
) -> None:
    rng = np.random.default_rng(0)
    read, errors = measured(servicer7, exact, np.zeros(13)), []
    for _ in range(150):
        noisy = read.joint_position + JOINT * rng.normal(size=read.joint_position.shape)
        model, state = model_of(servicer7, replace(read, joint_position=noisy), start, np.zeros(13))
        errors.append(residuals(model, state)[1])
    # Nothing else is noisy: the windows' own is 1e-15, the gyro has none.
    expected, found = model.twist_covariance, np.cov(np.array(errors).T)
    for part in (slice(0, 3), slice(6, 9)):
        assert np.trace(found[part, part]) == pytest.approx(np.trace(expected[part, part]), rel=0.2)
    size = np.sqrt(np.trace(expected[:3, :3]) * np.trace(expected[6:, 6:]))
    assert found[:3, 6:] == pytest.approx(expected[:3, 6:], abs=0.1 * size)
    # That of the joints before it is half as much again.
    assert np.trace(expected[6:, 6:]) > 1.4 * np.trace(expected[:3, :3])
