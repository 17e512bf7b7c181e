"""The executable `replay`: from a bag to the estimate, its JSON, its report and its bag."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import recorded
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.replay.replay import main
from mbaid_ros.replay.results import History, Run, TopicStatistics, as_json, summary
from simulated import CONFIG, table1

MODEL = str(CONFIG / 'table1.urdf')
DURATION = 20.0
RATE = 20.0
SHAPE = {'mass', 'com', 'inertia'}
INERTIA = ['ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz']


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(recorded.papers_case(tmp_path_factory.mktemp('bags') / 'papers_case', DURATION, RATE))


def result_of(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> Any:
    assert main([*arguments, '--model', MODEL, '--json', '-']) == code
    captured = capsys.readouterr()
    assert captured.err == ''
    return json.loads(captured.out)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return the one line that bad input leads to."""
    assert main(list(arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ''
    assert captured.err.startswith('mbaid_ros replay: ')
    assert captured.err.count('\n') == 1
    return captured.err


def numbers_within(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return numbers_within(list(value.values()))
    if isinstance(value, list):
        return [number for item in value for number in numbers_within(item)]
    return [value]


def papers_parameters(folder: Path, more: str = '') -> Path:
    file = folder / 'estimator.yaml'
    file.write_text(
        'estimator:\n  ros__parameters:\n    method: paper_main\n'
        f'    paper.total_angular_momentum: [0.0, 0.0, 4597.634]\n{more}'
    )
    return file


def test_the_json_has_what_scripts_rely_on(capsys: pytest.CaptureFixture[str], bag: str) -> None:
    result = result_of(capsys, bag)
    assert list(result) == [
        *('bag', 'method', 'stage', 'target_link', 'status', 'estimate', 'std', 'covariance', 'error_budget'),
        *(
            'identifiable',
            'momentum',
            'time_offset',
            'events',
            'capture',
            'debris',
            'samples',
            'span_s',
            'warnings',
            'history',
        ),
    ]
    assert result['bag'] == bag
    assert result['target_link'] == 'link4'
    assert result['status'] in {'estimating', 'converged'}
    for key in ('estimate', 'identifiable'):
        assert set(result[key]) == SHAPE
        assert len(result[key]['com']) == 3
        assert list(result[key]['inertia']) == INERTIA
    assert set(result['momentum']) == {'linear', 'angular', 'linear_std', 'angular_std'}
    assert result['events'] == []
    assert result['capture'] is None
    assert result['debris'] is None
    assert all('\n' not in warning for warning in result['warnings'])
    first, last = result['history'][0], result['history'][-1]
    assert set(first) == {'t', 'status', 'estimate', 'std'}
    assert 0.0 < first['t'] < 1.0  # the end of the first window
    assert last['estimate'] == result['estimate']
    assert result['span_s'] == last['t'] == pytest.approx(DURATION, abs=0.6)
    assert result['samples'] == pytest.approx(DURATION * RATE, abs=12)
    for key in ('estimate', 'std', 'momentum'):
        assert all(number is None or math.isfinite(number) for number in numbers_within(result[key]))


def test_the_papers_case_leads_to_the_last_link(capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path) -> None:
    # Without noise; within a percent, for the recursion's initial covariance still shows after 20 s.
    result = result_of(capsys, bag, '--params', str(papers_parameters(tmp_path)))
    assert result['estimate']['mass'] == pytest.approx(934.45, rel=1e-2)
    assert result['estimate']['com'][:2] == pytest.approx([2.3, 0.9], rel=1e-2)
    assert result['estimate']['com'][2] is None  # the motion is planar
    assert result['estimate']['inertia']['izz'] == pytest.approx(3435.0, rel=1e-2)
    assert result['identifiable']['com'] == [True, True, False]
    assert not result['identifiable']['inertia']['ixx']


def test_several_bags_are_a_list_and_the_paths_are_as_given(capsys: pytest.CaptureFixture[str], bag: str) -> None:
    bare = f'{bag}/papers_case.mcap'
    results = result_of(capsys, bag, bare)
    assert [result['bag'] for result in results] == [bag, bare]
    assert results[0]['estimate'] == results[1]['estimate']


def test_a_bag_cut_off_is_read_up_to_the_cut_with_a_warning(
    capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path
) -> None:
    content = Path(bag, 'papers_case.mcap').read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[: len(content) // 2])
    result = result_of(capsys, str(cut), code=3)  # too short a piece to determine anything
    assert 0 < result['samples'] < DURATION * RATE
    assert any('cut off' in warning for warning in result['warnings'])


def test_parameters_of_the_file_hold_and_arguments_override_them(
    capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path
) -> None:
    file = papers_parameters(tmp_path, '    target_link: link3\n')
    result = result_of(capsys, bag, '--params', str(file))
    assert (result['method'], result['target_link']) == ('paper_main', 'link3')
    result = result_of(capsys, bag, '--params', str(file), '--method', 'paper_difference', '--target', 'link4')
    assert (result['method'], result['target_link']) == ('paper_difference', 'link4')


def test_other_topic_names(capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path) -> None:
    renamed = str(tmp_path / 'renamed')
    with BagReader(bag) as source, BagWriter(renamed) as target:
        for topic in source.topics.values():
            target.add_topic(f'/arm{topic.name}', topic.type)
        for name, data, time in source.raw():
            target.write_raw(f'/arm{name}', data, time)
    assert "no topic '/joint_states'; topics: /arm/joint_states" in refused(capsys, renamed, '--model', MODEL)
    result = result_of(capsys, renamed, '--joint-states', '/arm/joint_states', '--odom', '/arm/odom')
    assert result['status'] != 'waiting'


def test_the_estimates_as_a_bag(capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path) -> None:
    output = tmp_path / 'estimates'
    result = result_of(capsys, bag, '--output', str(output))
    with BagReader(output) as estimates:
        read = [message for _, message, _ in estimates.read(['/estimator/estimate'])]
        assert estimates.topics['/estimator/inertia'].type == 'geometry_msgs/msg/InertiaStamped'
        assert estimates.topics['/estimator/estimate'].latched
    assert [None if np.isnan(message.inertia.m) else message.inertia.m for message in read] == [
        entry['estimate']['mass'] for entry in result['history']
    ]
    assert not np.isnan(read[-1].inertia.m)
    assert read[-1].header.frame_id == 'link4'
    assert read[-1].momentum_frame == 'odom'
    assert read[0].header.stamp.sec == recorded.EPOCH
    assert refused(capsys, bag, '--model', MODEL, '--output', str(output)).endswith('a bag is never overwritten\n')
    assert 'one BAG; 2' in refused(capsys, bag, bag, '--model', MODEL, '--output', str(tmp_path / 'two'))


def test_the_report_needs_nothing_else(capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path) -> None:
    report = tmp_path / 'report.html'
    assert main([bag, '--model', MODEL, '--report', str(report)]) == 0
    text = report.read_text()
    assert 'link4' in capsys.readouterr().out
    svg = ET.fromstring(text[text.index('<svg') : text.index('</svg>') + 6])
    assert len(list(svg.iter())) > 100
    assert 'src=' not in text
    assert 'prefers-color-scheme: dark' in text
    assert '<script' not in text


def test_two_reports_of_the_same_data_are_the_same(bag: str, tmp_path: Path) -> None:
    for name in ('a', 'b'):
        assert main([bag, '--model', MODEL, '--report', str(tmp_path / name)]) == 0
    assert (tmp_path / 'a').read_text() == (tmp_path / 'b').read_text()


def resting_bag(path: Path) -> str:
    """Write a bag of the robot at rest, with the sensor noise that the estimator expects."""
    model, start = table1()
    moving = recorded.simulate(model, start, 5.0, 20.0)
    generator = np.random.default_rng(0)
    still = {name: values[np.zeros(len(moving), dtype=int)] for name, values in vars(moving).items()}
    for name in ('joint_velocity', 'base_linear_velocity', 'base_angular_velocity'):
        still[name] = generator.normal(scale=1e-4, size=still[name].shape)
    return str(recorded.write(path, model, type(moving)(**{**still, 'time': moving.time})))


def test_data_that_determine_nothing_end_with_3(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bag = resting_bag(tmp_path / 'rest')
    report = tmp_path / 'report.html'
    result = result_of(capsys, bag, '--report', str(report), code=3)
    assert result['status'] == 'not_identifiable'
    assert not any(numbers_within(result['identifiable']))
    assert all(number is None for number in numbers_within(result['estimate']))
    assert 'does not determine' in report.read_text()


def test_joints_of_another_robot_end_with_3_and_the_names(capsys: pytest.CaptureFixture[str], bag: str) -> None:
    assert main([bag, '--model', str(CONFIG / 'servicer7.urdf'), '--json', '-']) == 3
    result = json.loads(capsys.readouterr().out)
    assert result['status'] == 'waiting'
    assert result['samples'] == 0
    assert result['history'] == []
    assert any('joint' in warning for warning in result['warnings'])
    assert main([bag, '--model', str(CONFIG / 'servicer7.urdf')]) == 3
    verdict = capsys.readouterr().out.splitlines()[0]
    assert verdict.endswith('the data hold no complete window; joint missing: joint5, joint6, joint7')


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['--model', MODEL], 'required: BAG'),
        (['{bag}'], 'required: --model'),
        (['/absent', '--model', MODEL], "bag '/absent' does not exist"),
        (['{bag}', '--model', '/absent.urdf'], "cannot read robot description '/absent.urdf': No such file"),
        (['{bag}', '--model', '{bag}/metadata.yaml'], 'robot description'),
        (['{bag}', '--model', MODEL, '--target', 'hand'], 'hand'),
        (
            ['{bag}', '--model', MODEL, '--method', 'magic'],
            "'method' is 'magic'; accepted: difference",
        ),
        (['{bag}', '--model', MODEL, '--method', 'paper_main'], 'total_angular_momentum'),
        (['{bag}', '--model', MODEL, '--params', '/absent.yaml'], "parameter file '/absent.yaml'"),
        (['{bag}', '--model', MODEL, '--odom', '/pose'], "no topic '/pose'; topics: /joint_states (sensor_msgs"),
        (['{bag}', '--model', MODEL, '--odom', '/joint_states'], 'accepted: nav_msgs/msg/Odometry'),
        (['{bag}', '--model', MODEL, '--json', '/absent/x.json'], "--json '/absent/x.json' cannot be written"),
        (['{bag}', '--model', MODEL, '--report', '/'], "--report '/' cannot be written"),
        (['{bag}', '--model', MODEL, '--rate', '2'], "unknown argument '--rate'"),
    ],
)
def test_bad_input_is_one_line(capsys: pytest.CaptureFixture[str], bag: str, arguments: list[str], text: str) -> None:
    assert text in refused(capsys, *(argument.replace('{bag}', bag) for argument in arguments))


def estimate(number: int) -> Estimate:
    return Estimate(method='difference', status='estimating', time=float(number))


@pytest.mark.parametrize('count', [0, 1, 4999, 5000, 5001, 9999, 10_001, 47_123])
def test_the_history_is_thinned_evenly_to_5000(count: int) -> None:
    history = History()
    for number in range(count):
        history.add(estimate(number))
    times = [entry.time for entry in history.entries()]
    assert len(times) <= 5000
    if count <= 5000:
        assert times == list(range(count))
    else:
        assert len(times) > 1600
        assert times[0] == 0.0
        assert times[-1] == count - 1
        steps = np.diff(times)
        assert np.all(steps[:-1] == steps[0])
        assert steps[-1] <= steps[0]


def hostile_run() -> Run:
    final = Estimate(
        method='difference',
        status='converged',
        parameters=np.linspace(1.0, 10.0, 10, dtype=np.float64),
        covariance=np.eye(10) * 0.01,
        identifiable=np.ones(10, dtype=bool),
        time_offset=0.01,
        time_offset_std=0.001,
        warnings=('one <script>',),
    )
    return Run(
        bag='<b>&bag',
        target_link='<link>',
        final=final,
        history=(final, final),
        topics=(TopicStatistics('/a<b', 'x', 1, float('nan')),),
        used=1,
        dropped={'<cause>': 3},
        warnings=('two', 'one <script>'),
    )


def test_what_comes_from_files_is_escaped_in_the_report() -> None:
    from mbaid_ros.replay.report import html  # noqa: PLC0415 - takes a while to import

    text = html([hostile_run(), hostile_run()])
    for part in ('<script>', '<b>', '<link>', '<cause>', 'a<b'):
        assert part not in text


def test_standard_deviations_and_time_offset_in_json_and_on_the_terminal() -> None:
    result = as_json(hostile_run())
    assert result['std']['mass'] == pytest.approx(0.1)
    assert result['time_offset'] == {'value': 0.01, 'std': 0.001}
    assert result['warnings'] == ['one <script>', 'two']
    text = summary(hostile_run())
    assert 'mass' in text
    assert '± 0.20 kg' in text
    assert '± 95 %' in text
    assert text.count('warning: ') == 2
