"""What an IMU's angular velocity measures of a window: exact on exact data, off as its unknowns say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from floating import float_freely
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.geometry import Array, crossed, exp, rotate_back
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.unknowns.sensors import GyroErrors, gyro
from mbaid_ros.simulation.motion import Sinusoids
from observed import MID, observe
from windowed import FIRST, LAST, residuals, window_model, window_of

SIZES = np.full(13, 1e-3)  # rad/s; relative, rad, relative; s
UNKNOWN = gyro(GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0))


@pytest.fixture(scope='module')
def exact(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> Samples:
    return observe(float_freely(servicer7, joints, start, 6.0), MID)


def measured(exact: Samples, value: Array) -> Samples:
    """Return samples with what a gyro reads that has these errors."""
    bias, scale, turn, shared, delay = value[:3], value[3:6], value[6:9], value[9:12], value[12]
    rate = CubicSpline(exact.time, rotate_back(exact.base_rotation, exact.base_angular_velocity))
    late = CubicSpline(exact.time, rate(exact.time - delay) @ exp(turn))  # rows: turned back
    turned = late.antiderivative()(exact.time) @ (np.diag(1.0 + scale) + crossed(shared)) + exact.time[:, None] * bias
    return replace(exact, gyro=turned)


def left(servicer7: MomentumKernel, exact: Samples, start: Array, value: Array, known: Array) -> Array:
    """Return what is left of the readings where some of the errors are known."""
    layout = Layout.of(servicer7, (UNKNOWN,))
    momentum = np.concatenate((np.zeros(6), start, servicer7.target.parameters))
    state = np.concatenate((momentum, known))
    assert len(momentum) == BODY.stop
    model = window_model(layout, window_of(measured(exact, value), 0.05), layout.point(state))
    return residuals(model, state)[1][6:]


def test_exact_readings_leave_nothing(servicer7: MomentumKernel, exact: Samples, start: Array) -> None:
    assert np.abs(left(servicer7, exact, start, np.zeros(13), np.zeros(13))).max() < 1e-8


@pytest.mark.parametrize('component', [6, 7, 8])
def test_an_orientation_of_its_own_is_turned_as_its_axes_are(
    servicer7: MomentumKernel, exact: Samples, start: Array, component: int
) -> None:
    value = np.zeros(13)
    value[component] = SIZES[component]
    layout = Layout.of(servicer7, (gyro(GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0, with_orientation=True)),))
    state = np.concatenate((np.zeros(6), start, servicer7.target.parameters, value))
    read = measured(exact, value)
    read = replace(read, base_rotation=read.base_rotation @ exp(value[6:9]))
    point = layout.point(np.concatenate((state[: BODY.stop], np.zeros(13))))
    model = window_model(layout, window_of(read, 0.05), point)
    # The error of the pose is that of the axes, and stays so.
    state[:3] = -read.base_rotation[np.searchsorted(read.time, FIRST - 1e-6)] @ value[6:9]
    pose, rate, after = residuals(model, state)
    turned = read.base_rotation[np.searchsorted(read.time, LAST - 1e-6)] @ value[6:9]
    assert np.abs(pose[:3]).max() < 5e-3 * SIZES[component]
    assert np.abs(rate[6:]).max() < 5e-3 * SIZES[component]
    assert after[:3] == pytest.approx(-turned, abs=5e-3 * SIZES[component])


@pytest.mark.parametrize('component', range(13))
def test_readings_are_off_as_the_columns_say(
    servicer7: MomentumKernel, exact: Samples, start: Array, component: int
) -> None:
    value = np.zeros(13)
    value[component] = SIZES[component]
    off = left(servicer7, exact, start, value, np.zeros(13))
    rest = left(servicer7, exact, start, value, value)
    assert np.abs(off).max() > 1e-6
    assert np.abs(rest).max() < 5e-3 * np.abs(off).max()
