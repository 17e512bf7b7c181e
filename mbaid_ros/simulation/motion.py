"""Motions of the arm's joints while the base floats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.urdf import Transmission
from mbaid_ros.errors import ParameterError

# Gains of the tracking error. The torques are those of the exact model, so only the integrator's own error is left to
# correct: a slow, critically damped loop (1 rad/s) is enough and does not shorten the step.
_STIFFNESS = 1.0  # 1/s^2
_DAMPING = 2.0  # 1/s


class Passive:
    """Free joints: no torque (the paper's case)."""

    def command(self, time: float, position: Array, velocity: Array) -> None:  # noqa: ARG002 - as of Driven
        """Return None: nothing drives the joints."""
        return

    def from_time(self, time: float) -> Passive:  # noqa: ARG002 - as of Driven
        """Return itself."""
        return self


class Driven(ABC):
    """Joints that follow a reference."""

    @abstractmethod
    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n,) each."""

    @abstractmethod
    def from_time(self, time: float) -> Driven:
        """Return the motion with time 0 at a time (s) of this one."""

    def command(self, time: float, position: Array, velocity: Array) -> Array:
        """Return the joint accelerations to give (n,): the reference's, corrected by the tracking error."""
        wanted, speed, acceleration = self.reference(time)
        return acceleration + _DAMPING * (speed - velocity) + _STIFFNESS * (wanted - position)


Motion = Passive | Driven


@dataclass(frozen=True)
class Sinusoids(Driven):
    """Joints that follow q_j(t) = q0_j + sum_k a_jk (sin(2 pi f_jk t + phi_jk) - sin(phi_jk))."""

    start: Array  # (n,) q0, rad or m
    amplitude: Array  # (n, K) rad or m
    frequency: Array  # (n, K) Hz
    phase: Array  # (n, K) rad

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n,) each."""
        rate = 2.0 * np.pi * self.frequency
        angle = rate * time + self.phase
        sine, speed = self.amplitude * np.sin(angle), self.amplitude * rate
        position = self.start + (sine - self.amplitude * np.sin(self.phase)).sum(axis=1)
        return position, (speed * np.cos(angle)).sum(axis=1), -(rate * rate * sine).sum(axis=1)

    def from_time(self, time: float) -> Sinusoids:
        """Return the motion with time 0 at a time (s) of this one."""
        phase = self.phase + 2.0 * np.pi * time * self.frequency
        return Sinusoids(self.reference(time)[0], self.amplitude, self.frequency, phase)


def sinusoids(start: Array, amplitudes: Array, frequencies: Array, phases: Array) -> Sinusoids:
    """Build sinusoids from flat arrays, joint by joint: (j1 term 1, j1 term 2, ..., j2 term 1, ...).

    Raises ParameterError: The arrays are not of one length, a multiple of the number of joints.

    Parameters
    ----------
    start : (n,) rad or m
    amplitudes, frequencies : (n K,) rad or m; Hz
    phases : (n K,) rad, or empty for zero
    """
    joints = len(start)
    if not len(phases):
        phases = np.zeros(len(amplitudes))
    if len(amplitudes) != len(frequencies) or len(amplitudes) != len(phases):
        raise ParameterError(
            f'motion.amplitudes, motion.frequencies and motion.phases have {len(amplitudes)}, {len(frequencies)} and '
            f'{len(phases)} numbers; arrays of one length are accepted'
        )
    if joints == 0 or len(amplitudes) == 0 or len(amplitudes) % joints:
        raise ParameterError(
            f'motion.amplitudes has {len(amplitudes)} numbers; a multiple of the {joints} joints is accepted'
        )
    shape = (joints, -1)
    return Sinusoids(start, amplitudes.reshape(shape), frequencies.reshape(shape), phases.reshape(shape))


def with_resting_joints(driven: Flags, motion: Sinusoids, start: Array) -> Sinusoids:
    """Return a motion of k joints from their start (k,), whose driven joints move."""
    if driven.all():
        return motion
    parts = []
    for part in (motion.amplitude, motion.frequency, motion.phase):
        whole = np.zeros((len(driven), part.shape[1]))
        whole[driven] = part
        parts.append(whole)
    return Sinusoids(start, *parts)


def random_sinusoids(
    start: Array, seed: int, terms: int, amplitude: float, period_min: float, period_max: float
) -> Sinusoids:
    """Draw sinusoids: amplitudes in (0.5, 1) of `amplitude` shared among the terms, periods uniform in their range.

    Raises ParameterError: The periods are not in order.

    Parameters
    ----------
    start : (n,) rad or m
    seed : the same seed gives the same motion
    terms : sinusoids a joint
    amplitude : rad or m, largest excursion of a joint from the middle of its motion
    period_min, period_max : s
    """
    if not 0.0 < period_min <= period_max:
        raise ParameterError(
            f'motion.period_min is {period_min:g} s and motion.period_max {period_max:g} s; '
            '0 < period_min <= period_max is accepted'
        )
    generator = np.random.default_rng(seed)
    shape = (len(start), terms)
    return Sinusoids(
        start,
        amplitude=generator.uniform(0.5, 1.0, shape) * amplitude / terms,
        frequency=1.0 / generator.uniform(period_min, period_max, shape),
        phase=generator.uniform(-np.pi, np.pi, shape),
    )


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
    """Return a motion of the k independent joints, scaled down to their limits.

    Where the start is not given, it moves to where the motion fits.

    Raises ParameterError: The start that is given is outside the limits.
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


def with_mimic_joints(motion: Sinusoids, transmission: Transmission) -> Sinusoids:
    """Return the motion of all n joints from that of the k independent ones."""
    if transmission.direct:
        return motion
    place, gain = transmission.driver, transmission.multiplier
    amplitude = motion.amplitude[place] * gain[:, None]
    return Sinusoids(transmission.positions(motion.start), amplitude, motion.frequency[place], motion.phase[place])


def _ratio(allowed: Array, wanted: Array) -> Array:
    """Return the allowed part of the wanted motion, 1 if all of it."""
    fits = wanted <= allowed
    return np.where(fits, 1.0, _KEPT * allowed / np.where(fits, 1.0, wanted))
