"""What is told of motions that follow in campaigns."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.replay.campaigns.then import Then, ThenStatistics

ASKED = np.arange(10) < 8


def told(std: float) -> dict[str, object]:
    """Return what is told where one parameter ends with a standard deviation; none of the last two can be known."""
    still = np.zeros((1, 1))
    trajectory = JointTrajectory(('joint1',), np.array([30.0]), still, still, still)
    deviations = np.where(ASKED, 0.1, np.nan)
    deviations[3] = std
    last = Estimate('trajectory', 'estimating', parameters=np.ones(10), covariance=np.diag(deviations**2))
    return Then('planned', trajectory, 0.4, np.array([0.1, 0.2]), ASKED).told(last, np.ones(10))


def test_the_least_known_of_what_can_be_known_counts() -> None:
    assert told(0.2)['after'] == pytest.approx(0.2)
    found = ThenStatistics.of([told(0.2), told(np.nan), told(0.2)])
    assert found is not None
    assert found.after == pytest.approx(0.2)
    assert found.halvings == pytest.approx(2.0)
    assert 'from 40 to 20 %, halved 2.0 times a minute' in str(found)


def test_what_is_not_determined_in_the_end_is_told() -> None:
    assert told(np.nan)['after'] is None
    found = ThenStatistics.of([told(np.nan)])
    assert found is not None
    assert found.as_json()['after'] is None
    assert 'the least known from 40 % to not determined; base turned by' in str(found)
