"""Errors of the odometry (mount, scale, bias and delay of the twist) and the rows of its poses and twists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.contracts import (
    Course,
    Hypothesis,
    Linear,
    Motion,
    NominalModel,
    Observation,
    PlacedFrame,
    Stack,
    Unknown,
    Words,
    diagonal,
    twist_in_plane,
)
from mbaid_ros.core.geometry import (
    Array,
    Flags,
    cross,
    exp,
    quaternion_from_rotation,
    rotation_from_quaternion,
    skew,
)
from mbaid_ros.core.joints.model import JointNoise
from mbaid_ros.core.odometry.stream import AttachedFrame
from mbaid_ros.core.orbit import TURNING_FRAMES, orbit_fixed_frame
from mbaid_ros.core.repair import Conversion, Repair, Setting, numbers, widened, wider_prior
from mbaid_ros.core.results.estimate import with_band
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel, force_cross, inertia_matrix, motion_cross
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.state import Point, Variables
from mbaid_ros.core.windows import ANGULAR_FIRST, Midpoints, Prediction
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import parameter

TWIST_FRAMES = ('child', 'inertial')
SCALE, ANGULAR_BIAS, LINEAR_BIAS = 'odometry scale', 'twist bias', 'twist velocity bias'
TURNING, LATE = 'odometry turning', 'twist late'
POSES_LATE, POSES_DRIFT = 'poses late', 'poses drift'
OF_TWIST = (LATE, ANGULAR_BIAS, LINEAR_BIAS)  # errors of the twist alone
_MINUTE = 60.0  # s: a unit
_ALONG = 4.0  # standard deviations, to which an angular velocity is along the normal of an orbit
_LARGEST_SCALE, _FASTEST = 0.1, 0.01  # of odometry.scale_std; rad/s, of odometry.turning_std
_DRIFT_TIME = 30.0  # s, of the errors of odometry that drifts
_UNIT = 1e-3  # largest difference of a quaternion parameter from unit length


@dataclass(frozen=True)
class OdometryMountConfig:
    """The uncertainty of the mount of the odometry on the base."""

    position_std: float = parameter(2e-3, 'm', minimum=0.0)
    """Standard deviation of each coordinate of the base link's origin in the frame that the odometry locates; 0:
    exact."""
    orientation_std: float = parameter(2e-3, 'rad', minimum=0.0)
    """Standard deviation of the base link's orientation in that frame, about each axis; 0: exact."""


@dataclass(frozen=True)
class OdometryConfig:
    """Constant errors of the odometry, beside its noise."""

    turning_std: float = parameter(0.0, 'rad/s', minimum=0.0, maximum=0.01)
    """Standard deviation of the angular velocity of the odometry's frame about each axis, as of one that turns with an
    orbit that orbit.* do not describe; 0: it does not turn."""
    scale_std: float = parameter(0.001, minimum=0.0, maximum=0.1)
    """Relative standard deviation of the odometry's length scale, as from motion capture; a bar of known length
    gives .0002, a stereo camera has .01; 0: exact."""
    angular_velocity_bias_std: float = parameter(1e-4, 'rad/s', minimum=0.0)
    """Standard deviation of the bias of the odometry's angular velocity about each axis of the base, if a gyro measures
    it: 10 deg/h are 5e-5 rad/s; 0: exact."""


@dataclass(frozen=True)
class PoseConfig:
    """Poses of the base without a twist: a PoseStamped or the like on the topic pose, or a transform on /tf."""

    tf_child_frame: str = parameter('')
    """Take the pose of the base from /tf: child frame of the transform, a link of the base or, with marker.position, a
    marker. Empty: /tf is not read."""


@dataclass(frozen=True)
class MarkerConfig:
    """A frame on the base that the odometry locates and that is no link of the robot."""

    position: tuple[float, ...] = parameter((), 'm', lengths=(0, 3))
    """Origin, in the base link's frame, of a child_frame_id that is no link of the robot; empty: refused."""
    orientation: tuple[float, ...] = parameter((0.0, 0.0, 0.0, 1.0), lengths=(4,))
    """Orientation of the marker's frame in the base link's: quaternion x, y, z, w."""


@dataclass(frozen=True, eq=False)
class OdometryMount(Unknown):
    """Rotation vector (rad) and position (m) of the base's frame in the one that the odometry locates."""

    words: ClassVar = {
        'mount': Words(
            'position and orientation of the odometry mount',
            'odometry_mount.position_std, .orientation_std',
            'the mount of the odometry: measure it (odometry_mount)',
            lambda _, value: (
                f'the odometry is mounted {1e3 * np.linalg.norm(value[3:]):.3g} mm and '
                f'{1e3 * np.linalg.norm(value[:3]):.3g} mrad off: measure the mount'
            ),
        )
    }
    of_measurement = True
    calibrated = True

    @property
    def tilt(self) -> float:
        """Standard deviation of its rotation, about each axis, rad."""
        return float(np.sqrt(np.sum(self.factor[:3] ** 2) / 3.0))

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the mount as uncertain as it is off."""
        del cause, kernel
        place, turn = with_band(value[3:], std[3:], 1e3), with_band(value[:3], std[:3], 1e3)
        parts = zip(('orientation', 'position'), np.split(value, 2), strict=True)
        parameters: dict[str, Setting] = {
            f'odometry_mount.{part}_std': widened(float(np.max(np.abs(own)))) for part, own in parts
        }
        return Repair(
            f'the odometry is mounted {place} mm and {turn} mrad off',
            parameters,
            value=numbers(value),
            std=numbers(std),
            unit='rad, m',
        )

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the equations of a robot that is measured by its odometry's frame depend on where that is.

        A turn of the base takes everything along but the measured twist (trajectory.md, eq. 2). A base that is
        elsewhere, by a, moves faster by w x a, and the angular momentum about its origin is less by a x P.
        """
        del kernel
        rotation = states.configuration.rotation[:, 0]
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        total, twist = states.known_momentum, states.body_twist[:, 0]
        axes = np.swapaxes(rotation, 1, 2)  # (N, 3, 3), one a row
        turn, faster, away = np.zeros((3, len(rotation), 3, 6))
        turn[..., 3:] = axes
        faster[..., :3] = cross(twist[:, None, 3:], axes)
        away[..., 3:] = cross(axes, total[:, None, :3])
        turned = force_cross(turn, total[:, None]) - motion_cross(turn, twist[:, None]) @ inertia
        return np.swapaxes(np.concatenate((turned, faster @ inertia + away), axis=1), 1, 2)

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return its effect on the pose, and on the velocity: v_read = v_true - w x R mu_p.

        A pose error turns the twist that is read, for that is turned by the pose; the mount's part of it does not.
        """
        if sensor not in ('pose', 'twist'):
            return None
        read = np.zeros((len(motion.rotation), 6, 6))
        read[:, :3, :3] = read[:, 3:, 3:] = -motion.rotation if sensor == 'pose' else -motion.turning
        if sensor == 'twist':
            read[:, 3:, :3] = -motion.sliding
        return read

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this mount."""
        return replace(nominal, mount=nominal.mount + value)

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the turn about the normal and the displacement in the plane."""
        return twist_in_plane(detector)


def odometry_mount(position_std: float, orientation_std: float) -> OdometryMount:
    """Return the mount as an unknown, of these standard deviations (m, rad); 0 is exact."""
    return OdometryMount(diagonal(np.repeat((orientation_std, position_std), 3)), ('mount',) * 6)


def marker_text(mount: Array, marker: PlacedFrame | None) -> str:
    """Return the parameters that declare a mount (6,), rad and m, found on top of the declared marker if there is one.

    With E = Exp(mu_R) the marker that the poses locate has the axes E^T A and the origin E^T (a - mu_p).
    """
    rotation, position = (np.eye(3), np.zeros(3)) if marker is None else (marker.rotation, marker.position)
    back = exp(mount[:3]).T
    position, quaternion = back @ (position - mount[3:]), quaternion_from_rotation(back @ rotation)
    place, turn = (', '.join(f'{x:.5f}' for x in np.round(each, 5) + 0.0) for each in (position, quaternion))
    return f'marker.position: [{place}], marker.orientation: [{turn}]' + (
        '' if marker else ' (of a child_frame_id that is no link)'
    )


def _long_or_short(value: Array) -> str:
    return 'long' if np.sum(value) > 0.0 else 'short'


@dataclass(frozen=True, eq=False)
class OdometryScale(Linear):
    """Relative scale error s: positions are read (1 + s) times as far as they are."""

    # Whether from the origin of its frame, which poses of other sensors have, too; else from the run's
    from_world: bool = False

    words: ClassVar = {
        SCALE: Words(
            every='the lengths of the odometry (their scale)',
            parameter='odometry.scale_std',
            remedy='the scale of the odometry: calibrate it (odometry.scale_std)',
            deviation=lambda _, value: (
                f'the scale of the odometry is off: it reads lengths {1e2 * np.sum(np.abs(value)):.2g} % too '
                f'{_long_or_short(value)}; calibrate it, or raise odometry.scale_std'
            ),
        )
    }
    in_equations = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the scale as uncertain as it is off."""
        del cause, kernel
        return wider_prior(
            f'the odometry reads lengths {with_band(np.abs(value), std, 1e2)} % too {_long_or_short(value)}',
            'odometry.scale_std',
            value,
            std,
            most=_LARGEST_SCALE,
        )

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the velocity that is read; the arm of the linear one is left out."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        return -inertia[..., :3] @ states.body_twist[:, 0, :3, None]

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return the position as far as the base has come, or its velocity."""
        if sensor not in ('pose', 'twist'):
            return None
        read = np.zeros((len(motion.time), 6, 1))
        position = motion.position + motion.origin if self.from_world else motion.position
        read[:, 3:, 0] = position if sensor == 'pose' else motion.twist[:, 3:]
        return read


def odometry_scale(deviation: float, *, from_world: bool = False) -> OdometryScale:
    """Return the scale as an unknown, of a relative standard deviation; `from_world` as of the class."""
    return OdometryScale(np.array([[deviation]]), (SCALE,), from_world)


@dataclass(frozen=True, eq=False)
class TwistBias(Linear):
    """Constant in base axes, angular (rad/s) and linear (m/s)."""

    words: ClassVar = {
        ANGULAR_BIAS: Words(
            remedy='the bias of the angular velocity: more motion determines it (odometry.angular_velocity_bias_std)',
            deviation=lambda _, value: (
                f'the angular velocity of the twist has a bias of {np.linalg.norm(value):.2g} rad/s: leave the twist '
                'out, or raise odometry.angular_velocity_bias_std'
            ),
        ),
        LINEAR_BIAS: Words(
            deviation=lambda _, value: (
                f'the velocity of the twist has a bias of {np.linalg.norm(value):.2g} m/s: leave the twist out'
            )
        ),
    }
    in_equations = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return an angular bias as uncertain as it is large, and the twist left out for a linear one."""
        del kernel
        turns = cause == ANGULAR_BIAS
        unit = 'rad/s' if turns else 'm/s'
        what = 'angular velocity' if turns else 'velocity'
        text = f'the {what} of the twist has a bias of {with_band(value, std)} {unit}'
        if turns:
            return wider_prior(text, 'odometry.angular_velocity_bias_std', value, std, unit)
        conversion = Conversion(with_twist=False)
        return Repair(text, conversion=conversion, value=numbers(value), std=numbers(std), unit=unit)

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the twist that is read."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        rotation = states.configuration.rotation[:, 0]
        return -np.concatenate((inertia[..., 3:] @ rotation, inertia[..., :3] @ rotation), axis=-1)

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return the base's axes."""
        if sensor != 'twist':
            return None
        read = np.zeros((len(motion.time), 6, 6))
        read[:, :3, :3] = read[:, 3:, 3:] = motion.axes
        return read

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the turn about the normal and the speeds in the plane."""
        return twist_in_plane(detector)


def twist_bias(angular: float, linear: float) -> TwistBias:
    """Return the bias as an unknown, of standard deviations in rad/s and m/s; 0 is exact."""
    return TwistBias(diagonal(np.repeat((angular, linear), 3)), (ANGULAR_BIAS,) * 3 + (LINEAR_BIAS,) * 3)


@dataclass(frozen=True, eq=False)
class OdometryTurning(Linear):
    """Angular velocity of the odometry's frame, rad/s, (3,) in its own axes, such as an orbit's."""

    words: ClassVar = {TURNING: Words(deviation=lambda _, value: orbit_fixed_frame(float(np.linalg.norm(value))))}

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the orbit that the frame turns with, or its angular velocity as uncertain as it is large."""
        del cause, kernel
        text, left = f'the frame of the odometry turns by {with_band(value, std, 1e3)} mrad/s', float(np.max(std))
        for frame, axis in TURNING_FRAMES.items():
            rate = float(axis @ value)
            if np.linalg.norm(value - rate * axis) < _ALONG * left < rate:
                declared: dict[str, Setting] = {
                    'orbit.mean_motion': float(f'{rate:.6g}'),
                    'orbit.frame': frame,
                    'orbit.gradient_relative_std': min(widened(2.0 * left / rate), 1.0),
                    'odometry.turning_std': widened(left),
                }
                text = f'{text}, as {frame} axes of an orbit do'
                return Repair(text, declared, value=numbers(value), std=numbers(std), unit='rad/s')
        return wider_prior(
            text,
            'odometry.turning_std',
            value,
            std,
            'rad/s',
            most=_FASTEST,
        )

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return the rotation of such a frame back, about the run's origin."""
        if sensor not in ('pose', 'twist'):
            return None
        read = np.zeros((len(motion.time), 6, 3))
        time = motion.time[:, None, None] if sensor == 'pose' else 1.0
        read[:, :3], read[:, 3:] = -time * np.eye(3), time * skew(motion.position)
        return read


def odometry_turning(deviation: float) -> OdometryTurning:
    """Return the frame's angular velocity as an unknown, of a standard deviation, rad/s."""
    return OdometryTurning(diagonal(np.full(3, deviation)), (TURNING,) * 3)


@dataclass(frozen=True, eq=False)
class TwistLate(Linear):
    """By how much the twist is behind the pose, s."""

    words: ClassVar = {
        LATE: Words(
            deviation=lambda _, value: f'the twist is {1e3 * np.sum(value):+.3g} ms late against the pose: leave it out'
        )
    }

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the twist left out."""
        del cause, kernel
        text = f'the twist is {with_band(value, std, 1e3)} ms late against the pose'
        conversion = Conversion(with_twist=False)
        return Repair(text, conversion=conversion, value=numbers(value), std=numbers(std), unit='s')

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return the earlier twist."""
        return -motion.slope[..., None] if sensor == 'twist' else None


@dataclass(frozen=True, eq=False)
class PosesBesideOthers(Linear):
    """Delay (s) and velocity (m/s) of the poses against joints and other sensors, 4: only these show them."""

    words: ClassVar = {
        POSES_LATE: Words(
            deviation=lambda _, value: (
                f'the odometry is stamped {1e3 * np.sum(value):+.3g} ms late against other sensors: check its stamps'
            )
        ),
        POSES_DRIFT: Words(
            deviation=lambda _, value: (
                f'the position of the odometry drifts by {6e4 * np.linalg.norm(value):.3g} mm a minute against other '
                'sensors: calibrate it'
            )
        ),
    }

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return the earlier pose, and the displacement."""
        if sensor != 'pose':
            return None
        moved = motion.time[:, None, None] * np.eye(6)[:, 3:]
        return np.concatenate((-motion.twist[..., None], moved), axis=2)


def poses_beside_others(delay: float, drift: float) -> PosesBesideOthers:
    """Return these as an unknown, of standard deviations in s and m/s."""
    return PosesBesideOthers(diagonal([delay, *np.full(3, drift)]), (POSES_LATE, *(POSES_DRIFT,) * 3))


@dataclass(frozen=True, eq=False)
class Vibration(Linear):
    """The pose vibrates at one frequency: amplitudes (24,) rad and m of sine and cosine, and their growth a minute."""

    frequency: float = 0.0  # Hz

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return each, or how fast it changes."""
        rate, time = 2.0 * np.pi * self.frequency, motion.time[:, None, None]
        axes = np.eye(6)
        sine, cosine = np.sin(rate * time) * axes, np.cos(rate * time) * axes
        late = time / _MINUTE
        if sensor == 'pose':
            return np.concatenate((sine, cosine, late * sine, late * cosine), axis=2)
        if sensor != 'twist':
            return None
        growing = (rate * late * cosine + sine / _MINUTE, cosine / _MINUTE - rate * late * sine)
        return np.concatenate((rate * cosine, -rate * sine, *growing), axis=2)


def vibration(frequency: float) -> Vibration:
    """Return a vibration of the pose at a frequency, Hz, as an unknown."""
    size = np.tile(np.repeat((1e-3, 1e-2), 3), 4)
    return Vibration(np.diag(size), ('vibration',) * 24, frequency)


@dataclass(frozen=True)
class Measurement(ArrayRecord):
    """What windows measure of the state x: value = rows x + noise, NaN where it is not measured."""

    value: Array  # (k,)
    rows: Array  # (k, s)
    covariance: Array  # (k, k) of the noise


def state_rows(errors: Array, readings: Array) -> Array:
    """Return rows (..., r, s) of the state: a composition (..., r, p + 1) without its constant, and the readings."""
    return np.concatenate((errors[..., :-1], readings), axis=-1)


def at_knots(values: Array, inside: slice) -> Array:
    """Return values midway between knots at the knots of the intervals inside; at an open end the value midway."""
    around = np.concatenate(
        (values[max(inside.start - 1, 0) : inside.start or 1], values[inside.start : inside.stop + 1])
    )
    around = around if len(values) > inside.stop else np.concatenate((around, values[-1:]))
    return 0.5 * (around[:-1] + around[1:])


def mean_over_knots(knots: Array, change: Array) -> Array:
    """Return the mean of values (m + 1, B, ...) at a window's knots and the next, with some of their change."""
    mean = total(knots[:-1]) / (len(knots) - 1)
    return mean + change * (knots[-1] - knots[0]) if change.any() else mean


def pose_measurement(errors: Array, change: Array, readings: Array, point: Array) -> tuple[Array, Array]:
    """0 = mean of xi over the knots + readings + noise (measurements.md, eq. 1), linearised at (r,).

    A share `change` of the change of xi whitens correlated errors. The twist in the readings is that at the knots
    themselves: half an interval later its noise, the joints' as that of xi, would look like a delay by that half.
    """
    mean = mean_over_knots(errors, change[..., None])
    return readings @ point - mean[..., -1], state_rows(mean, readings)


def mean_twist(
    errors: Array, prediction: Prediction, point: Point, weights: Array, offset: Array | None = None
) -> Array:
    """Return the mean of the predicted twist and its derivative by the state, (B, 6, p + 1), constant last.

    V = V_predicted + F xi + G (parameters - linearisation), with weights (m,) of the intervals. `offset` (B, 6) is how
    much more momentum the windows have than the point.
    """
    gain = prediction.by_parameters[..., ANGULAR_FIRST, :]
    model: Array = prediction.by_pose_error[..., ANGULAR_FIRST, :] @ (0.5 * (errors[1:] + errors[:-1]))
    model[..., 6:-1] += gain
    model[..., -1] += prediction.twist[..., ANGULAR_FIRST] - gain @ point.parameters
    if offset is not None:
        model[..., -1] -= (gain[..., :6] @ offset[..., None])[..., 0]
    return total(weights[:, None, None, None] * model)


def rate_measurement(mean: Array, measured: Array, readings: Array, point: Array) -> tuple[Array, Array]:
    """V_measured - V_predicted = F xi + G (parameters - linearisation) + readings + noise, weighted.

    Parameters
    ----------
    mean : (B, r, p + 1) what sensors read of twist or pose error, constant last; `measured` (B, r) they did read
    readings, point : (B, r, e), (e,) by the unknowns of the readings, linearised there
    """
    return measured - mean[..., -1] + readings @ point, state_rows(mean, readings)


class Twist:
    """The twist of the odometry as a sensor. It is turned by the measured pose, as the rate of a gyro is."""

    name = 'twist'
    of_base = np.eye(6)

    def observed(self, course: Course, base: Motion) -> Observation:
        """Return the mean twist, whose noise is white in base axes."""
        around, inside, stack = course.around, course.inside, course.stack
        count = inside.stop - inside.start
        weights = parabolic_weights(count)
        axes = np.zeros((len(stack.windows), 6, 6))
        axes[..., :3, :3] = axes[..., 3:, 3:] = around.base_rotation[inside.start + count // 2]
        white = count * np.sum(weights**2) / stack.samples
        return Observation(
            total(weights[:, None, None] * around.base_twist[inside][..., ANGULAR_FIRST]),
            white * (axes @ stack.twist_covariance @ np.swapaxes(axes, -1, -2)),
            base,
        )


@dataclass(frozen=True)
class IntegratedTwist(ArrayRecord):
    """Integral of a window's twist from its first knot on; of several windows with these along a first axis."""

    replaces_twist: Flags  # () whether it takes the place of the twist; all else is zero where not
    # first two: (6,), (6, s): value - rows x = c - c' + noise, to the next window's first knot, with its c'
    integral_value: Array
    integral_rows: Array
    # mean_value, mean_rows: (6,), (6, s): value - rows x = c - joint noise in the mean pose + noise, mean over the
    # knots
    mean_value: Array
    mean_rows: Array
    white: Array  # (6, 6) covariance of the noise in the way
    # share, left: () share of that noise in the mean, and variance of the rest of the mean's noise, over `white`
    share: Array
    left: Array
    change: Array  # () as `Stack.whitening`

    @staticmethod
    def none(count: int, size: int) -> IntegratedTwist:
        """Return those of windows, a count, whose twist is measured by itself; for a state of this size."""
        value, rows, nothing = np.zeros((count, 6)), np.zeros((count, 6, size)), np.zeros(count)
        counts = np.zeros(count, dtype=bool)
        return IntegratedTwist(counts, value, rows, value, rows, rows[..., :6], nothing, nothing, nothing)


def integral_weights(count: int) -> tuple[Array, Array]:
    """Return the weights (m,) of a window's twists in its integral, and in the mean of the integrals to its knots."""
    remaining = count - 1.0 - np.arange(count)
    return np.full(count, 1.0 / count), remaining / np.sum(remaining)


def integrated_twist(
    stack: Stack,
    prediction: Prediction,
    middle: Midpoints,
    errors: Array,
    point: Point,
    *,
    by_readings: Sequence[Array],
    stored: Array,
) -> IntegratedTwist:
    """Return the integrated twist of a stack's windows; other arguments as of `mean_twist`.

    Parameters
    ----------
    by_readings : rates by the unknowns of the readings, as of `reading_columns`, with each of `integral_weights`
    stored : (B, 6, c) noise in the twist by stored momentum
    """
    count, spacing = len(middle), stack.windows[0].spacing
    share, of_mean = 0.5 * (count - 1.0) / count, integral_weights(count)[1]
    parts: list[tuple[Array, Array]] = []
    sizes = count * spacing, share * count * spacing
    for weights, rates, size in zip(integral_weights(count), by_readings, sizes, strict=True):
        measured = total(weights[:, None, None] * middle.base_twist[..., ANGULAR_FIRST])
        twist = mean_twist(errors, prediction, point, weights)
        value, rows = rate_measurement(twist, measured, rates, point.nuisance)
        parts.append((size * value, size * rows))
    way, mean = parts
    white = (count * spacing) ** 2 / stack.samples * _white(stack, middle.base_rotation[count // 2], stored)
    nothing = np.ones(len(stack.windows))
    left = count * np.sum((share * of_mean) ** 2) - share**2
    return IntegratedTwist(nothing > 0.0, *way, *mean, white, share * nothing, left * nothing, stack.whitening[:, 0])


def _white(stack: Stack, rotation: Array, stored: Array) -> Array:
    """Return the (B, 6, 6) covariance of the white noise of one twist, and of the readings of stored momentum."""
    axes = np.zeros((len(rotation), 6, 6))
    axes[..., :3, :3] = axes[..., 3:, 3:] = rotation
    return np.asarray(axes @ stack.twist_covariance @ np.swapaxes(axes, -1, -2) + stored @ np.swapaxes(stored, -1, -2))


@cache
def telescoped(count: int, spacing: float) -> float:
    """Return the variance of joint noise in a window's twist over that in its mean pose, 1/s^2."""
    return float(count * np.sum(np.diff(np.pad(parabolic_weights(count), 1)) ** 2) / spacing**2)


def total(values: Array) -> Array:
    """Return the sum along the intervals in order: numpy chooses another order for other memory layouts."""
    return np.asarray(np.add.reduce(np.ascontiguousarray(values), axis=0))


@cache
def parabolic_weights(count: int) -> Array:
    """Return the (m,) weights of a window's twists: a parabola that vanishes at its ends."""
    place = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    parabola = 1.0 - place**2
    return np.asarray(parabola / np.sum(parabola))


@dataclass(frozen=True)
class BorderNoise:
    """How a window's measurements depend on c (k,), and c on the next window's; q (k,) are of unit variance."""

    # by_noise, by_carried: (w, k) derivatives of a window's w whitened measurements by q and c
    by_noise: Array
    by_carried: Array
    # value, rows, inverse factor: (k,), (k, v), (k, k): q = back (c' - c - process noise + value - rows variables)
    integral_value: Array
    integral_rows: Array
    inverse_factor: Array
    process: Array  # (k, n) of that noise, as in `WhitenedWindow`


def integrated_twist_rows(
    twist: IntegratedTwist, pose: Measurement, noise_of_joints: JointNoise, variables: Variables
) -> tuple[list[tuple[Array, Array, Array, BorderNoise]], Array]:
    """Return value, rows, log_noise and link of B windows by pose and integrated twist, as in `WhitenedWindow`.

    Second, (B, 6, 6) S^-1 of these measurements as the joints' noise is in them. The measured way, free of that noise,
    takes the place of the change of xi that whitens the mean pose.
    """
    select, of_joints = variables.measured, noise_of_joints.pose
    size, change = len(select), twist.change[:, None]
    values = np.concatenate(
        ((pose.value - change * twist.integral_value) @ select.T, twist.mean_value @ select.T),
        axis=1,
    )
    by_state = np.concatenate(
        (select @ (pose.rows - change[..., None] * twist.integral_rows), select @ twist.mean_rows),
        axis=1,
    )
    common = of_joints @ np.swapaxes(of_joints, -1, -2)
    factor = np.linalg.cholesky(select @ twist.white @ select.T)
    noise = np.zeros((len(pose), 2 * size, 2 * size))
    noise[:, :size, :size] = select @ pose.covariance @ select.T
    noise[:, :size, size:] = noise[:, size:, :size] = select @ common @ select.T
    noise[:, size:, size:] = select @ (common + twist.left[:, None, None] * twist.white) @ select.T
    by_noise = np.concatenate((-change[..., None] * factor, twist.share[:, None, None] * factor), axis=1)
    by_carried = np.concatenate((np.zeros((size, size)), np.eye(size)))
    triangle = np.linalg.cholesky(noise)
    whiten = np.linalg.inv(triangle)
    links = map(
        BorderNoise,
        whiten @ by_noise,
        whiten @ by_carried,
        twist.integral_value @ select.T,
        select @ variables.rows(twist.integral_rows),
        np.linalg.inv(factor),
        select @ noise_of_joints.process,
    )
    both = block_diag(select, select).reshape(2, size, 2, 6).sum(axis=2).reshape(2 * size, 6)
    certain = _certain(noise + by_noise @ np.swapaxes(by_noise, -1, -2), by_carried, factor)
    log_noise = 2.0 * np.add.reduce(np.log(np.diagonal(triangle, axis1=1, axis2=2).T.copy()), axis=0)
    white = (whiten @ values[..., None])[..., 0], whiten @ variables.rows(by_state), log_noise
    return list(zip(*white, links, strict=True)), both.T @ certain @ both


def _certain(noise: Array, by_carried: Array, walk: Array) -> Array:
    """Return the (B, w, w) inverse of the covariance of the measurements, with c as certain as all windows make it.

    c is a random walk. Measured with a variance r times that of its step, it keeps 1 / sqrt(1 + 4 r) of r: the smoothed
    variance far from the ends of a run.

    Parameters
    ----------
    noise, by_carried : (B, w, w) covariance of the measurements given c, and (w, k) their derivative by c
    walk : (B, k, k) factor of the covariance of a step of c
    """
    inverse = np.linalg.inv(noise)
    seen = inverse @ by_carried @ walk
    size, along = np.linalg.eigh(np.swapaxes(by_carried @ walk, -1, -2) @ seen)
    size = np.maximum(size, 1e-12)
    left = (seen @ along) / np.sqrt(np.sqrt(size * (size + 4.0)))[:, None]
    return np.asarray(inverse - left @ np.swapaxes(left, -1, -2))


def drifting_position(position_std: float) -> Hypothesis:
    """Return the position of the odometry, of which a reading has a standard deviation in m, as a random walk."""
    return Hypothesis(
        'the odometry position drifts',
        'the odometry position drifts: check the sensor, or set noise.base_correlation_time',
        position=position_std,
        physical=False,
        repair=Repair('the odometry position drifts', {'noise.base_correlation_time': _DRIFT_TIME}, unit='s'),
    )


def marker_frame(config: MarkerConfig) -> AttachedFrame | None:
    """Return the frame that the parameters place on the base.

    Raises ParameterError: The orientation is no unit quaternion.
    """
    quaternion = np.array(config.orientation)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > _UNIT:
        raise ParameterError(
            f"parameter 'marker.orientation' has length {length:g}; accepted: a quaternion x, y, z, w of length 1"
        )
    if not config.position:
        return None
    return AttachedFrame(rotation_from_quaternion(quaternion), np.array(config.position))


def declared_mount(config: OdometryMountConfig, *, located: bool) -> OdometryMount:
    """Return the mount of the odometry, exact where nothing locates the base."""
    return odometry_mount(config.position_std, config.orientation_std) if located else odometry_mount(0.0, 0.0)


def declared_scale(config: OdometryConfig, *, located: bool, from_world: bool = False) -> OdometryScale:
    """Return the scale of the odometry, exact where nothing locates the base; `from_world` as of `OdometryScale`."""
    return odometry_scale(config.scale_std if located else 0.0, from_world=from_world)


def declared_twist_bias(config: OdometryConfig, *, located: bool) -> TwistBias:
    """Return the bias of the odometry's angular velocity, exact where nothing locates the base."""
    return twist_bias(config.angular_velocity_bias_std if located else 0.0, 0.0)


def declared_turning(config: OdometryConfig, *, located: bool) -> OdometryTurning:
    """Return the angular velocity of the odometry's frame, exact where nothing locates the base."""
    return odometry_turning(config.turning_std if located else 0.0)
