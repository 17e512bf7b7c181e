"""External wrenches, gravity gradient, wheels and springs of a simulated robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Integers, cross, rotate, rotate_back, unvec
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import Kinematics, Link, RobotModel
from mbaid_ros.core.swing import cantilever
from mbaid_ros.simulation import quaternions


@dataclass(frozen=True)
class Springs:
    """Springs and dampers of f joints."""

    joints: Integers  # (f,) indices
    # stiffness, damping: (f,) N m/rad, N m s/rad; N/m, N s/m for a prismatic joint
    stiffness: Array
    damping: Array

    @staticmethod
    def from_frequencies(
        model: RobotModel, names: Sequence[str], frequencies: Sequence[float], ratios: Sequence[float]
    ) -> Springs:
        """Return the springs of joints with natural frequencies, Hz, all else held, and damping ratios."""
        joints = np.array([model.joint_names.index(name) for name in names], dtype=np.intp)
        inertia = np.sum(cantilever(Kinematics(model))[joints] * model.body_parameters(), axis=(1, 2))
        rate = 2.0 * np.pi * np.array(frequencies)
        return Springs(joints, inertia * rate**2, 2.0 * np.array(ratios) * inertia * rate)

    def torque(self, position: Array, velocity: Array) -> Array:
        """Return their torques on their joints, (f,), from all joints' (n,) positions and rates."""
        return np.asarray(-self.stiffness * position[self.joints] - self.damping * velocity[self.joints])


@dataclass(frozen=True)
class BodyPoses:
    """Where the n + 1 bodies are at an instant."""

    time: float  # s since the start of the run
    rotation: Array  # (n + 1, 3, 3) body to odometry axes
    position: Array  # (n + 1, 3) m, body origins in the odometry frame
    angular_velocity: Array  # (3,) rad/s, of the base, in its axes


@dataclass(frozen=True)
class BodyWrench:
    """A force and torque on a body, constant in its axes; or on the base, constant in those of the odometry frame."""

    body: int | None  # index of the moving body; None for the odometry frame
    # force, torque: (3,) N, N m, about the frame's origin, in its axes
    force: Array
    torque: Array

    @staticmethod
    def on_link(link: Link | None, wrench: Array) -> BodyWrench:
        """Return a (6,) force and torque about the origin of a link's frame, or of the odometry frame, in its axes."""
        if link is None:
            return BodyWrench(None, wrench[:3], wrench[3:])
        force = link.rotation @ wrench[:3]
        return BodyWrench(link.body, force, np.cross(link.position, force) + link.rotation @ wrench[3:])

    def with_origin(self, origin: Array) -> BodyWrench:
        """Return the wrench with positions relative to another origin (3,) in the odometry frame."""
        return self if self.body is not None else replace(self, torque=self.torque - np.cross(origin, self.force))

    def on_base(self, position: Array, orientation: Array) -> tuple[Array, Array]:
        """Return force and torque, constant in the odometry frame, about the base's origin and in its axes.

        Parameters
        ----------
        position : (3,) m, of the base
        orientation : (4,) quaternion (x, y, z, w), base to odometry frame
        """
        back = quaternions.conjugate(orientation)
        return quaternions.rotate(back, self.force), quaternions.rotate(back, self.with_origin(position).torque)


@dataclass(frozen=True, eq=False)
class GravityGradient:
    """The gravity gradient in the falling frame."""

    orbit: Orbit  # Orbit
    origin: Array  # (3,) m, which the bodies' positions count from
    # mass, centre, inertia: (b,), (b, 3), (b, 3, 3) of each body, kg, m, kg m^2 about the centre of mass, its own axes
    mass: Array
    centre: Array
    inertia: Array

    @staticmethod
    def on_robot(model: RobotModel, orbit: Orbit, origin: Array) -> GravityGradient:
        """Return the effects on a robot whose positions count from an origin (3,) m in the falling frame."""
        bodies = model.body_parameters()
        massive = bodies[:, 0] > 0.0
        values = np.zeros_like(bodies)
        values[massive] = [physical(body) for body in bodies[massive]]
        return GravityGradient(orbit, origin, values[:, 0], values[:, 1:4], unvec(values[:, 4:]))

    def wrenches(self, now: BodyPoses) -> Array:
        """Return m G x at each centre of mass and 3 mu/r^3 up x I up, about the bodies' origins, (n + 1, 6)."""
        instant = np.array([now.time])
        up = rotate_back(now.rotation, np.broadcast_to(self.orbit.zenith_at(instant), now.position.shape))
        place = self.origin + now.position + rotate(now.rotation, self.centre)
        force = rotate_back(now.rotation, self.mass[:, None] * (place @ self.orbit.gradient(instant)[0]))
        torque = 3.0 * self.orbit.gradient_strength(instant) * cross(up, rotate(self.inertia, up))
        return np.concatenate((force, torque + cross(self.centre, force)), axis=1)


@dataclass(frozen=True, eq=False)
class Wheels:
    """w wheels that are held, or ramped: of speeds start + slope t relative to the base."""

    names: tuple[str, ...]  # of each
    axes: Array  # (w, 3) unit vectors in the base's axes
    spin_inertias: Array  # (w,) kg m^2
    start: Array  # (w,) rad/s
    slope: Array  # (w,) rad/s^2

    def speeds(self, time: Array) -> Array:
        """Return the (N, w) speeds at (N,) times, rad/s."""
        return np.asarray(self.start + self.slope * time[:, None])

    def momentum(self, speeds: Array) -> Array:
        """Return the (N, 3) angular momentum that they store at (N, w) speeds, N m s, base axes."""
        return np.asarray((self.spin_inertias * speeds) @ self.axes)

    def wrenches(self, now: BodyPoses) -> Array:
        """Return the reaction of their motors and their gyroscopic torque on the base: -(h' + w x h)."""
        stored = self.momentum(self.speeds(np.array([now.time])))[0]
        wrenches = np.zeros((len(now.position), 6))
        wrenches[0, 3:] = -self.momentum(self.slope) - np.cross(now.angular_velocity, stored)
        return wrenches

    def from_time(self, time: float) -> Wheels:
        """Return the wheels with time 0 at a time (s) of these."""
        return replace(self, start=self.speeds(np.array([time]))[0])


Effect = GravityGradient | Wheels  # with the wrenches (n + 1, 6) on all bodies: N, N m about their origins


@dataclass(frozen=True)
class Environment:
    """Lasting effects on the bodies."""

    wheels: Wheels | None = None  # inside the base; None where there are none
    orbit: Orbit | None = None  # about the epoch at time 0; None where there is none
    springs: Springs | None = None  # of joints that nothing drives; None where there is none

    def effects(self, model: RobotModel, origin: Array) -> tuple[Effect, ...]:
        """Return the effects on a robot whose positions count from an origin (3,) m in the odometry frame."""
        gravity_columns = () if self.orbit is None else (GravityGradient.on_robot(model, self.orbit, origin),)
        return (*gravity_columns, *(() if self.wheels is None else (self.wheels,)))

    def from_time(self, time: float) -> Environment:
        """Return the environment with time 0 at a time (s) of this one."""
        return Environment(
            None if self.wheels is None else self.wheels.from_time(time),
            None if self.orbit is None else self.orbit.with_epoch(time),
            self.springs,
        )
