"""The linearisation point of the windows to come, which follows the estimate along well-known directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import BODY, Layout, Point, near_part
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array

# The point moves when the estimate is this far from its reference (squared Mahalanobis distance, of 20 to 200
# numbers): directions that nothing sees gain less information by that than their priors have. It moves along directions
# whose relative deviation is below the second number, and along those whose offset squared, the remainder of second
# order, exceeds a tenth of their deviation. An unknown's unit is about 1 % of its size.
_HELD, _WELL_KNOWN, _CURVED, _UNIT = 16.0, 1e-3, 0.1, 0.01


@dataclass(frozen=True, eq=False)
class LinearisationPoint:
    """The linearisation point of the windows to come (trajectory.md, eq. 6).

    Each window is blind along some directions, such as all masses and momenta growing together, or CoM and odometry
    mount displaced together. Linearised at another point these are others, and together the windows would seem to see
    them. So the point follows the estimate along the directions that are well known, and rests along the others unless
    the estimate is far.
    """

    point: Point  # at which windows are linearised at present
    reference: Array  # (s,) the estimate when the point moved last

    def near_estimate(
        self, gaussian: SquareRootInformation, layout: Layout, variables: Variables
    ) -> LinearisationPoint:
        """Return the same, or relinearised if the estimate is too far from its reference."""
        distribution = MeanAndCovariance.from_gaussian(gaussian, variables)
        gather, root = variables.from_state[variables.persistent], _known(gaussian.triangle, variables)
        distance = root @ (gather @ (distribution.mean - self.reference))
        return self._relinearised(distribution, root, layout) if distance @ distance > _HELD else self

    def _relinearised(self, distribution: MeanAndCovariance, root: Array, layout: Layout) -> LinearisationPoint:
        """Return it moved to the estimate, along eigenvectors of the information R^T R of the lasting variables."""
        variables, held = distribution.variables, self.point
        lasting, state = variables.persistent, held.state
        # A body heavier than the robot sets the typical size: its momentum at 1 m/s is the typical one.
        heavier = float(distribution.mean[BODY.start] / variables.typical_momentum[0])
        unit = np.full(root.shape[1], 1.0 / max(1.0, heavier))
        unit[np.arange(len(variables.scale))[lasting] >= variables.first_unknown] = _UNIT
        information, directions = np.linalg.eigh((root / unit).T @ (root / unit))
        deviation = 1.0 / np.sqrt(np.maximum(information, 1.0))
        offset = directions.T @ (unit * (variables.from_state[lasting] @ (distribution.mean - state)))
        moving = (deviation < _WELL_KNOWN) | (offset**2 > _CURVED * deviation)
        state += variables.to_state[:, lasting] @ (directions @ np.where(moving, offset, 0.0) / unit)
        step = state[layout.parameters] - held.parameters
        part = near_part(held.parameters, step)
        state[layout.parameters] = held.parameters + part * step
        # The next window continues the error chain of the last: at the same readings.
        state[layout.readings] = held.readings
        return LinearisationPoint(layout.point(state), distribution.mean.copy() if part == 1.0 else self.reference)


def _known(root: Array, variables: Variables) -> Array:
    """Return the square-root information R of all but pose error, Gauss-Markov processes and a constant force."""
    first, count = variables.poses, len(variables.scale)
    others = np.concatenate((np.arange(count, len(root)), variables.gauss_markov)).astype(int)
    if not others.size:
        return root[first:, first:count]
    order = np.concatenate((others, np.arange(count)[variables.persistent]))
    triangle = np.asarray(np.linalg.qr(root[first:, order], mode='r'))
    return triangle[len(others) : len(order), len(others) :]
