"""How far an estimate is from where its windows are linearised: what another pass over them would move it by."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import TypeVar

import numpy as np
import pytest

from floating import make
from mbaid_ros.core.filter.bank import HypothesisFilter
from mbaid_ros.core.filter.batch import BatchIteration
from mbaid_ros.core.filter.gaussian import MeanAndCovariance
from mbaid_ros.core.filter.initialisation import LinearityCheck
from mbaid_ros.core.filter.state import BODY, BODY_PLACES, Point
from mbaid_ros.core.filter.window import Window, in_stacks
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.unknowns.hypotheses import UNDISTURBED
from mbaid_ros.simulation.simulation import Truth
from observed import HIGH, kernel, observe, windows

Found = TypeVar('Found')
ENOUGH = 10_000  # steps of the filter


def returned(bits: Generator[int, None, Found]) -> Found:
    found: list[Found] = []

    def whole() -> Iterator[int]:
        found.append((yield from bits))

    for _ in whole():
        pass
    return found[0]


def last(bits: Iterator[int | Curvature]) -> Curvature:
    *_, found = bits
    assert isinstance(found, Curvature)
    return found


class Young:
    """A young run of few windows, and passes over it."""

    def __init__(self, truth: Truth) -> None:
        following = make(kernel('servicer7'), HIGH)
        following.update(windows(observe(truth, HIGH, 3))[:16], 0)
        run = following._runs.run
        assert run is not None
        self.windows: list[Window] = run._young.windows
        self.passes: BatchIteration = run._start.passes
        self.point = run.point

    def passed(self, point: Point) -> tuple[HypothesisFilter, MeanAndCovariance]:
        """Return what all windows lead to, linearised at a point."""
        passed = returned(self.passes.over(in_stacks(self.windows), point))
        (track,) = returned(self.passes.run(passed, (self.passes.fresh(UNDISTURBED),)))
        return track, MeanAndCovariance.of(track.belief, self.passes.variables)

    def at(self, moments: MeanAndCovariance) -> Point:
        """Return the point that moments lead to."""
        return self.passes.layout.point(moments.mean, moments.deviation)

    def far(self) -> Point:
        """Return a point of twice the moments of inertia."""
        layout = self.passes.layout
        state = np.zeros(layout.size)
        state[layout.parameters] = self.point.parameters
        state[BODY.start + 4 : BODY.stop] *= 2.0
        return layout.point(state)


@pytest.fixture(scope='module')
def young(servicer: Truth) -> Young:
    return Young(servicer)


def ratio(shift: Array, covariance: Array) -> float:
    return float(np.max(np.abs(shift) / np.sqrt(covariance.diagonal())))


def test_it_is_the_step_of_the_next_pass(young: Young) -> None:
    track, moments = young.passed(young.far())
    _, after = young.passed(young.at(moments))
    found = last(young.passes.displacement(in_stacks(young.windows), track))
    assert found.shifts[0] == pytest.approx(after.mean[BODY] - moments.mean[BODY], rel=1e-9, abs=1e-12)


def test_passes_that_have_come_to_a_point_are_not_displaced_and_one_from_afar_is(young: Young) -> None:
    stacks = in_stacks(young.windows)
    afar, moments = young.passed(young.far())
    assert last(young.passes.displacement(stacks, afar)).anywhere
    for _ in range(4):
        near, moments = young.passed(young.at(moments))
    found = last(young.passes.displacement(stacks, near))
    assert not found.anywhere
    assert ratio(found.shifts[0], found.covariance) < 0.05


def test_it_is_asked_once_the_body_is_better_known_and_kept_until_windows_are_linearised_anew(young: Young) -> None:
    track, moments = young.passed(young.far())
    covariance = moments.covariance(BODY_PLACES)
    linearity = LinearityCheck(young.passes)
    asked = []
    for before in (covariance, 3.0 * covariance):  # no better known than where they were linearised, or better
        linearity.begin(None, before, track, anew=True)
        linearity.follow(young.windows, track)
        linearity.owe(ENOUGH)
        asked.append(linearity.owing)
    assert asked == [False, True]
    while linearity.owing:
        shown = linearity.work_off()
    assert shown
    told = [linearity.displaced]
    linearity.begin(None, 3.0 * covariance, track, anew=False)
    told.append(linearity.displaced)  # better known by now than where they have been linearised anew: not asked yet
    linearity.begin(None, covariance, track, anew=False)
    told.append(linearity.displaced)
    assert told == [True, True, False]
