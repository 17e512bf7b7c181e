"""The state at a window's first knot, and the point that windows are linearised at.

State: pose error xi (6), total momentum P, L (6), target body phi (10), then the unknowns of the nominal model in units
of their priors: first those that the prediction depends on, then those of the readings alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np

from mbaid_ros.core.filter.knots import Midpoints
from mbaid_ros.core.geometry import Array, Flags, cross
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Configuration, PlaneDetector
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS, body_sizes, summed_over_bodies
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum
from mbaid_ros.core.unknowns.declaration import NominalModel, PlacedFrame, Unknown, uncertain
from mbaid_ros.core.unknowns.priors import UnknownsPrior, in_plane_map

POSE, LINEAR, ANGULAR, BODY = slice(0, 6), slice(6, 9), slice(9, 12), slice(12, 22)
_NEAR = 0.5  # of the body's size: no step goes further, as the prediction is linear no further
MOMENTUM = slice(LINEAR.start, ANGULAR.stop)
# Rows of a twist (v, w) in the order (angular, linear) of a pose error.
ANGULAR_FIRST = np.array([3, 4, 5, 0, 1, 2])
BODY_PLACES = np.arange(BODY.start, BODY.stop)


class BodyPrior(Protocol):
    """A prior of the target."""

    @property
    def declared(self) -> bool:
        """Whether anything is."""

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o)."""


class WeighedMass(Protocol):
    """A mass of the whole robot."""

    @property
    def mass(self) -> float:
        """Its value, kg."""

    @property
    def std(self) -> float:
        """Its standard deviation, kg."""

    @property
    def with_target(self) -> bool:
        """Whether all of the target is weighed as well."""


@dataclass(frozen=True, eq=False)
class Declared:
    """The declaration of a robot and its run: the unknowns, and the priors of all that is none."""

    unknowns: tuple[Unknown, ...] = ()  # in the order of the state: those that are only read come last
    target: BodyPrior | None = None
    linear_momentum: float = 0.0  # N s, of the total linear momentum about zero; 0 where nothing is known of it
    joint_prior: UnknownsPrior | None = None  # of all independent numbers together, after a calibration
    total_mass: WeighedMass | None = None  # where the whole robot was weighed
    marker: PlacedFrame | None = None  # that the odometry locates; None for the base link or another link
    imu: Link | None = None  # the link that an IMU is on, where joints move it

    def with_links(self, links: Unknown) -> Declared:
        """Return the same with these errors of known links."""
        others = (each for each in self.unknowns if each.mass_row() is None)
        return replace(self, unknowns=uncertain(links, *others))


@dataclass(frozen=True, eq=False)
class Point:
    """Where windows are linearised."""

    parameters: Array  # (u,) of the prediction: P, L, phi, unknowns
    readings: Array  # (r,) the other unknowns
    side: NominalModel  # the nominal model there

    @property
    def body(self) -> Array:
        """Standard parameters of the target (10,)."""
        return self.parameters[BODY.start - LINEAR.start : BODY.stop - LINEAR.start]

    @property
    def state(self) -> Array:
        """The state (s,) there, without a pose error."""
        return np.concatenate((np.zeros(POSE.stop), self.parameters, self.readings))


@dataclass(frozen=True, eq=False)
class Layout:
    """The layout of the state."""

    kernel: MomentumKernel  # of the robot as its URDF has it
    unknowns: tuple[Unknown, ...]  # those of the readings last
    known: UnknownsPrior  # their prior
    # (3, 6) the equations that hold for a planar motion, as `PlaneDetector.equation_selection`; None in space
    plane: Array | None = None
    imu: Link | None = None  # the link that an IMU is on, where joints move it

    @staticmethod
    def from_unknowns(
        kernel: MomentumKernel,
        unknowns: Sequence[Unknown],
        known: UnknownsPrior | None = None,
        plane: Array | None = None,
    ) -> Layout:
        """Return the layout of a state with these unknowns, and a joint prior of theirs.

        Raises ValueError: The prior is of other numbers, or the unknowns of the readings are not the last.
        """
        count, last = sum(unknown.count for unknown in unknowns), [unknown.in_readings for unknown in unknowns]
        if known is None:
            known = UnknownsPrior.standard_normal(count)
        elif len(known.mean) != count or last != sorted(last):
            raise ValueError(f'a posterior of {len(known.mean)} numbers does not match {count} unknowns, in order')
        return Layout(kernel, tuple(sorted(unknowns, key=lambda unknown: unknown.in_readings)), known, plane)

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """The slice of each unknown in the state."""
        ends = BODY.stop + np.cumsum([0, *(unknown.count for unknown in self.unknowns)])
        return tuple(slice(*pair) for pair in pairwise(ends.tolist()))

    @cached_property
    def parameters(self) -> slice:
        """The slice of the parameters of the prediction."""
        return slice(LINEAR.start, BODY.stop + sum(each.count for each in self.predicted))

    @cached_property
    def readings(self) -> slice:
        """The slice of the unknowns that affect the readings only."""
        return slice(self.parameters.stop, self.size)

    @cached_property
    def size(self) -> int:
        """Size s of the state."""
        return BODY.stop + sum(each.count for each in self.unknowns)

    @cached_property
    def predicted(self) -> tuple[Unknown, ...]:
        """The unknowns that the prediction depends on."""
        return tuple(each for each in self.unknowns if not each.in_readings)

    @cached_property
    def of_joints(self) -> tuple[tuple[Unknown, slice], ...]:
        """The unknowns that add to the joints' motion, and their slices of the parameters."""
        first = self.parameters.start
        return tuple(
            (unknown, slice(place.start - first, place.stop - first))
            for unknown, place in zip(self.unknowns, self.places, strict=True)
            if unknown.moves_joints
        )

    @cached_property
    def read(self) -> tuple[Unknown, ...]:
        """The unknowns that only the readings depend on."""
        return tuple(each for each in self.unknowns if each.in_readings)

    @cached_property
    def causes(self) -> tuple[str, ...]:
        """The c causes in the error budget."""
        return tuple(dict.fromkeys(self.cause_of))

    @cached_property
    def cause_of(self) -> tuple[str, ...]:
        """The cause of each of the unknowns' e independent numbers."""
        return tuple(cause for unknown in self.unknowns for cause in unknown.causes)

    @cached_property
    def part_of(self) -> tuple[str, ...]:
        """The part of its cause that each of these numbers is by itself; empty where none."""
        return tuple(part for unknown in self.unknowns for part in unknown.parts)

    @cached_property
    def belongs(self) -> Array:
        """Causes of the numbers as (e, c) zeros and ones."""
        return np.array([[float(own == cause) for cause in self.causes] for own in self.cause_of]).reshape(
            len(self.cause_of), len(self.causes)
        )

    def extended(self, more: Sequence[Unknown]) -> Layout:
        """Return the layout with more unknowns, independent of the others."""
        before = len(self.predicted)
        predicted, read = (tuple(each for each in more if each.in_readings is which) for which in (False, True))
        unknowns = (*self.unknowns[:before], *predicted, *self.unknowns[before:], *read)
        known = self.known.extended(sum(each.count for each in predicted), before=self.readings.start - BODY.stop)
        known = known.extended(sum(each.count for each in read), before=len(known.mean))
        return replace(self, unknowns=unknowns, known=known)

    def state(self, body: Array, momentum: Array) -> Array:
        """Return the state (s,) with a body (10,), a momentum (6,), and the unknowns as declared."""
        return np.concatenate((np.zeros(POSE.stop), momentum, body, self.known.mean))

    def point(self, state: Array, deviation: Array | None = None) -> Point:
        """Return the linearisation point of a state (s,) with standard deviations (s,)."""
        values = self.linearisation_state(state, deviation)
        side = NominalModel.nominal(self.kernel)
        for unknown, place in zip(self.unknowns, self.places, strict=True):
            side = unknown.applied_to(side, unknown.factor @ values[place])
        return Point(values[self.parameters], values[self.readings], side)

    def linearisation_state(self, state: Array, deviation: Array | None = None) -> Array:
        """Return the linearisation point (s,) of windows, for a state (s,) with standard deviations (s,)."""
        values = state.copy()
        for unknown, place in zip(self.unknowns, self.places, strict=True):
            uncertain = np.zeros(unknown.count) if deviation is None else deviation[place]
            values[place] = unknown.linearisation_value(values[place], uncertain)
        return values

    @cached_property
    def time_constants(self) -> Array:
        """Time constants (e,) of the unknowns' numbers, s; inf where they stay. Empty where all do."""
        times = np.concatenate([np.zeros(0), *(unknown.time_constants for unknown in self.unknowns)])
        return times if np.isfinite(times).any() else np.zeros(0)

    @cached_property
    def noise_driven(self) -> Array:
        """Which of the unknowns' e numbers the joints' noise drives, too, as ones among zeros."""
        return numbers_of(self.unknowns, [each.noise_driven for each in self.unknowns]).astype(float)

    @cached_property
    def joint_columns(self) -> Array:
        """Offsets (n, f) of the joints by each of the unknowns' f Gauss-Markov processes."""
        steps = [
            np.zeros((self.kernel.model.joints, each.count)) if each.joint_columns is None else each.joint_columns
            for each in self.unknowns
        ]
        times = self.time_constants
        return np.concatenate(steps, axis=1)[:, np.isfinite(times)] if times.size else np.zeros((0, 0))


def numbers_of(unknowns: Sequence[Unknown], which: Sequence[bool]) -> Flags:
    """Return which of the unknowns' e numbers are of certain unknowns."""
    return np.repeat(np.array(which, dtype=bool), [each.count for each in unknowns])


def near_part(parameters: Array, step: Array) -> float:
    """Return the part of a step from a point's (u,) parameters over which the prediction is linear."""
    body = slice(BODY.start - LINEAR.start, BODY.stop - LINEAR.start)
    if parameters[body][0] == 0.0:
        return 1.0  # nothing is known of a body that has no mass
    far, size = np.abs(step[body]), body_sizes(parameters[body])
    # Numbers without size, as a mass without inertia, stay as they are.
    change = float(np.max(np.divide(far, size, out=np.where(far > 0.0, np.inf, 0.0), where=size != 0.0)))
    return min(1.0, _NEAR / max(change, _NEAR))


def layout_of(kernel: MomentumKernel, declared: Declared, detector: PlaneDetector) -> Layout:
    """Return the layout for the declared unknowns of a robot that moves in a plane or in space."""
    unknowns, known = declared.unknowns, declared.joint_prior
    if known is not None:
        # The swing of passive joints at the start of another run does not apply to this one.
        known = known.drawn_anew(numbers_of(unknowns, [each.redrawn_after_gap for each in unknowns]))
    if detector.planar:
        seen = tuple(unknown.in_plane(detector) for unknown in unknowns)
        known = known and known.of([in_plane_map(*pair) for pair in zip(unknowns, seen, strict=True)])
        unknowns = seen
    layout = Layout.from_unknowns(kernel, unknowns, known, detector.equation_selection() if detector.planar else None)
    return replace(layout, imu=declared.imu)


def mobility_and_joint_momentum(
    kernel: MomentumKernel, stored: Array, bodies: Array, placed: Configuration, body_twist: Array
) -> tuple[Array, Array]:
    """Return M^-1 and the momentum of the joint motion at a resting base, that stored inside bodies included.

    `stored` (N, c) are its readings; `bodies` (N, b, 10) are those of `placed`, in common axes about the base's origin.
    """
    mobility, moving = mobility_and_momentum(bodies, body_twist)
    if kernel.storage.count:
        moving[:, 3:] += np.sum(kernel.storage.momenta(placed.rotation, stored), axis=1)
    return mobility, moving


def total_momentum(middle: Midpoints, point: Point, known: Array, impulses: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the total (P, L_b) at N instants, (N, 3) each: that of the point, thrust and orbit included.

    Parameters
    ----------
    middle, point : Midpoints, Point
    known : (n + 1, 10) standard parameters of all bodies
    impulses : columns of tide and of thrusters that deviate from their commands
    """
    parameters, (tide, thrust) = point.parameters, impulses
    linear, angular = parameters[:3] + middle.impulse[:, :3], parameters[3:6] + middle.impulse[:, 3:]
    about_base = angular - cross(middle.base_position, linear)
    parts = [(tide, known)] if tide.shape[1] else []
    if thrust.shape[1] and point.side.thrust.any():
        parts.append((thrust, point.side.thrust.reshape(-1, THRUSTER_ERRORS)))
    for columns, numbers in parts:
        more = summed_over_bodies(columns, numbers)
        linear, about_base = linear + more[:, :3], about_base + more[:, 3:]
    return linear, about_base


def in_plane(mobility: Array, plane: Array) -> Array:
    """Return the (N, 6, 6) matrices from momentum to twist of a robot kept in a plane with (3, 6) rows.

    The constraint takes up all momentum out of the plane.
    """
    return np.asarray(plane.T @ np.linalg.inv(plane @ np.linalg.inv(mobility) @ plane.T) @ plane)
