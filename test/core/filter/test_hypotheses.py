"""Hypotheses that share a root are as each alone is."""

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.hypotheses import Bank, HypothesisFilter, cap_likelihood, joined, update_bank
from mbaid_ros.core.filter.linearise import WhitenedWindow
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.state import MOMENTUM, Variables
from mbaid_ros.session.catalogue import hypotheses
from windowed import joint_window, prepare, variables, window

ALL = hypotheses(1.0, 0.1, 'none', adapt=True)
JUMPING = (0, 3)  # the undisturbed one, and a force in base axes
AT = 3  # window of the jump


def windows(seed: int, space: Variables, at: int = AT) -> list[WhitenedWindow]:
    """Return windows, one of which no hypothesis explains."""
    rng = np.random.default_rng(seed)
    made = [prepare(window(rng, 0.1), space) for _ in range(6)]
    made[at] = replace(made[at], value=made[at].value + 30.0)
    return made


def followed(bank: Bank, made: list[WhitenedWindow], space: Variables) -> Bank:
    for place, white in enumerate(made):
        bank = update_bank(bank, joint_window(np.zeros((30, 1)), 0.5 * place), white, space)
    return bank


def filtered(place: int, gaussian: SquareRootInformation) -> HypothesisFilter:
    return HypothesisFilter(ALL[place], gaussian, longest_jump=1 if place in JUMPING else 0)


def assert_alike(one: HypothesisFilter, other: HypothesisFilter, space: Variables) -> None:
    here, there = (MeanAndCovariance.from_gaussian(each.gaussian, space) for each in (one, other))
    assert here.mean == pytest.approx(there.mean, rel=1e-8, abs=1e-8)
    assert here.shift == pytest.approx(there.shift, rel=1e-8, abs=1e-8)
    assert here.force == pytest.approx(there.force, rel=1e-8, abs=1e-8)
    assert here.variance == pytest.approx(there.variance, rel=1e-8)
    assert one.gaussian.log_likelihood == pytest.approx(other.gaussian.log_likelihood, rel=1e-9)
    assert one.gaussian.innovations.sums == pytest.approx(other.gaussian.innovations.sums, rel=1e-8, abs=1e-8)
    assert [jump.time for jump in one.jumps] == [jump.time for jump in other.jumps]


@pytest.mark.parametrize('until', [AT, AT + 3])
def test_hypotheses_that_share_a_root_are_as_each_is_alone(until: int) -> None:
    space = variables(np.random.default_rng(1))
    made = windows(2, space)[:until]
    priors = SquareRootInformation.priors(space, [each.force for each in ALL])
    together = followed(tuple(filtered(*pair) for pair in enumerate(priors)), made, space)
    for place, each in enumerate(together):
        (alone,) = followed((filtered(place, SquareRootInformation.prior(space, ALL[place].force)),), made, space)
        assert_alike(each, alone, space)
        assert bool(each.jumps) == (place in JUMPING and until > AT)
    # Those that jump share one root, other forces another, and either walk has its own.
    roots = [id(each.gaussian.conditional) for each in together]
    assert len(set(roots)) == (3 if until == AT else 4)
    assert roots[0] == roots[3]
    assert roots[1] == roots[2]


def test_the_first_hypothesis_joins_the_others() -> None:
    space = variables(np.random.default_rng(3))
    made = windows(4, space)
    others = SquareRootInformation.priors(space, [each.force for each in ALL[1:]])
    rest = followed(tuple(filtered(*pair) for pair in enumerate(others, start=1)), made[:AT], space)
    (first,) = followed((filtered(0, SquareRootInformation.prior(space)),), made[:AT], space)
    bank = joined((first, *rest))
    assert bank[0].gaussian.conditional is bank[1].gaussian.conditional
    (alone,) = followed((first,), made[AT:], space)
    assert_alike(followed(bank, made[AT:], space)[0], alone, space)
    (jumped,) = followed((first,), made[AT : AT + 1], space)
    assert joined((jumped, *rest))[0] is jumped


def test_the_momentum_before_a_jump_is_the_one_that_is_published() -> None:
    """With the correction for shared noise, as that after it."""
    space = variables(np.random.default_rng(1))
    made = windows(2, space)
    (before,) = followed((filtered(0, SquareRootInformation.prior(space, 'none')),), made[:AT], space)
    (after,) = followed((before,), made[AT : AT + 1], space)
    expected = MeanAndCovariance.from_gaussian(before.gaussian, space)
    assert np.abs(expected.shift[MOMENTUM]).max() > 1e-6 * np.abs(expected.mean[MOMENTUM]).max()
    assert after.jumps[0].before == pytest.approx(expected.mean[MOMENTUM], rel=1e-9)


def test_the_first_window_is_no_jump_even_if_it_contradicts_the_prior() -> None:
    """There is no momentum before it that it could have jumped from: the prior is wrong."""
    space = variables(np.random.default_rng(1))
    for at, jumps in ((0, 0), (1, 1)):
        made = windows(2, space, at)[: at + 1]
        (found,) = followed((filtered(0, SquareRootInformation.prior(space)),), made, space)
        assert found.gaussian.last_nis > 1000.0 or jumps
        assert len(found.jumps) == found.inflations == jumps


def test_a_hypothesis_that_is_not_needed_is_no_likelier_than_the_first() -> None:
    prior = SquareRootInformation.prior(variables(np.random.default_rng(1)), 'none')
    bank = tuple(filtered(0, replace(prior, log_likelihood=each)) for each in (5.0, 9.0, 2.0, 7.0))
    assert [each.gaussian.log_likelihood for each in cap_likelihood(bank)] == [5.0, 5.0, 2.0, 5.0]


def test_innovations_of_their_own_size_lose_no_likelihood_and_larger_ones_half_their_square() -> None:
    prior = SquareRootInformation.prior(variables(np.random.default_rng(1)), 'none')
    assert replace(prior, nis=20.0, measured=20).misfit == 0.0
    assert replace(prior, nis=29.0, measured=20).misfit == 4.5
