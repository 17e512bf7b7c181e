"""`replay` of many bags: on all cores, with the results of one after the other."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import recorded
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.run import replay_bag
from mbaid_ros.replay.start import replay as main
from simulated import CONFIG

MODEL = str(CONFIG / 'table1.urdf')
QUICK = ('--model', MODEL, '--method', 'difference')
DURATIONS = (8.0, 3.0, 5.0)


@pytest.fixture(scope='module', name='bags')
def three_bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp('many')
    return [str(recorded.papers_case(folder / f'{length:g}_s', length, 20.0)) for length in DURATIONS]


def test_many_bags_lead_to_what_each_leads_to_alone(
    capsys: pytest.CaptureFixture[str], bags: list[str], tmp_path: Path
) -> None:
    alone = []
    for bag in bags:
        main([bag, *QUICK, '--json', '-'])
        alone.append(without_origin(capsys.readouterr().out))
    report = tmp_path / 'report.html'
    main([*bags, *QUICK, '--json', '-', '--report', str(report), '--processes', '2'])
    together = capsys.readouterr()
    assert together.err == ''
    assert [without_origin(json.dumps(result)) for result in json.loads(together.out)] == alone
    urdf = Path(MODEL).read_text()
    runs = [replay_bag(bag, EstimatorConfig(method='difference'), urdf, Inputs()) for bag in bags]
    page, foot = report.read_text().split('<footer>')
    assert page == html(runs, [None] * len(runs)).split('<footer>')[0]
    assert foot.count('SHA-256') == 1 + len(bags)


def test_runs_of_one_robot_add_up(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """With --continue the second run begins from the first; so does a run that is given the first one's JSON."""
    begun, after = (str(recorded.papers_case(tmp_path / f'{length:g}_s', length, 20.0)) for length in (14.0, 12.0))
    result = tmp_path / 'first.json'
    main([begun, after, '--model', MODEL, '--continue', '--json', '-'])
    first, second = json.loads(capsys.readouterr().out)
    assert first['continuation']
    assert second['std']['mass'] < first['std']['mass']
    main([begun, '--model', MODEL, '--json', str(result)])
    capsys.readouterr()
    main([after, '--model', MODEL, '-p', f'continue_from:={result}', '--json', '-'])
    assert json.loads(capsys.readouterr().out)['estimate'] == second['estimate']


def without_origin(text: str) -> str:
    """Return a result without the command and the date that made it."""
    result = json.loads(text)
    assert result.pop('made_by')['robot']['name'] == 'table1'
    return json.dumps(result)
