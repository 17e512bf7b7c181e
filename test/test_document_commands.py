"""Every command of every document runs as printed, or as the mark above its block says: documents.py has the marks."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from catkin_pkg.packages import find_packages
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
    prelude,
    project,
)
from graph import Graph, graph
from mbaid_ros.bags import BagReader
from mbaid_ros.nodes.subscriptions import message_class

RECORDING = 4.0  # s, after which somebody at the keyboard would press Ctrl-C


def put_on_path(folder: Path, *programs: str) -> str:
    """Write programs into a folder, and return the shell command that makes them the first to be found."""
    folder.mkdir()
    for program in programs:
        path = folder / program
        path.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{__file__}" {program} "$@"\n')
        path.chmod(0o755)
    return f'export PATH={folder}:"$PATH"\n'


def rosdep(words: list[str]) -> None:
    """Print the keys that `rosdep install` would install, from the manifests that it would read."""
    parser = argparse.ArgumentParser('rosdep')
    parser.add_argument('verb', choices=['install'])
    parser.add_argument('--from-paths', nargs='+', required=True)
    parser.add_argument('--ignore-src', action='store_true')
    parser.add_argument('-y', action='store_true')
    arguments = parser.parse_args(words)
    packages = [package for path in arguments.from_paths for package in find_packages(path).values()]
    assert len(packages) == len(arguments.from_paths), 'a folder without a package'
    keys = {key.name for package in packages for key in (*package.exec_depends, *package.buildtool_depends)}
    left = keys - {package.name for package in packages} if arguments.ignore_src else keys
    sys.stdout.write(' '.join(sorted(left)) + '\n')


def pip(words: list[str]) -> None:
    """See with the real pip that nothing is left to install."""
    assert words[0] == 'install'
    offline = ['--dry-run', '--no-index', '--disable-pip-version-check']
    subprocess.run([sys.executable, '-m', 'pip', 'install', *offline, *words[1:]], check=True)


def colcon(words: list[str]) -> None:
    """List with the real colcon what it would build, and give what it has built in the project's folder."""
    assert words[0] == 'build'
    real = Path(sys.executable).with_name('colcon')
    subprocess.run([str(real), '--log-base', os.devnull, 'list', *words[1:]], check=True)
    Path('install').symlink_to(ROOT / 'install')


def ros2(words: list[str]) -> None:
    """Start an executable for `ros2 run`, and the recorder for `ros2 bag record`."""
    parser = argparse.ArgumentParser('ros2')
    commands = parser.add_subparsers(dest='command', required=True)
    run = commands.add_parser('run', add_help=False)
    run.add_argument('package', choices=['mbaid_ros'])
    run.add_argument('executable')
    run.add_argument('arguments', nargs=argparse.REMAINDER)
    record = commands.add_parser('bag').add_subparsers(required=True).add_parser('record')
    record.add_argument('-s', '--storage', choices=['mcap'], required=True)
    record.add_argument('-o', '--output', required=True)
    record.add_argument('--topics', nargs='+', required=True)
    chosen = parser.parse_args(words)
    if chosen.command == 'bag':
        parameters = [f'output:={chosen.output}', f'topics:=[{",".join(chosen.topics)}]', f'duration:={RECORDING}']
        chosen.executable = 'recorder'
        chosen.arguments = ['--ros-args', *(word for parameter in parameters for word in ('-p', parameter))]
    program = str(ROOT / 'install' / 'mbaid_ros' / 'lib' / 'mbaid_ros' / chosen.executable)
    os.execv(program, [program, *chosen.arguments])


def rviz2(words: list[str]) -> None:
    """Read the layout, of which test_layouts.py checks what it shows."""
    parser = argparse.ArgumentParser('rviz2')
    parser.add_argument('-d', '--display-config', type=Path, required=True)
    parser.add_argument('-f', '--fixed-frame', required=True)
    layout = yaml.safe_load(parser.parse_args(words).display_config.read_text(encoding='utf-8'))
    assert layout['Visualization Manager']['Displays']


if __name__ == '__main__':
    {each.__name__: each for each in (rosdep, pip, colcon, ros2, rviz2)}[sys.argv[1]](sys.argv[2:])


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
    if document == 'README.md':
        assert 'the inertia of link7 is identified' in run.stdout
        assert (tmp_path / 'report.html').is_file()
    if document == 'docs/reference/json.md':
        assert run.stdout.splitlines()[-1].startswith("{'mass': 934.4")


def test_the_way_with_ros_finds_both_packages_and_leads_to_the_executables(tmp_path: Path) -> None:
    (block,) = blocks(INSTALL, 'run with stand-ins')
    stand_ins = put_on_path(tmp_path / 'bin', 'rosdep', 'pip', 'colcon')
    with project(tmp_path / 'ws' / 'src' / 'mbaid_ros'):
        run = bash(
            f'{stand_ins}{block.text}{prelude()[1]}ros2 run mbaid_ros replay --help', ROOT, {'HOME': str(tmp_path)}
        )
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
        env=place.environment,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
        os.killpg(process.pid, signal.SIGINT)
        error = process.communicate(timeout=20.0)[1]
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
