"""Every command of every document runs as printed, or as the mark above its block says: documents.py has the marks."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from mbaid_msgs.msg import InertiaEstimate

from documents import (
    DOCUMENTS,
    INSTALL,
    README,
    ROOT,
    TUTORIAL,
    Block,
    bash,
    blocks,
    names,
    outputs,
    prelude,
    project,
    with_ros2,
)
from graph import PATIENCE, Graph, graph
from make_pictures import IMAGES, REPORTS, curves
from mbaid_ros.bags import BagReader
from mbaid_ros.nodes.subscriptions import message_class
from stand_ins import put_on_path

TICKS = re.compile(r'<text [^>]*>(.*?)</text>')  # of a picture's axes, whose scale follows from the curves
HERE = re.compile(r"^cat > \S+ <<'END'\n.*?^END\n", re.DOTALL | re.MULTILINE)  # a file that a block writes


@pytest.mark.parametrize(
    'document',
    [
        pytest.param(name, marks=[] if name == 'README.md' else [pytest.mark.long])
        for name in names(DOCUMENTS)
        if blocks(ROOT / name, 'run')
    ],
)
def test_the_commands_run_as_printed(document: str, tmp_path: Path) -> None:
    commands = ''.join(block.text for block in blocks(ROOT / document, 'run'))
    with project(tmp_path) as folder:
        run = bash(''.join(prelude() if document != 'README.md' else []) + commands, folder)
    assert (run.returncode, run.stderr) == (0, ''), run.stdout
    assert [text for text in outputs(ROOT / document) if text not in run.stdout] == []
    for each in (picture for picture in REPORTS if document == f'docs/{picture.page}'):
        made = curves((tmp_path / each.report).read_text(encoding='utf-8'))
        stored = (IMAGES / each.picture).read_text(encoding='utf-8')
        assert TICKS.findall(made) == TICKS.findall(stored), 'run `make pictures`'
    if document == 'README.md':
        assert 'the inertia of link7 is identified' in run.stdout
        assert (tmp_path / 'report.html').is_file()
    if document == 'docs/reference/json.md':
        assert run.stdout.splitlines()[-1].startswith("{'mass': 934.4")


def test_the_way_with_ros_finds_both_packages_and_leads_to_the_executables(tmp_path: Path) -> None:
    (block,) = blocks(INSTALL, 'run with stand-ins')
    stand_ins = put_on_path(tmp_path / 'bin', 'rosdep', 'pip', 'colcon')
    with project(tmp_path / 'ws' / 'src' / 'mbaid_ros'):
        run = bash(f'{stand_ins}{block.text}ros2 run mbaid_ros replay --help', ROOT, {'HOME': str(tmp_path)})
    assert run.returncode == 0, run.stdout + run.stderr
    keys, *rest = run.stdout.splitlines()
    assert {'rclpy', 'pinocchio', 'python3-rosbags-pip', 'rosidl_default_generators'} <= set(keys.split())
    assert 'mbaid_msgs' not in keys
    assert {('mbaid_ros', 'src/mbaid_ros'), ('mbaid_msgs', 'src/mbaid_ros/msg_defs')} <= {
        tuple(line.split('\t')[:2]) for line in rest
    }
    assert 'usage: replay' in run.stdout


@contextmanager
def running(block: Block, place: Graph, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Start a node as printed; in the end interrupt it as Ctrl-C does, and see that it takes it well."""
    process = subprocess.Popen(
        ['bash', '-ec', ''.join(prelude()) + block.text],
        cwd=folder,
        env=with_ros2(place.environment),
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
        os.killpg(process.pid, signal.SIGINT)
        error = process.communicate(timeout=PATIENCE)[1]
        assert process.returncode == 0, error
        assert 'Traceback' not in error
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def test_the_live_commands_lead_to_an_estimate_and_to_answers(tmp_path: Path) -> None:
    own, estimator, simulator = blocks(README, 'live')
    questions = [block.text for path in DOCUMENTS for block in blocks(path, 'on the graph')]
    assert len(questions) >= 2
    with project(tmp_path / 'work') as folder, graph(tmp_path) as place:
        estimates = place.collect('/estimator/estimate', InertiaEstimate)
        with running(estimator, place, folder), running(simulator, place, folder):
            place.wait(lambda: any(estimate.samples > 0 for estimate in estimates), 'an estimate')
            for command in sorted(''.join(questions).splitlines(), key=lambda line: 'service call' in line):
                ask(place, shlex.split(command))
        estimates.clear()
        with running(own, place, folder):
            place.wait(lambda: any('/base/odom' in str(estimate.warnings) for estimate in estimates), 'what it lacks')


def ask(place: Graph, words: list[str]) -> None:
    """Do through rclpy what a command of ROS 2 does."""
    if words[:3] == ['ros2', 'topic', 'echo']:
        (topic,) = words[3:]
        place.wait(lambda: topic in dict(place.node.get_topic_names_and_types()), topic)
        types = dict(place.node.get_topic_names_and_types())
        messages = place.collect(topic, message_class(types[topic][0]))
        place.wait(lambda: messages, f'a message of {topic}')
    elif words[:3] == ['ros2', 'service', 'call']:
        service, type_name, values = words[3:]
        package, _, name = type_name.split('/')
        service_type = getattr(import_module(f'{package}.srv'), name)
        assert place.call(service, service_type, service_type.Request(**yaml.safe_load(values))).success
    else:
        raise AssertionError(f'not known here: {words}')


@pytest.mark.long
def test_the_tutorial_leads_to_a_live_estimate_and_to_one_from_a_recording(tmp_path: Path) -> None:
    recorder, estimator, watch, simulator = blocks(TUTORIAL, 'live')
    record, show = blocks(TUTORIAL, 'run with stand-ins')
    files = [part for block in blocks(TUTORIAL, 'run') for part in HERE.findall(block.text)]
    stand_ins = put_on_path(tmp_path / 'bin', 'ros2', 'rviz2')
    with project(tmp_path / 'work') as folder, graph(tmp_path) as place:
        assert bash('mkdir tutorial\n' + ''.join(files), folder).returncode == 0
        for name in ('robot.urdf', 'estimator.yaml'):
            (folder / f'my_{name}').symlink_to(folder / 'tutorial' / name)
        estimates = place.collect('/estimator/estimate', InertiaEstimate)
        with (
            running(recorder, place, folder),
            running(estimator, place, folder),
            running(watch, place, folder),
            running(simulator, place, folder),
        ):
            run = bash(prelude()[0] + stand_ins + record.text + show.text, folder, place.environment)
            place.wait(lambda: any(estimate.samples > 0 for estimate in estimates), 'an estimate')
        assert run.returncode == 0, run.stdout + run.stderr
        assert "topics in 'my_run'" in run.stdout
        assert 'the inertia of gripper is estimated' in run.stdout
        assert (folder / 'my_run.html').is_file()
        with BagReader(folder / 'my_run_2') as bag:
            assert set(bag.topics) == {'/joint_states', '/odom'}
