"""How far off the robot looks beside what is declared of it: kinds, single things, and a link's mass by itself."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.filter.prior_scales import PriorScaleFactors
from mbaid_ros.core.geometry import Array

LINKS = ('base_link', 'link1', 'link2', 'link3')
CAUSES = tuple(f'link:{name}' for name in LINKS for _ in range(10))
PARTS = tuple(f'mass:{name}' if place == 0 else '' for name in LINKS for place in range(10))
PLACE = 20  # of the mass of link2
OTHER_LINKS = np.array(CAUSES) != 'link:link2'
NOISE = 2.0  # of what the data say of each number, in units of its prior


def said(truth: Array, seed: int, parts: tuple[str, ...] = PARTS) -> PriorScaleFactors:
    """Return what is said of numbers that data see with noise."""
    seen = 1.0 / (1.0 + NOISE**2)
    values = seen * (truth + NOISE * np.random.default_rng(seed).normal(size=len(truth)))
    return PriorScaleFactors.of(values, (1.0 - seen) * np.eye(len(truth)), CAUSES, parts)


def off(place: int, far: float) -> Array:
    """Return numbers of which one is as far off."""
    return np.where(np.arange(len(CAUSES)) == place, far, 0.0)


def test_a_mass_alone_that_is_far_off_widens_what_it_contributes() -> None:
    each = np.array([said(off(PLACE, 10.0), seed).each for seed in range(50)])
    assert np.mean(each[:, PLACE] > 2.0) > 0.9
    assert np.median(each, axis=0)[OTHER_LINKS].max() < 1.1
    # One of ten numbers that is not looked at by itself is less of a surprise.
    other = np.array([said(off(PLACE + 3, 10.0), seed).each for seed in range(50)])
    assert np.mean(other[:, PLACE + 3]) < 0.7 * np.mean(each[:, PLACE])


def test_masses_as_declared_are_hardly_ever_taken_for_mistaken() -> None:
    rng = np.random.default_rng(1)
    each = np.empty((300, 2, len(CAUSES)))
    for seed, (looked_at, not_so) in enumerate(each):
        truth = rng.normal(size=len(CAUSES))
        looked_at[:] = said(truth, seed).each
        not_so[:] = said(truth, seed, ('',) * len(CAUSES)).each
    masses = np.any(np.array([PARTS]) != '', axis=0)
    assert np.mean(each[:, 0, masses] > 1.5) < np.mean(each[:, 1, masses] > 1.5) + 0.03
    assert np.all(each[:, 0, ~masses] == each[:, 1, ~masses])


def test_a_mass_is_named_where_it_is_further_off_than_its_link() -> None:
    assert 'mass:link2' in dict(said(off(PLACE, 14.0), 0).sure)
    whole = np.where(np.array(CAUSES) == 'link:link2', 8.0, 0.0)
    assert 'link:link2' in dict(said(whole, 0).sure)
    assert 'mass:link2' not in dict(said(whole, 0).sure)
    assert set(said(off(0, 0.0), 0).distances) == {f'link:{name}' for name in LINKS}
