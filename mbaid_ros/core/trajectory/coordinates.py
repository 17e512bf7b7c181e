"""The variables of the filter: all of the state in space, what moves in the plane for a planar robot."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.trajectory.belief import Coordinates
from mbaid_ros.core.trajectory.chain import ANGULAR, BODY, DELAY, FORCE, LINEAR

_ANGLE, _LENGTH, _DELAY = 1e-3, 1e-2, 1e-2  # rad, m, s: typical sizes of pose errors and of a time offset
# Standard deviations of the first pose's error, and of momentum and body in typical sizes: no prior, in effect.
_OPEN_ANGLE, _OPEN_LENGTH = 1e-2, 0.1  # rad, m
_OPEN = 30.0
# Standard deviation of a constant force (N) and torque (N m), in typical sizes of the momentum: far above a leak's.
_FORCE = 1e-3


def coordinates(kernel: MomentumKernel, detector: PlaneDetector, delay_std: float) -> Coordinates:
    """Return the filter's variables for the motion seen so far.

    Parameters
    ----------
    kernel : MomentumKernel; the errors of its known bodies are variables
    detector : decides whether the motion is planar
    delay_std : s, of the joints' stamps; 0 where their delay is no variable
    """
    typical = unknown_scale(kernel)
    factor = kernel.errors.factor
    sizes = np.empty(BODY.stop + len(factor) + 7)
    sizes[:3], sizes[3:6], sizes[DELAY] = _ANGLE, _LENGTH, _DELAY
    sizes[FORCE] = _FORCE * typical[10:16]
    sizes[LINEAR], sizes[ANGULAR], sizes[BODY] = typical[10:13], typical[13:16], typical[:10]
    deviation = _OPEN * sizes
    deviation[:3], deviation[3:6], deviation[DELAY] = _OPEN_ANGLE, _OPEN_LENGTH, delay_std
    deviation[FORCE] = sizes[FORCE]
    errors = slice(BODY.stop, BODY.stop + len(factor))
    own = np.sqrt(np.sum(factor**2, axis=1))
    sizes[errors], deviation[errors] = np.where(own > 0.0, own, 1.0), 0.0
    open_factor = np.column_stack((np.diag(deviation), np.zeros((len(sizes), kernel.errors.count))))
    open_factor[errors, len(sizes) :] = factor
    basis, measured = _planar(kernel, detector) if detector.planar else (np.eye(len(sizes)), np.eye(6))
    if delay_std <= 0.0:
        basis = basis[:, :DELAY]
    acting = np.any(basis[FORCE] != 0.0, axis=0)
    basis = np.concatenate((basis[:, ~acting], basis[:, acting]), axis=1)
    return Coordinates(basis, np.sqrt((basis**2).T @ sizes**2), measured, open_factor)


def _planar(kernel: MomentumKernel, detector: PlaneDetector) -> tuple[Array, Array]:
    """Return the basis and the measured combinations of a planar motion."""
    rows = detector.rows()
    measured = np.zeros((3, 6))
    measured[0, :3] = rows[2, 3:]  # the turn about the normal
    measured[1:, 3:] = rows[:2, :3]  # the displacement in the plane
    blocks = [measured.T, rows.T]
    bodies = [kernel.target, *(Link('', index, np.eye(3), np.zeros(3), np.zeros(10)) for index in kernel.errors.bodies)]
    for body in bodies:
        plane = detector.plane(body)
        if plane is not None:
            blocks.append(plane.basis)
    blocks += [rows.T, np.ones((1, 1))]
    basis = np.zeros((sum(len(block) for block in blocks), sum(block.shape[1] for block in blocks)))
    row = column = 0
    for block in blocks:
        basis[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return basis, measured
