"""The ratios of a body's moments of inertia: what rotation alone tells, where nothing tells the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, unvec

_TRACE = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])  # of (ixx, ixy, ixz, iyy, iyz, izz)
_CLEARER = 5.0  # times as well known as the scale, from which ratios say what the moments do not


@dataclass(frozen=True)
class InertiaRatios:
    """Inertia about the centre of mass over its trace, with one standard deviation each.

    Attributes
    ----------
    elements, std : (6,) (ixx, ixy, ixz, iyy, iyz, izz)
    principal, principal_std : (3,) principal moments, the smallest first
    scale_std : relative, of the trace
    """

    elements: Array
    std: Array
    principal: Array
    principal_std: Array
    scale_std: float

    @property
    def clearer(self) -> bool:
        """Whether the ratios are known far better than the scale is."""
        return bool(self.scale_std > _CLEARER * float(np.max(self.principal_std / self.principal)))


def inertia_ratios(parameters: Array, covariance: Array) -> InertiaRatios:
    """Return the ratios of a body of which something is known, to first order.

    Parameters
    ----------
    parameters : (10,) mass, CoM, inertia about it
    covariance : (10, 10) of these
    """
    inertia, of_inertia = parameters[4:], covariance[4:, 4:]
    trace = float(_TRACE @ inertia)
    elements = inertia / trace
    slope = (np.eye(6) - np.outer(elements, _TRACE)) / trace
    ratios = slope @ of_inertia @ slope.T
    principal, axes = np.linalg.eigh(unvec(elements))
    # A principal moment changes by what its axis has of the change: v^T dI v.
    x, y, z = axes
    along = np.stack((x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z), axis=1)
    variance = np.diag(along @ ratios @ along.T)
    return InertiaRatios(
        elements=elements,
        std=np.sqrt(np.maximum(np.diag(ratios), 0.0)),
        principal=principal,
        principal_std=np.sqrt(np.maximum(variance, 0.0)),
        scale_std=float(np.sqrt(max(_TRACE @ of_inertia @ _TRACE, 0.0))) / trace,
    )
