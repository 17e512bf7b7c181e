"""The table of real hardware: what counts as published, what holds, and logs that lie in several clones."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmark_hardware import ALL, Outcome, Recordings, Result, main, row, run, unfit
from benchmarks.frame import Frame

WEIGHED = Recordings('a body', {'mass': (10.0, 10.4), 'izz': (0.2,)}, 'weighed', 'none', 3, ('run_*/a.mat', 'none.mat'))
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


def test_a_log_that_cannot_be_read_fails_in_one_line(tmp_path: Path) -> None:
    fans = next(number for number, each in enumerate(ALL) if each.name.startswith('fans'))
    log = tmp_path / 'control_data_DLMI_disturbance.csv'
    log.write_text('1,2\n3,4\n', encoding='utf-8')
    found = run(tmp_path, {fans: [log]}, fans, 0)
    assert list(found.status) == ['failed', '']
    assert str(found.shown).startswith(f'{tmp_path.name}/{log.stem}: failed; IndexError: ')
    assert '\n' not in str(found.shown)


def test_a_page_needs_one_commit_and_every_log() -> None:
    counts = {number: each.count for number, each in enumerate(ALL)}
    assert list(unfit('abc', counts)) == []
    assert list(unfit('', counts)) == ['files differ from the commit']
    assert list(unfit('abc', counts | {2: 3})) == ['SPOT, March 2021: 3 of 4 logs']
    assert list(unfit('abc', {0: 1, 2: 0})) == [f'{len(ALL) - 2} rows are left out', 'SPOT, March 2021: 0 of 4 logs']


def test_a_page_stays_as_it_was_without_the_clones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ['benchmark_hardware.py', '--clones', str(tmp_path), '--rows', 'station|fans', '--output', str(tmp_path)]
    monkeypatch.setattr('sys.argv', words)
    main()  # tmp_path has no page: writing it would fail
    said = capsys.readouterr().out
    assert 'missing: space station, six windows: USLAB000018.txt\n' in said
    assert f'the page stays as it was: {len(ALL) - 2} rows are left out\n' in said
    assert 'the page stays as it was: space station, six windows: 0 of 6 logs\n' in said


def runs_until_a_stop(row: str, seed: int) -> Outcome:
    if seed == 1:
        raise KeyboardInterrupt
    return Outcome.of_results(row, ['mass'], result(10.0 + seed, 0.2), Result())


def test_a_stop_keeps_the_finished_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('sys.argv', ['script', '--store', str(tmp_path), '--processes', '1'])
    frame = Frame('A script.', 'page.md', seeds=2)
    with pytest.raises(SystemExit, match=f'stopped; {tmp_path} has the finished runs'):
        list(frame.outcomes(Outcome, runs_until_a_stop, {'row': 'row'}))
    monkeypatch.setattr('sys.argv', ['script', '--store', str(tmp_path), '--seeds', '1'])
    frame = Frame('A script.', 'page.md', seeds=2)
    [(_, found)] = frame.outcomes(Outcome, runs_until_a_stop, {'row': 'row'})
    assert list(found.shown) == ['row: estimating; mass 10 ± 0.98; izz 0.2 ± 0.02']
    assert [each.name for each in tmp_path.iterdir()] == ['row.npz']
