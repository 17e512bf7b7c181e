"""The filter's mean and covariance: contributions of each prior, prior scale factors, errors in variables."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from checked import generic
from declarations import exact_but
from mbaid_ros.core.contracts import UNDISTURBED
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update
from mbaid_ros.core.filter.linearise import WhitenedWindow
from mbaid_ros.core.filter.posterior import (
    Continuation,
    End,
    MeanAndCovariance,
    Posterior,
    PriorComparison,
    VarianceComponents,
)
from mbaid_ros.core.filter.time_update import advance
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.model import InformationCorrection
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import BODY, BODY_PLACES, Layout, UnknownsPrior, Variables, variables
from observed import MID, kernel
from windowed import prepare
from windowed import variables as drawn_variables
from windowed import window as drawn_window

MEASURED = 12


class Case:
    """The seven-joint servicer, some of whose unknowns windows full of random rows tell of."""

    def __init__(self, windows: int = 5, unseen: slice = slice(0)) -> None:
        robot = kernel('servicer7')
        declared = exact_but(
            robot,
            known_joints__zero_std=1e-3,
            known_joints__axis_std=2e-3,
            odometry_mount__position_std=2e-3,
            time_offset__prior_std=5e-3,
        )
        self.layout = Layout.from_unknowns(robot, declared.unknowns)
        self.space: Variables = variables(self.layout, PlaneDetector(robot.model), declared)
        rng = np.random.default_rng(5)
        self.windows = [self._window(rng, unseen) for _ in range(windows)]
        gaussian = SquareRootInformation.prior(self.space)
        for white in self.windows:
            gaussian = advance(update(gaussian, white), white, self.space, UNDISTURBED)
        self.distribution = MeanAndCovariance.from_gaussian(gaussian, self.space)

    def _window(self, rng: np.random.Generator, unseen: slice) -> WhitenedWindow:
        size = self.layout.size
        rows, way = rng.normal(size=(MEASURED, size)), 0.1 * rng.normal(size=(6, size))
        way[:, :6] += np.eye(6)
        rows[:, unseen] = way[:, unseen] = 0.0
        shared = rng.normal(size=size)
        shared[unseen] = 0.0
        none, head = np.zeros((6, 6)), np.eye(12)
        head[:6] = way[:, :12]
        return WhitenedWindow(
            *(rng.normal(size=MEASURED), rows, 0.0, way, rng.normal(size=6), np.zeros((6, 0)), np.linalg.inv(head)),
            *(shared, np.zeros((10, 11)), none, np.zeros((6, size)), none, none, np.zeros((6, 0)), np.zeros(0)),
            length=0.5,
            places=np.arange(MEASURED),
        )

    def sources(self) -> Array:
        """Return what white noise and prior each contribute to the covariance of the state, (1 + v, s, s).

        The estimate's error as a linear function of the noise of all values, and of the prior's independent numbers.
        """
        size = self.layout.size
        whole: Array = np.eye(size)
        rows = []
        for white in self.windows:
            rows.append(white.rows @ whole)
            step = np.eye(size)
            step[:6] = white.transition
            whole = step @ whole
        matrix, root = np.concatenate(rows), self.space.from_state @ self.space.factor
        covariance = np.linalg.inv(matrix.T @ matrix + np.linalg.inv(root @ root.T))
        to_state = self.space.to_state @ whole
        noise = to_state @ covariance @ matrix.T
        prior = to_state @ (covariance @ matrix.T @ matrix - np.eye(size)) @ root
        return np.stack([noise @ noise.T, *(np.outer(column, column) for column in prior.T)])


def test_the_shares_are_what_each_prior_contributes() -> None:
    case = Case()
    distribution, layout = case.distribution, case.layout
    # Of numbers of momentum and body that are no coordinates of the state.
    rows = np.arange(6, BODY.stop)
    jacobian = np.random.default_rng(1).normal(size=(4, len(rows)))
    parts = distribution.contributions(jacobian @ distribution.factor[rows], layout)
    shares = dict(zip(layout.causes, (parts.T**2 @ layout.belongs).T, strict=True))
    names = layout.kernel.model.joint_names
    assert set(shares) == {*(f'{part}:{name}' for name in names for part in ('zero', 'axis')), 'mount', 'time offset'}

    def of(covariance: Array) -> Array:
        return np.einsum('mi,ij,mj->m', jacobian, covariance[np.ix_(rows, rows)], jacobian)

    noise, *priors = (of(each) for each in case.sources())
    for cause, share in shares.items():
        own = [
            place.start + index
            for unknown, place in zip(layout.unknowns, layout.places, strict=True)
            for index, each in enumerate(unknown.causes)
            if each == cause
        ]
        assert share == pytest.approx(sum(priors[index] for index in own), rel=1e-6)
    # What is left of the whole is sensor noise, and the priors of pose, momentum and body.
    whole = of(distribution.factor @ distribution.factor.T)
    rest = noise + sum(priors[: BODY.stop])
    assert sum(shares.values()) + rest == pytest.approx(whole, rel=1e-8)


LINKS = ('base_link', 'link1', 'link2', 'link3')
CAUSES = tuple(f'link:{name}' for name in LINKS for _ in range(10))
PARTS = tuple(f'mass:{name}' if place == 0 else '' for name in LINKS for place in range(10))
PLACE = 20  # of the mass of link2
NOISE = 2.0  # of what the data say of each number, in units of its prior


def said(truth: Array, seed: int, parts: tuple[str, ...] = PARTS) -> VarianceComponents:
    """Return what is said of numbers that data see with noise."""
    seen = 1.0 / (1.0 + NOISE**2)
    values = seen * (truth + NOISE * np.random.default_rng(seed).normal(size=len(truth)))
    return VarianceComponents.from_posterior(values, (1.0 - seen) * np.eye(len(truth)), CAUSES, parts)


def off(place: int, far: float) -> Array:
    return np.where(np.arange(len(CAUSES)) == place, far, 0.0)


def test_masses_as_declared_are_hardly_ever_taken_for_mistaken() -> None:
    rng = np.random.default_rng(1)
    each = np.empty((300, 2, len(CAUSES)))
    for seed, (looked_at, not_so) in enumerate(each):
        truth = rng.normal(size=len(CAUSES))
        looked_at[:] = said(truth, seed).factors
        not_so[:] = said(truth, seed, ('',) * len(CAUSES)).factors
    masses = np.any(np.array([PARTS]) != '', axis=0)
    assert np.mean(each[:, 0, masses] > 1.5) < np.mean(each[:, 1, masses] > 1.5) + 0.03
    assert np.all(each[:, 0, ~masses] == each[:, 1, ~masses])


def test_a_mass_is_named_where_it_is_further_off_than_its_link() -> None:
    assert 'mass:link2' in dict(said(off(PLACE, 14.0), 0).significant)
    whole = np.where(np.array(CAUSES) == 'link:link2', 8.0, 0.0)
    assert 'link:link2' in dict(said(whole, 0).significant)
    assert 'mass:link2' not in dict(said(whole, 0).significant)
    assert set(said(off(0, 0.0), 0).distances) == {f'link:{name}' for name in LINKS}


@pytest.mark.parametrize('seed', range(3))
def test_a_body_that_is_heavier_throughout_is_found_by_all_of_its_numbers_together(seed: int) -> None:
    along = np.where(np.array(CAUSES) == 'link:link2', 1.0, 0.0) / np.sqrt(10.0)
    seen = 0.6  # of each number's variance, by the data
    rng = np.random.default_rng(seed)

    def scales(far: float) -> list[VarianceComponents]:
        noise = np.sqrt(seen - seen**2) * rng.normal(size=len(CAUSES))
        given = seen * far * along + noise, (1.0 - seen) * np.eye(len(CAUSES)), CAUSES, PARTS, None
        return [VarianceComponents.from_posterior(*given, each) for each in ({}, {'density:link2': along})]

    apart, together = scales(6.0)
    assert np.all(together.factors[20:30] > np.maximum(apart.factors[20:30], 2.5))
    assert 'density:link2' in dict(together.significant)
    apart, together = scales(0.0)
    assert np.array_equal(apart.factors, together.factors)


def test_causes_of_all_sizes_together_are_scaled_as_each_alone() -> None:
    rng = np.random.default_rng(0)
    causes = tuple(np.repeat(('link:a', 'zero:a', 'zero:b', 'axis:a', 'mount'), (10, 1, 1, 2, 6)).tolist())
    root = rng.normal(size=(len(causes), len(causes)))
    covariance, values = np.linalg.inv(np.eye(len(causes)) + root @ root.T), 3.0 * rng.normal(size=len(causes))
    together = VarianceComponents.from_posterior(values, covariance, causes, ('',) * len(causes))
    for cause, size in together.scales.items():
        own = np.flatnonzero([each == cause or each.startswith(f'{cause}:') for each in causes])
        numbers = PriorComparison.from_posterior(values[own], covariance[np.ix_(own, own)])
        chances = (0.05, 0.05) if ':' not in cause else (0.01, 0.2)
        assert size == pytest.approx([float(part) for part in numbers.likely_scales(*chances)])
        if cause in together.distances:
            assert together.distances[cause] == pytest.approx([float(part) for part in numbers.distances])
        assert np.all(together.factors[own] >= size.factor)
    nothing = VarianceComponents.from_posterior(np.zeros(0), np.zeros((0, 0)), (), ())
    assert (nothing.as_declared, nothing.significant, nothing.scales) == (True, (), {})


@pytest.mark.parametrize('seed', range(3))
def test_noise_in_rows_feigns_the_information_that_it_has_on_average(seed: int) -> None:
    rng = np.random.default_rng(seed)
    space, model = drawn_variables(rng), drawn_window(rng)
    slope = np.einsum('aun,ub->abn', model.noise.by_unknowns[:, :10], space.to_state[BODY, BODY])
    information = np.zeros((10, 10))
    for covariance, size in ((model.pose.covariance, 1.0), (model.rates.covariance, model.joints_in_twist)):
        # E[(d rows)^T covariance^-1 (d rows)] of an error of the joints with unit covariance.
        information += size * np.einsum('abn,ac,cdn->bd', slope, np.linalg.inv(covariance), slope)
    at = information @ (space.from_state[BODY, BODY] @ model.body)
    assert prepare(model, space).bias_information == pytest.approx(np.column_stack((information, at)), rel=1e-8)


def test_what_is_feigned_adds_up_and_widens_the_body_and_what_goes_with_it() -> None:
    rng = np.random.default_rng(4)
    space = drawn_variables(rng)
    white = [prepare(drawn_window(rng), space) for _ in range(2)]
    gaussian = SquareRootInformation.prior(space)
    for each in white:
        gaussian = update(gaussian, each)
    assert gaussian.bias_information == pytest.approx(white[0].bias_information + white[1].bias_information)
    distribution = MeanAndCovariance.from_gaussian(gaussian, space)
    rows = np.arange(6, BODY.stop)  # momentum and body
    covariance = distribution.covariance(rows)
    information = np.zeros((len(rows), len(rows)))
    gather = space.from_state[BODY, BODY]
    # Of these drawn windows' information, what is left of a hundredth of the joints' noise.
    small = MeanAndCovariance.from_gaussian(replace(gaussian, bias_information=1e-4 * gaussian.bias_information), space)
    information[6:, 6:] = 1e-4 * gather.T @ gaussian.bias_information[:, :-1] @ gather
    expected = np.linalg.inv(np.eye(len(rows)) - covariance @ information)
    for which in (rows, BODY_PLACES):
        times = small.error_amplification(small.factor_of(space.to_state[which]), which)
        assert times == pytest.approx(expected[-len(which) :, -len(which) :], rel=1e-7, abs=1e-9)


def test_intervals_hold_where_much_of_what_seems_known_is_noise() -> None:
    """Thousands of fits of y = x h, h measured with a known noise: the spread of x is that of the wider interval."""
    rng = np.random.default_rng(0)
    runs, count, truth, noise, of_row = 4000, 200, 1.0, 0.5, 0.5
    motion = 0.6 * rng.standard_normal(count)
    rows = motion + of_row * rng.standard_normal((runs, count))
    values = truth * motion + noise * rng.standard_normal((runs, count))
    # The residual y - x h has the rows' noise, too, as its part of the noise: S = noise^2 + x^2 of_row^2.
    size = noise**2 + truth**2 * of_row**2
    bias_information = count * of_row**2 / size

    def step(x: Array) -> Array:
        residual = values - x[:, None] * rows
        score = np.sum(rows * residual, axis=1) / size + x * bias_information  # on average zero at the truth
        return np.asarray(x + score / (np.sum(rows**2, axis=1) / size))

    found: Array = np.full(runs, 0.7)
    for _ in range(200):
        found = step(found)
    information = np.mean(np.sum(rows**2, axis=1)) / size
    seems = np.sqrt(1.0 / information)
    found_of = InformationCorrection.from_information(
        np.array([[1.0 / information]]), np.array([[bias_information, bias_information]]), np.ones(1)
    )
    wider = np.hypot(1.0 + found_of.gain[0, 0] / information, found_of.score[0, 0] / np.sqrt(information))
    assert bias_information / information == pytest.approx(0.41, abs=0.05)
    assert np.mean(found) == pytest.approx(truth, abs=0.02)
    assert np.std(found) > 1.3 * seems
    assert np.std(found) == pytest.approx(wider * seems, rel=0.08)


def test_states_are_drawn_in_pairs_with_the_covariance_and_no_mass_below_a_half() -> None:
    case, own = Case(), slice(6, BODY.stop)
    mean, change = np.zeros(case.layout.size), np.arange(1.0, 7.0)
    mean[BODY] = [100.0, 20.0, -10.0, 30.0, 40.0, 1.0, 2.0, 50.0, 3.0, 45.0]
    triangle = np.triu(generic(3, case.layout.size - 6, case.layout.size - 6))
    end = cast('Any', SimpleNamespace(momentum_change=change))

    def known(factor: float) -> Posterior:
        return Posterior(
            case.layout, case.space, UNDISTURBED, mean, factor * triangle, end, Continuation(False, triangle, mean)
        )

    near = known(1e-3)
    assert near.deviation[own] == pytest.approx(1e-3 * np.sqrt(np.diag(triangle.T @ triangle))[:16])
    now = mean[own] + np.concatenate((change, np.zeros(10)))
    assert near.point.state[own] == pytest.approx(now)
    away = np.array([each.state[own] for each in near.drawn(401, 0)]) - now
    assert away.shape == (401, 16)
    assert away[:200] == pytest.approx(-away[201:], abs=1e-9)
    unit = np.linalg.solve(1e-3 * triangle[:16, :16].T, away[:201].T)
    assert unit @ unit.T / 201 == pytest.approx(np.eye(16), abs=0.35)  # five standard deviations
    assert np.mean(unit**2) == pytest.approx(1.0, abs=0.1)
    # Where a mass would be less than half, all numbers go as much less far.
    far = known(40.0 / abs(triangle[6, 6]))
    whole, part = (np.array([each.state[own] for each in made.drawn(400, 1)]) - now for made in (near, far))
    whole *= 40.0 / abs(triangle[6, 6]) / 1e-3
    short = whole[:, 6] < -50.0
    assert 20 < np.sum(short) < 380
    assert part[~short] == pytest.approx(whole[~short], rel=1e-6, abs=1e-6)
    assert part[short, 6] == pytest.approx(np.full(np.sum(short), -50.0))
    assert part[short] == pytest.approx(whole[short] * (-50.0 / whole[short, 6:7]), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize('count', [1, 2, 25])
@pytest.mark.parametrize('joints', [False, True])
@pytest.mark.parametrize('twist', [False, True])
def test_a_run_ends_with_its_last_sample_and_the_noise_by_then(count: int, joints: bool, twist: bool) -> None:
    """With rates as read, or by the positions where two samples show them; momentum is about the run's origin."""
    time, covariance = 3.0 + 0.02 * np.arange(count), np.tile(np.diag(np.arange(1.0, 7.0)), (count, 1, 1))
    slope, place, turns = generic(0, 2), generic(1, 3), np.tile(np.eye(3), (count, 1, 1))
    position, rates = time[:, None] * slope, np.full((count, 2), 7.0 if joints else np.nan)
    move = np.full((count, 3), 5.0 if twist else np.nan)
    base = time[:, None] * place
    window = Samples(time, position, rates, base, turns, move, move, covariance, 2.0 * covariance)
    origin, change = generic(2, 3), generic(3, 6)
    end = End.from_window(window, MID, 0.5, origin, change)
    assert (end.rate, end.time) == (2.0 * count, time[-1])
    assert end.joint_position == pytest.approx(position[-1])
    assert end.joint_velocity == pytest.approx([7.0, 7.0] if joints else slope if count > 1 else [0.0, 0.0])
    assert end.base_position == pytest.approx(base[-1] - origin)
    assert end.noise.pose == pytest.approx(np.diag([4.0, 5.0, 6.0, 1.0, 2.0, 3.0]))  # orientation first
    assert end.measures_twist is twist
    about = np.concatenate((change[:3], change[3:] - np.cross(origin, change[:3])))
    assert end.momentum_change == pytest.approx(about)


def test_unknowns_are_in_units_of_a_joint_prior_about_its_mean() -> None:
    """After a calibration: distances from its mean by its covariance, and those by the data, stay what they are."""
    case = Case()
    plain, covariance = case.distribution.mean[BODY.stop :], case.distribution.unknowns_covariance
    root, mean = np.tril(np.random.default_rng(1).normal(size=covariance.shape)), generic(2, len(plain))
    known = UnknownsPrior(mean, root + 5.0 * np.eye(len(root)))
    values, found = case.distribution.unknowns(replace(case.layout, known=known))
    prior = known.factor @ known.factor.T
    assert values @ values == pytest.approx((plain - mean) @ np.linalg.solve(prior, plain - mean))
    by_data = (plain - mean) @ np.linalg.solve(covariance, plain - mean)
    assert values @ np.linalg.solve(found, values) == pytest.approx(by_data)


def test_numbers_that_noise_drives_count_as_declared() -> None:
    case = Case()
    values, covariance = case.distribution.unknowns(case.layout)
    driven = np.arange(len(values)) % 3 == 0
    layout: Any = SimpleNamespace(known=case.layout.known, noise_driven=driven.astype(float))
    right, found = case.distribution.unknowns_as_declared(layout)
    assert np.array_equal(right, np.where(driven, 0.0, values))
    assert found == pytest.approx(np.where(driven[:, None] | driven, np.eye(len(values)), covariance))
