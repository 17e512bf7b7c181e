"""The executables as `ros2 run` finds them, and what they do with arguments, signals and mistakes."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory, get_packages_with_prefixes
from mbaid_msgs.msg import InertiaEstimate

from graph import LOCAL, Graph, executable, free_domain
from mbaid_ros.nodes import estimator
from simulated import CONFIG

NAMES = (
    'simulator',
    'estimator',
    'recorder',
    'player',
    'watch',
    'simulate',
    'replay',
    'calibrate',
    'campaign',
    'export',
    'convert',
    'noise_at_rest',
)
TABLE1 = f'robot_description_file:={CONFIG / "table1.urdf"}'


def assigned(*texts: str) -> list[str]:
    return ['--ros-args', *(word for text in texts for word in ('-p', text))]


def test_the_package_is_in_the_index() -> None:
    assert 'mbaid_ros' in get_packages_with_prefixes()
    share = Path(get_package_share_directory('mbaid_ros'))
    assert (share / 'package.xml').is_file()
    assert (share / 'config' / 'table1.urdf').is_file()


@pytest.mark.parametrize('name', NAMES)
def test_help_has_an_example(name: str) -> None:
    assert os.access(executable(name), os.X_OK)
    run = subprocess.run([executable(name), '--help'], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 0
    assert not run.stderr
    assert re.search(r'example:\n  (ros2 run mbaid_ros )?' + name, run.stdout)


@pytest.mark.parametrize('name', NAMES)
def test_an_unknown_argument_is_one_line(name: str) -> None:
    run = subprocess.run([executable(name), '--colour'], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 2
    assert not run.stdout
    assert run.stderr.count('\n') == 1
    assert '--colour' in run.stderr or 'required' in run.stderr


@pytest.fixture(name='_domain')
def own_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with free_domain() as domain:
        for name, value in {**LOCAL, 'ROS_DOMAIN_ID': str(domain)}.items():
            monkeypatch.setenv(name, value)
        yield


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['table1.urdf'], "unknown argument 'table1.urdf'"),
        (assigned('windows:=1.0'), "unknown parameter 'windows'; known: window, "),
        (assigned('window:=0.0'), "parameter 'window' is 0.0 s; accepted: a number > 0 and <= 1e+06 s"),
        (assigned('window:=wide'), "parameter 'window' is 'wide'; accepted: a number > 0 and <= 1e+06 s"),
        (
            assigned('noise.joint_position:=-1'),
            "parameter 'noise.joint_position' is -1 rad; accepted: a number >= 0 rad",
        ),
        (assigned('method:=kalman'), "parameter 'method' is 'kalman'; accepted: "),
        (assigned('method:=paper_main'), 'method paper_main needs paper.total_angular_momentum'),
        (assigned('method:=paper_main', TABLE1), 'method paper_main needs paper.total_angular_momentum'),
        (assigned('robot_description_file:=/no/robot.urdf'), "'/no/robot.urdf'"),
        (assigned(f'robot_description_file:={__file__}'), 'not valid XML'),
        (assigned(TABLE1, 'target_link:=hand'), "link 'hand' is not in the robot description; links: base_link, link1"),
        (assigned('window'), "'-p window'"),
        (assigned('paper.total_angular_momentum:=[0,0,1.5]'), 'write all with a decimal point'),
        (['--ros-args', '--params-file', '/no/file.yaml'], '/no/file.yaml'),
        (['--ros-args', '-r', '__node:=9'], "'-r __node:=9'"),
        (['--ros-args', '--colour'], '--colour'),
    ],
)
@pytest.mark.usefixtures('_domain')
def test_what_cannot_be_used_is_one_line(arguments: list[str], text: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert estimator.main(arguments) == 2
    captured = capfd.readouterr()
    assert not captured.out
    assert captured.err.startswith('mbaid_ros estimator: ')
    assert captured.err.count('\n') == 1
    assert text in captured.err
    assert '/src/' not in captured.err


@pytest.mark.usefixtures('_domain')
def test_security_without_its_keys_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    asked = {'ENABLE': 'true', 'STRATEGY': 'Enforce', 'KEYSTORE': str(tmp_path)}
    for name, value in asked.items():
        monkeypatch.setenv(f'ROS_SECURITY_{name}', value)
    assert estimator.main(['--ros-args', '--enclave', '/mbaid_ros/estimator']) == 2
    error = capfd.readouterr().err
    assert f"'{tmp_path}/enclaves/mbaid_ros/estimator' does not exist" in error
    assert error.count('\n') == 1


def test_the_nodes_need_nothing_that_only_bags_need() -> None:
    code = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"rosbags", "mcap", "matplotlib", "tqdm", "apsw", "zstandard", "distributed"}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent())
for name in ("estimator", "managed", "simulator", "watch"):
    __import__(f"mbaid_ros.nodes.{name}")
"""
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_an_end_in_order(graph: Graph, number: signal.Signals) -> None:
    # A whole number is accepted where a broken one is meant.
    node = graph.start('estimator', *assigned(TABLE1, 'window:=1', 'noise.joint_position:=1e-5'))
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    graph.wait(lambda: estimates, 'the estimate that waits')
    assert node.stop(number) == 0
    assert not node.stdout
    assert all('[INFO]' in line for line in node.stderr.splitlines())
