"""Where the variances of an estimate of the filter come from."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import SENSOR_NOISE, ErrorBudget
from mbaid_ros.core.robot.inertia import physical_jacobian
from mbaid_ros.core.trajectory.filter.belief import Moments
from mbaid_ros.core.trajectory.filter.prior_sizes import PriorSizes
from mbaid_ros.core.trajectory.state import BODY, BODY_PLACES, Layout
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.unknowns.catalogue import Uncertainty

# Of a variance, by which a difference of shares may be below zero: more says that large numbers have cancelled.
_ROUNDING = 1e-3


def error_budget(moments: Moments, layout: Layout, uncertainty: Uncertainty, sizes: PriorSizes) -> ErrorBudget:
    """Return the budget of the ten parameters: what no prior contributes is sensor noise. NaN where it is not known.

    Parameters
    ----------
    moments, layout : of the filter
    uncertainty : what is known beforehand of target and momentum, whose priors count where they are given
    sizes : how many times as far off as declared the unknowns' independent numbers are taken to be
    """
    variables = moments.variables
    jacobian, part = physical_jacobian(moments.mean[BODY]), moments.factor_of(variables.spread[BODY])
    own = jacobian @ moments.amplification(part, BODY_PLACES) @ part
    errors = moments.contributions(own, layout).T * sizes.each
    squares = errors**2
    given = []
    if uncertainty.target.given:
        given.append(('target prior', variables.body))
    if uncertainty.linear_momentum > 0.0:
        given.append(('momentum prior', slice(variables.poses, variables.head)))
    priors = np.array([_of_a_prior(own, moments, variables, which) for _, which in given]).reshape(-1, len(own))
    whole = np.sum(own**2, axis=1) + np.sum(moments.by_score(jacobian @ part) ** 2, axis=1)
    noise = whole - np.sum((errors / sizes.each) ** 2, axis=1) - priors.sum(axis=0)
    # Where hardly anything is known of a direction, differences of large numbers are left: they tell nothing.
    noise = np.where(noise < -_ROUNDING * whole, np.nan, np.maximum(noise, 0.0))
    parts = np.column_stack((noise, squares @ layout.belongs, priors.T))
    names = (SENSOR_NOISE, *layout.causes, *(name for name, _ in given))
    with np.errstate(divide='ignore', invalid='ignore'):
        shares = parts / parts.sum(axis=1, keepdims=True)
    unchecked = np.zeros(shares.shape, dtype=bool)
    declared = slice(1, 1 + len(layout.causes))
    unchecked[:, declared] = shares[:, declared] > _seen(errors, sizes.covariance, layout)
    return ErrorBudget(names, shares, unchecked)


def _seen(errors: Array, covariance: Array, layout: Layout) -> Array:
    """Return (m, c) which part of each cause's prior variance the data take off, in the direction that matters.

    An estimate errs by k sqrt(share) standard deviations if what is declared is k of its own off in that direction, and
    the data see k^2 times this part of that, as a chi-square: where the part is less than the share the estimate is far
    off before the data say so.

    Parameters
    ----------
    errors : (m, e) of estimates, for each of the unknowns' independent numbers that is one off
    covariance : (e, e) of these numbers, of unit variance beforehand
    layout : of the filter
    """
    within = layout.alike * covariance  # of numbers of the same cause
    left = ((errors @ within) * errors) @ layout.belongs
    return np.asarray(1.0 - left / np.maximum(errors**2 @ layout.belongs, np.finfo(float).tiny))


def _of_a_prior(own: Array, moments: Moments, variables: Variables, which: slice) -> Array:
    """Return the part (m,) of variances that comes from the prior of some variables, independent of all others.

    In units of its own square root the prior is of unit variance.
    """
    gather = variables.gather[which]
    root = np.linalg.cholesky(gather @ variables.factor @ variables.factor.T @ gather.T)
    return np.asarray(np.sum(np.linalg.solve(root, moments.with_variables(own)[which]) ** 2, axis=0))
