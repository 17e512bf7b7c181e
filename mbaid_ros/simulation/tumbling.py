"""The flight of a free body before its capture, and the camera that tracks a frame on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, solve_ivp

from mbaid_ros.core.geometry import Array, cross, exp, quaternion_from_rotation, rotate, rotation_from_quaternion, unvec
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.changes import Target

_LIMITS = {'rtol': 1e-11, 'atol': 1e-12}  # errors of a step
_ROUNDING = 1e-9  # of a period: a pose due within this of a limit is due at it


class FreeMotion:
    """A body that nothing acts on, until it is captured.

    Parameters
    ----------
    target : the body, its velocity and its spin at the capture
    rotation, position : (3, 3), (3,) m, of the capturing link's frame at that instant, in the odometry frame
    """

    def __init__(self, target: Target, rotation: Array, position: Array) -> None:
        self._target, self._rotation = target, rotation
        self._centre = position + rotation @ target.body[1:4]
        self._inertia = unvec(target.body[4:])
        start = np.concatenate((np.zeros(3), [1.0], rotation.T @ target.spin))
        solved = solve_ivp(self._backward, (0.0, target.time), start, DOP853, dense_output=True, **_LIMITS)
        self._spun = solved.sol  # quaternion to the link's axes at the capture, and spin in body axes, so long before

    def poses(self, time: Array, place: Array) -> tuple[Array, Array]:
        """Return positions (N, 3) and rotations (N, 3, 3), in the odometry frame, of a frame fixed to the body.

        At the capture its axes are those of the link.

        Parameters
        ----------
        time : (N,) s since the start of the run, none after the capture
        place : (3,) m, its origin in the link's frame at the capture
        """
        before = self._target.time - time
        rotation = self._rotation @ rotation_from_quaternion(quaternions.normalised(self._spun(before)[:4].T))
        centre = self._centre - before[:, None] * self._target.velocity
        return centre + rotate(rotation, place - self._target.body[1:4]), rotation

    def _backward(self, _: float, values: Array) -> Array:
        """Return the rates of quaternion and spin (7,) in body axes, backwards in time."""
        spin = values[4:]
        turning = 0.5 * quaternions.product(values[:4], quaternions.pure(spin))
        torque = -cross(spin, self._inertia @ spin)
        return -np.concatenate((turning, np.linalg.solve(self._inertia, torque)))


@dataclass(frozen=True)
class Tracking:
    """What a camera tracks of the body, and how well."""

    place: Array  # (3,) m, origin of the tracked frame as of `FreeMotion.poses`
    rate: float  # Hz
    position_noise: float = 0.0  # m, of each coordinate
    orientation_noise: float = 0.0  # rad, about each axis
    missing: float = 0.0  # part of the poses that are


class TargetCamera:
    """Poses of a frame on the free body, with seeded noise; none after the capture.

    Parameters
    ----------
    motion, until : of the body, and the time of its capture, s
    seed : the same seed gives the same noise
    """

    def __init__(self, motion: FreeMotion, until: float, tracking: Tracking, seed: int) -> None:
        self._motion, self._until, self._tracking = motion, until, tracking
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
        position, rotation = self._motion.poses(np.minimum(time, self._until), tracking.place)
        return time, position + away, quaternion_from_rotation(exp(turn) @ rotation)
