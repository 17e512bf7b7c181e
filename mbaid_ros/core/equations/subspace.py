"""Which equations hold and which unknowns they can tell: everything in space, seven numbers in a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.equations.errors_in_variables import Blocks
from mbaid_ros.core.equations.window_rows import UNKNOWNS
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import Plane, PlaneDetector


@dataclass(frozen=True)
class Subspace:
    """A selection of the equations and a basis of the unknowns.

    Attributes
    ----------
    rows : (k, 6) Pi, the equations used are Pi f
    basis : (u, v) orthonormal B, the unknowns are x = B x'
    plane : in the target link's frame; None in space
    """

    rows: Array
    basis: Array
    plane: Plane | None

    @property
    def planar(self) -> bool:
        """Whether equations and unknowns out of the plane are left out."""
        return self.plane is not None

    def of(self, blocks: Blocks) -> Blocks:
        """Return the blocks' equations in the unknowns of this subspace."""
        return blocks.restrict(self.rows, self.basis) if self.planar else blocks

    def lift(self, covariance: Array, open_variance: Array) -> Array:
        """Return the (..., u, u) covariance of all unknowns, with a given variance where nothing is known.

        Parameters
        ----------
        covariance : (..., v, v) of x'
        open_variance : (u,)
        """
        if not self.planar:
            return covariance
        outside = np.eye(len(self.basis)) - self.basis @ self.basis.T
        return np.asarray(self.basis @ covariance @ self.basis.T + (outside * open_variance) @ outside.T)


def subspace(detector: PlaneDetector, kernel: MomentumKernel) -> Subspace:
    """Return the subspace that the motion seen so far allows.

    In a plane: mass, first moment in the plane, moment of inertia about its normal, linear momentum in the plane and
    angular momentum about its normal.

    Parameters
    ----------
    detector : PlaneDetector
    kernel : MomentumKernel
    """
    rows, plane = detector.rows(), detector.plane(kernel.target)
    if plane is None:
        return Subspace(rows, np.eye(UNKNOWNS), None)
    return Subspace(rows, np.asarray(block_diag(plane.basis, rows.T)), plane)
