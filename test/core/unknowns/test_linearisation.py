"""A window of a robot that is off: what its model says near the URDF, and that nothing is left at the robot itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from floating import float_freely
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.unknowns.catalogue import catalogue
from mbaid_ros.simulation.motion import Sinusoids
from observed import MID, observe
from windowed import residuals, window_model, window_of
from wrong_robots import DECLARED, Wrong

SPACING = 0.05  # s
SECONDS = 6.0


class Case:
    """One window of a robot with some numbers of its unknowns, read without noise."""

    def __init__(self, robot: MomentumKernel, joints: Sinusoids, start: Array, size: float) -> None:
        # Not those whose readings are linear: windows stay where they are.
        unknowns = catalogue(robot, replace(DECLARED, clock_drift=0.0, odometry_scale=0.0, twist_bias=0.0))
        rng = np.random.default_rng(11)
        numbers = tuple(size * rng.normal(size=unknown.count) for unknown in unknowns)
        wrong = Wrong.by(unknowns, numbers, robot.model.joints)
        self.layout = Layout.of(robot, unknowns)
        body = np.concatenate((np.zeros(6), start, robot.target.parameters))
        # The catalogue's order is that of the state: what is only read comes last in both.
        self.known = np.concatenate((body, *numbers))
        self.nominal = np.concatenate((body, np.zeros(self.layout.size - BODY.stop)))
        read = wrong.read(float_freely(wrong.robot(robot), joints, start, SECONDS))
        self.window = window_of(observe(read, MID), SPACING)

    def residuals(self, at: Array) -> Array:
        """Return what the true state leaves of pose, twist and the pose error that follows, linearised at a state."""
        model = window_model(self.layout, self.window, self.layout.point(at))
        return np.concatenate(residuals(model, self.known))

    def twist(self, at: Array, x: Array) -> Array:
        """Return what a state leaves of the twist, linearised at another one, with the pose error that it asks for."""
        model = window_model(self.layout, self.window, self.layout.point(at))
        x = x.copy()
        x[:6] = np.linalg.solve(model.pose_rows[:, :6], residuals(model, x)[0])
        return residuals(model, x)[1]


def test_nothing_is_left_where_a_robot_is_linearised_at_what_it_is(
    servicer7: MomentumKernel, joints: Sinusoids, start: Array
) -> None:
    exact, off = (Case(servicer7, joints, start, size) for size in (0.0, 1.0))
    least = np.abs(exact.residuals(exact.known)).max()
    assert least < 1e-8
    assert np.abs(off.residuals(off.known)).max() < 3.0 * least
    # At the URDF the readings are off by millimetres and milliradians.
    assert np.abs(off.residuals(off.nominal)).max() > 1e-3


def test_what_is_left_of_the_twist_is_of_second_order(
    servicer7: MomentumKernel, joints: Sinusoids, start: Array
) -> None:
    whole, half = (Case(servicer7, joints, start, size) for size in (1.0, 0.5))
    unexplained = np.abs(whole.twist(whole.nominal, whole.nominal)).max()
    left = np.abs(whole.twist(whole.nominal, whole.known)).max()
    assert left < 0.02 * unexplained
    assert np.abs(half.twist(half.nominal, half.known)).max() == pytest.approx(0.25 * left, rel=0.1)
