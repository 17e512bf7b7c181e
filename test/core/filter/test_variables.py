"""The filter's variables: what is drawn anew, and the prior near a mass."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.state import _drawn_anew


def test_numbers_drawn_anew_differ_by_twice_their_variance() -> None:
    """Two independent draws of unit variance: their difference, which is added, has a variance of two."""
    which = np.array([True, False, True, False])
    change = _drawn_anew(which)
    assert change.shape == (4, 2)
    assert change @ change.T == pytest.approx(np.diag([2.0, 0.0, 2.0, 0.0]))
