"""The executable `replay`: from a bag to the estimate, its JSON, its report and its bag."""

from __future__ import annotations

import hashlib
import html
import json
import math
import re
import shlex
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import made_runs
import recorded
from checked import answer
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.results.estimate import Status
from mbaid_ros.parameters import values_of
from mbaid_ros.replay.arguments import replay as main
from mbaid_ros.replay.provenance import hashes
from mbaid_ros.replay.replay import _continued, exit_code
from simulated import CONFIG, table1

MODEL = str(CONFIG / 'table1.urdf')
refused = partial(answer, main, code=2)
DURATION = 20.0
RATE = 20.0
QUICK = ('--method', 'difference')  # where it is not the estimate that is tested
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


@pytest.fixture(scope='module', name='output')
def replayed(bag: str) -> Path:
    """Return a folder with the JSON and the bag of estimates of the default method."""
    folder = Path(bag).parent
    files = ['--json', str(folder / 'out.json'), '--output', str(folder / 'estimates'), '--report']
    assert main([bag, '--model', MODEL, *files, str(folder / 'out.html')]) == 0
    return folder


def test_the_json_has_what_scripts_rely_on(output: Path, bag: str) -> None:
    result = json.loads((output / 'out.json').read_text(encoding='utf-8'))
    assert list(result) == [
        *('bag', 'method', 'stage', 'target_link', 'status', 'estimate', 'std', 'covariance', 'error_budget'),
        *('unchecked', 'identifiable', 'momentum', 'time_offset', 'noise', 'flexible', 'thrusters', 'events'),
        *('residual', 'holdout', 'causes', 'repairs', 'sensors', 'capture'),
        *('debris', 'samples', 'span_s', 'warnings', 'model', 'made_by', 'advice', 'continuation', 'history'),
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
    assert result['flexible'] is None
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
    file = papers_parameters(tmp_path, '    target_link: link3\n    window: 1.0\n')
    result = result_of(capsys, bag, '--params', str(file))
    assert (result['method'], result['target_link']) == ('paper_main', 'link3')
    result = result_of(capsys, bag, '--params', str(file), '--method', 'paper_difference', '--target', 'link4')
    assert (result['method'], result['target_link']) == ('paper_difference', 'link4')
    # Several bags are a list, with their paths as given.
    bare = f'{bag}/papers_case.mcap'
    results = result_of(capsys, bag, bare, '--params', str(file), '-p', 'method:=difference', '--target', 'link4')
    assert [result['bag'] for result in results] == [bag, bare]
    assert results[0]['estimate'] == results[1]['estimate']
    made_by = results[0]['made_by']['parameters']
    assert (results[0]['method'], made_by['window']) == ('difference', 1.0)


def test_other_topic_names(capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path) -> None:
    renamed = str(tmp_path / 'renamed')
    with BagReader(bag) as source, BagWriter(renamed) as target:
        for topic in source.topics.values():
            target.add_topic(f'/arm{topic.name}', topic.type)
        for name, data, time in source.raw():
            target.write_raw(f'/arm{name}', data, time)
    assert "no topic '/joint_states'; topics: /arm/joint_states" in refused(capsys, renamed, '--model', MODEL)
    advice = "has no topic '/odom' or '/pose'; give --odom /arm/odom\n"
    assert advice in refused(capsys, renamed, '--joint-states', '/arm/joint_states', '--model', MODEL)
    result = result_of(capsys, renamed, '--joint-states', '/arm/joint_states', '--odom', '/arm/odom', *QUICK)
    assert result['status'] != 'waiting'
    assert [each['topic'] for each in result['sensors']] == ['/arm/odom']


def test_a_bag_without_the_base_is_refused_with_the_topics_it_has(
    capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path
) -> None:
    for kept, words in (('/joint_states', "no topic '/odom'"), ('/odom', "no topic '/joint_states'")):
        alone = str(tmp_path / kept[1:])
        with BagReader(bag) as source, BagWriter(alone) as target:
            target.add_topic(kept, source.topics[kept].type)
            for name, data, time in source.raw([kept]):
                target.write_raw(name, data, time)
        assert f'{words}; topics: {kept} (' in refused(capsys, alone, '--model', MODEL)


@dataclass(frozen=True)
class Ended:
    """The end of a run, as far as the next one begins from it."""

    bag: str
    posterior: str | None = 'mass'
    contradicted: bool = False
    warnings: tuple[str, ...] = ()
    final: Any = field(default_factory=lambda: SimpleNamespace(repairs=()))


def test_nothing_goes_on_from_a_run_that_was_repaired_or_cannot_be_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    repaired = Ended('repaired', final=SimpleNamespace(repairs=('degrees',)))
    ends = [
        Ended('a'),
        repaired,
        Ended('wrong', contradicted=True, warnings=('own',)),
        Ended('short', None),
        Ended('b'),
    ]
    begun: list[str | None] = []

    def replayed(bag: str, *_: object, before: Ended | None, **__: object) -> Ended:
        begun.append(before.bag if before else None)
        return next(each for each in ends if each.bag == bag)

    monkeypatch.setattr('mbaid_ros.replay.replay.replay_bag', replayed)
    nothing: Any = None
    runs = _continued([*(each.bag for each in ends), 'b'], nothing, nothing, nothing)
    assert begun == [None, 'a', 'a', 'a', 'a', 'b']
    first = 'nothing goes on from repaired, which was repaired'
    notes = [f'nothing goes on from {bag}, which reached no estimate that can be trusted' for bag in ('wrong', 'short')]
    assert [each.warnings for each in runs[:4]] == [(), (), ('own', first), (first, notes[0])]
    assert [each.warnings for each in runs[4:]] == [(first, *notes)] * 2


def test_the_estimates_as_a_bag(capsys: pytest.CaptureFixture[str], output: Path, bag: str) -> None:
    result = json.loads((output / 'out.json').read_text(encoding='utf-8'))
    output /= 'estimates'
    with BagReader(output) as estimates:
        read = [message for _, message, _ in estimates.read(['/estimator/estimate'])]
        reported = [message.inertia.m for _, message, _ in estimates.read(['/estimator/inertia'])]
        assert estimates.topics['/estimator/inertia'].type == 'geometry_msgs/msg/InertiaStamped'
        assert estimates.topics['/estimator/estimate'].latched
    assert [None if np.isnan(message.inertia.m) else message.inertia.m for message in read] == [
        entry['estimate']['mass'] for entry in result['history']
    ]
    assert 0 < len(reported) < len(read)  # from the first that can be computed with
    assert reported == [message.inertia.m for message in read[-len(reported) :]]
    assert not np.isnan(read[-1].inertia.m)
    assert read[-1].header.frame_id == 'link4'
    assert read[-1].momentum_frame == 'odom'
    assert read[0].header.stamp.sec == recorded.EPOCH
    assert refused(capsys, bag, '--model', MODEL, '--output', str(output)).endswith('a bag is never overwritten\n')
    assert 'one BAG; 2' in refused(capsys, bag, bag, '--model', MODEL, '--output', f'{output}_two')


def test_the_result_says_what_made_it(capsys: pytest.CaptureFixture[str], bag: str, tmp_path: Path) -> None:
    report = tmp_path / "the operator's.html"
    before = datetime.now(timezone.utc).replace(microsecond=0)
    made = result_of(capsys, bag, '--report', str(report), '--params', str(papers_parameters(tmp_path)))['made_by']
    assert list(made) == ['version', 'command', 'date', 'robot', 'parameters', 'bag_sha256']
    assert made['version'] == version('mbaid_ros')
    assert shlex.split(made['command'])[:5] == ['ros2', 'run', 'mbaid_ros', 'replay', bag]
    assert str(report) in shlex.split(made['command'])
    assert before <= datetime.fromisoformat(made['date']) <= datetime.now(timezone.utc)
    assert made['robot'] == {'name': 'table1', 'file': MODEL, 'sha256': sha256(Path(MODEL))}
    assert made['parameters'] == jsonable(EstimatorConfig(), {'method': 'paper_main', **PAPERS_MOMENTUM})
    assert made['bag_sha256'] == {'papers_case.mcap': sha256(Path(bag, 'papers_case.mcap'))}
    foot = html.unescape(report.read_text().partition('<footer>')[2])
    for text in (made['command'], made['date'], made['robot']['sha256'], made['bag_sha256']['papers_case.mcap']):
        assert text in foot


def test_a_file_that_is_compressed_as_a_whole_has_its_sha256(tmp_path: Path) -> None:
    (tmp_path / 'bag_0.mcap.zstd').write_bytes(b'content')
    assert hashes(str(tmp_path)) == {'bag_0.mcap.zstd': sha256(tmp_path / 'bag_0.mcap.zstd')}


PAPERS_MOMENTUM = {'paper.total_angular_momentum': [0.0, 0.0, 4597.634]}


def jsonable(config: EstimatorConfig, changes: dict[str, Any]) -> Any:
    return json.loads(json.dumps({**values_of(config), **changes}))


def sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def wrong_model(folder: Path) -> str:
    """Return the servicer with a base 40 % too heavy."""
    text = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    mass = re.search(r'<mass value="([^"]*)"/>', text)
    assert mass
    path = folder / 'wrong.urdf'
    path.write_text(text.replace(mass[0], f'<mass value="{1.4 * float(mass[1])}"/>', 1), encoding='utf-8')
    return str(path)


def test_data_that_contradict_the_model_end_with_4(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bag, report = str(CONFIG.parent / 'bags' / 'servicer7_mid'), tmp_path / 'report.html'
    arguments = ['--model', wrong_model(tmp_path), '-p', 'method:=difference', '--report', str(report)]
    assert main([bag, *arguments]) == 4
    assert 'the numbers of link7 must not be trusted' in capsys.readouterr().out
    page = report.read_text()
    assert '<p class="verdict wrong">The data contradict the model, so the numbers of link7' in page
    assert 'verdict good' not in page


@pytest.mark.parametrize(
    ('statuses', 'code'),
    [
        (('converged', 'estimating'), 0),
        (('converged', 'waiting'), 3),
        (('waiting', 'inconsistent', 'converged'), 4),
        (('inconsistent',), 4),
    ],
)
def test_of_several_bags_the_worst_counts(statuses: tuple[Status, ...], code: int) -> None:
    assert exit_code([made_runs.run(made_runs.estimate(status=status)) for status in statuses]) == code


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
    verdict = capsys.readouterr().out.split('\n\n')[1].splitlines()[0]
    assert verdict.endswith('the data contain no complete window; joint missing: joint5, joint6, joint7')


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['--model', MODEL], 'required: BAG'),
        (['{bag}'], 'required: --model'),
        (['/absent', '--model', MODEL], "bag '/absent' does not exist"),
        (['{bag}', '--model', '/absent.urdf'], "cannot read robot description '/absent.urdf': No such file"),
        (['{bag}', '--model', '{bag}/metadata.yaml'], 'robot description'),
        (['{bag}', '--model', MODEL, '--target', 'hand'], 'hand'),
        (['{bag}', '--model', MODEL, '--method', 'magic'], "'method' is 'magic'; accepted: trajectory, difference"),
        (['{bag}', '--model', MODEL, '--method', 'paper_main'], 'total_angular_momentum'),
        (['{bag}', '--model', MODEL, '--params', '/absent.yaml'], "parameter file '/absent.yaml'"),
        (['{bag}', '--model', MODEL, '--odom', '/pose'], "no topic '/pose'; topics: /joint_states (sensor_msgs"),
        (['{bag}', '--model', MODEL, '--odom', '/joint_states'], 'accepted: nav_msgs/msg/Odometry'),
        (['{bag}', '--model', MODEL, '--json', '/absent/x.json'], "--json '/absent/x.json' cannot be written"),
        (['{bag}', '--model', MODEL, '--report', '/'], "--report '/' cannot be written"),
        (['{bag}', '--model', MODEL, '--rate', '2'], "unknown argument '--rate'"),
        (['{bag}', '--model', MODEL, '-p', 'windwo:=1.0'], "'windwo'"),
        (['{bag}', '--model', MODEL, '--truth', '/absent.json'], "cannot read truth '/absent.json'"),
    ],
)
def test_bad_input_is_one_line(capsys: pytest.CaptureFixture[str], bag: str, arguments: list[str], text: str) -> None:
    assert text in refused(capsys, *(argument.replace('{bag}', bag) for argument in arguments))
