"""Momentum of bodies by their ten inertial parameters, its derivatives, and the kernel of a whole robot."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, bracket, cross, rotate, rotate_back, skew, unvec
from mbaid_ros.core.robot.model import Configuration, Kinematics, Link, RobotModel, displaced, express
from mbaid_ros.core.samples import Index, Samples

THRUSTER_ERRORS = 5  # errors of a thruster: scale, turn about three axes, delay


def momentum(parameters: Array, twist: Array) -> Array:
    """Return the momentum (..., 6) of bodies: kg m/s, kg m^2/s.

    Parameters
    ----------
    parameters : (..., 10) (m, h, I_o) about the base origin in odometry axes
    twist : (..., 6) (u, w) at the base origin
    """
    mass, first_moment, inertia = parameters[..., :1], parameters[..., 1:4], unvec(parameters[..., 4:])
    linear, angular = twist[..., :3], twist[..., 3:]
    # P = m u + w x h;  L_b = h x u + I_o w
    p = mass * linear + cross(angular, first_moment)
    return np.concatenate((p, cross(first_moment, linear) + rotate(inertia, angular)), axis=-1)


def inertia_matrix(parameters: Array) -> Array:
    """Return the (..., 6, 6) spatial inertia M with momentum = M twist, of (..., 10) (m, h, I_o) about the base."""
    matrix = np.zeros((*parameters.shape[:-1], 6, 6))
    first = skew(parameters[..., 1:4])
    matrix[..., :3, :3] = parameters[..., :1, None] * np.eye(3)
    matrix[..., :3, 3:] = -first
    matrix[..., 3:, :3] = first
    matrix[..., 3:, 3:] = unvec(parameters[..., 4:])
    return matrix


def regressor(rotation: Array, position: Array, twist: Array) -> Array:
    """Return Y (..., 6, 10) with momentum = Y (m, h, I_o) for a link's parameters in its own frame.

    Linear in all ten parameters: the inertia is about the link's origin, not the CoM as in the paper's eqs. 9 and 14.

    Parameters
    ----------
    rotation, position : (..., 3, 3), (..., 3) m, the link's frame: R, and r relative to the base origin
    twist : (..., 6) of the link (u, w) at the base origin
    """
    angular = twist[..., 3:]
    velocity = twist[..., :3] + cross(angular, position)  # v, of the link's origin
    shape = np.broadcast_shapes(rotation.shape[:-2], twist.shape[:-1])
    matrix = np.zeros((*shape, 6, 10))
    # P = m v + [w]x R h (method.md, eq. 1)
    first = skew(angular) @ rotation
    matrix[..., :3, 0] = velocity
    matrix[..., :3, 1:4] = first
    # L_b = m r x v + ([r]x [w]x R - [v]x R) h + R bracket(R^T w) vec(I_o) (eq. 2, about the base's origin)
    matrix[..., 3:, 0] = cross(position, velocity)
    matrix[..., 3:, 1:4] = skew(position) @ first - skew(velocity) @ rotation
    matrix[..., 3:, 4:] = rotation @ bracket(rotate_back(rotation, angular))
    return matrix


@dataclass(frozen=True, eq=False)
class Storage:
    """Angular momentum stored inside bodies, with c readings."""

    bodies: tuple[int, ...] = ()  # (c,) indices of the moving bodies that hold it
    axes: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (c, 3) unit vectors in the axes of these bodies
    # (c,) kg m^2 about these axes, of a reading that is a speed (rad/s); 1 of a momentum (N m s)
    inertias: Array = field(default_factory=lambda: np.zeros(0))
    noises: Array = field(default_factory=lambda: np.zeros(0))  # (c,) standard deviation of one reading
    names: tuple[str, ...] = ()  # c, of each

    @staticmethod
    def from_wheels(link: Link, names: Sequence[str], axes: Array, inertias: Sequence[float], noise: float) -> Storage:
        """Return wheels with (w, 3) unit axes in a link's frame, whose speeds are read with a noise (rad/s)."""
        bodies, noises = (link.body,) * len(names), np.full(len(names), noise)
        return Storage(bodies, axes @ link.rotation.T, np.array(inertias, dtype=float), noises, tuple(names))

    @staticmethod
    def from_published(link: Link, noise: float) -> Storage:
        """Return a momentum that is published in the axes of a link's frame, with a noise (N m s)."""
        return Storage((link.body,) * 3, link.rotation.T.copy(), np.ones(3), np.full(3, noise), ('x', 'y', 'z'))

    def __add__(self, other: Storage) -> Storage:
        """Return the storage of both, concatenated."""
        axes, inertias, noises = (
            np.concatenate((getattr(self, name), getattr(other, name))) for name in ('axes', 'inertias', 'noises')
        )
        return Storage(self.bodies + other.bodies, axes, inertias, noises, self.names + other.names)

    @property
    def count(self) -> int:
        """Number c."""
        return len(self.bodies)

    def with_inertia_changes(self, inertias: Array) -> Storage:
        """Return the storage with spin inertias changed by (c,)."""
        return replace(self, inertias=self.inertias + inertias)

    def axes_in_odometry(self, rotation: Array) -> Array:
        """Return the (N, c, 3) axes in odometry axes, of bodies with (N, n + 1, 3, 3) axes."""
        return rotate(rotation[:, list(self.bodies)], self.axes)

    def jacobian(self, rotation: Array) -> Array:
        """Return the derivative of the momentum by each reading, (N, 6, c)."""
        columns = np.zeros((len(rotation), 6, self.count))
        columns[:, 3:] = np.swapaxes(self.inertias[:, None] * self.axes_in_odometry(rotation), 1, 2)
        return columns

    def momenta(self, rotation: Array, readings: Array) -> Array:
        """Return the stored momentum of each body, (N, n + 1, 3) N m s, odometry axes, for (N, c) readings."""
        stored = np.zeros(rotation.shape[:-1])
        each = (self.inertias * readings)[..., None] * self.axes_in_odometry(rotation)
        for place, body in enumerate(self.bodies):
            stored[:, body] += each[:, place]
        return stored


def about_points(changes: Array, position: Array, numbers: int = 10) -> Array:
    """Return changes (N, 6 numbers b) of (P, L) about the origin as (N, b, 6, numbers) about (N, 3) points."""
    columns = changes.reshape(len(changes), changes.shape[1] // (6 * numbers), 6, numbers).copy()
    if not columns.size:
        return columns
    columns[..., 3:, :] -= skew(position)[:, None] @ columns[..., :3, :]
    return columns


def link_columns(columns: Array, link: Link) -> Array:
    """Return the (N, 6, 10) columns of a link's standard parameters in its own frame, from those of all bodies."""
    to_body = express(np.eye(10), link.rotation, link.position).T
    return np.asarray(columns[:, link.body] @ to_body)


def summed_over_bodies(columns: Array, parameters: Array) -> Array:
    """Return the (N, 6) sum of columns times (n + 1, 10) standard parameters of all bodies, each in its own frame."""
    return np.asarray(np.einsum('nbij,bj->ni', columns, parameters))


def momentum_change(samples: Samples, parameters: Array) -> Array:
    """Return the change of (P, L) by thrust and orbit until the last sample, (6,), about the odometry's origin.

    `parameters` (n + 1, 10) are the standard ones of all bodies, each in its own frame.
    """
    impulse = samples.impulse[-1]
    if not samples.gravity_columns.shape[1]:
        return impulse
    return np.asarray(
        impulse + summed_over_bodies(about_points(samples.gravity_columns[-1:], np.zeros((1, 3))), parameters)[0]
    )


@dataclass(frozen=True, eq=False)
class Springs:
    """f joints that no JointState reports."""

    joints: tuple[int, ...] = ()  # f indices
    # rate, ratio: (f,) natural angular frequency, rad/s, with all else held; damping ratio
    frequency: Array = field(default_factory=lambda: np.zeros(0))
    damping_ratio: Array = field(default_factory=lambda: np.zeros(0))
    # (2, f) deflection and rate at the first instant, rad or m, and per s
    initial_state: Array = field(default_factory=lambda: np.zeros((2, 0)))

    @property
    def count(self) -> int:
        """Number f."""
        return len(self.joints)

    @property
    def highest_frequency(self) -> float:
        """The highest natural frequency, Hz; 0 without any."""
        return float(np.max(self.frequency, initial=0.0) / (2.0 * np.pi))


@dataclass(frozen=True)
class KnownErrors:
    """Errors of the standard parameters of b known bodies: a factor times e independent numbers of variance one.

    `bodies` are indices; the rows of the factor (10 b, e) are in the bodies' own frames.
    """

    bodies: tuple[int, ...] = ()
    factor: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def count(self) -> int:
        """Number e of independent errors."""
        return self.factor.shape[1]

    @property
    def covariance(self) -> Array:
        """Of the standard parameters, (10 b, 10 b)."""
        return np.asarray(self.factor @ self.factor.T)


@dataclass(frozen=True)
class BodyStates:
    """N samples as the momentum equations need them, in odometry axes about the base link's origin."""

    configuration: Configuration  # poses of the bodies and joint twists
    body_twist: Array  # (N, n + 1, 6) twist of every body
    known: Array  # (N, n + 1, 10) standard parameters of the known bodies
    # rotation, position, twist: (N, 3, 3), (N, 3), (N, 6) of the target link: R, r and (u, w)
    rotation: Array
    position: Array
    twist: Array
    # storage, stored: momentum stored inside bodies, and its readings, (N, c)
    storage: Storage
    stored: Array
    # (N, n + 1, 6, 10) derivatives of the change of (P, L_b) by an orbit, by each body's standard parameters in its own
    # frame; (N, 0, 6, 10) without one
    gravity_columns: Array
    thrust: Array  # (N, f, 6, 5) derivatives of the change of (P, L_b) by thrust, by each thruster's errors

    def __getitem__(self, index: Index) -> BodyStates:
        """Return the states of a slice, mask or list of samples."""
        names = (
            'configuration',
            'body_twist',
            'known',
            'rotation',
            'position',
            'twist',
            'stored',
            'gravity_columns',
            'thrust',
        )
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    @property
    def momenta(self) -> Array:
        """(P, L) of each known body, with the momentum stored in it, (N, n + 1, 6)."""
        momenta = momentum(self.known, self.body_twist)
        if self.storage.count:
            momenta[..., 3:] += self.storage.momenta(self.configuration.rotation, self.stored)
        return momenta

    @property
    def known_momentum(self) -> Array:
        """(P_k, L_k) of all known bodies, (N, 6)."""
        return np.sum(self.momenta, axis=1)

    @property
    def regressor(self) -> Array:
        """Y of the target link, (N, 6, 10): its momentum is Y (m, h, I_o)."""
        return regressor(self.rotation, self.position, self.twist)

    def regressor_of(self, link: Link) -> Array:
        """Return Y of any link, (N, 6, 10)."""
        rotation, position = self.configuration.link_pose(link)
        return regressor(rotation, position, self.body_twist[:, link.body])

    @property
    def hinge_velocity(self) -> Array:
        """Velocity v of the target link's origin, (N, 3) m/s."""
        return self.twist[:, :3] + cross(self.twist[:, 3:], self.position)


class MomentumKernel:
    """The momentum of a robot with one unknown link, or several, for batches of samples.

    Raises ModelError: An unknown link is not one of the model.

    Parameters
    ----------
    target : name of the unknown link; its inertial entry in the URDF never enters
    others : names of further unknown links (theta_u and theta_k in the paper's eqs. 6 to 14: any partition)

    Attributes
    ----------
    target, unknown : the first of the unknown links, all of them
    known : (n + 1, 10) standard parameters of the known bodies, each in its own frame
    errors : of these parameters; none by default
    storage : momentum stored inside bodies; none by default
    springs : of passive joints; none by default
    """

    def __init__(self, model: RobotModel, target: str, *others: str) -> None:
        self.model = model
        self.target = model.link(target)
        self.unknown = (self.target, *map(model.link, others))
        self.kinematics = Kinematics(model)
        self.known = model.body_parameters(without=(target, *others))
        self.errors = KnownErrors()
        self.storage = Storage()
        self.springs = Springs()

    def with_body_changes(self, change: Array) -> MomentumKernel:
        """Return a kernel whose known bodies differ by (n + 1, 10) standard parameters, each in its own frame."""
        return self._replaced(known=self.known + change)

    def with_unknown_link(self, target: str) -> MomentumKernel:
        """Return a kernel whose unknown link is another one; the one before is as the robot description has it."""
        other, before = self.model.link(target), self.target.name
        known = (
            self.known + self.model.body_parameters(without=(target,)) - self.model.body_parameters(without=(before,))
        )
        return self._replaced(target=other, unknown=(other,), known=known)

    def with_displaced_joints(self, origins: Array, tilts: Array) -> MomentumKernel:
        """Return a kernel with displaced joints: (n, 3) m, (n, 3) rad as in `ModelErrors`."""
        model = displaced(self.model, origins, tilts)
        return self._replaced(model=model, kinematics=Kinematics(model))

    def with_errors(self, errors: KnownErrors) -> MomentumKernel:
        """Return a kernel whose known bodies have these errors."""
        return self._replaced(errors=errors)

    def body_parameters(self, parameters: Array) -> Array:
        """Return the (n + 1, 10) standard parameters of all bodies, given (10,) of the target link in its frame."""
        known = self.known.copy()
        known[self.target.body] += express(parameters, self.target.rotation, self.target.position)
        return known

    def with_storage(self, storage: Storage) -> MomentumKernel:
        """Return a kernel of a robot that stores momentum inside bodies."""
        return self._replaced(storage=storage)

    def with_springs(self, springs: Springs) -> MomentumKernel:
        """Return a kernel of a robot with these passive joints."""
        return self._replaced(springs=springs)

    def _replaced(self, **changed: object) -> MomentumKernel:
        other = copy(self)
        vars(other).update(changed)
        return other

    def states(self, samples: Samples) -> BodyStates:
        """Return the states of all bodies at N samples."""
        twist = np.concatenate((samples.base_linear_velocity, samples.base_angular_velocity), axis=-1)
        motion = (samples.base_rotation, samples.joint_position, samples.joint_velocity, twist)
        states = self.states_of(*motion, samples.stored)
        if not samples.gravity_columns.shape[1] and not samples.thrust.shape[1]:
            return states
        place = samples.base_position
        thrust = about_points(samples.thrust, place, THRUSTER_ERRORS)
        return replace(states, gravity_columns=about_points(samples.gravity_columns, place), thrust=thrust)

    def states_of(
        self,
        base_rotation: Array,
        joint_position: Array,
        joint_velocity: Array,
        base_twist: Array,
        readings: Array | None = None,
    ) -> BodyStates:
        """Return the states of all bodies for (N, 3, 3), (N, n), (N, n), (N, 6) in odometry axes.

        Without (N, c) readings of the stored momentum, it is zero.
        """
        count = len(joint_position)
        configuration = self.kinematics.configure(base_rotation, joint_position)
        body_twist = self.kinematics.body_twists(configuration, joint_velocity, base_twist)
        rotation, position = configuration.link_pose(self.target)
        return BodyStates(
            configuration=configuration,
            body_twist=body_twist,
            known=express(self.known, configuration.rotation, configuration.position),
            rotation=rotation,
            position=position,
            twist=body_twist[:, self.target.body],
            storage=self.storage,
            stored=np.zeros((count, self.storage.count)) if readings is None else readings,
            gravity_columns=np.zeros((count, 0, 6, 10)),
            thrust=np.zeros((count, 0, 6, THRUSTER_ERRORS)),
        )


def unknown_scale(kernel: MomentumKernel) -> Array:
    """Return the (16,) typical sizes of (m, h, I_o, P_0, L_0), by which unknowns are scaled before anything is solved.

    Mass and size of the known bodies set them, of the target where it is alone. Momentum is that of the
    whole moving at 1 m/s and 1 rad/s.
    """
    bodies = kernel.model.body_parameters(without=kernel.target.name)
    # Of a single body nothing is known: it is about as heavy as described.
    mass = max(float(np.sum(bodies[:, 0])) or float(kernel.target.parameters[0]), 1e-3)
    steps = np.concatenate((kernel.model.positions, kernel.target.position[None]))
    length = max(float(np.sum(np.linalg.norm(steps, axis=1))), 0.1)
    body = np.concatenate(([mass], np.full(3, mass * length), np.full(6, mass * length**2)))
    return np.concatenate((body, np.full(3, mass), np.full(3, mass * length)))


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the momentum (P, L_b) by the measured quantities z, at N states: d h / dz = known + target phi.

    The order of z is: joint positions (n), joint velocities (n), base orientation (3, odometry axes), base linear and
    angular velocity (3 + 3, base axes). About the base's origin the momentum does not depend on the base's position.
    """

    known: Array  # (N, 6, 2 n + 9)
    target: Array  # (N, 6, 2 n + 9, 10 k), to be multiplied by the standard parameters of the k unknown links


def sensitivity(kernel: MomentumKernel, states: BodyStates) -> Sensitivity:
    """Return the derivatives of the momentum by the measurements, at N states."""
    members, owner, twists = _movers_and_twists(kernel, states)
    joint_twist = states.configuration.joint_twist
    parts = []
    for link in kernel.unknown:
        moves = members[:, link.body]  # 1 where the joint moves the link
        rotation, position = states.configuration.link_pose(link)
        # The regressor is linear in the twist: that of the unit twists, (N, 6, 60), makes all others.
        units = regressor(rotation[:, None], position[:, None], np.eye(6)).reshape(-1, 6, 60)
        moving = np.concatenate(
            (twists * moves[owner, None], states.body_twist[:, None, link.body] * moves[:, None]), 1
        )
        products = np.moveaxis((moving @ units).reshape(*moving.shape, 10), -1, 1)
        parts.append(_assembled(joint_twist, *np.split(products, [twists.shape[1]], axis=2)))
    return Sensitivity(sensitivity_of_known(kernel, states), np.concatenate(parts, axis=-1))


def sensitivity_of_known(kernel: MomentumKernel, states: BodyStates) -> Array:
    """Return the (N, 6, 2 n + 9) derivatives of the known bodies' momentum alone."""
    members, owner, twists = _movers_and_twists(kernel, states)
    composite = members @ states.known
    momenta = members @ states.momenta  # of the bodies that the joints move, and of the whole
    joint_twist = states.configuration.joint_twist
    return _assembled(joint_twist, momentum(composite[:, owner], twists)[:, None], momenta[:, None])[..., 0]


def sensitivity_to_joints(kernel: MomentumKernel, states: BodyStates) -> tuple[Array, Array]:
    """Return the (N, 6, n) derivatives of the known bodies' momentum by joint positions, and by joint velocities."""
    positions, velocities = np.split(sensitivity_of_known(kernel, states)[..., : 2 * kernel.model.joints], 2, axis=-1)
    return positions, velocities


def _movers_and_twists(kernel: MomentumKernel, states: BodyStates) -> tuple[Array, Array, Array]:
    """Return the bodies moved by each joint, and (last) the base, (n + 1, n + 1); the mover of each twist; the twists.

    The (N, 2 n + 6, 6) twists: the changes of the joints' children by turning, the joints' own, the base's unit twists.
    """
    ancestors = kernel.kinematics.ancestors  # (bodies, joints)
    joint_twist = states.configuration.joint_twist
    joints = joint_twist.shape[1]
    # Composite bodies: everything that joint j moves, and (last) the whole robot.
    members = np.concatenate((ancestors.T, np.ones((1, joints + 1))))
    # q_j turns its subtree, but the carrier's velocity is held: S_j x* h - I (S_j x V_j), V_j of the child.
    carried = motion_cross(joint_twist, states.body_twist[:, 1:])
    unit = _base_twists(states.configuration.rotation[:, 0])
    owner = np.concatenate((np.arange(joints), np.arange(joints), np.full(6, joints)))
    return members, owner, np.concatenate((carried, joint_twist, unit), axis=1)


def _assembled(joint_twist: Array, moved: Array, momenta: Array) -> Array:
    """Return the derivatives of c momenta, (N, 6, 2 n + 9, c), in the order of `Sensitivity`.

    Parameters
    ----------
    joint_twist : (N, n, 6) S_j
    moved : (N, c, 2 n + 6, 6) momentum of the subtrees at the twists S_j x V_j, S_j and the base's unit twists
    momenta : (N, c, n + 1, 6) momentum of the subtree of joint j, and (last) of everything
    """
    joints = joint_twist.shape[1]
    moved, momenta = np.moveaxis(moved, 1, -1), np.moveaxis(momenta, 1, -1)  # as they are multiplied: (N, ..., 6, c)
    positions = _force_matrix(joint_twist) @ momenta[:, :joints] - moved[:, :joints]
    # The base's orientation turns everything: S x* h of the whole robot.
    orientation = _TURNS @ momenta[:, joints, None]
    rates, velocities = moved[:, joints : 2 * joints], moved[:, 2 * joints :]
    return np.concatenate((positions, rates, orientation, velocities), axis=1).swapaxes(1, 2)


def motion_cross(left: Array, right: Array) -> Array:
    """Return the twist S x V, for (..., 6) twists (u, w)."""
    linear = cross(left[..., 3:], right[..., :3]) + cross(left[..., :3], right[..., 3:])
    return np.concatenate((linear, cross(left[..., 3:], right[..., 3:])), axis=-1)


def force_cross(twist: Array, momentum_vector: Array) -> Array:
    """Return S x* h, for (..., 6) twists (u, w) and momenta (P, L)."""
    linear, angular = momentum_vector[..., :3], momentum_vector[..., 3:]
    moment = cross(twist[..., 3:], angular) + cross(twist[..., :3], linear)
    return np.concatenate((cross(twist[..., 3:], linear), moment), axis=-1)


def _force_matrix(twist: Array) -> Array:
    """Return the (..., 6, 6) matrix that makes S x* h of h."""
    matrix = np.zeros((*twist.shape, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = skew(twist[..., 3:])
    matrix[..., 3:, :3] = skew(twist[..., :3])
    return matrix


_TURNS = _force_matrix(np.eye(6)[3:])  # by the unit twists about the axes


def _base_twists(rotation: Array) -> Array:
    """Return the (N, 6, 6) unit twists along and about the base's axes, one a row."""
    twists = np.zeros((len(rotation), 6, 6))
    twists[:, :3, :3] = twists[:, 3:, 3:] = np.swapaxes(rotation, -1, -2)
    return twists


def inverse_inertia_and_momentum(bodies: Array, body_twist: Array, plane: Array | None = None) -> tuple[Array, Array]:
    """Return the inverse of the locked inertia (N, 6, 6) and the momentum (N, 6) of all bodies about the base's origin.

    Of a robot kept in a plane it is the inverse in the plane: the constraint takes up all momentum out of it, and the
    moments about axes in the plane, which are unknown, may be zero.

    Raises LinAlgError: All mass lies on a line, and the locked inertia has no inverse.

    Parameters
    ----------
    bodies : (N, b, 10) standard parameters of the bodies at N instants, about the base's origin in common axes
    body_twist : (N, b, 6) (u, w) at the base's origin
    plane : (3, 6) rows of a planar motion in these axes; None in space
    """
    inertia = inertia_matrix(np.sum(bodies, axis=1))
    inverse = np.linalg.inv(inertia) if plane is None else plane.T @ np.linalg.inv(plane @ inertia @ plane.T) @ plane
    return np.asarray(inverse), np.sum(momentum(bodies, body_twist), axis=1)


def inverse_inertia_and_joint_momentum(
    kernel: MomentumKernel,
    stored: Array,
    bodies: Array,
    placed: Configuration,
    body_twist: Array,
    plane: Array | None = None,
) -> tuple[Array, Array]:
    """Return M^-1 and the momentum of the joint motion at a resting base, that stored inside bodies included.

    `stored` (N, c) are its readings; `bodies` (N, b, 10) are those of `placed`, in common axes about the base's origin.
    """
    inverse_inertia, moving = inverse_inertia_and_momentum(bodies, body_twist, plane)
    if kernel.storage.count:
        moving[:, 3:] += np.sum(kernel.storage.momenta(placed.rotation, stored), axis=1)
    return inverse_inertia, moving
