"""What the first stage publishes before the second one has started."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from made_runs import estimate
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.two_stage import FIRST_STAGE, LATE, TwoStageEstimator


def published(*statuses: str, twist: bool = True) -> list[Estimate]:
    """Return the estimates of a second stage that never starts beside a first one of some statuses, a second each."""
    second: Any = SimpleNamespace(method='trajectory', changed=False, settled=False, offer=lambda _: None)
    second.update = lambda _windows, _origin: [estimate(status='not_identifiable')]
    made = iter(estimate(status=status, time=float(time)) for time, status in enumerate(statuses))
    first: Any = SimpleNamespace(method='difference', update=lambda _windows, _origin: [next(made)])
    window: Any = SimpleNamespace(missing_rates=(False, not twist))
    method = TwoStageEstimator(first, second)
    method._early = lambda first, window, origin: first.update([window], origin)[-1]  # type: ignore[method-assign]
    return method.update([window] * len(statuses), 0)


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
