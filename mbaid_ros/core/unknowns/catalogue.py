"""All unknowns of the nominal model, and the words of their causes.

A new unknown is a class beside its kin with its words, a field of `Uncertainty` and a line here: in `_of_sensors` where
it belongs to a run, in `_not_calibrated` where it belongs to the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.model_errors import KnownErrors, links_to_bodies
from mbaid_ros.core.sensors.base import AttachedFrame
from mbaid_ros.core.unknowns.base import (
    LATE,
    TURNING,
    OdometryTurning,
    TwistLate,
    odometry_mount,
    odometry_scale,
    twist_bias,
)
from mbaid_ros.core.unknowns.bodies import KnownTarget, TargetPrior, TotalMass, known_bodies, spin_inertias
from mbaid_ros.core.unknowns.declaration import Linear, Unknown, Words, diagonal
from mbaid_ros.core.unknowns.environment import Circle, DisturbanceModel, disturbances, gravity, orbit_shape, thrusters
from mbaid_ros.core.unknowns.flexible import spring_errors, starting_swing, swing_noise
from mbaid_ros.core.unknowns.joints import geared_joints, joint_placements, joint_tracking
from mbaid_ros.core.unknowns.priors import UnknownsPrior
from mbaid_ros.core.unknowns.sensors import GyroErrors, clock_drift, gyro, time_offset

_LEAST_STD = 1e-6  # least standard deviation of a number in its unit: exact beside others of the same unknown


@dataclass(frozen=True)
class Uncertainty:
    """How uncertain the nominal model is: standard deviations, 0 is exact. Bodies' errors are those of the kernel."""

    zeros: Sequence[float] = ()  # of each joint: rad (m for a prismatic one); empty is exact
    origins: Sequence[float] = ()  # of each joint: m
    axes: Sequence[float] = ()  # of each joint: rad
    mount_position: float = 0.0  # m, of the base's frame in the one that the odometry locates
    mount_orientation: float = 0.0  # rad
    time_offset: float = 0.0  # s, of the joints' stamps
    target: TargetPrior | KnownTarget = field(default_factory=TargetPrior)
    linear_momentum: float = 0.0  # N s, of the total linear momentum about zero; 0 where nothing is known of it
    joint_prior: UnknownsPrior | None = None  # of all independent numbers together, after a calibration
    spin_inertias: Sequence[float] = ()  # kg m^2, of each wheel; empty is exact
    thrusters: Sequence[str] = ()  # frames of those that are not as commanded
    thrust_scale: float = 0.0  # relative, of each of them
    thrust_direction: float = 0.0  # rad
    thrust_delay: float = 0.0  # s
    gyro: GyroErrors | None = None  # None where there is none
    clock_drift: float = 0.0  # s/s, of the joints' stamps
    odometry_scale: float = 0.0  # relative, of the lengths that the odometry reads
    twist_bias: float = 0.0  # rad/s, of its angular velocity
    orbit: float = 0.0  # rad/s, mean motion of an orbit that may be there undeclared; 0 is none
    circle: Circle | None = None  # the orbit that is declared, where it may be no circle
    torque: DisturbanceModel = field(default_factory=DisturbanceModel)  # from outside
    force: DisturbanceModel = field(default_factory=DisturbanceModel)  # from outside
    tracking: Sequence[float] = ()  # of each joint: rad or m, how far it wanders from its reading; empty is not at all
    tracking_time: Sequence[float] = ()  # s, over which it does
    spring_frequency: Sequence[float] = ()  # of each passive joint: relative, of its natural frequency
    spring_ratio: Sequence[float] = ()  # of its damping ratio
    spring_start: Sequence[float] = ()  # rad or m, of its deflection at the start
    spring_noise: Sequence[float] = ()  # rad or m, stationary, of the deflection that the model does not excite
    total_mass: TotalMass | None = None  # the mass of the whole robot, where it is known
    marker: AttachedFrame | None = None  # that the odometry locates, as declared; None for the base link or another


def catalogue(kernel: MomentumKernel, uncertainty: Uncertainty) -> tuple[Unknown, ...]:
    """Return all unknowns of the nominal model but the exact ones; those only read come last."""
    none = [0.0] * kernel.model.joints
    placements = (uncertainty.zeros or none, uncertainty.origins or none, uncertainty.axes or none)
    return (
        *_uncertain(known_bodies(kernel.model, kernel.errors), joint_placements(kernel, *placements)),
        *_not_calibrated(kernel, uncertainty),
        *_uncertain(odometry_mount(uncertainty.mount_position, uncertainty.mount_orientation)),
        *_of_sensors(uncertainty),
    )


def _not_calibrated(kernel: MomentumKernel, uncertainty: Uncertainty) -> tuple[Unknown, ...]:
    """Return the unknowns that belong to the robot and to no calibration."""
    thrust = uncertainty.thrust_scale, uncertainty.thrust_direction, uncertainty.thrust_delay
    return _uncertain(
        spin_inertias(kernel, uncertainty.spin_inertias),
        thrusters(uncertainty.thrusters, *thrust),
        joint_tracking(kernel.model.joint_names, uncertainty.tracking, uncertainty.tracking_time),
        *_of_springs(kernel, uncertainty),
    )


def _of_springs(kernel: MomentumKernel, uncertainty: Uncertainty) -> tuple[Unknown, ...]:
    """Return the springs of passive joints, and how these swing at the start."""
    springs = kernel.springs
    if not springs.count:
        return ()
    names = [kernel.model.joint_names[joint] for joint in springs.joints]
    parts = (
        *(uncertainty.spring_frequency, uncertainty.spring_ratio),
        *(uncertainty.spring_start, uncertainty.spring_noise),
    )
    frequency, ratio, start, noise = (part if len(part) else np.zeros(springs.count) for part in parts)
    return (
        spring_errors(names, frequency, ratio),
        starting_swing(names, start, springs.frequency),
        swing_noise(names, noise, springs.frequency, springs.damping_ratio),
    )


def _of_sensors(uncertainty: Uncertainty) -> tuple[Unknown, ...]:
    """Return the unknowns that belong to a run, its sensors and its environment, and to no calibration."""
    return _uncertain(
        gyro(uncertainty.gyro),
        time_offset(uncertainty.time_offset),
        clock_drift(uncertainty.clock_drift),
        odometry_scale(uncertainty.odometry_scale),
        twist_bias(uncertainty.twist_bias, 0.0),
        gravity(uncertainty.orbit),
        *disturbances(uncertainty.torque, uncertainty.force),
        *(() if uncertainty.circle is None else (orbit_shape(uncertainty.circle),)),
    )


def _uncertain(*unknowns: Unknown) -> tuple[Unknown, ...]:
    return tuple(unknown for unknown in unknowns if unknown.count and unknown.factor.any())


@dataclass(frozen=True, eq=False)
class CalibratedModel:
    """A calibration beside the robot description, which has its bodies, origins and axes already."""

    links: tuple[Link, ...]  # k of them
    zeros: Array  # (n,) as of a NominalModel
    mount: Array  # (6,) as of a NominalModel
    # (10 k + 6 n + 6,) squared: standard parameters of the links, each in its own frame; of each joint zero,
    # displacement of its frame and tilts of its axis; mount
    covariance: Array

    def with_kernel(self, kernel: MomentumKernel, uncertainty: Uncertainty) -> tuple[MomentumKernel, Uncertainty]:
        """Return a kernel with its target and its uncertainty, correlated; the rest of the uncertainty as given."""
        joints = kernel.model.joints
        bodies, carry = links_to_bodies(self.links, [link.name for link in kernel.unknown])
        whole = block_diag(carry, np.eye(6 * joints + 6))
        covariance, mount = whole @ self.covariance @ whole.T, self.mount
        if uncertainty.gyro is not None and uncertainty.gyro.alone:
            # No poses are measured: there is nothing that is mounted elsewhere than the base's own frame.
            covariance[-6:] = covariance[:, -6:] = 0.0
            mount = np.zeros(6)
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        of_bodies = deviations[: len(carry)]
        each = deviations[len(carry) : -6].reshape(joints, 6)
        zeros, origins, axes = (_size(part) for part in (each[:, :1], each[:, 1:4], each[:, 4:]))
        orientation, position = _size(deviations[-6:].reshape(2, 3))
        units = np.concatenate(
            (
                of_bodies,
                np.column_stack((zeros, *(origins,) * 3, *(axes,) * 2)).ravel(),
                np.repeat((orientation, position), 3),
            )
        )
        values = np.concatenate((np.zeros(len(carry)), np.zeros(6 * joints), mount))
        values[len(carry) : -6 : 6] = self.zeros
        known = _gaussian(values, covariance, units)
        others, sensing = (
            sum(unknown.count for unknown in each)
            for each in (_not_calibrated(kernel, uncertainty), _of_sensors(uncertainty))
        )
        known = known.extended(others, before=int(np.count_nonzero(units[:-6])))
        known = known.extended(sensing, before=len(known.mean))
        doubted = kernel.with_errors(KnownErrors(bodies, diagonal(of_bodies)))
        return doubted, replace(
            uncertainty,
            zeros=zeros.tolist(),
            origins=origins.tolist(),
            axes=axes.tolist(),
            mount_position=float(position),
            mount_orientation=float(orientation),
            joint_prior=known,
        )


def _size(deviations: Array) -> Array:
    """Return the root mean square of each row."""
    return np.sqrt(np.mean(deviations**2, axis=-1))


def _gaussian(values: Array, covariance: Array, units: Array) -> UnknownsPrior:
    """Return numbers in their units with a factor of their covariance; those without a unit are left out."""
    uncertain = units > 0.0
    own = units[uncertain]
    scaled = covariance[np.ix_(uncertain, uncertain)] / own / own[:, None]
    size = np.maximum(np.sqrt(np.maximum(np.diag(scaled), 0.0)), _LEAST_STD)
    eigenvalues, vectors = np.linalg.eigh(scaled / size / size[:, None])
    return UnknownsPrior(values[uncertain] / own, size[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))


def candidate_unknowns(known: Sequence[str], joints: Sequence[str]) -> tuple[Linear, ...]:
    """Return unknowns that a contradicted run is tried with, by joints' names, beside those whose labels are known.

    Their standard deviations are too small to matter, a thousandth of a plausible value: the run stays as it was. The
    likelihood gain of a wider prior follows from its estimate (`core/filter/prior_scale.py`).
    """
    every: tuple[Linear, ...] = (
        odometry_scale(5e-5),
        OdometryTurning(3e-6 * np.eye(3), (TURNING,) * 3),
        clock_drift(1e-6),
        TwistLate(np.array([[3e-4]]), (LATE,)),
        twist_bias(1e-5, 0.0),
        twist_bias(0.0, 1e-4),
        geared_joints(joints),
    )
    return tuple(each for each in every if not set(each.causes) & set(known))


def _kinds(kind: type[Unknown]) -> list[type[Unknown]]:
    """Return a class of unknowns and all that derive from it."""
    return [kind, *(each for part in kind.__subclasses__() for each in _kinds(part))]


# By kind of cause: those of every unknown, and of the priors of target and momentum.
_WORDS: dict[str, Words] = {
    'target prior': Words(remedy='the prior of the target (target_prior)'),
    'momentum prior': Words(remedy='the prior of the momentum (momentum.linear_prior_std)'),
}
for _kind in _kinds(Unknown):
    _WORDS.update(_kind.words)
_LARGEST_SIZE = 10.0  # that is tried (trajectory.md, eq. 8): beyond it, how many times is not known


def _words_of(cause: str) -> tuple[Words, str]:
    """Return the words of a cause's kind and the name of the thing: 'zero:elbow', or 'zero' for all zeros."""
    kind, _, name = cause.partition(':')
    return _WORDS.get(kind, Words()), name


def in_words(cause: str) -> str:
    """Return a cause of the error budget in words: 'link:arm' is link arm, 'zero:elbow' the zero of elbow."""
    kind, _, name = cause.partition(':')
    return f'{kind} {name}' if kind == 'link' else f'the {kind} of {name}' if name else kind


@lru_cache(maxsize=1024)  # asked for at each window
def kind_in_words(cause: str) -> str:
    """Return a cause of the error budget, or a kind of them, in words: 'zero' is the joints' zeros."""
    words, name = _words_of(cause)
    return words.every if words.every and not name else in_words(cause)


def remedy_text(cause: str) -> str:
    """Return a cause in words, and its remedy."""
    words, name = _words_of(cause)
    return words.remedy.format(name) or cause


def underestimated_text(cause: str, size: float) -> str:
    """Return that a thing, 'link:arm', or all of a kind, 'link', is `size` times as far off as declared."""
    words, name = _words_of(cause)
    parameter = words.parameter or 'its standard deviation'
    times = f'{size:.1f}' if size < 0.95 * _LARGEST_SIZE else f'{_LARGEST_SIZE:g} or more'
    return (
        f'{kind_in_words(cause)} {"looks" if name else "look"} {times} times as far off as declared: intervals allow '
        f'for that; raise {parameter}'
    )


def deviation_text(cause: str, value: Array) -> str:
    """Return the value that an unknown would need, by its label and numbers (k,), SI units, and the remedy."""
    words, name = _words_of(cause)
    if words.deviation is None:
        return f'{cause} is off by {np.linalg.norm(value):.3g}'
    return words.deviation(name, value)


def target_changed_text(time: float, *, exchanged: bool) -> str:
    """Return that the body moved in the grasp at a time, s, or was exchanged for another."""
    if exchanged:
        return f'another body is in the grasp since {time:.1f} s, caught or lost: identify it from then on'
    return f'the body moved in the grasp at {time:.1f} s: identify it again from then on'
