"""How far equations linearised at a solution are from those linearised anywhere else within its interval.

A solution of linear equations is the same wherever they are linearised. One that moves by a good part of its standard
deviation, where it is linearised at another point as likely, owes that deviation to the point: what tells of the
parameter is of second order, a product of two unknowns. So it is with the moments of inertia of a body that a planar
arm holds, of which only the tilts of its own axes tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, Flags

# Standard deviations that a solution may move by: a bias of half of one costs a 95 % interval three of its
# hundredths. Of equations that are near linear it moves by some hundredths, where the mass is known to a seventh by
# up to .4, where products of unknowns lead by .5 to 1.2.
_LARGEST = 0.5


@dataclass(frozen=True, eq=False)
class Curvature:
    """What has come of linearising elsewhere.

    Attributes
    ----------
    shifts : (d, 10) by which the standard parameters have moved, at each of d other points
    covariance : (10, 10) of them at the solution
    largest : standard deviations that a near linear one moves by at most
    """

    shifts: Array
    covariance: Array
    largest: float = _LARGEST

    def straight(self, jacobian: Array) -> Flags:
        """Return of which numbers (m,) the equations are near linear.

        Parameters
        ----------
        jacobian : (m, 10) of the numbers with respect to the standard parameters
        """
        moved = np.max(np.abs(self.shifts @ jacobian.T), axis=0)
        variance = np.einsum('ij,jk,ik->i', jacobian, self.covariance, jacobian)
        return np.asarray(moved**2 <= self.largest**2 * variance)

    @property
    def anywhere(self) -> bool:
        """Whether any of the standard parameters moves too far."""
        return not bool(self.straight(np.eye(10)).all())
