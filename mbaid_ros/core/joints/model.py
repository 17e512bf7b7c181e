"""Errors of joints: zeros, origins, axes, tracking, lags, gears (once a turn), and encoder noise in a window's rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar, TypeVar

import numpy as np
from scipy.linalg import block_diag
from scipy.linalg.lapack import dtrtrs

from mbaid_ros.core.contracts import CLEAR, Linear, NominalModel, Stack, Unknown, Words, diagonal
from mbaid_ros.core.geometry import Array, Integers, cross, rotate, skew
from mbaid_ros.core.repair import Repair, Setting, numbers, widened, wider_prior
from mbaid_ros.core.results.estimate import with_band
from mbaid_ros.core.robot.model import Configuration, Kinematics, PlaneDetector, RobotModel
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel, inertia_matrix, sensitivity_to_joints
from mbaid_ros.core.robot.urdf import Transmission
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.state import BODY, Layout, Variables
from mbaid_ros.core.swing import of_swing, passive_momenta
from mbaid_ros.core.wheels import by_readings
from mbaid_ros.core.windows import ANGULAR_FIRST, Bodies, Midpoints, Prediction
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.parameters import by_name, parameter

_PLACEMENT_NUMBERS = 6  # numbers a joint: zero (1), origin (3), tilt of the axis (2)
TRACKING = 'tracking'
GEARED = 'geared'
LAG = 'lag'
SUSPECTED_LAG = 1e-4  # s, standard deviation of a lag that is tried: a thousand times as much is a slow filter
# Standard deviation, rad or m: far below that of drives; a thousand times as much is plausible.
_GEARED_STD = 1e-5
_MOST = 0.99  # part of the information that the noise may make: intervals are then a hundred times as wide
_TRACKING_TIME = 2.0  # s, in which a servo's following error decorrelates: some periods of its slow loop


@dataclass(frozen=True)
class _Zero:
    zero_std: float = parameter(1e-3, 'rad', minimum=0.0)
    """Standard deviation of every joint's zero, true minus measured position, constant; m for a prismatic joint. 0:
    exact."""


@dataclass(frozen=True)
class JointDeviations(_Zero):
    """Standard deviations of the joints."""

    origin_std: float = parameter(1e-3, 'm', minimum=0.0)
    """Standard deviation of each coordinate of every joint's origin; 0: exact."""
    axis_std: float = parameter(1e-3, 'rad', minimum=0.0)
    """Standard deviation of the tilt of every joint's axis, about each of two directions; 0: exact."""


@dataclass(frozen=True)
class _Tracking:
    tracking_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of the tracking error of every joint, for joint states that are commands: true minus
    commanded position, a Gauss-Markov process of 2 s; m for a prismatic joint; 0: none."""


@dataclass(frozen=True)
class _Lag:
    lag_std: float = parameter(0.0, 's', minimum=0.0, maximum=1.0)
    """Standard deviation of every joint's lag behind its stamp, beside time_offset, as of a filter, or of a driver that
    reads one joint after the other; 0: none."""


@dataclass(frozen=True)
class _Gear:
    turn_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of how far every joint is from its reading with its own angle, sine and cosine once a turn:
    an eccentric gear or encoder; m for a prismatic joint; 0: not at all."""
    scale_std: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Relative standard deviation of every joint's reading, proportional to it: a wrong number of counts or gear; 0:
    exact."""


@dataclass(frozen=True)
class SingleJointDeviations(_Gear, _Lag, _Tracking, JointDeviations):
    """Standard deviations of a single joint, in place of those of all."""


@dataclass(frozen=True)
class KnownJointsConfig(_Gear, _Lag, _Tracking, JointDeviations):
    """The uncertainty of the joints."""

    joints: Mapping[str, Mapping[str, float]] = by_name(SingleJointDeviations, 'joint')


@dataclass(frozen=True, eq=False)
class JointPlacements(Unknown):
    """Of each joint: true less measured position (rad or m), displacement of its frame (m) and tilt of its axis (rad).

    Displacement and tilt are in the joint's own axes, the tilt about two directions normal to the joint's axis.
    """

    across: Array  # (n, 3, 2) these directions

    words: ClassVar = {
        'zero': Words(
            "the joints' zeros",
            'known_joints.zero_std',
            'the zero of {}: calibrate it (known_joints)',
            lambda name, value: f'the zero of {name} is off by {1e3 * np.sum(value):+.3g} mrad (mm): measure it',
        ),
        'origin': Words(
            "the joints' origins",
            'known_joints.origin_std',
            'the origin of {}: measure or calibrate it (known_joints)',
            lambda name, value: f'the origin of {name} is off by {1e3 * np.linalg.norm(value):.3g} mm: check the URDF',
        ),
        'axis': Words(
            "the joints' axes",
            'known_joints.axis_std',
            'the axis of {}: measure or calibrate it (known_joints)',
            lambda name, value: f'the axis of {name} is off by {1e3 * np.linalg.norm(value):.3g} mrad: check the URDF',
        ),
    }
    calibrated = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the joint's zero, origin or axis as uncertain as it is off."""
        part, _, name = cause.partition(':')
        slides = kernel.model.prismatic[kernel.model.joint_names.index(name)]
        unit = 'm' if part == 'origin' or (part == 'zero' and slides) else 'rad'
        return wider_prior(
            f'the {part} of {name} is off by {with_band(value, std, 1e3)} m{unit}',
            f'known_joints.{name}.{part}_std',
            value,
            std,
            unit,
        )

    def load_motions(self, kernel: MomentumKernel, placed: Configuration) -> Array:
        """Return the twists X (u, w), one a row, by which each number displaces the load of its joint."""
        model = kernel.model
        parents = list(model.parents)
        count, joints = placed.joint_twist.shape[:2]
        frames = placed.rotation[:, parents] @ model.rotations
        displacement = np.zeros((count, joints, _PLACEMENT_NUMBERS, 6))
        displacement[:, :, 0] = placed.joint_twist
        displacement[:, :, 1:4, :3] = np.swapaxes(frames, -1, -2)
        turn = np.swapaxes(frames @ self.across, -1, -2)
        # The joint's own frame: the load of a prismatic joint has slid away from it.
        place = placed.position[:, parents] + rotate(placed.rotation[:, parents], model.positions)
        displacement[:, :, 4:, :3] = cross(np.broadcast_to(place[:, :, None], turn.shape), turn)
        displacement[:, :, 4:, 3:] = turn
        return displacement

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the change of the momentum by a displaced load of a joint."""
        return momentum_displaced(kernel, states, self.load_motions(kernel, states.configuration))

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these placements."""
        each = value.reshape(-1, _PLACEMENT_NUMBERS)
        tilts = (self.across @ each[:, 4:, None])[..., 0]
        kernel = nominal.kernel.with_displaced_joints(each[:, 1:4], tilts)
        return replace(nominal, kernel=kernel, zeros=nominal.zeros + each[:, 0])

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the zeros, the displacements in the plane, and the tilts of the axes that slide within it."""
        blocks = []
        for joint, slides in enumerate(detector.model.prismatic):
            plane = detector.plane_of_body(joint + 1)
            block = np.zeros((_PLACEMENT_NUMBERS, 4))
            block[0, 0] = 1.0
            block[1:4, 1:3] = plane.axes.T
            block[4:, 3] = self.across[joint].T @ plane.normal
            blocks.append(block if slides else block[:, :3])
        return np.asarray(block_diag(*blocks))


def joint_placements(
    kernel: MomentumKernel,
    zeros: Sequence[float],
    origins: Sequence[float],
    axes: Sequence[float],
    *,
    independent: bool = False,
) -> JointPlacements:
    """Return the placements as an unknown; (n,) standard deviations: rad (m for a prismatic one), m, rad; 0: exact.

    A joint that follows another is off by that one's zero, too, beside its own; not where `independent`: then each
    number is all by which its joint is off.
    """
    factor = diagonal(np.column_stack((zeros, *(origins,) * 3, *(axes,) * 2)).ravel())
    parts = ('zero', *('origin',) * 3, *('axis',) * 2)
    labels = tuple(f'{part}:{name}' for name in kernel.model.joint_names for part in parts)
    placements = JointPlacements(factor, labels, Kinematics(kernel.model).across)
    moved = kernel.model.transmission
    return placements if independent else _with_leaders(placements, moved, moved.multiplier)


U = TypeVar('U', bound=Unknown)


def _with_leaders(unknown: U, moved: Transmission, gains: Array) -> U:
    """Return an unknown whose first number of each joint contains so many times (n,) that of the joint it follows."""
    if moved.direct:
        return unknown
    followers = list(moved.followers)
    first = np.arange(0, len(unknown.labels), len(unknown.labels) // len(gains))
    factor = unknown.factor.copy()
    factor[first[followers]] += gains[followers, None] * factor[first[moved.leaders[followers]]]
    return replace(unknown, factor=factor, led=tuple(unknown.labels[row] for row in first[followers].tolist()))


def momentum_displaced(kernel: MomentumKernel, states: BodyStates, displacement: Array) -> Array:
    """Return the change of the momentum, (N, 6, n d), by d small motions (N, n, d, 6) of each joint's load."""
    change = _displacement_matrices(kernel, states)
    columns = displacement @ np.swapaxes(change, -1, -2)  # (N, n, d numbers, 6 of the momentum)
    return np.swapaxes(columns.reshape(len(columns), -1, 6), 1, 2)


def _displacement_matrices(kernel: MomentumKernel, states: BodyStates) -> Array:
    """Return the (N, n, 6, 6) matrices that make X x* h_S - I_S (X x V_p) of each joint (trajectory.md, eq. 2)."""
    carried = kernel.kinematics.ancestors.T
    inertia = inertia_matrix(carried @ states.known)
    whole = carried @ states.momenta
    parent = states.body_twist[:, list(kernel.model.parents)]
    # X x* h and X x V are linear in X: -[h] and -[V] in brackets.
    force = np.zeros((*whole.shape, 6))
    force[..., :3, 3:] = force[..., 3:, :3] = -skew(whole[..., :3])
    force[..., 3:, 3:] = -skew(whole[..., 3:])
    motion = np.zeros((*parent.shape, 6))
    motion[..., :3, :3] = motion[..., 3:, 3:] = -skew(parent[..., 3:])
    motion[..., :3, 3:] = -skew(parent[..., :3])
    return np.asarray(force - inertia @ motion)


@dataclass(frozen=True, eq=False)
class JointTracking(Linear):
    """Of each joint: true less read position (rad or m), in every motion another one."""

    correlation: Array  # (e,) s, time constant of each independent number

    words: ClassVar = {
        TRACKING: Words(
            'the deviations of joints from their readings',
            'known_joints.tracking_std',
            deviation=lambda name, value: (
                f'{name} deviates by {1e3 * np.sum(value):+.3g} mrad (mm) from its reading: log encoder positions, not '
                'commands, or raise known_joints.tracking_std'
            ),
        )
    }
    of_measurement = False
    in_equations = True
    redrawn_per_motion = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the joint as far from its reading as it is."""
        del std
        return tracking_repair(cause.partition(':')[2], float(np.max(np.abs(value))), kernel)

    @property
    def time_constants(self) -> Array:
        """Time constants of the errors."""
        return self.correlation

    @property
    def joint_columns(self) -> Array:
        """Each joint is further on by its own number."""
        return self.factor

    def load_motions(self, kernel: MomentumKernel, placed: Configuration) -> Array:
        """Return the motion of each load along its joint."""
        del kernel
        return placed.joint_twist[:, :, None]

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the change of the momentum by a load that has moved on along its joint."""
        return momentum_displaced(kernel, states, self.load_motions(kernel, states.configuration))

    def in_plane(self, detector: PlaneDetector) -> JointTracking:
        """Return it as it is: joints only move in the plane."""
        del detector
        return self


def joint_tracking(
    names: Sequence[str], deviations: Sequence[float], times: Sequence[float], moved: Transmission | None = None
) -> JointTracking:
    """Return it as an unknown of n joints: stationary standard deviations, rad or m; time constants, s; empty: none.

    `moved` is which joints follow others.
    """
    each = np.asarray(deviations if len(deviations) else np.zeros(len(names)), dtype=float)
    correlation = np.asarray(times if len(times) else np.ones(len(names)), dtype=float)[each > 0.0]
    tracking = JointTracking(diagonal(each), tuple(f'{TRACKING}:{name}' for name in names), correlation)
    return tracking if moved is None else _with_leaders(tracking, moved, moved.multiplier)


def tracking_repair(name: str, size: float, kernel: MomentumKernel) -> Repair:
    """Return a joint that may be off its reading by a size, rad or m, another one in every two seconds."""
    unit = 'm' if kernel.model.prismatic[kernel.model.joint_names.index(name)] else 'rad'
    return Repair(
        f'{name} deviates from its reading by some {1e3 * size:.2g} m{unit}',
        {f'known_joints.{name}.tracking_std': widened(size)},
        value=size,
        unit=unit,
    )


@dataclass(frozen=True, eq=False)
class GearedJoints(Unknown):
    """Of each joint: how it deviates from its reading with its own angle, by sine, cosine and proportion of that.

    The first two in rad (m), the third relative.
    """

    moved: Transmission | None = None  # which joints follow others; None: none does

    words: ClassVar = {
        GEARED: Words(
            'gears and scales of the joints',
            'known_joints.turn_std',
            'the gear of {}: calibrate it over a turn (known_joints)',
            lambda name, value: (
                f'{name} is flexible or geared: it deviates from its encoder with its angle, by '
                f'{_once_a_turn(value)} and {100.0 * np.sum(value[2:]):+.2g} % of the angle'
            ),
        )
    }
    in_equations = False
    moves_joints = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the joint as far from its reading, once a turn and in proportion, as it is found to be."""
        del kernel
        name, turn = cause.partition(':')[2], float(np.max(np.abs(value[:2])))
        text = (
            f'{name} deviates from its encoder with its angle, by {_once_a_turn(value)} and '
            f'{with_band(value[2:], std[2:], 100.0)} % of the angle'
        )
        wider: dict[str, Setting] = {
            f'known_joints.{name}.turn_std': widened(turn),
            f'known_joints.{name}.scale_std': widened(abs(float(value[2])), 1.0),
        }
        return Repair(text, wider, None, numbers(value), numbers(std), '')

    def deflections(self, position: Array, rate: Array, acceleration: Array) -> tuple[Array, Array]:
        """Return what each number adds to the position of its joint and of those that follow it, and to the rate."""
        del acceleration
        sine, cosine = np.sin(position), np.cos(position)
        joints = np.eye(position.shape[1])[:, :, None]
        places, rates = (
            (joints * np.stack(part, axis=-1)[:, :, None, :]).reshape(*position.shape, -1)
            for part in ((sine, cosine, position), (cosine * rate, -sine * rate, rate))
        )
        if self.moved is None or self.moved.direct:
            return places, rates
        return self.moved.errors @ places, self.moved.errors @ rates

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these gears."""
        return replace(nominal, gears=value.reshape(-1, 3))

    def in_plane(self, detector: PlaneDetector) -> GearedJoints:
        """Return it as it is: joints only move in the plane."""
        del detector
        return self


def _once_a_turn(value: Array) -> str:
    return f'{1e3 * np.linalg.norm(value[:2]):.2g} mrad (mm) once a turn'


def geared_joints(
    names: Sequence[str], turns: Sequence[float], scales: Sequence[float], moved: Transmission | None = None
) -> GearedJoints:
    """Return them as unknowns of standard deviations, rad and relative, each; 0: none. `moved`: which follow others."""
    labels = tuple(f'{GEARED}:{name}' for name in names for _ in range(3))
    return GearedJoints(diagonal(np.column_stack((turns, turns, scales)).ravel()), labels, moved)


def suspected_gears(model: RobotModel) -> GearedJoints:
    """Return them as nearly exact."""
    nearly = [_GEARED_STD] * model.joints
    return geared_joints(model.joint_names, nearly, nearly, model.transmission)


@dataclass(frozen=True, eq=False)
class JointLags(Unknown):
    """By how much each joint is read late, s, beside the stamps of all: a filter, or a driver that reads one by one."""

    words: ClassVar = {
        LAG: Words(
            'the lags of the joints',
            'known_joints.lag_std',
            'the lag of {}: measure it (known_joints)',
            lambda name, value: (
                f'{name} is read {1e3 * np.sum(value):+.3g} ms late against the others: a filter or a slow reading in '
                'its driver; correct it, or raise known_joints.lag_std'
            ),
            lambda names, values: (
                'each joint is read late by its own: '
                + ', '.join(f'{name} {1e3 * value:+.3g} ms' for name, value in zip(names, values.tolist(), strict=True))
                + '; filters or slow readings in the driver: correct them, or raise known_joints.lag_std'
            ),
        )
    }
    in_equations = False
    moves_joints = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the joint's lag, or that of all, as uncertain as it is large."""
        del kernel
        _, _, name = cause.partition(':')
        if not name:
            parameters: dict[str, Setting] = {'known_joints.lag_std': widened(float(np.max(np.abs(value))))}
            return Repair('each joint is read late by its own', parameters, None, numbers(value), numbers(std), 's')
        text = f'{name} is read {with_band(value, std, 1e3)} ms late against the others'
        return wider_prior(text, f'known_joints.{name}.lag_std', value, std, 's')

    def deflections(self, position: Array, rate: Array, acceleration: Array) -> tuple[Array, Array]:
        """Return how much further on and faster each joint is than it is read."""
        del position
        joints = np.eye(rate.shape[1])
        return rate[..., None] * joints, acceleration[..., None] * joints

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return the lags that joints are moved by: none, unless it is clearly one, as of all stamps."""
        return np.where(np.abs(value) > CLEAR * deviation, value, 0.0)

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these lags."""
        return replace(nominal, lags=value)

    def in_plane(self, detector: PlaneDetector) -> JointLags:
        """Return it as it is: joints only move in the plane."""
        del detector
        return self


def joint_lags(names: Sequence[str], deviations: Sequence[float], moved: Transmission | None = None) -> JointLags:
    """Return them as unknowns of standard deviations, s, each; 0: none. `moved`: which joints follow others."""
    lags = JointLags(diagonal(deviations), tuple(f'{LAG}:{name}' for name in names))
    return lags if moved is None else _with_leaders(lags, moved, np.ones(len(names)))


def by_deflections(
    unknown: Unknown, kernel: MomentumKernel, motion: Midpoints, acceleration: Array, bodies: Bodies
) -> Array:
    """Return the derivative (N, 6, e) of the predicted twist (v, w) by an unknown that adds to the joints' motion.

    Parameters
    ----------
    unknown, kernel : of the joints; of the robot where it is linearised
    motion, bodies : at N instants
    acceleration : of the joints then, (N, n)
    """
    position, rate = unknown.deflections(motion.joint_position, motion.joint_velocity, acceleration)
    by_rate, by_position = joint_gains(kernel, bodies)
    return np.asarray((by_position @ position + by_rate @ rate) @ unknown.factor)


def joint_gains(kernel: MomentumKernel, bodies: Bodies) -> tuple[Array, Array]:
    """Return the derivatives (N, 6, n) of the predicted twist by the joint rates, and by the joint positions."""
    by_position, by_rate = sensitivity_to_joints(kernel, bodies.states)
    back = -bodies.inverse_inertia
    if bodies.passive is None:
        return back @ by_rate, back @ by_position
    along = passive_momenta(kernel, bodies.states.configuration.joint_twist, by_rate)
    return bodies.passive.inertias.solve(-by_rate, -along)[0], back @ by_position


def gains_by_unknowns(layout: Layout, kernel: MomentumKernel, bodies: Bodies, by_rate: Array) -> Array:
    """Return the derivative (N, 6, 10 + e, n), by the body and the prediction's unknowns, of A (N, 6, n), `by_rate`.

    A is the derivative of the twist by the joint rates: the motion of one joint at unit rate without momentum. M dA is
    minus the change of the momentum of that motion by an unknown.
    """
    count, joints = len(by_rate), by_rate.shape[-1]
    each = bodies.states[np.repeat(np.arange(count), joints)]  # once for every joint
    alone = np.tile(np.arange(joints), count)
    added = kernel.kinematics.ancestors.T[alone][..., None] * _of(each.configuration.joint_twist, alone)[:, None]
    twist = np.swapaxes(by_rate, 1, 2).reshape(-1, 1, 6) + added
    readings, thrust = np.zeros_like(each.stored), np.zeros_like(each.thrust)
    of_target = twist[:, kernel.target.body]
    motion = replace(
        each,
        body_twist=twist,
        twist=of_target,
        stored=readings,
        gravity_columns=each.gravity_columns[:, :0],
        thrust=thrust,
    )
    columns = [motion.regressor]
    for unknown in layout.predicted:
        of_momentum = unknown.momentum_columns(kernel, motion)
        nothing = np.zeros((len(alone), 6, unknown.count))
        columns.append(nothing if of_momentum is None else of_momentum @ unknown.factor)
    both = np.concatenate(columns, axis=-1)
    right = -both.reshape(count, joints, 6, both.shape[-1]).transpose(0, 2, 3, 1)
    return (bodies.inverse_inertia @ right.reshape(count, 6, -1)).reshape(right.shape)


def _of(joint_twist: Array, joints: Integers) -> Array:
    """Return the (N, 6) twist of one joint at each instant."""
    return joint_twist[np.arange(len(joints)), joints]


@dataclass(frozen=True)
class JointNoise(ArrayRecord):
    """The joints' noise in B windows, (angular, linear)."""

    pose: Array  # (B, 6, n) factor of the covariance of the mean pose
    by_unknowns: Array  # (B, 6, 10 + e, n) its derivative by the target body and the prediction's unknowns
    # (B, 6, n + c) factor of the pose error that accumulates until the next window, by joints and the c readings of
    # stored momentum
    process: Array
    common: Array  # (B, 6, c) factor of the noise that rate sensors share, by these and by Gauss-Markov processes
    process_gain: Array  # (B, 6, f) motion of the base with each Gauss-Markov process, when that grows by one
    process_variance: Array  # (B, f) variance that each gains in the window by the joints' noise, beside its own


def joint_noise(
    layout: Layout,
    kernel: MomentumKernel,
    stacks: Sequence[Stack],
    inside: Sequence[slice],
    predictions: Sequence[Prediction],
    bodies: Bodies,
    *,
    swing: Array | None = None,
) -> list[JointNoise]:
    """Return the noise of stacks of windows, from their first, middle and last intervals.

    Parameters
    ----------
    layout, kernel : of the state; of the robot where it is linearised
    stacks, inside : windows, and their own intervals among those of each stack
    predictions, bodies : of each stack and the intervals beside, (m, B, ...); of all these, one after the other
    swing : (B, f, u) derivative of passive joints' deflections at the ends of all windows; None without any
    """
    # Of each stack its windows' first, middle and last intervals.
    places = [np.array([own.start, (own.start + own.stop) // 2, own.stop - 1]) for own in inside]
    begins = np.cumsum([0, *(each.twist[..., 0].size for each in predictions)])
    index = np.concatenate(  # (3, all windows)
        [
            begin + len(stack.windows) * place[:, None] + np.arange(len(stack.windows))
            for begin, place, stack in zip(begins, places, stacks, strict=False)
        ],
        axis=1,
    )
    gains = (gain[:, ANGULAR_FIRST] for gain in joint_gains(kernel, bodies[index.ravel()]))
    by_rate, by_position = (gain.reshape(*index.shape, *gain.shape[1:]) for gain in gains)
    first, middle, last = by_rate
    slope = np.concatenate([each[place[1]].error_slope for each, place in zip(predictions, places, strict=True)])
    size = [np.full((len(each.windows), 1, 1), each.windows[0].spacing) for each in stacks]
    apart = np.concatenate([each * (place[2] - place[0]) for each, place in zip(size, places, strict=True)])
    length = apart + np.concatenate(size)
    deviation = np.concatenate([np.sqrt(stack.joint_variance / stack.samples) for stack in stacks])
    if kernel.springs.count:  # nothing reads passive joints: their errors are those of the parameters
        deviation = np.repeat(deviation, kernel.model.joints // deviation.shape[-1], axis=-1)
        deviation[..., list(kernel.springs.joints)] = 0.0
    # At position level the turn of A itself remains, and F~ A dq.
    remainder = by_position[1] + slope @ middle - (last - first) / apart
    by_unknowns = gains_by_unknowns(layout, kernel, bodies[index[1]], middle[:, ANGULAR_FIRST])[:, ANGULAR_FIRST]
    moved = kernel.model.transmission
    process, stored = moved.by_noise(deviation * length, remainder), np.zeros((*middle.shape[:-1], 0))
    if kernel.storage.count:
        stored = by_readings(bodies[index[1]])
        samples = np.concatenate([stack.samples for stack in stacks])
        process = np.concatenate((process, length / np.sqrt(samples) * stored), axis=-1)
    steps = np.zeros((*last.shape[:-1], 0))
    if layout.time_constants.size:
        samples = np.concatenate([stack.samples for stack in stacks])
        steps = last @ layout.joint_columns
        # The rate of a Gauss-Markov process is white, its density twice the variance over the time constant.
        times = layout.time_constants[np.isfinite(layout.time_constants)]
        within = np.sqrt(2.0 / times * samples / length) * (middle @ layout.joint_columns)
        stored = np.concatenate((stored, within), axis=-1)
    added = np.zeros((len(steps), steps.shape[-1]))
    if swing is not None and layout.time_constants.size:
        more, added, jolts = of_swing(layout, kernel, bodies[index[1]], swing, (deviation, length))
        steps, stored = steps + more, np.concatenate((stored, np.sqrt(samples) / length * jolts), axis=-1)
    slopes = moved.by_noise(deviation[..., None, :], by_unknowns)
    noise = JointNoise(moved.by_noise(deviation, middle), slopes, process, stored, steps, added)
    ends = np.cumsum([0, *(len(stack.windows) for stack in stacks)])
    return [noise[begin:end] for begin, end in pairwise(ends)]


def errors_in_variables_bias(precision: Array, slope: Array, body: Array, variables: Variables) -> Array:
    """Return the information M of the body by the joints' noise in the rows, and M times the body, (B, b, b + 1).

    Parameters
    ----------
    precision : (B, 6, 6) S^-1 of the measurements, the joints' noise in pose and twist together
    slope : (B, 6, 10 + e, n) that noise in the rows
    body : (B, 10) standard parameters at the linearisation point
    variables : of the filter
    """
    of_body = slope[:, :, :10].transpose(0, 3, 1, 2) @ variables.to_state[BODY, variables.body]
    weighed = precision[:, None] @ of_body  # (B, n, 6, b)
    windows, joints, numbers, count = of_body.shape
    flat = of_body.reshape(windows, joints * numbers, count)
    information = np.swapaxes(flat, 1, 2) @ weighed.reshape(flat.shape)  # M of intervals.md, eq. 1
    at = variables.from_state[variables.body, BODY] @ body[..., None]
    return np.concatenate((information, information @ at), axis=-1)


@dataclass(frozen=True)
class InformationCorrection:
    """Correction of the body's b variables for M (intervals.md, eqs. 1 and 2), P their covariance without it."""

    gain: Array  # (b, b) N: errors are larger by (1 - P M)^-1 = 1 + P N
    score: Array  # (b, b) K: their covariance gains (1 - P M)^-1 P M P (1 - M P)^-1 = P K K^T P
    shift: Array  # (b,) s: the estimate moves by P s

    @staticmethod
    def from_information(covariance: Array, bias_information: Array, mean: Array) -> InformationCorrection:
        """Return it for covariance (b, b), (M, M body) (b, b + 1) and mean (b,)."""
        root, information, at = np.linalg.cholesky(covariance), bias_information[:, :-1], bias_information[:, -1]
        # With P = F F^T and F^T M F = V diag(mu) V^T:  N = F^-T V diag(mu / (1 - mu)) V^T F^-1.
        part, along = np.linalg.eigh(root.T @ information @ root)
        part = np.clip(part, 0.0, _MOST)
        back = dtrtrs(root.T, along)[0]
        gain = (back * (part / (1.0 - part))) @ back.T
        score = information @ mean - at
        return InformationCorrection(gain, back * (np.sqrt(part) / (1.0 - part)), score + gain @ covariance @ score)


def declared_placements(config: KnownJointsConfig, kernel: MomentumKernel) -> JointPlacements:
    """Return the placements of the joints.

    Raises ParameterError: A name is not that of a joint.
    """
    parts = (joint_values(config, part, kernel.model) for part in ('zero_std', 'origin_std', 'axis_std'))
    return joint_placements(kernel, *parts)


def declared_tracking(config: KnownJointsConfig, model: RobotModel) -> JointTracking:
    """Return the deviations of the joints from their readings.

    Raises ParameterError: A name is not that of a joint.
    """
    deviations = joint_values(config, 'tracking_std', model)
    times = (_TRACKING_TIME,) * len(deviations)
    return joint_tracking(model.joint_names, deviations, times, model.transmission)


def declared_gears(config: KnownJointsConfig, model: RobotModel) -> GearedJoints:
    """Return the gears and scales of joints.

    Raises ParameterError: As of `joint_values`.
    """
    turns, scales = (joint_values(config, name, model) for name in ('turn_std', 'scale_std'))
    return geared_joints(model.joint_names, turns, scales, model.transmission)


def declared_lags(config: KnownJointsConfig, model: RobotModel) -> JointLags:
    """Return the lags of the joints.

    Raises ParameterError: A name is not that of a joint.
    """
    return joint_lags(model.joint_names, joint_values(config, 'lag_std', model), model.transmission)


def joint_values(config: KnownJointsConfig, part: str, model: RobotModel) -> tuple[float, ...]:
    """Return a parameter of each joint: the joint's own, or that of all."""
    foreign = [name for name in config.joints if name not in model.joint_names]
    if foreign:
        raise ParameterError(
            f"parameter 'known_joints.{foreign[0][:60]}' is of no joint; accepted: {listing(model.joint_names)}"
        )
    every = getattr(config, part)
    return tuple(config.joints.get(name, {}).get(part, every) for name in model.joint_names)
