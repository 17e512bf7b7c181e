"""The point at which windows are linearised: held until the estimate has moved, then moved along."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import (
    BODY,
    Layout,
    Point,
    near_part,
)
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array

# Squared Mahalanobis distance, of some twenty to two hundred numbers, that the estimate may move before windows are
# linearised elsewhere: directions that nothing sees gain less information by that than their priors have. Then what
# moves are the directions known as well as this, relative to typical sizes, and those that are so far off that their
# square, what is left of second order, is more than a tenth of a standard deviation. An unknown's unit is about 1 %
# of its size.
_HELD, _WELL_KNOWN, _CURVED, _UNIT = 16.0, 1e-3, 0.1, 0.01


class LinearisationPoint:
    """Linearisation point of the windows to come.

    Each window sees nothing along some directions g: of all masses and momenta growing together, say, or of CoM and
    odometry mount displaced together. Linearised at another point these are others, and together the windows would tell
    of either. So what is well known stays near the estimate in every combination of its numbers, and what is hardly
    known stays where it is, unless it is far.

    Attributes
    ----------
    point : at which windows are linearised at present; None before there is a start

    Parameters
    ----------
    layout : of the state
    variables : of the filter
    """

    def __init__(self, layout: Layout, variables: Variables) -> None:
        self._layout = layout
        self._variables = variables
        self.point: Point | None = None
        self._reference: Array = np.zeros(layout.size)  # the estimate when it was last moved

    def begin(self, point: Point) -> None:
        """Go on from a point that a search has found."""
        self.point = point
        self._reference[self._layout.parameters] = point.parameters
        self._reference[self._layout.readings] = point.readings

    def moved_with(self, belief: SquareRootInformation) -> Point:
        """Return the point for what is believed now: another one where docs/trajectory.md, eq. 6, holds."""
        assert self.point is not None, 'there is a start'
        moments = MeanAndCovariance.of(belief, self._variables)
        gather, root = self._variables.gather[self._variables.lasting], self._known(belief.root)
        distance = root @ (gather @ (moments.mean - self._reference))
        if distance @ distance > _HELD:
            self._move(moments, root)
        return self.point

    def _move(self, moments: MeanAndCovariance, root: Array) -> None:
        """Move the point with the estimate, along the eigenvectors of its information R^T R.

        Parameters
        ----------
        moments : of the state
        root : square-root information of all but the pose error, what wanders and a constant force
        """
        assert self.point is not None, 'there is a start'
        layout, variables, held = self._layout, self._variables, self.point
        lasting = variables.lasting
        state = moments.mean.copy()
        state[layout.parameters] = held.parameters
        state[layout.readings] = held.readings
        # Beside a body that is heavier than the robot, what is typical of the robot is little.
        heavier = float(moments.mean[BODY.start] / variables.typical_mass)
        unit = np.full(root.shape[1], 1.0 / max(1.0, heavier))
        unit[np.arange(len(variables.scale))[lasting] >= variables.own] = _UNIT
        information, directions = np.linalg.eigh((root / unit).T @ (root / unit))
        deviation = 1.0 / np.sqrt(np.maximum(information, 1.0))
        offset = directions.T @ (unit * (variables.gather[lasting] @ (moments.mean - state)))
        moving = (deviation < _WELL_KNOWN) | (offset**2 > _CURVED * deviation)
        state += variables.spread[:, lasting] @ (directions @ np.where(moving, offset, 0.0) / unit)
        step = state[layout.parameters] - held.parameters
        part = near_part(held.parameters, step)
        state[layout.parameters] = held.parameters + part * step
        if part == 1.0:
            self._reference = moments.mean.copy()
        # What follows has to be linked to the windows before: at their readings.
        self.point = layout.beside(state, held)

    def _known(self, root: Array) -> Array:
        """Return the square-root information of all but the pose error, what wanders and a constant force."""
        variables = self._variables
        first, count = variables.poses, len(variables.scale)
        others = np.concatenate((np.arange(count, len(root)), variables.wandering)).astype(int)
        if not others.size:
            return root[first:, first:count]
        order = np.concatenate((others, np.arange(count)[variables.lasting]))
        triangle = np.asarray(np.linalg.qr(root[first:, order], mode='r'))
        return triangle[len(others) : len(order), len(others) :]
