"""The flight of a free body before its capture, its motion in the hand, and the camera that tracks a frame on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, solve_ivp

from mbaid_ros.core.geometry import Array, cross, exp, quaternion_from_rotation, rotate, rotation_from_quaternion, unvec
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.changes import CaptureSimulation, Target
from mbaid_ros.simulation.slip import body_poses

_LIMITS = {'rtol': 1e-11, 'atol': 1e-12}  # errors of a step
_ROUNDING = 1e-9  # of a period: a pose due within this of a limit is due at it


class FreeMotion:
    """A body that nothing acts on, until it is captured.

    Parameters
    ----------
    target : the body, its velocity and its spin at the capture
    rotation, position : (3, 3), (3,) m, of the capturing link's frame at that instant, in the odometry frame
    orbit : in which it falls with the frame of the odometry, the epoch at time 0; None without one
    """

    def __init__(self, target: Target, rotation: Array, position: Array, orbit: Orbit | None = None) -> None:
        self._target, self._rotation, self._orbit = target, rotation, orbit
        self._inertia = unvec(target.body[4:])
        start = np.concatenate(
            (np.zeros(3), [1.0], rotation.T @ target.spin, position + rotation @ target.body[1:4], target.velocity)
        )
        solved = solve_ivp(self._backward, (0.0, target.time), start, DOP853, dense_output=True, **_LIMITS)
        # Quaternion to the link's axes at the capture, spin in body axes, centre and its velocity, so long before.
        self._moved = solved.sol

    def poses(self, time: Array, place: Array) -> tuple[Array, Array]:
        """Return positions (N, 3) and rotations (N, 3, 3), in the odometry frame, of a frame fixed to the body.

        At the capture its axes are those of the link.

        Parameters
        ----------
        time : (N,) s since the start of the run, none after the capture
        place : (3,) m, its origin in the link's frame at the capture
        """
        before = self._target.time - time
        moved = self._moved(before)
        rotation = self._rotation @ rotation_from_quaternion(quaternions.normalised(moved[:4].T))
        return moved[7:10].T + rotate(rotation, place - self._target.body[1:4]), rotation

    def _backward(self, before: float, values: Array) -> Array:
        """Return the rates of quaternion, spin, centre and its velocity (13,), backwards in time."""
        spin, centre, velocity = values[4:7], values[7:10], values[10:]
        turning = 0.5 * quaternions.product(values[:4], quaternions.pure(spin))
        torque, pull = -cross(spin, self._inertia @ spin), np.zeros(3)
        if self._orbit is not None:
            instant = np.array([self._target.time - before])
            strength, zenith = float(self._orbit.gradient_strength(instant)[0]), self._orbit.zenith_at(instant)[0]
            turned = rotation_from_quaternion(quaternions.normalised(values[None, :4]))[0]
            up = (self._rotation @ turned).T @ zenith
            torque = torque + 3.0 * strength * cross(up, self._inertia @ up)
            pull = strength * (3.0 * zenith * (zenith @ centre) - centre)
        return -np.concatenate((turning, np.linalg.solve(self._inertia, torque), velocity, pull))


class GraspedMotion:
    """The body after its capture, as the hand carries it: instants in order, of a run that may begin later, s."""

    def __init__(self, simulation: CaptureSimulation, model: RobotModel, begin: float = 0.0) -> None:
        self._simulation, self._model, self._begin = simulation, model, begin

    def poses(self, time: Array, place: Array) -> tuple[Array, Array]:
        """Return the poses of a frame fixed to it, as of FreeMotion, at times after the capture."""
        target, time = self._simulation.target, time - self._begin
        truth = self._simulation.advance(time)
        rotation, position = body_poses(self._model, truth, target.link, self._simulation.slip, time - target.time)
        return position + rotate(rotation, place), rotation


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """The motion of the body before its capture and after it, in the odometry's frame."""

    free: FreeMotion
    grasped: GraspedMotion | None = None  # None where nothing tracks it after the capture
    turning: Orbit | None = None  # with which that frame turns

    def poses(self, time: Array, place: Array, capture: float) -> tuple[Array, Array]:
        """Return positions (N, 3) and rotations (N, 3, 3) of a frame fixed to the body, as of FreeMotion."""
        early = time <= capture
        position, rotation = np.empty((len(time), 3)), np.empty((len(time), 3, 3))
        if early.any():
            position[early], rotation[early] = self.free.poses(time[early], place)
        if self.grasped is not None and not early.all():
            position[~early], rotation[~early] = self.grasped.poses(time[~early], place)
        if self.turning is None:
            return position, rotation
        back = np.swapaxes(self.turning.to_inertial(time), 1, 2)
        return rotate(back, position), back @ rotation


@dataclass(frozen=True)
class Tracking:
    """What a camera tracks of the body, and how well."""

    place: Array  # (3,) m, origin of the tracked frame as of `FreeMotion.poses`
    rate: float  # Hz
    position_noise: float = 0.0  # m, of each coordinate
    orientation_noise: float = 0.0  # rad, about each axis
    missing: float = 0.0  # part of the poses that are


class TargetCamera:
    """Poses of a frame on the body, with seeded noise.

    Parameters
    ----------
    motion, capture, until : of the body, the time of its capture, and that of the last pose, s
    seed : the same seed gives the same noise
    """

    def __init__(
        self, motion: TrackedMotion, capture: float, tracking: Tracking, seed: int, until: float | None = None
    ) -> None:
        self._motion, self._capture, self._tracking = motion, capture, tracking
        self._until = capture if until is None else until
        self._given = 0
        streams = np.random.SeedSequence(seed).spawn(10)[7:]  # those before are of the other sensors
        self._position, self._turn, self._lost = (np.random.default_rng(stream) for stream in streams)

    def readings(self, until: float) -> tuple[Array, Array, Array]:
        """Return times (N,) s, positions (N, 3) m and quaternions (N, 4), of all new poses up to a time, s."""
        tracking = self._tracking
        count = max(math.floor(min(until, self._until) * tracking.rate + _ROUNDING) + 1, self._given)
        time = np.arange(self._given, count) / tracking.rate
        self._given = count
        kept = self._lost.random(len(time)) >= tracking.missing
        away = tracking.position_noise * self._position.standard_normal((len(time), 3))
        turn = tracking.orientation_noise * self._turn.standard_normal((len(time), 3))
        time, away, turn = time[kept], away[kept], turn[kept]
        if not time.size:
            return time, away, np.zeros((0, 4))
        position, rotation = self._motion.poses(np.minimum(time, self._until), tracking.place, self._capture)
        return time, position + away, quaternion_from_rotation(exp(turn) @ rotation)
