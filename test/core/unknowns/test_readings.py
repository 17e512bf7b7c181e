"""What odometry mount and delay do to the readings of a window, against finite differences on exact data."""

from __future__ import annotations

import numpy as np
import pytest

from floating import float_freely
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.simulation.motion import Sinusoids
from mbaid_ros.core.simulation.run import Truth
from mbaid_ros.core.trajectory.state import BODY, Layout
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.odometry_mount import odometry_mount
from mbaid_ros.core.unknowns.time_offset import time_offset
from observed import MID, observe
from windowed import FIRST, LAST, residuals, window_model, window_of
from wrong_robots import Wrong

SPACING = 0.05  # s
SECONDS = 6.0


@pytest.fixture(scope='module')
def truth(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> Truth:
    """Return a servicer that is as its URDF says, as it tumbles and drifts."""
    return float_freely(servicer7, joints, start, SECONDS)


def read(truth: Truth, unknown: Unknown, value: Array, joints: int) -> Samples:
    return observe(Wrong.by((unknown,), (value,), joints).read(truth), MID)


def state(robot: MomentumKernel, momentum: Array, error: Array, value: Array) -> Array:
    return np.concatenate((error, momentum, robot.target.parameters, value))


def base(exact: Samples, time: float) -> tuple[Array, Array]:
    """Return orientation (3, 3) and twist (angular, linear) of the base midway between two samples."""
    index = int(np.searchsorted(exact.time, time))
    twist = np.concatenate((exact.base_angular_velocity, exact.base_linear_velocity), axis=1)
    # The mean of two rotations that differ by half a milliradian is one, to a part in a million.
    rotation, mean = (0.5 * (values[index - 1] + values[index]) for values in (exact.base_rotation, twist))
    return rotation, mean


def of_mount(exact: Samples, time: float, component: int) -> Array:
    """Return the pose error of odometry that is mounted elsewhere: R mu_R, R mu_p."""
    rotation = base(exact, time)[0]
    error = np.zeros(6)
    block = slice(0, 3) if component < 3 else slice(3, 6)
    error[block] = rotation[:, component % 3]
    return error


def of_delay(exact: Samples, time: float, _component: int) -> Array:
    """Return the pose error of a chain that lies behind by what the base moves in that time."""
    return -base(exact, time)[1]


MOUNT, DELAY = odometry_mount(1.0, 1.0), time_offset(1.0)  # in their own units


@pytest.mark.parametrize(('unknown', 'component'), [*((MOUNT, each) for each in range(6)), (DELAY, 0)])
def test_readings_are_off_as_the_rows_say(
    servicer7: MomentumKernel, truth: Truth, start: Array, unknown: Unknown, component: int
) -> None:
    # Central differences over 10 ms of a motion whose own time is seconds; mounts are all but linear.
    size, tolerance = (5e-3, 1e-3) if unknown is DELAY else (1e-3, 1e-5)
    exact = observe(truth, MID)
    layout = Layout.of(servicer7, (unknown,))
    here = layout.point(state(servicer7, start, np.zeros(6), np.zeros(unknown.count)))
    begin, end = ((of_delay if unknown is DELAY else of_mount)(exact, time, component) for time in (FIRST, LAST))
    parts = []
    for step in (size, -size):
        value = np.zeros(unknown.count)
        value[component] = step
        window = window_of(read(truth, unknown, value, servicer7.model.joints), SPACING)
        x = state(servicer7, start, step * begin, value)
        parts.append(np.concatenate(residuals(window_model(layout, window, here), x)))
    pose, twist, after = np.split((parts[0] - parts[1]) / (2.0 * size), 3)
    motion = np.abs(np.concatenate(base(exact, FIRST)[1:])).max()
    scale = motion if unknown is DELAY else 1.0
    assert pose == pytest.approx(np.zeros(6), abs=tolerance * scale)
    assert twist == pytest.approx(np.zeros(6), abs=tolerance * scale)
    assert after == pytest.approx(end, abs=tolerance * scale)
    # And the columns are not nothing.
    model = window_model(layout, window_of(exact, SPACING), here)
    assert np.abs(model.pose_rows[:, BODY.stop + component]).max() > 0.3 * scale
