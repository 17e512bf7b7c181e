from __future__ import annotations

import pytest

from mbaid_ros.nodes.player import Pace


def test_a_run_goes_by_the_clock_and_is_late_after_a_standstill() -> None:
    clock = [100.0]
    pace = Pace(10.0, 2.0, lambda: clock[0])
    pace.begin()
    assert pace.now() == 0.0
    for seconds in (0.125, 0.1875):  # less than may be told at once
        clock[0] += seconds
        assert pace.now() == pytest.approx(10.0 * (clock[0] - 100.0))
        assert pace.late == 0.0
    clock[0] += 5.0  # 50 s of the run, of which 2 s are told
    assert pace.now() == pytest.approx(5.125)
    assert pace.late == pytest.approx(4.8)
    assert pace.now() == pytest.approx(5.125)
    clock[0] += 0.1
    assert pace.now() == pytest.approx(6.125)
    assert pace.late == pytest.approx(4.8)
