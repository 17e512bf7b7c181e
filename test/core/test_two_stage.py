"""The change from the difference form to the trajectory filter, with two stages that say what they are told to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from made_runs import estimate
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.core.two_stage import DISAGREE, TwoStageEstimator
from observed import MID, configured_motion, observe, windows

MASS, INERTIA = slice(0, 1), slice(4, 10)


class Stage:
    """Says one estimate after another, whatever it is given."""

    settled, disturbed, changed = True, False, False
    needs_rates = False

    def __init__(self, method: str, said: Sequence[Estimate]) -> None:
        self.method = method
        self._said = [replace(each, stage=method) for each in said]
        self.restarts = 0

    def update(self, windows: list[Samples], _origin: int) -> list[Estimate]:
        """Say the next ones."""
        return [self._said.pop(0) for _ in windows]

    def offer(self, estimate: Estimate) -> None:
        """Need no start."""

    def restart(self) -> None:
        """Count it."""
        self.restarts += 1

    def work_off(self) -> bool:
        """Have nothing to do."""
        return False

    def knowledge(self) -> Posterior | None:
        """Know nothing."""
        return None


def knowing(known: slice, *, mass: float = 100.0) -> Estimate:
    """Return an estimate of which some parameters are determined."""
    determined = np.zeros(10, dtype=bool)
    determined[known] = True
    parameters = np.array([mass, 0.1, 0.2, 0.3, 10.0, 0.5, 0.2, 12.0, 0.3, 11.0])
    return replace(
        estimate(),
        parameters=parameters,
        covariance=np.diag((0.01 * parameters) ** 2),
        identifiable=determined,
        status='estimating',
        warnings=(),
    )


def both(first: Sequence[Estimate], second: Sequence[Estimate]) -> tuple[list[Estimate], Stage]:
    """Return what is published of two stages, and the second one."""
    later = Stage('trajectory', second)
    window, *_ = windows(observe(configured_motion('servicer7', 2.0, 100.0, 0.01), MID, 1))
    return TwoStageEstimator(Stage('difference', first), later).update([window] * len(first), 0), later


def test_stages_that_know_nothing_in_common_do_not_contradict_each_other() -> None:
    found, later = both([knowing(MASS)] * 3, [knowing(INERTIA), knowing(slice(0, 0)), knowing(MASS)])
    assert later.restarts == 0
    assert [each.status for each in found] == ['estimating'] * 3
    assert [each.stage for each in found] == ['trajectory'] * 3


def test_the_second_stage_starts_again_where_the_first_contradicts_it() -> None:
    found, later = both([knowing(MASS)] * 2, [knowing(MASS, mass=110.0), knowing(MASS)])
    assert later.restarts == 1
    assert [each.stage for each in found] == ['difference', 'trajectory']
    assert [each.status for each in found] == ['inconsistent', 'estimating']
    assert found[0].warnings == (DISAGREE,)


@pytest.mark.parametrize(('mass', 'agrees'), [(106.0, True), (108.0, False)])
def test_they_may_be_as_far_apart_as_chance_allows(mass: float, agrees: bool) -> None:
    found, _ = both([knowing(MASS)] * 3, [knowing(MASS, mass=mass)] * 3)
    assert [each.status for each in found] == ['estimating' if agrees else 'inconsistent'] * 3


@pytest.mark.parametrize('agrees', [True, False])
def test_a_first_stage_goes_in_the_end_unless_it_contradicts_the_second(agrees: bool) -> None:
    """Gone, it may say anything."""
    many = 1200
    first = [knowing(MASS)] * many + [knowing(MASS, mass=200.0)]
    second = [knowing(MASS, mass=100.0 if agrees else 110.0)] * (many + 1)
    found, _ = both(first, second)
    assert {each.status for each in found[:many]} == {'estimating' if agrees else 'inconsistent'}
    assert found[-1].status == ('estimating' if agrees else 'inconsistent')
