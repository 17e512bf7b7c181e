"""Drawn motions within the limits of the URDF, and joints that follow others."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.mimic import Transmission
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.simulation.motion import Sinusoids

_KEPT = 0.999  # of a limit, where it binds: the joints track their reference, and do not lie on it


def independent_limits(model: RobotModel) -> tuple[Array, Array, Array]:
    """Return lower, upper and velocity limits (k,) of the joints that follow no other, for all that they move.

    rad or m, rad/s or m/s; infinite where the URDF has none.
    """
    moved = model.transmission
    lower, upper = np.full((2, len(moved.independent)), [[-np.inf], [np.inf]])
    velocity = np.full(len(moved.independent), np.inf)
    for joint, limit in enumerate(model.limits):
        gain, place = moved.multiplier[joint], moved.driver[joint]
        if gain == 0.0:
            continue
        ends = sorted((end - moved.offset[joint]) / gain for end in (limit.lower, limit.upper))
        lower[place], upper[place] = max(lower[place], ends[0]), min(upper[place], ends[1])
        velocity[place] = min(velocity[place], limit.velocity / abs(gain))
    return lower, upper, velocity


def within_limits(motion: Sinusoids, model: RobotModel, *, start_given: bool) -> Sinusoids:
    """Return a motion of the k independent joints made as much smaller as their limits ask for, and else as it is.

    Where the start is not given, it moves to where the motion fits.

    Raises
    ------
    ParameterError
        The start that is given is outside the limits.
    """
    lower, upper, velocity = independent_limits(model)
    outside = (motion.start < lower) | (motion.start > upper)
    if start_given and outside.any():
        joint = int(np.flatnonzero(outside)[0])
        raise ParameterError(
            f"parameter 'initial.joint_positions' has {motion.start[joint]:g} for '{model.independent_joints[joint]}'; "
            f'accepted: its limits, {lower[joint]:g} to {upper[joint]:g}, or motion.within_limits: false'
        )
    reach = motion.amplitude.sum(axis=1)
    centre = -(motion.amplitude * np.sin(motion.phase)).sum(axis=1)  # of the excursion, less the start
    fastest = 2.0 * np.pi * (motion.amplitude * motion.frequency).sum(axis=1)
    scale = _ratio(velocity, fastest)
    if start_given:
        room = np.minimum(_ratio(upper - motion.start, reach + centre), _ratio(motion.start - lower, reach - centre))
    else:
        room = _ratio(0.5 * (upper - lower), reach)
    scale = np.minimum(scale, room)
    start = motion.start
    if not start_given:
        middle, extent = start + scale * centre, scale * reach
        moved = np.clip(middle, lower + extent, np.maximum(upper - extent, lower + extent))
        start = np.where(moved == middle, start, moved - scale * centre)
    return Sinusoids(start, motion.amplitude * scale[:, None], motion.frequency, motion.phase)


def followed(motion: Sinusoids, transmission: Transmission) -> Sinusoids:
    """Return the motion of all n joints from that of the k independent ones."""
    if transmission.direct:
        return motion
    place, gain = transmission.driver, transmission.multiplier
    amplitude = motion.amplitude[place] * gain[:, None]
    return Sinusoids(transmission.positions(motion.start), amplitude, motion.frequency[place], motion.phase[place])


def _ratio(allowed: Array, wanted: Array) -> Array:
    """Return 1 where what is wanted is allowed, else what part of it is."""
    fits = wanted <= allowed
    return np.where(fits, 1.0, _KEPT * allowed / np.where(fits, 1.0, wanted))
