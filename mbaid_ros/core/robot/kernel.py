"""The one kernel: from samples to the momentum of the known bodies and the motion of the target link.

`MomentumKernel.states` has all that the derivatives and the filter need. `momentum_rows` computes the momentum
equations alone, for thousands of samples in a seventh of the time: a recursion from the base outwards, in which each
product is one of long vectors (the samples stand last), by parts that fit into the processor's cache. Bodies are
followed there by their axial frames (see `Kinematics`), which a joint turns about their third axis. Nothing mixes
samples: a batch is its samples to the last bit.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, rotate_back, unvec
from mbaid_ros.core.robot.kinematics import Configuration, Kinematics, Springs
from mbaid_ros.core.robot.model import Link, RobotModel, displaced, express
from mbaid_ros.core.robot.model_errors import KnownErrors
from mbaid_ros.core.robot.momentum import Storage, momentum, regressor
from mbaid_ros.core.robot.orbit import OF_A_THRUSTER, about, of_bodies, of_link
from mbaid_ros.core.samples import Index, Samples

_PART = 16_000  # bodies times samples, of 240 bytes each: they fit a cache of some megabytes


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
    # storage, readings: momentum stored inside bodies, and its readings, (N, c)
    storage: Storage
    readings: Array
    # (N, n + 1, 6, 10) derivatives of the change of (P, L_b) by an orbit, by each body's standard parameters in its own
    # frame; (N, 0, 6, 10) without one
    tide: Array
    thrust: Array  # (N, f, 6, 5) derivatives of the change of (P, L_b) by thrust, by each thruster's errors

    def __getitem__(self, index: Index) -> BodyStates:
        """Return the states of a slice, mask or list of samples."""
        names = ('configuration', 'body_twist', 'known', 'rotation', 'position', 'twist', 'readings', 'tide', 'thrust')
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    @property
    def momenta(self) -> Array:
        """(P, L) of each known body, with the momentum stored in it, (N, n + 1, 6)."""
        momenta = momentum(self.known, self.body_twist)
        if self.storage.count:
            momenta[..., 3:] += self.storage.momenta(self.configuration.rotation, self.readings)
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
        rotation, position = self.configuration.link(link)
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

    def corrected(self, change: Array) -> MomentumKernel:
        """Return a kernel whose known bodies differ by (n + 1, 10) standard parameters, each in its own frame."""
        return self._with(known=self.known + change)

    def identifying(self, target: str) -> MomentumKernel:
        """Return a kernel whose unknown link is another one; the one before is as the robot description has it."""
        other, before = self.model.link(target), self.target.name
        known = (
            self.known + self.model.body_parameters(without=(target,)) - self.model.body_parameters(without=(before,))
        )
        return self._with(target=other, unknown=(other,), known=known)

    def displaced(self, origins: Array, tilts: Array) -> MomentumKernel:
        """Return a kernel with displaced joints: (n, 3) m, (n, 3) rad as in `ModelErrors`."""
        model = displaced(self.model, origins, tilts)
        return self._with(model=model, kinematics=Kinematics(model))

    def with_uncertainty(self, errors: KnownErrors) -> MomentumKernel:
        """Return a kernel whose known bodies have these errors."""
        return self._with(errors=errors)

    def with_target(self, parameters: Array) -> Array:
        """Return the (n + 1, 10) standard parameters of all bodies, given (10,) of the target link in its frame."""
        known = self.known.copy()
        known[self.target.body] += express(parameters, self.target.rotation, self.target.position)
        return known

    def storing(self, storage: Storage) -> MomentumKernel:
        """Return a kernel of a robot that stores momentum inside bodies."""
        return self._with(storage=storage)

    def swinging(self, springs: Springs) -> MomentumKernel:
        """Return a kernel of a robot with these passive joints."""
        return self._with(springs=springs)

    def _with(self, **changed: object) -> MomentumKernel:
        other = copy(self)
        vars(other).update(changed)
        return other

    def states(self, samples: Samples) -> BodyStates:
        """Return the states of all bodies at N samples."""
        twist = np.concatenate((samples.base_linear_velocity, samples.base_angular_velocity), axis=-1)
        motion = (samples.base_rotation, samples.joint_position, samples.joint_velocity, twist)
        states = self.states_of(*motion, samples.stored)
        if not samples.tide.shape[1] and not samples.thrust.shape[1]:
            return states
        place = samples.base_position
        return replace(states, tide=about(samples.tide, place), thrust=about(samples.thrust, place, OF_A_THRUSTER))

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
        rotation, position = configuration.link(self.target)
        return BodyStates(
            configuration=configuration,
            body_twist=body_twist,
            known=express(self.known, configuration.rotation, configuration.position),
            rotation=rotation,
            position=position,
            twist=body_twist[:, self.target.body],
            storage=self.storage,
            readings=np.zeros((count, self.storage.count)) if readings is None else readings,
            tide=np.zeros((count, 0, 6, 10)),
            thrust=np.zeros((count, 0, 6, OF_A_THRUSTER)),
        )


def cantilever_inertias(model: RobotModel, parameters: Array) -> Array:
    """Return the inertia about or along each joint's axis of all that it carries, (n,) kg m^2 or kg, joints at zero.

    `parameters` (n + 1, 10) are the bodies' standard ones, each in its own frame.
    """
    kinematics = Kinematics(model)
    placed = kinematics.configure(np.eye(3)[None], np.zeros((1, model.joints)))
    carried = kinematics.ancestors.T @ express(parameters, placed.rotation, placed.position)
    return np.asarray(np.sum(placed.joint_twist * momentum(carried, placed.joint_twist), axis=-1)[0])


def unknown_scale(kernel: MomentumKernel) -> Array:
    """Return the (16,) typical sizes of (m, h, I_o, P_0, L_0), by which unknowns are scaled before anything is solved.

    Mass and size of the known bodies set them; momentum is that of the whole moving at 1 m/s and 1 rad/s.
    """
    bodies = kernel.model.body_parameters(without=kernel.target.name)
    mass = max(float(np.sum(bodies[:, 0])), 1e-3)
    steps = np.concatenate((kernel.model.positions, kernel.target.position[None]))
    length = max(float(np.sum(np.linalg.norm(steps, axis=1))), 0.1)
    body = np.concatenate(([mass], np.full(3, mass * length), np.full(6, mass * length**2)))
    return np.concatenate((body, np.full(3, mass), np.full(3, mass * length)))


@dataclass(frozen=True)
class MomentumRows:
    """Momentum equations of N samples, about the base link's origin, odometry axes."""

    known: Array  # (6, N) momentum (P_k, L_k) of the known bodies
    regressors: tuple[Array, ...]  # (6, 10, N) Y of each unknown link


@dataclass(frozen=True)
class _Motion:
    """The motion of frames at N samples, in odometry axes; with several frames, they stand first."""

    axes: Array  # (..., 3, 3, N) the three axes of a frame, one after the other: the columns of its rotation matrix R
    # position, velocity, rate: (..., 3, N) r, m, of the origin relative to the base's; v, m/s, of the origin; w, rad/s
    position: Array
    velocity: Array
    rate: Array


def momentum_rows(kernel: MomentumKernel, samples: Samples) -> MomentumRows:
    """Return the momentum equations of N samples."""
    count = len(samples)
    if count == 1:
        # With a single sample in the last axis, einsum adds up in another order.
        rows = momentum_rows(kernel, Samples.concatenate([samples, samples]))
        return MomentumRows(rows.known[:, :1], tuple(each[..., :1] for each in rows.regressors))
    rows = MomentumRows(np.empty((6, count)), tuple(np.zeros((6, 10, count)) for _ in kernel.unknown))
    axial, known = kernel.kinematics.axial, kernel.known
    # m, h and I_o of the known bodies in their axial frames, (b, 1, 1), (b, 3), (b, 3, 3).
    mass, first = known[:, 0, None, None], rotate_back(axial, known[:, 1:4])
    inertia = np.swapaxes(axial, 1, 2) @ unvec(known[:, 4:]) @ axial
    parts = -(-count * len(mass) // _PART)
    for number in range(parts):
        part = slice(count * number // parts, count * (number + 1) // parts)
        bodies = _motion(kernel, samples, part)
        _put_momentum(rows.known[:, part], bodies, mass, first, inertia)
        for link, matrix in zip(kernel.unknown, rows.regressors, strict=True):
            _put_regressor(matrix[..., part], _motion_of(link, kernel, bodies))
        for place, body in enumerate(kernel.storage.bodies):  # stored angular momentum
            x, y, z = kernel.storage.inertias[place] * (axial[body].T @ kernel.storage.axes[place])
            along, across, up = bodies.axes[body]
            rows.known[3:, part] += (along * x + across * y + up * z) * samples.stored[part, place]
    if samples.tide.shape[1]:  # without the momentum that an orbit adds, the rest is constant
        columns = about(samples.tide, samples.base_position)
        rows.known[:] -= of_bodies(columns, known).T
        for link, matrix in zip(kernel.unknown, rows.regressors, strict=True):
            matrix[:] -= np.moveaxis(of_link(columns, link), 0, -1)
    return rows


def _motion(kernel: MomentumKernel, samples: Samples, part: slice) -> _Motion:
    """Return the motion of all bodies' axial frames at N samples, from the base outwards."""
    prismatic, parents, placements = kernel.model.prismatic, kernel.model.parents, kernel.kinematics.placements
    angle, speed = (
        np.ascontiguousarray(values[part].T)[:, None] for values in (samples.joint_position, samples.joint_velocity)
    )
    count, bodies = angle.shape[-1], len(parents) + 1
    frames = np.empty((bodies, 4, 3, count))  # three axes, and the origin from the parent's
    position, velocity, rate = np.empty((3, bodies, 3, count))
    frames[0, :3] = samples.base_rotation[part].transpose(2, 1, 0)
    position[0], velocity[0] = 0.0, samples.base_linear_velocity[part].T
    rate[0] = samples.base_angular_velocity[part].T
    cosine, sine = np.cos(angle), np.sin(angle)
    sines = np.stack((sine, -sine), axis=1)
    for joint, parent in enumerate(parents):
        # The joint at zero; then x turns to x cos(q) + y sin(q) and y to y cos(q) - x sin(q), or all slides.
        frame = np.einsum('kj,jin->kin', placements[joint], frames[parent, :3], out=frames[joint + 1])
        if prismatic[joint]:
            frame[3] += frame[2] * angle[joint]
        else:
            turning = frame[:2]
            other = sines[joint] * turning[::-1]
            turning *= cosine[joint]
            turning += other
    axis, lever = frames[1:, 2], frames[1:, 3]
    moving = axis * speed
    for joint, parent in enumerate(parents):
        np.add(position[parent], lever[joint], out=position[joint + 1])
        np.add(rate[parent], 0.0 if prismatic[joint] else moving[joint], out=rate[joint + 1])
    swing = _cross(rate[list(parents)], lever)
    for joint, parent in enumerate(parents):
        np.add(velocity[parent], swing[joint], out=velocity[joint + 1])
        if prismatic[joint]:
            velocity[joint + 1] += moving[joint]
    return _Motion(frames[:, :3], position, velocity, rate)


def _motion_of(link: Link, kernel: MomentumKernel, bodies: _Motion) -> _Motion:
    """Return the motion of a link's frame."""
    body = link.body
    placement = np.column_stack((link.rotation, link.position)).T @ kernel.kinematics.axial[body]
    frame = np.einsum('kj,jin->kin', placement, bodies.axes[body])
    lever, rate = frame[3], bodies.rate[body]
    return _Motion(frame[:3], bodies.position[body] + lever, bodies.velocity[body] + _cross(rate, lever), rate)


def _put_momentum(total: Array, bodies: _Motion, mass: Array, first_moment: Array, inertia: Array) -> None:
    """Write the (6, N) momentum of all known bodies."""
    first = np.einsum('bj,bjin->bin', first_moment, bodies.axes)
    spin = np.einsum('bij,bjn->bin', inertia, np.einsum('bjin,bin->bjn', bodies.axes, bodies.rate))
    # P = m v + w x R h;  L = R h x v + R I_o R^T w about the body's origin, and r x P more about the base's
    linear = _cross(bodies.rate, first)
    linear += mass * bodies.velocity
    angular = np.einsum('bjin,bjn->bin', bodies.axes, spin)
    angular += _cross(first, bodies.velocity)
    angular += _cross(bodies.position, linear)
    total[:3], total[3:] = linear[0], angular[0]
    for body in range(1, len(linear)):  # one by one: numpy's order of sums depends on the number of samples
        total[:3] += linear[body]
        total[3:] += angular[body]


def _put_regressor(matrix: Array, link: _Motion) -> None:
    """Write the (6, 10, N) Y of a link; see `momentum.regressor`."""
    axes, position, velocity, rate = link.axes, link.position, link.velocity, link.rate
    of_mass, of_first, of_inertia = matrix[:, 0], matrix[:, 1:4].swapaxes(0, 1), matrix[3:, 4:]
    # P = m v + [w]x R h (method.md, eq. 1)
    first = _cross(rate, axes)
    of_mass[:3], of_first[:, :3] = velocity, first
    # L_b = m r x v + ([r]x [w]x R - [v]x R) h + R bracket(R^T w) vec(I_o) (eq. 2, about the base's origin)
    of_mass[3:] = _cross(position, velocity)
    np.subtract(_cross(position, first), _cross(velocity, axes), out=of_first[:, 3:])
    along, across, up = axes
    x, y, z = np.einsum('jin,in->jn', axes, rate)
    of_inertia[:, 0] = along * x
    of_inertia[:, 1] = along * y + across * x
    of_inertia[:, 2] = along * z + up * x
    of_inertia[:, 3] = across * y
    of_inertia[:, 4] = across * z + up * y
    of_inertia[:, 5] = up * z


def _cross(left: Array, right: Array) -> Array:
    """Return a x b of vectors (..., 3, N)."""
    a, b, c = (left[..., axis, :] for axis in range(3))
    x, y, z = (right[..., axis, :] for axis in range(3))
    product = np.empty(np.broadcast_shapes(left.shape, right.shape))
    product[..., 0, :] = b * z - c * y
    product[..., 1, :] = c * x - a * z
    product[..., 2, :] = a * y - b * x
    return product
