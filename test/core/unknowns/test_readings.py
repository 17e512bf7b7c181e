"""What odometry mount and delay do to the readings of a window, against finite differences on exact data."""

from __future__ import annotations

import numpy as np
import pytest

from floating import float_freely
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.unknowns.base import odometry_mount, odometry_scale, twist_bias
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.sensors import clock_drift, time_offset
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
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


def of_drift(exact: Samples, time: float, _component: int) -> Array:
    """Return the pose error of a delay that has grown until then."""
    return -time * base(exact, time)[1]


def of_scale(exact: Samples, time: float, _component: int) -> Array:
    """Return the pose error of lengths that are read too long."""
    index = int(np.searchsorted(exact.time, time))
    position = 0.5 * (exact.base_position[index - 1] + exact.base_position[index])
    return -np.concatenate((np.zeros(3), position))


def of_twist(_exact: Samples, _time: float, _component: int) -> Array:
    """Return none: a bias of the twist is not in the pose."""
    return np.zeros(6)


# In their own units.
MOUNT, DELAY, DRIFT = odometry_mount(1.0, 1.0), time_offset(1.0), clock_drift(1.0)
SCALE, BIAS = odometry_scale(1.0), twist_bias(1.0, 1.0)
ERROR = {MOUNT: of_mount, DELAY: of_delay, DRIFT: of_drift, SCALE: of_scale, BIAS: of_twist}


@pytest.mark.parametrize(
    ('unknown', 'component'), [(unknown, each) for unknown in ERROR for each in range(unknown.count)]
)
def test_readings_are_off_as_the_rows_say(
    servicer7: MomentumKernel, truth: Truth, start: Array, unknown: Unknown, component: int
) -> None:
    # Central differences over 10 ms of a motion whose own time is seconds; mounts and biases are all but linear.
    late = unknown in {DELAY, DRIFT}
    size = 5e-3 if unknown is DELAY else 1e-3
    # A window's mean twist stands for that at each of its instants.
    tolerance = 1e-2 if unknown in {DRIFT, SCALE} else 1e-3 if unknown is DELAY else 1e-5
    exact = observe(truth, MID)
    layout = Layout.of(servicer7, (unknown,))
    here = layout.point(state(servicer7, start, np.zeros(6), np.zeros(unknown.count)))
    begin, end = (ERROR[unknown](exact, time, component) for time in (FIRST, LAST))
    parts = []
    for step in (size, -size):
        value = np.zeros(unknown.count)
        value[component] = step
        window = window_of(read(truth, unknown, value, servicer7.model.joints), SPACING)
        own = (1.0 - step) * start if unknown is DRIFT else start  # in seconds of the joints' clock
        x = state(servicer7, own, step * begin, value)
        parts.append(np.concatenate(residuals(window_model(layout, window, here), x)))
    pose, twist, after = np.split((parts[0] - parts[1]) / (2.0 * size), 3)
    motion = np.abs(np.concatenate(base(exact, FIRST)[1:])).max()
    scale = motion if late or unknown is SCALE else 1.0
    assert pose == pytest.approx(np.zeros(6), abs=tolerance * scale)
    assert twist == pytest.approx(np.zeros(6), abs=tolerance * scale)
    assert after == pytest.approx(end, abs=tolerance * scale)
    # And the columns are not nothing.
    model = window_model(layout, window_of(exact, SPACING), here)
    rows = model.twist_rows if unknown is BIAS else model.pose_rows
    assert np.abs(rows[:, BODY.stop + component]).max() > 0.3 * scale
