"""Where the variances of an estimate of the filter come from."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import SENSOR_NOISE, ErrorBudget
from mbaid_ros.core.robot.inertia import physical_jacobian
from mbaid_ros.core.trajectory.belief import Moments
from mbaid_ros.core.trajectory.state import BODY, Layout
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.unknowns.catalogue import Uncertainty


def error_budget(moments: Moments, layout: Layout, variables: Variables, uncertainty: Uncertainty) -> ErrorBudget:
    """Return the budget of the ten parameters: what no prior contributes is sensor noise.

    Parameters
    ----------
    moments, layout, variables : of the filter
    uncertainty : what is known beforehand of target and momentum, whose priors count where they are given
    """
    own = moments.factor_of(physical_jacobian(moments.mean[BODY]) @ variables.spread[BODY, : variables.own])
    variance = np.sum(own**2, axis=1)
    causes, parts = moments.contributions(own, layout)
    given = []
    if uncertainty.target.given:
        given.append(('target prior', slice(variables.head, variables.own)))
    if uncertainty.linear_momentum > 0.0:
        given.append(('momentum prior', slice(variables.poses, variables.head)))
    names = (SENSOR_NOISE, *causes, *(name for name, _ in given))
    parts = np.column_stack((parts, *(_of_a_prior(own, moments, variables, which) for _, which in given)))
    with np.errstate(divide='ignore', invalid='ignore'):
        shares = np.column_stack((variance - parts.sum(axis=1), parts)) / variance[:, None]
    return ErrorBudget(names, shares)


def _of_a_prior(own: Array, moments: Moments, variables: Variables, which: slice) -> Array:
    """Return the part (m,) of variances that comes from the prior of some variables, independent of all others.

    In units of its own square root the prior is of unit variance.
    """
    gather = variables.gather[which]
    root = np.linalg.cholesky(gather @ variables.factor @ variables.factor.T @ gather.T)
    return np.asarray(np.sum(np.linalg.solve(root, moments.with_variables(own)[which]) ** 2, axis=0))
