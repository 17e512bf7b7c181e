"""What the first stage publishes before the second one has started."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, patch

import numpy as np

from made_runs import BODY, estimate
from mbaid_ros.core import two_stage
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.two_stage import DISAGREE, FIRST_STAGE, LATE, TwoStageEstimator


def published(*statuses: str, twist: bool = True) -> list[Estimate]:
    """Return the estimates of a second stage that never starts beside a first one of some statuses, a second each."""
    second: Any = SimpleNamespace(method='trajectory', changed=False, settled=False, offer=lambda _: None)
    second.update = lambda _windows, _origin: [estimate(status='not_identifiable')]
    made = iter(estimate(status=status, time=float(time)) for time, status in enumerate(statuses))
    first: Any = SimpleNamespace(method='difference', update=lambda _windows, _origin: [next(made)])
    window: Any = MagicMock(missing_rates=(False, not twist))
    window.__len__.return_value = 50
    with patch.object(two_stage, 'with_rates', lambda window: window):
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
    second: Any = SimpleNamespace(method='trajectory', changed=False, settled=True, disturbed=False, update=take_second)
    second.offer, second.run_slice = lambda _: None, lambda: False
    second.restart = lambda: restarts.append(len(calls))
    stages = TwoStageEstimator(first, second)
    window: Any = SimpleNamespace(missing_rates=(False, False))
    found = []
    for _ in range(4):
        calls.clear()
        found += stages.update([window], 0)
        before, _ = list(calls), stages.run_slice()
        assert before == (['first', 'second'] if len(found) in {1, 4} else ['second'])
        assert sorted(calls) == ['first', 'second']
    # The contradiction that the third window holds is found once its estimate is out, and said with the fourth.
    assert restarts == [2]
    assert [DISAGREE.text in each.warnings for each in found] == [False, False, False, True]
