"""All that passes over a few windows yield, with many unknowns at once, as it was; no start is searched."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from checked import returned, some
from declarations import exact_but
from mbaid_ros.core.contracts import Convention, in_stacks
from mbaid_ros.core.diagnosis.passes import FilterPasses, fitted
from mbaid_ros.core.filter.gauss_newton import MultiStart, momentum_drift
from mbaid_ros.core.filter.hypotheses import LONGEST, joined, leader
from mbaid_ros.core.filter.posterior import MeanAndCovariance, error_budget
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.state import Layout
from mbaid_ros.core.windows import Window
from mbaid_ros.session.catalogue import hypotheses
from observed import MID, configured_motion, kernel, observe
from unchanged import Unchanged
from windowed import half_second_windows

DECLARED: dict[str, object] = {
    'known_links__relative_std': 0.02, 'known_joints__zero_std': 1e-3, 'known_joints__tracking_std': 3e-4,
    'known_joints__lag_std': 5e-3, 'odometry_mount__position_std': 2e-3, 'odometry_mount__orientation_std': 1e-3,
    'odometry__turning_std': 1e-4, 'odometry__scale_std': 1e-3, 'odometry__angular_velocity_bias_std': 1e-4,
    'time_offset__estimate': True, 'disturbance__torque_std': 0.02, 'disturbance__torque_time': 5.0,
    'disturbance__force_std': 0.02, 'disturbance__force_time': 2.0,
}  # fmt: skip
CASES: dict[str, tuple[str, dict[str, object]]] = {
    'space': ('servicer7', {'target_prior__mass': 150.0, 'target_prior__mass_std': 20.0}),
    'plane': ('table1', {'momentum__linear_prior_std': 5.0, 'disturbance__axes': 'inertial'}),
}
HYPOTHESES = hypotheses(900.0, 1e-3, 'none', adapt=True)


def sums(value: Any) -> Iterator[Any]:
    """Yield an array as two sums with generic weights; of an object with arrays, those of each."""
    if isinstance(value, np.ndarray):
        weights = np.random.default_rng(value.size).uniform(0.3, 1.0, (2, value.size))
        yield weights @ np.nan_to_num(value.ravel().astype(float), posinf=1.0)
    elif isinstance(value, list | tuple):
        yield from (each for part in value for each in sums(part))
    elif hasattr(value, '__dataclass_fields__'):
        yield from sums([getattr(value, each.name) for each in fields(value)])
    elif isinstance(value, int | float | str):
        yield value


@cache
def passes(case: str) -> tuple[FilterPasses, list[Window]]:
    """Return passes over windows with a jump, with poses whose errors last, and after a gap."""
    name, more = CASES[case]
    robot, samples = kernel(name), observe(configured_motion(name, 8.0, 100.0), MID, 3)
    detector, declared = PlaneDetector(robot.model), exact_but(robot, **DECLARED, **more)
    detector.update(samples)
    planar = (each.in_plane(detector) for each in declared.unknowns)
    windows = half_second_windows(samples, 7.0)
    for place, each in enumerate(windows):
        noise = replace(each.noise, correlation_time=0.1 * (place % 3 == 0))
        knots = replace(each.knots, base_position=each.knots.base_position + 0.02 * (place > 7))
        windows[place] = replace(each, noise=noise, knots=knots, after_gap=place == 10)
    unknowns = tuple(planar) if detector.planar else declared.unknowns
    return FilterPasses(Layout.from_unknowns(robot, unknowns), detector, declared), windows


@pytest.mark.parametrize('case', CASES)
def test_passes_over_windows(case: str, unchanged: Unchanged) -> None:
    over, windows = passes(case)
    layout, space, batch = over.layout, over.variables, over._batch
    fit = fitted(windows, Convention('', layout.kernel))
    state = np.append(fit.point(layout).state[:22], np.random.default_rng(0).uniform(-0.5, 0.5, layout.size - 22))
    whites = returned(over.linearised(windows, layout.point(state)))
    white = {f'{place}': [*sums(whites[place][1])] for place in (0, 3, 8, 10)}
    unchanged.values(**white, fit=[fit.parameters, fit.misfit])
    bank = returned(batch.filter(whites, joined(batch.priors(HYPOTHESES, LONGEST))))
    found = [(each.gaussian.log_likelihood, each.gaussian.nis, each.misfit, *sums(each.jumps)) for each in bank]
    unchanged.values(found=found, leader=leader(bank).hypothesis.cause)
    gaussian, rows = bank[0].gaussian, np.arange(6, layout.size)
    distribution = MeanAndCovariance.from_gaussian(gaussian, space)
    scales = distribution.prior_scales(layout)
    budget = error_budget(distribution, layout, over.declared, scales, np.ones(10, dtype=bool))
    mean, factor = distribution.published(scales, layout, rows)
    drifts = [momentum_drift(whites, each.gaussian, space, layout) for each in bank[:3]]
    unchanged.values(
        mean=[*sums([distribution.mean[6:], distribution.deviation[6:], distribution.shift[6:]])],
        published=[*sums([mean, factor @ factor.T])],
        shares=[budget.shares[0], budget.shares[3], np.sum(budget.unobserved, axis=0)],
        innovations=[gaussian.innovations.sums, gaussian.innovations.counts],
        scales=[(each.factor, each.gain) for each in scales.scales.values()],
        gains=[*over.gains(gaussian, layout.causes[:2]).values()],
        way=[*sums(over.unpredicted(whites, gaussian, bank[0].hypothesis))],
        repairs=[(each, over.repair(bank[0], each)) for each in layout.causes[:4]],
        drift=[*sums([momentum_drift(whites, gaussian, space, layout, [gaussian] * len(whites)), *drifts])],
    )


@pytest.mark.parametrize('case', CASES)
def test_iterations_over_windows(case: str, unchanged: Unchanged) -> None:
    over, windows = passes(case)
    layout, batch, first, stacks = over.layout, over._batch, HYPOTHESES[0], in_stacks(windows[:8])
    guesses = MultiStart(batch, HYPOTHESES)._guesses(windows, layout)
    prior = batch.prior_at(first, mass=float(guesses[0].parameters[6]))
    result = some(returned(batch.converge(stacks, guesses[0], prior)))
    flags = result.converged, result.physical, result.consistent, result.acceptable, result.is_rivalled_by(result)
    reached = [*sums([result.point.state[6:16], result.deviation, result.merit])]
    bent, step = (returned(each(stacks, result.filtered)) for each in (batch.nonlinearity, batch.newton_step))
    others = []
    for exchanged, after in ((True, guesses[-1]), (False, result.point)):
        changed = over.target_changes(windows, 4, (result.point, after), first, exchanged=exchanged)
        others.append(returned(changed))
    others.append(returned(over.with_inflated_prior(layout.causes[0], 10.0).refined(windows, result.point, first)))
    likelihoods, bodies = [each.gaussian.log_likelihood for each in others], [each.parameters for each in guesses]
    unchanged.values(guesses=bodies, reached=[flags, reached], bent=[*sums([bent, step])], likelihoods=likelihoods)
