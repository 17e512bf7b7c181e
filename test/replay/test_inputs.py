"""Which bags `replay` reads, and which part: `--start` and `--end`, bags without times of recording, many bags."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import recorded
from checked import answer, some
from defects import no_twist
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.pipeline import POSES_ALONE
from mbaid_ros.replay.arguments import replay
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.one_bag import read_motions, replay_bag
from mbaid_ros.replay.report.page import html
from recorded import JOINT_STATE, ODOMETRY
from simulated import CONFIG

BAG = Path(__file__).parents[2] / 'bags' / 'servicer7_mid'
ROBOT = BAG.parents[1] / 'config' / 'servicer7.urdf'
EPOCH = 1_700_000_000_000_000_000  # ns


def result_of(bag: Path, tmp_path: Path, *words: str) -> dict[str, Any]:
    file = tmp_path / 'result.json'
    parameters = f'{ROBOT.with_suffix("")}_estimator.yaml'
    replay([str(bag), '--model', str(ROBOT), '--params', parameters, '--json', str(file), *words])
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def recorded_at_zero(path: Path, count: int) -> Path:
    """Write the bag in real time, its first messages as recorded at time 0."""
    with BagReader(BAG) as before, BagWriter(path) as after:
        for topic, kind in (('/joint_states', JOINT_STATE), ('/odom', ODOMETRY)):
            after.add_topic(topic, kind)
        for place, (topic, message, time) in enumerate(before.read(['/joint_states', '/odom'])):
            message.header.stamp.sec += EPOCH // 10**9
            after.write(topic, message, 0 if place < count else EPOCH + time)
    return path


def test_a_part_of_a_bag_is_read(tmp_path: Path) -> None:
    found = result_of(BAG, tmp_path, '--start', '20', '--end', '40', '--method', 'difference')
    assert found['span_s'] == pytest.approx(20.0, abs=0.1)
    assert found['samples'] == pytest.approx(1000, abs=3)
    with BagReader(BAG, 20.0, 40.0) as bag:
        times = np.array([time for _, _, time in bag.raw(['/odom'])])
    assert 20e9 <= times[0] < times[-1] <= 40e9
    assert len(times) == pytest.approx(1000, abs=2)


@pytest.mark.parametrize(
    ('words', 'text'),
    [
        (('--start', '100'), 'contains no messages from 100 s on'),
        (('--start', '10', '--end', '5'), '--start 10 and --end 5 leave nothing; accepted: an end after the start'),
        (('--start', '-1'), "'-1' is not accepted; accepted: a number >= 0 s"),
    ],
)
def test_a_part_that_is_none_is_refused(words: tuple[str, ...], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert text in answer(replay, capsys, str(BAG), '--model', str(ROBOT), *words, code=2)


@pytest.mark.parametrize('count', [20, 100_000])
def test_times_of_recording_that_were_never_filled_in_are_not_used(tmp_path: Path, count: int) -> None:
    bag = recorded_at_zero(tmp_path / 'bag', count)
    report = tmp_path / 'report.html'
    words = ('--method', 'difference', '--report', str(report))
    warnings = result_of(bag, tmp_path, *words)['warnings']
    assert any('by their stamps they last 60 s: rates are by the stamps' in text for text in warnings)
    assert report.read_text().count('<td class="n">3001</td><td class="n">50</td>') == 2
    if count < 100:
        part = result_of(bag, tmp_path, '--start', '20', '--end', '40', '--method', 'difference')
        assert part['samples'] == pytest.approx(1000, abs=3)


@pytest.mark.parametrize(('per_second', 'unit'), [(1_000, 'milliseconds'), (1_000_000, 'microseconds'), (60, '')])
def test_seconds_that_hold_smaller_units_are_named(
    per_second: int, unit: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'bag'
    with BagReader(BAG) as before, BagWriter(path) as after:
        for topic, kind in (('/joint_states', JOINT_STATE), ('/odom', ODOMETRY)):
            after.add_topic(topic, kind)
        for topic, message, time in before.read(['/joint_states', '/odom']):
            if topic == '/odom':
                message.header.stamp.sec, message.header.stamp.nanosec = 1 + per_second * time // 10**9, 0
            after.write(topic, message, EPOCH + time)
    assert replay([str(path), '--model', str(ROBOT), '--method', 'difference']) in {3, 4}
    found = re.search(r'recorded within 60 s, by their stamps they last [^:]*: rates are', capsys.readouterr().out)
    assert some(found)[0].endswith(f' s, as if sec were {unit}: rates are' if unit else ' s: rates are')


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
        replay([bag, *QUICK, '--json', '-'])
        alone.append(without_origin(capsys.readouterr().out))
    report = tmp_path / 'report.html'
    replay([*bags, *QUICK, '--json', '-', '--report', str(report), '--processes', '2'])
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
    begun, after = (str(recorded.papers_case(tmp_path / f'{length:g}_s', length, 20.0)) for length in (20.0, 15.0))
    result = tmp_path / 'first.json'
    replay([begun, after, '--model', MODEL, '--continue', '--json', '-'])
    first, second = json.loads(capsys.readouterr().out)
    assert first['continuation']
    assert second['std']['mass'] < first['std']['mass']
    result.write_text(json.dumps(first))
    replay([after, '--model', MODEL, '-p', f'continue_from:={result}', '--json', '-'])
    assert json.loads(capsys.readouterr().out)['estimate'] == second['estimate']


def without_origin(text: str) -> str:
    """Return a result without the command and the date that made it."""
    result = json.loads(text)
    assert result.pop('made_by')['robot']['name'] == 'table1'
    return json.dumps(result)


def played(path: Path, *changes: Callable[[Any], None]) -> str:
    """Write the first four seconds of the bag once for each change of its odometry."""
    with BagReader(BAG, 0.0, 4.0) as before, BagWriter(path) as after:
        for topic, kind in (('/joint_states', JOINT_STATE), ('/odom', ODOMETRY)):
            after.add_topic(topic, kind)
        for turn, change in enumerate(changes):
            for topic, message, time in before.read(['/joint_states', '/odom']):
                if topic == '/odom':
                    change(message)
                after.write(topic, message, time + turn * 4_000_000_000)
    return str(path)


def unchanged(_message: Any) -> None: ...


def test_a_bag_of_four_runs_has_the_rate_of_one(tmp_path: Path) -> None:
    played(tmp_path / 'bag', *[unchanged] * 4)
    found = result_of(tmp_path / 'bag', tmp_path, '--method', 'difference')
    assert found['sensors'][0]['rate'] == pytest.approx(50.0, rel=0.01)
    assert not any('by their stamps' in text for text in found['warnings'])


def test_a_calibration_has_the_notes_on_every_motion(tmp_path: Path) -> None:
    bag = played(tmp_path / 'bag', no_twist, unchanged)
    assert POSES_ALONE in read_motions(bag, EstimatorConfig(), ROBOT.read_text(), Inputs()).warnings
