"""The tide of a robot that nothing locates: gravity turns it about its common centre of mass, and moves it nowhere."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import exp, skew, unvec
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.orbit import Orbit, of_bodies
from mbaid_ros.core.sensors.base import orientation_only
from mbaid_ros.core.sensors.falling_frame import FallingFrame, bodies_of
from observed import MID, observe
from simulated import robot
from thrusting import pushed

RATE = 1.1e-3  # rad/s


def test_it_is_the_gravity_gradient_torque_about_the_common_centre_of_mass() -> None:
    model = robot('servicer7')
    orbit = Orbit.inertial(RATE, np.array([0.3, 0.2, 1.0]), np.array([0.0, 1.0, -0.2]))
    samples = observe(pushed(), MID)[:2]
    frame = FallingFrame(orbit, model, relative_twist=True, located=False)
    tide = frame.applied(samples, 0).tide
    bodies, length = bodies_of(model), float(samples.time[1] - samples.time[0])
    brought = of_bodies(tide.reshape(2, -1, 6, 10), bodies)[1] / length
    placed = Kinematics(model).configure(samples.base_rotation, samples.joint_position)
    whole = np.sum(express(bodies, placed.rotation, placed.position), axis=1)[0]
    centre = whole[1:4] / whole[0]
    inertia = unvec(whole[4:]) + whole[0] * skew(centre) @ skew(centre)
    up = orbit.up
    np.testing.assert_array_equal(brought[:3], 0.0)
    torque = 3.0 * RATE**2 * np.cross(up, inertia @ up)  # at the first sample; the tide is the mean until the second
    np.testing.assert_allclose(brought[3:], torque, atol=1e-2 * float(np.linalg.norm(torque)))


def test_an_orientation_in_an_orbit_fixed_frame_is_turned_without_a_position() -> None:
    model, stamps = robot('servicer7'), np.array([0, 10**12], dtype=np.int64)
    fixed = np.tile(np.eye(3), (2, 1, 1))
    base = orientation_only(stamps, fixed, np.tile(np.diag([1e-6, 4e-6, 9e-6]), (2, 1, 1)))
    frame = FallingFrame(Orbit.turning_with(RATE, 'lvlh'), model, relative_twist=True, located=False)
    seen = frame.falling(base)
    turned = exp(np.array([[0.0, -RATE * 1e3, 0.0]]))[0]
    np.testing.assert_allclose(seen.rotation[1], turned, atol=1e-9)
    np.testing.assert_allclose(seen.pose_covariance[1, 3:, 3:], turned @ np.diag([1e-6, 4e-6, 9e-6]) @ turned.T)
    assert np.isnan(seen.pose_covariance[:, :3, :3]).all()
