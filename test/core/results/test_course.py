"""Numbers are told while they can be used, and once that they no longer can."""

from __future__ import annotations

import numpy as np
import pytest

from made_runs import BODY, STD, estimate, planar
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.publication import (
    Debris,
    DebrisPublication,
    Frame,
    InertiaPublication,
    is_complete,
    is_usable,
)

NEGATIVE = estimate(parameters=np.concatenate(([-3.0], BODY[1:])))
NOTHING = Estimate(method='trajectory', status='not_identifiable')
CONTRADICTED = estimate(status='inconsistent')


@pytest.mark.parametrize('useless', [NEGATIVE, NOTHING, CONTRADICTED], ids=['negative', 'nothing', 'contradicted'])
def test_the_loss_of_usable_numbers_is_told_once(useless: Estimate) -> None:
    course = InertiaPublication()
    assert course.follow(useless) is None
    for usable in (estimate(), planar()):
        assert is_usable(usable)
        assert course.follow(usable) is usable
        lost = course.follow(useless)
        assert lost is not None
        assert np.all(np.isnan(lost.parameters))
        assert (lost.status, lost.stamp) == (useless.status, useless.stamp)
        assert course.follow(useless) is None


def test_a_link_is_complete_with_all_ten_numbers_alone() -> None:
    assert is_complete(estimate())
    assert not is_complete(planar())
    assert not is_complete(CONTRADICTED)


def test_the_loss_of_the_captured_body_is_told_once() -> None:
    course = DebrisPublication()
    assert course.follow(None) is None
    body = Debris(Frame('grasp', np.eye(3), np.zeros(3)), BODY, np.diag(STD**2))
    assert course.follow(body) is body
    lost = course.follow(None)
    assert lost is not None
    assert lost.frame is body.frame
    assert np.all(np.isnan(lost.parameters))
    assert np.all(np.isnan(lost.covariance))
    assert course.follow(None) is None
