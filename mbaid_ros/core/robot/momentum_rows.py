"""The rows of the momentum equations alone, of thousands of samples at once: no more than they need, and fast.

What `BodyStates` says of the momentum and its regressor, by a recursion from the base outwards. The samples stand last
in every array here, so that each product is one of long vectors; and no more samples are worked through at a time than
what belongs to all their bodies finds room in the processor's cache. As nothing mixes samples, a batch is its samples
to the last bit.

Bodies are followed by their axial frames (see `Kinematics`), which a joint turns about their third axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, rotate_back, unvec
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.orbit import about, of_bodies, of_link
from mbaid_ros.core.samples import Samples

_PART = 16_000  # bodies times samples, of 240 bytes each: what a cache of some megabytes holds


@dataclass(frozen=True)
class MomentumRows:
    """Momentum equations of N samples, about the base link's origin, odometry axes.

    Attributes
    ----------
    known : (6, N) momentum (P_k, L_k) of the known bodies
    regressors : (6, 10, N) Y of each unknown link
    """

    known: Array
    regressors: tuple[Array, ...]

    def first(self, count: int) -> MomentumRows:
        """Return those of the first samples."""
        return MomentumRows(self.known[:, :count], tuple(regressor[..., :count] for regressor in self.regressors))


@dataclass(frozen=True)
class _Motion:
    """The motion of frames at N samples, in odometry axes; with several frames, they stand first.

    Attributes
    ----------
    axes : (..., 3, 3, N) the three axes of a frame, one after the other: the columns of its rotation matrix R
    position : (..., 3, N) r, m, of the origin relative to the base's
    velocity : (..., 3, N) v, m/s, of the origin
    rate : (..., 3, N) w, rad/s
    """

    axes: Array
    position: Array
    velocity: Array
    rate: Array


@dataclass(frozen=True)
class _Known:
    """The standard parameters of the b known bodies in their axial frames.

    Attributes
    ----------
    mass, first_moment, inertia : (b, 1, 1), (b, 3), (b, 3, 3) m, h and I_o: kg, kg m, kg m^2
    """

    mass: Array
    first_moment: Array
    inertia: Array

    @classmethod
    def of(cls, kernel: MomentumKernel) -> _Known:
        """Return those of a kernel."""
        axial, known = kernel.kinematics.axial, kernel.known
        inertia = np.swapaxes(axial, 1, 2) @ unvec(known[:, 4:]) @ axial
        return cls(known[:, 0, None, None], rotate_back(axial, known[:, 1:4]), inertia)


def momentum_rows(kernel: MomentumKernel, samples: Samples) -> MomentumRows:
    """Return the momentum equations of N samples."""
    count = len(samples)
    if count == 1:
        # Where only one sample stands last, einsum adds up in another order.
        return momentum_rows(kernel, Samples.concatenate([samples, samples])).first(1)
    rows = MomentumRows(np.empty((6, count)), tuple(np.zeros((6, 10, count)) for _ in kernel.unknown))
    known = _Known.of(kernel)
    parts = -(-count * len(known.mass) // _PART)
    for number in range(parts):
        part = slice(count * number // parts, count * (number + 1) // parts)
        bodies = _motion(kernel, samples, part)
        _put_momentum(rows.known[:, part], bodies, known)
        for link, regressor in zip(kernel.unknown, rows.regressors, strict=True):
            _put_regressor(regressor[..., part], _motion_of(link, kernel, bodies))
        if kernel.storage.count:
            _add_stored(rows.known[3:, part], bodies, kernel, samples.stored[part])
    if samples.tide.shape[1]:
        _take_off_tide(rows, kernel, samples)
    return rows


def _motion(kernel: MomentumKernel, samples: Samples, part: slice) -> _Motion:
    """Return the motion of all bodies' axial frames at N samples, from the base outwards."""
    prismatic, parents, placements = kernel.model.prismatic, kernel.model.parents, kernel.kinematics.placements
    angle, speed = (
        np.ascontiguousarray(values[part].T)[:, None] for values in (samples.joint_position, samples.joint_velocity)
    )
    count, bodies = angle.shape[-1], len(parents) + 1
    frames = np.empty((bodies, 4, 3, count))  # three axes, and where the origin is from the parent's
    position, velocity, rate = np.empty((3, bodies, 3, count))
    frames[0, :3] = samples.base_rotation[part].transpose(2, 1, 0)
    position[0], velocity[0] = 0.0, samples.base_linear_velocity[part].T
    rate[0] = samples.base_angular_velocity[part].T
    cosine, sine = np.cos(angle), np.sin(angle)
    sines = np.stack((sine, -sine), axis=1)
    for joint, parent in enumerate(parents):
        # Where the joint is at zero; then x turns to x cos(q) + y sin(q) and y to y cos(q) - x sin(q), or all slides.
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


def _put_momentum(total: Array, bodies: _Motion, known: _Known) -> None:
    """Write the (6, N) momentum of all known bodies."""
    first = np.einsum('bj,bjin->bin', known.first_moment, bodies.axes)
    spin = np.einsum('bij,bjn->bin', known.inertia, np.einsum('bjin,bin->bjn', bodies.axes, bodies.rate))
    # P = m v + w x R h;  L = R h x v + R I_o R^T w about the body's origin, and r x P more about the base's
    linear = _cross(bodies.rate, first)
    linear += known.mass * bodies.velocity
    angular = np.einsum('bjin,bjn->bin', bodies.axes, spin)
    angular += _cross(first, bodies.velocity)
    angular += _cross(bodies.position, linear)
    total[:3], total[3:] = linear[0], angular[0]
    for body in range(1, len(linear)):  # one by one: how numpy sums depends on the number of samples
        total[:3] += linear[body]
        total[3:] += angular[body]


def _add_stored(total: Array, bodies: _Motion, kernel: MomentumKernel, readings: Array) -> None:
    """Add the angular momentum that is stored in bodies to a (3, N) one."""
    storage, axial = kernel.storage, kernel.kinematics.axial
    for place, body in enumerate(storage.bodies):
        x, y, z = storage.inertias[place] * (axial[body].T @ storage.axes[place])
        along, across, up = bodies.axes[body]
        total += (along * x + across * y + up * z) * readings[:, place]


def _take_off_tide(rows: MomentumRows, kernel: MomentumKernel, samples: Samples) -> None:
    """Take off what an orbit has brought: what is left is constant."""
    columns = about(samples.tide, samples.base_position)
    rows.known[:] -= of_bodies(columns, kernel.known).T
    for link, regressor in zip(kernel.unknown, rows.regressors, strict=True):
        regressor[:] -= np.moveaxis(of_link(columns, link), 0, -1)


def _put_regressor(matrix: Array, link: _Motion) -> None:
    """Write the (6, 10, N) Y of a link; see `momentum.regressor`."""
    axes, position, velocity, rate = link.axes, link.position, link.velocity, link.rate
    of_mass, of_first, of_inertia = matrix[:, 0], matrix[:, 1:4].swapaxes(0, 1), matrix[3:, 4:]
    # P = m v + [w]x R h (docs/method.md, eq. 1)
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
