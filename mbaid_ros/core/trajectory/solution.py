"""The solution of a run after a window: its events, its error budget, and the estimate that is reported of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mbaid_ros.core.filter.bank import HypothesisFilter
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import BODY, BODY_PLACES, MOMENTUM, Declared, Layout
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array, Flags, cross
from mbaid_ros.core.linear_algebra import chi_square_limit
from mbaid_ros.core.results.estimate import PULSE, SYMPTOM, Event, PassiveJoint, Thruster, constant_force
from mbaid_ros.core.results.parameters import SENSOR_NOISE, DeferredBudget, ErrorBudget
from mbaid_ros.core.results.status import MOST_JUMPS, Reason
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import physical_jacobian
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.environment import Thrusters
from mbaid_ros.core.unknowns.flexible import FREQUENCY, SpringErrors
from mbaid_ros.core.unknowns.sensors import TimeOffset

U = TypeVar('U', bound=Unknown)

_NOTHING = 1e-6  # chance that noise looks like a constant force as large: one less sure is not reported


def forces(filtered: HypothesisFilter, distribution: MeanAndCovariance) -> tuple[Event, ...]:
    """Return the constant force and torque as an event, if it is significant."""
    axes = filtered.hypothesis.force
    if axes == 'none':
        return ()
    value, factor = distribution.force, distribution.force_factor
    significance = float(value @ np.linalg.pinv(factor @ factor.T, hermitian=True) @ value)
    if significance < chi_square_limit(_NOTHING, len(value)):
        return ()
    return (Event(0.0, 'ramp', value[:3], value[3:], constant_force(axes)),)


def jumps(filtered: HypothesisFilter, distribution: MeanAndCovariance, origin: Array) -> tuple[Event, ...]:
    """Return the jumps of the momentum, without the effect of a constant force; origin (3,) m of the run."""
    levels = [(jump.before, jump.force_impulse) for jump in filtered.jumps]
    levels.append((distribution.mean[MOMENTUM], filtered.force_impulse))
    events, cause = [], PULSE if len(filtered.jumps) <= MOST_JUMPS else SYMPTOM
    for jump, (after, impulse) in zip(filtered.jumps, levels[1:], strict=True):
        change = after - jump.before - distribution.impulse_of_force(impulse - jump.force_impulse)
        angular = change[3:] + cross(origin, change[:3])
        events.append(Event(jump.time, 'step', change[:3], angular, cause))
    return tuple(events)


_ROUNDING = 1e-3  # of a variance: a share further below zero is a difference of large numbers


def error_budget(
    distribution: MeanAndCovariance,
    layout: Layout,
    declared: Declared,
    prior_scales: PriorScaleFactors,
    known: Flags,
) -> ErrorBudget:
    """Return the variance by source of the ten parameters; NaN where unknown. The rest of all priors is sensor noise.

    Parameters
    ----------
    distribution, layout : of the filter
    declared : priors of target and momentum, where they are given
    prior_scales : scale factors of the unknowns' priors
    known : (10,) which parameters are determined
    """
    given = []
    if declared.target is not None and declared.target.declared:
        given.append(('target prior', distribution.variables.body))
    if declared.linear_momentum > 0.0:
        given.append(('momentum prior', slice(distribution.variables.poses, distribution.variables.head)))
    names = (SENSOR_NOISE, *layout.causes, *(name for name, _ in given))
    # Kept with many estimates: without the 150 kB that have been computed from this one.
    fresh, each = replace(distribution), prior_scales.factors
    return DeferredBudget(names, lambda: _shares(fresh, layout, [which for _, which in given], each, known))


def _shares(
    distribution: MeanAndCovariance, layout: Layout, given: list[slice], scales: Array, known: Flags
) -> tuple[Array, Flags]:
    """Return the shares (10, c), and which are unobserved, as of `error_budget`; `given` are variables with a prior."""
    variables = distribution.variables
    jacobian, part = physical_jacobian(distribution.mean[BODY]), distribution.factor_of(variables.to_state[BODY])
    factor = jacobian @ distribution.error_amplification(part, BODY_PLACES) @ part
    errors = distribution.contributions(factor, layout).T * scales
    squares = errors**2
    priors = np.array([_prior_part(factor, distribution, variables, which) for which in given]).reshape(-1, len(factor))
    total = np.sum(factor**2, axis=1) + np.sum(distribution.by_score(jacobian @ part) ** 2, axis=1)
    noise = total - np.sum((errors / scales) ** 2, axis=1) - priors.sum(axis=0)
    noise = np.where(noise < -_ROUNDING * total, np.nan, np.maximum(noise, 0.0))
    parts = np.column_stack((noise, squares @ layout.belongs, priors.T))
    with np.errstate(divide='ignore', invalid='ignore'):
        shares = parts / parts.sum(axis=1, keepdims=True)
    unobserved = np.zeros(shares.shape, dtype=bool)
    declared = slice(1, 1 + len(layout.causes))
    covariance = distribution.unknowns_as_declared(layout)[1]
    unobserved[:, declared] = shares[:, declared] > _observed(errors, covariance, layout)
    return np.where(known[:, None], shares, np.nan), unobserved


def _observed(errors: Array, covariance: Array, layout: Layout) -> Array:
    """Return the part (m, c) of each cause's prior variance that the data remove, along the errors (m, e).

    A cause that is k of its deviations off shifts an estimate by k sqrt(share) standard deviations, and raises the
    chi-square by k^2 times this part: where the part is below the share, the data do not warn in time.
    """
    cause = layout.belongs.argmax(axis=1)
    within = np.where(cause[:, None] == cause, covariance, 0.0)
    left = ((errors @ within) * errors) @ layout.belongs
    return np.asarray(1.0 - left / np.maximum(errors**2 @ layout.belongs, np.finfo(float).tiny))


def _prior_part(factor: Array, distribution: MeanAndCovariance, variables: Variables, which: slice) -> Array:
    """Return the part (m,) of variances that comes from the prior of some variables, independent of all others."""
    gather = variables.from_state[which]
    root = np.linalg.cholesky(gather @ variables.factor @ variables.factor.T @ gather.T)
    return np.asarray(np.sum(np.linalg.solve(root, distribution.with_variables(factor)[which]) ** 2, axis=0))


def estimates_of(
    kind: type[U], unknowns: Iterable[tuple[Unknown, slice]], mean: Array, deviation: Array
) -> Iterator[tuple[U, Array, Array]]:
    """Yield the unknowns of a kind with their values and standard deviations, SI units.

    Parameters
    ----------
    unknowns : each with the place of its independent numbers; an SI number takes at most one of them
    mean, deviation : of the numbers, in units of their priors
    """
    for unknown, place in unknowns:
        if isinstance(unknown, kind):
            yield unknown, unknown.factor @ mean[place], np.abs(unknown.factor @ deviation[place])


def estimates(kind: type[U], distribution: MeanAndCovariance, layout: Layout) -> Iterator[tuple[U, Array, Array]]:
    """Yield the unknowns of a kind with their values and standard deviations, SI units."""
    deviation = np.concatenate((np.zeros(BODY.stop), np.sqrt(distribution.unknowns_covariance.diagonal())))
    return estimates_of(kind, zip(layout.unknowns, layout.places, strict=True), distribution.mean, deviation)


def joint_delay(distribution: MeanAndCovariance, layout: Layout) -> tuple[float, float]:
    """Return the joints' delay and its standard deviation, s; NaN where it is no unknown."""
    found = ((float(value[0]), float(std[0])) for _, value, std in estimates(TimeOffset, distribution, layout))
    return next(found, (np.nan, np.nan))


def thrusters(estimated: Iterable[tuple[Thrusters, Array, Array]]) -> tuple[Thruster, ...]:
    """Return the estimated deviations of thrusters from their commands."""
    parts = (Thruster.all_of(unknown.frames, value, std) for unknown, value, std in estimated)
    return tuple(thruster for part in parts for thruster in part)


def passive_joints(
    estimated: Iterable[tuple[SpringErrors, Array, Array]], kernel: MomentumKernel, deflections: Array, resolved: Flags
) -> tuple[PassiveJoint, ...]:
    """Return the passive joints as estimated, those not resolved as declared; see `PassiveJoint.all_of`."""
    springs = kernel.springs
    value, std, prior = np.zeros((3, springs.count, 2))
    for unknown, *numbers in estimated:
        value, std, prior = (each.reshape(-1, 2) for each in (*numbers, np.linalg.norm(unknown.factor, axis=1)))
    names = [kernel.model.joint_names[joint] for joint in springs.joints]
    declared = springs.frequency, springs.damping_ratio, prior
    return PassiveJoint.all_of(names, declared, value, std, deflections, resolved)


_FAR = 3.0  # standard deviations of its declaration, beyond which a frequency is another thing's


def implausible_springs(mean: Array, layout: Layout, joints: Sequence[PassiveJoint], resolved: Flags) -> list[Reason]:
    """Return why passive joints contradict their declaration, by the estimated state (s,).

    `resolved` (f,): whose frequency the data resolve.
    """
    model, springs = layout.kernel.model, layout.kernel.springs
    reasons = []
    away, found = {}, springs.frequency / (2.0 * np.pi)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors):
            away = dict(zip(unknown.causes, mean[place].tolist(), strict=True))
            found = found * np.exp((unknown.factor @ mean[place])[::2])
    for joint, index, rate, hertz, seen in zip(joints, springs.joints, springs.frequency, found, resolved, strict=True):
        far = abs(away.get(f'{FREQUENCY}:{joint.joint}', 0.0))
        if far > _FAR and seen:
            text = (
                f'{joint.joint} would swing at {hertz:.3g} Hz, {far:.1f} standard deviations from '
                f'flexible.{joint.joint}.frequency, {rate / (2.0 * np.pi):.3g} Hz: correct it, or something else swings'
            )
            reasons.append(Reason(text, 'contradiction', 0.5 * far**2))
        limit = model.limits[index]
        lower, upper = (limit.lower, limit.upper) if limit.upper > limit.lower else (-np.inf, np.inf)
        if joint.deflection > min(upper, -lower):
            text = (
                f'{joint.joint} would swing by {joint.deflection:.3g} rad (m), beyond its limits in the URDF, '
                f'{lower:.3g} to {upper:.3g}: something else moves'
            )
            reasons.append(Reason(text, 'contradiction', 0.5 * _FAR**2))
    return reasons


def soft_grasp_warnings(kernel: MomentumKernel) -> list[str]:
    """Return a warning of each passive joint between base and target."""
    names = kernel.model.joint_names
    return [
        f'{names[joint]} is passive and carries the target: encoder noise drives its swing, so its frequency and '
        'damping stay as declared'
        for joint, carries in zip(kernel.springs.joints, joints_carrying_target(kernel), strict=True)
        if carries
    ]


def joints_carrying_target(kernel: MomentumKernel) -> Flags:
    """Return which passive joints (f,) lie between base and target: 3 Hz of one were found 9.7 deviations off."""
    return np.asarray(kernel.kinematics.ancestors[kernel.target.body, list(kernel.springs.joints)], dtype=bool)
