"""The table of real hardware: what counts as published, what holds, and logs that lie in several clones."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmark_hardware import ALL, Outcome, Recordings, Result, row

WEIGHED = Recordings('a body', {'mass': (10.0, 10.4), 'izz': (0.2,)}, 'weighed', 'none', ('run_*/a.mat', 'none.mat'))
REFUSED = Result('not_identifiable')


def result(mass: float, izz: float, status: str = 'estimating') -> Result:
    return Result(status, {'mass': (mass, 0.5), 'izz': (izz, 0.01)})


def cells(*pairs: tuple[Result, Result]) -> list[str]:
    return row(WEIGHED, Outcome.stack([Outcome.of_results('a run', WEIGHED.truth, *pair) for pair in pairs]))


def test_a_number_holds_if_all_weighings_lie_in_its_interval() -> None:
    found = [result(10.0, 0.2), result(9.3, 0.21), result(99.0, 9.0, 'inconsistent')]
    made = cells(*((each, Result()) for each in found))
    assert made[:5] == ['a body', 'weighed', '3', 'none', '2']
    assert made[5] == '3 of 4, off by at most 2.2 std'  # 10.4 kg lies 2.2 deviations from 9.3
    assert made[6] == '± 10 %'
    assert made[7:] == ['-', '-', '-']  # no repair was tried


def test_results_with_repair_have_columns_of_their_own() -> None:
    made = cells((REFUSED, result(10.2, 0.2)), (REFUSED, REFUSED))
    assert made[4:7] == ['0', '-', '-']
    assert made[7:9] == ['1', '2 of 2, off by at most 0.4 std']


def test_a_number_that_is_withheld_does_not_count() -> None:
    made = cells((Result('estimating', {'izz': (0.2, 0.01)}), Result()))
    assert made[4:7] == ['1', '1 of 1, off by at most 0.0 std', '-']


def test_a_log_in_two_clones_counts_once_and_missing_ones_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in ('one/run_1', 'one/run_2', 'two/run_1'):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / 'a.mat').touch()
    assert [log.parent.name for log in WEIGHED.found(tmp_path)] == ['run_1', 'run_2']
    assert capsys.readouterr().out == 'missing: a body: none.mat\n'


def test_nothing_is_fetched_without_clones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for recordings in ALL[2:]:
        assert recordings.found(tmp_path) == []
    assert capsys.readouterr().out.count('missing: ') > len(ALL) - 2
