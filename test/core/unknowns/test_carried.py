"""What a calibration has left open: numbers that a planar motion does not depend on have no variance."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.unknowns.priors import UnknownsPrior


def test_numbers_without_variance_leave_the_others_as_they_are() -> None:
    factor = np.random.default_rng(0).normal(size=(4, 4))
    factor[[1, 3]] = 0.0
    carried = UnknownsPrior(np.zeros(4), factor)
    some = [0, 2]
    assert np.all(np.isfinite(carried.triangle))
    white = carried.whitening[np.ix_(some, some)] @ factor[some]
    assert white @ white.T == pytest.approx(np.eye(2), abs=1e-9)
