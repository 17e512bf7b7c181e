"""Positions or orientations of the base in other axes: exchanged, turned round, or of a frame turned by right angles.

Without forces the common centre of mass moves along a straight line. That is linear in the robot's unknown numbers:
p = a + b t + c t^2 - R (k x_k + m r_t + R_t h), with the known bodies' centre of mass x_k and the target's pose
(r_t, R_t) in base axes. Least squares over the middles of all windows rules most axes out without the filter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations, product

import numpy as np

from mbaid_ros.core.diagnosis.conventions import Convention, mounted, with_poses
from mbaid_ros.core.filter.knots import Knots
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, Flags, log
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.sensors.base import AttachedFrame
from mbaid_ros.core.unknowns.base import marker_text

_FEWEST = 12  # windows, of three numbers each, for fourteen unknowns
_BETTER = 0.1  # part of the squared misfit that other axes leave at most
_TRIED = 2  # that a fit of all equations compares


def axis_conventions(
    kernel: MomentumKernel, windows: Sequence[Window], marker: AttachedFrame | None = None
) -> list[Convention]:
    """Return other axes of the base's poses that windows may be in, the likeliest first."""
    middles = [window.inside.start + (window.inside.stop - window.inside.start) // 2 for window in windows]
    knots = Knots.concatenate([window.knots[place : place + 1] for window, place in zip(windows, middles, strict=True)])
    time = np.array([window.start for window in windows])
    known: Flags = np.isfinite(np.column_stack((knots.base_position, knots.joint_position))).all(axis=1)
    if np.sum(known) < _FEWEST:
        return []
    knots, time = knots[known], time[known]
    offsets = _offsets(kernel, knots.joint_position)
    declared = _misfit(time, offsets, knots)
    found = [(_misfit(time, offsets, change(knots)), text, change) for text, change in _axes(marker)]
    likely = sorted((each for each in found if each[0] < _BETTER * declared), key=lambda each: each[0])[:_TRIED]
    return [Convention(text, kernel, partial(with_poses, change=change)) for _, text, change in likely]


def _offsets(kernel: MomentumKernel, joint_position: Array) -> Array:
    """Return (W, 3, 5) the reaction of the base, in its axes: known bodies, target's origin and target's axes."""
    still = np.zeros_like(joint_position)
    base = np.tile(np.eye(3), (len(still), 1, 1))
    states = kernel.states_of(base, joint_position, still, np.zeros((len(still), 6)))
    mass = max(float(np.sum(states.known[0, :, 0])), np.finfo(float).tiny)
    bodies = np.sum(states.known[..., 1:4], axis=1) / mass
    return np.concatenate((np.stack((bodies, states.position), axis=2), states.rotation), axis=2)


def _misfit(time: Array, offsets: Array, knots: Knots) -> float:
    """Return the mean squared distance, m^2, from where a free base would be, at best."""
    scaled = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
    drift = np.kron(np.vander(scaled, 3), np.eye(3))
    rows = np.concatenate((drift, -(knots.base_rotation @ offsets).reshape(len(drift), -1)), axis=1)
    place = knots.base_position.ravel()
    unknown = np.linalg.lstsq(rows, place, rcond=1e-9)[0]
    if unknown[9] + unknown[10] <= 0.0:  # the shares of both masses, one together: all axes turned round
        return np.inf
    return float(np.mean((place - rows @ unknown) ** 2))


def _axes(marker: AttachedFrame | None) -> Iterator[tuple[str, partial[Knots]]]:
    """Yield the base's frame in the 23 other axes, and its positions in the 47 others."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        axes = np.array(signs)[:, None] * np.eye(3)[list(order)]  # from the readings to the true ones
        if np.array_equal(axes, np.eye(3)):
            continue
        if np.linalg.det(axes) > 0.0:
            vector = log(axes)
            angle = float(np.linalg.norm(vector))
            mount = np.concatenate((-vector, np.zeros(3)))
            about = ', '.join(f'{each:.2g}' for each in np.round(vector / angle, 2) + 0.0)
            text = (
                f'the frame of the odometry is turned by {np.degrees(angle):.0f} degrees about ({about}) relative to '
                f'the base link: turn it back, or set {marker_text(mount, marker)}'
            )
            yield text, partial(mounted, mount=mount)
        names = ', '.join('-' * int(row.sum() < 0.0) + 'xyz'[int(np.argmax(np.abs(row)))] for row in axes.T)
        text = f'the positions of the odometry are ({names}) in the axes of its orientations: publish both in one frame'
        yield text, partial(_exchanged, axes=axes)


def _exchanged(knots: Knots, axes: Array) -> Knots:
    return replace(knots, base_position=np.einsum('ij,nj->ni', axes, knots.base_position))
