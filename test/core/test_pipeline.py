"""One identification from its first measurement on, and the change from its first stage to the second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checked import same
from made_runs import BODY, estimate
from mbaid_ros.core import method
from mbaid_ros.core.method import DISAGREE, FIRST_STAGE, LATE, TwoStageEstimator
from mbaid_ros.core.pipeline import RATE_MISSING, Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import Samples, Stamps
from mbaid_ros.tasks import Method, Tasks
from observed import MID, configured_motion, observe, windows
from windowed import base_stream, joint_stream, piece

START = 1_700_000_000_000_000_000


class Recorder(Method):
    """A method that keeps the windows it is given."""

    method = 'recorder'

    def __init__(self, *, needs_rates: bool = True) -> None:
        self.needs_rates = needs_rates
        self.windows: list[Samples] = []
        self.origins: set[int] = set()

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Keep the windows and return an empty estimate for each."""
        assert windows
        self.windows += windows
        self.origins.add(origin)
        return [Estimate('recorder', 'estimating', time=float(window.time[-1])) for window in windows]


def every(milliseconds: float, count: int) -> Stamps:
    return START + np.round(milliseconds * 1e6 * np.arange(count)).astype(np.int64)


@given(cuts=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_pieces_do_not_matter(cuts: int) -> None:
    joints, base = joint_stream(every(10.0, 300)), base_stream(every(16.0, 200))
    # Some velocities are missing: taken from the positions of their window.
    velocity = joints.velocity.copy()
    velocity[120:130, 1] = np.nan
    joints = replace(joints, velocity=velocity)
    whole, pieces = Recorder(), Recorder()
    together, one = Identifier(whole, 0.5, 0.1), Identifier(pieces, 0.5, 0.1)
    expected = together.push(joints, base)
    rng = np.random.default_rng(cuts)
    found: list[Estimate] = []
    first, second = 0, 0
    while first < 300 or second < 200:
        step = rng.integers(0, 40, 2)
        found += one.push(piece(joints, first, first + step[0]), piece(base, second, second + step[1]))
        first, second = first + int(step[0]), second + int(step[1])
    assert same(pieces.windows, whole.windows)
    assert [x.warnings for x in found] == [x.warnings for x in expected]
    assert (one.used, one.dropped, one.end_of_window) == (together.used, together.dropped, together.end_of_window)
    assert pieces.origins == {START}


@pytest.mark.parametrize(('samples', 'end'), [(1, 0.5), (50, 0.5), (51, 1.0), (149, 1.5), (151, 2.0)])
def test_the_window_that_is_open_ends_half_a_second_after_the_one_before(samples: int, end: float) -> None:
    one = Identifier(Recorder(), 0.5, 0.1)
    one.push(joint_stream(every(10.0, samples)), base_stream(every(10.0, 200)))
    assert one.end_of_window == START + round(1e9 * end)


@pytest.mark.parametrize(
    ('of_joints', 'of_base', 'spacing', 'dropped'),
    [(True, False, 500.0, 5), (False, True, 500.0, 5), (False, False, 500.0, 0), (True, True, 100.0, 0)],
)
def test_windows_of_a_single_sample_without_rates_are_dropped_and_counted(
    spacing: float, dropped: int, *, of_joints: bool, of_base: bool
) -> None:
    joints, base = joint_stream(every(spacing, 6)), base_stream(every(10.0, 260))
    joints.velocity[:] = np.where(of_joints, np.nan, joints.velocity)
    base.linear_velocity[:] = np.where(of_base, np.nan, base.linear_velocity)
    one = Identifier(method := Recorder(), 0.5, 0.1)
    found = one.push(joints, base)
    assert len(found) == len(method.windows) == (5 if spacing == 500.0 else 1) - dropped  # the last window is open
    assert (one.used, one.dropped[RATE_MISSING]) == (6 - dropped, dropped)


def test_a_jump_of_the_map_is_named_from_the_window_on_in_which_it_is() -> None:
    """Even where all measurements arrive in one call."""
    joints, base = joint_stream(every(10.0, 400)), base_stream(every(10.0, 400))
    position = base.position.copy()
    position[220:] += [0.5, 0.0, 0.0]
    found = Identifier(Recorder(), 0.5, 0.1).push(joints, replace(base, position=position))
    said = {
        each.time: any('at 2.2 s, as by a correction of the map' in text for text in each.warnings) for each in found
    }
    assert said == {time: time > 2.2 for time in said}
    assert {*said.values()} == {False, True}


MASS, INERTIA = slice(0, 1), slice(4, 10)


class Stage(Method):
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
    later: Any = Stage('trajectory', second)
    window, *_ = windows(observe(configured_motion('servicer7', 2.0, 100.0), MID, 1))
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
    assert found[0].warnings == (DISAGREE.text,)


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


# -- What the first stage publishes before the second one has started.


def published(*statuses: str, twist: bool = True) -> list[Estimate]:
    """Return the estimates of a second stage that never starts beside a first one of some statuses, a second each."""
    second: Any = SimpleNamespace(method='trajectory', tasks=Tasks(), changed=False, settled=False)
    second.offer = lambda _: None
    second.update = lambda _windows, _origin: [estimate(status='not_identifiable')]
    made = iter(estimate(status=status, time=float(time)) for time, status in enumerate(statuses))
    first: Any = SimpleNamespace(method='difference', update=lambda _windows, _origin: [next(made)])
    window: Any = MagicMock(missing_rates=(False, not twist))
    window.__len__.return_value = 50
    with patch.object(method, 'with_rates', lambda window: window):
        return TwoStageEstimator(first, second).update([window] * len(statuses), 0)


def test_a_first_stage_that_contradicts_the_data_publishes_nothing_for_ten_seconds() -> None:
    found = published('estimating', 'inconsistent', 'estimating', *['inconsistent'] * 8)
    assert LATE in found[0].warnings
    assert [each.status for each in found] == ['estimating', *['not_identifiable'] * 9, 'inconsistent']
    for each in found[1:10]:
        assert FIRST_STAGE in each.warnings
        assert not each.identifiable.any()
        assert np.isnan(each.parameters).all()
    assert [each.contradicted for each in found[1:4]] == [True, False, True]  # a run that ends here has an exit code
    assert found[10].identifiable.any()


def test_a_first_stage_of_poses_alone_publishes_nothing_for_ten_seconds() -> None:
    # Twelve milliseconds between a camera and the encoders move its first numbers by six standard deviations.
    found = published(*['estimating'] * 11, twist=False)
    assert [each.identifiable.any() for each in found] == [*[False] * 10, True]
    assert all(FIRST_STAGE in each.warnings and not each.contradicted for each in found[:10])


def test_a_second_stage_that_leads_publishes_before_the_first_one_works() -> None:
    calls: list[str] = []
    sizes = iter((1.0, 1.0, 2.0, 2.0))
    restarts: list[int] = []

    def take_first(_windows: Any, _origin: int) -> list[Estimate]:
        calls.append('first')
        return [estimate(parameters=next(sizes) * BODY)]

    def take_second(_windows: Any, _origin: int) -> list[Estimate]:
        calls.append('second')
        return [estimate()]

    first: Any = SimpleNamespace(method='difference', update=take_first)
    second: Any = SimpleNamespace(method='trajectory', tasks=Tasks(), changed=False, settled=True, disturbed=False)
    second.offer, second.update = lambda _: None, take_second
    second.restart = lambda: restarts.append(len(calls))
    stages = TwoStageEstimator(first, second)
    window: Any = SimpleNamespace(missing_rates=(False, False))
    found = []
    for _ in range(4):
        calls.clear()
        found += stages.update([window], 0)
        before, _ = list(calls), stages.tasks.run_slice()
        assert before == (['first', 'second'] if len(found) in {1, 4} else ['second'])
        assert sorted(calls) == ['first', 'second']
    # The contradiction that the third window holds is found once its estimate is out, and said with the fourth.
    assert restarts == [2]
    assert [DISAGREE.text in each.warnings for each in found] == [False, False, False, True]
