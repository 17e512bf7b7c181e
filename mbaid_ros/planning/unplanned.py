"""Unplanned motions within the same limits, for comparison with planned ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.planning.limits import BaseLimits
from mbaid_ros.planning.motions import Motions
from mbaid_ros.planning.splines import Splines

_SPACING, _EACH = 0.5, 10  # s, of speeds at most; of these for each joint at least
_RAMP = 2.0  # s, in which joints come from rest and back to it
_TERMS, _PERIODS = 2, (8.0, 40.0)  # sinusoids a joint, s
_LEGS = (4.0, 12.0)  # s, that a joint goes one way

Generator = np.random.Generator


def simple_motion(kind: str, motions: Motions, base: BaseLimits, seed: int) -> JointTrajectory:
    """Return a motion that is drawn, as large as the limits of joints and base allow; collisions are not looked at.

    Parameters
    ----------
    kind : of SIMPLE
    motions : where it begins, how long it takes, and the limits of the joints
    base : limits of the base's motion, for the best estimate of the robot
    seed : the same gives the same motion
    """
    duration = motions.splines.duration
    joints = len(motions.start)
    fine = replace(motions, splines=Splines(max(round(duration / _SPACING), _EACH * joints), duration))
    times = np.arange(1, fine.splines.count + 1) / fine.splines.count * duration
    drawn = SIMPLE[kind](times, joints, np.random.default_rng(seed))
    speeds = fine.splines.filling(np.diff(drawn, axis=0, prepend=0.0)[None], fine.start, fine.limits)
    for _ in range(3):
        speeds = fine.gentle(speeds, base)
    return fine.trajectory(speeds[0])


def _sinusoids(times: Array, joints: int, generator: Generator) -> Array:
    """Return random sinusoids of all joints, (T, k)."""
    size = generator.uniform(0.5, 1.0, (joints, _TERMS))
    rate = 2.0 * np.pi / generator.uniform(*_PERIODS, (joints, _TERMS))
    phase = generator.uniform(-np.pi, np.pi, (joints, _TERMS))
    moved = (size * (np.sin(rate * times[:, None, None] + phase) - np.sin(phase))).sum(axis=-1)
    ramp = np.clip(np.minimum(times, times[-1] - times) / _RAMP, 0.0, 1.0)[:, None]
    return np.asarray(moved * np.sin(0.5 * np.pi * ramp) ** 2)


def _one_by_one(times: Array, joints: int, generator: Generator) -> Array:
    """Return each joint there and back while the others rest, (T, k)."""
    share = np.clip(times[:, None] / times[-1] * joints - np.arange(joints), 0.0, 1.0)
    return np.sin(np.pi * share) ** 2 * generator.choice([-1.0, 1.0], joints)


def _trapezoids(times: Array, joints: int, generator: Generator) -> Array:
    """Return all joints there and back at a constant speed, with ramps, in legs that are drawn, (T, k)."""
    step = times[1] - times[0]
    speed = np.empty((len(times), joints))
    for joint in range(joints):
        turns = np.cumsum(generator.uniform(*_LEGS, int(times[-1] / _LEGS[0]) + 2))
        speed[:, joint] = generator.choice([-1.0, 1.0]) * (-1.0) ** np.searchsorted(turns, times)
    rest = max(min(round(_RAMP / step), len(times) // 4), 1)  # of a motion that is hardly longer, a part
    speed[:rest] = speed[-rest:] = 0.0
    ramp = np.ones(rest) / rest
    ramped = [np.convolve(each, ramp, 'same') for each in speed.T]
    return np.asarray(np.cumsum(ramped, axis=1).T)


SIMPLE: dict[str, Callable[[Array, int, Generator], Array]] = {
    'sinusoids': _sinusoids,
    'one_by_one': _one_by_one,
    'trapezoids': _trapezoids,
}
