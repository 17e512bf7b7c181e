"""The momentum equations alone, for thousands of samples in a seventh of the time that all states take.

A recursion from the base outwards, in which each product is one of long vectors (the samples stand last), by parts that
fit into the processor's cache. Bodies are followed by their axial frames (see `Kinematics`), which a joint turns about
their third axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, rotate_back, unvec
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.orbit import about, of_bodies, of_link
from mbaid_ros.core.samples import Samples

_PART = 16_000  # bodies times samples, of 240 bytes each: they fit a cache of some megabytes


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
