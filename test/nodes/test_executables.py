"""The executables as `ros2 run` finds them: arguments, signals at any time, mistakes, and what SROS2 has to admit."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import distribution
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import rclpy
from mbaid_msgs.msg import InertiaEstimate
from rclpy.node import Node

from checked import answer
from graph import LOCAL, PATIENCE, Graph, executable, reserved_domain
from mbaid_ros.cli import run
from mbaid_ros.nodes import estimator, player, recorder, simulator, watch
from mbaid_ros.nodes.estimator import EstimatorNode
from mbaid_ros.nodes.simulator import SimulatorNode
from mbaid_ros.nodes.start import run_node
from simulated import CONFIG, options

NAMES = (
    *('simulator', 'estimator', 'recorder', 'player', 'watch', 'simulate', 'plan', 'replay', 'calibrate', 'campaign'),
    *('export', 'convert', 'noise_at_rest'),
)
SIGNALS = (signal.SIGINT, signal.SIGTERM)
BAG = str(CONFIG.parent / 'bags' / 'table1_live')
TABLE1 = f'robot_description_file:={CONFIG / "table1.urdf"}'


def given(*texts: str) -> list[str]:
    return ['--ros-args', *options(*texts)]


@pytest.mark.usefixtures('_domain')
def test_every_executable_is_installed_and_an_unknown_argument_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """What each starts, in this process: test_cli.py has their help, and other tests start most of them."""
    starts = {each.name: each for each in distribution('mbaid-ros').entry_points if each.group == 'console_scripts'}
    assert set(starts) == set(NAMES)
    for name, start in starts.items():
        assert os.access(executable(name), os.X_OK), name
        monkeypatch.setattr(sys, 'argv', [str(executable(name)), '--colour'])
        code = start.load()()
        out, error = capfd.readouterr()
        assert (code, out, error.count('\n')) == (2, '', 1), name
        assert '--colour' in error or 'required' in error


@pytest.mark.parametrize(
    ('node', 'arguments', 'text'),
    [
        (estimator, ['table1.urdf'], "unknown argument 'table1.urdf'"),
        (estimator, given('windows:=1.0'), "unknown parameter 'windows'; known: window, "),
        (estimator, given('window:=wide'), "parameter 'window' is 'wide'; accepted: a number > 0 and <= 1e+06 s"),
        (estimator, given('method:=paper_main'), 'method paper_main needs paper.total_angular_momentum'),
        (estimator, given('method:=paper_main', TABLE1), 'method paper_main needs paper.total_angular_momentum'),
        (estimator, given('robot_description_file:=/no/robot.urdf'), "'/no/robot.urdf'"),
        (estimator, given(f'robot_description_file:={__file__}'), 'not valid XML'),
        (
            estimator,
            given(TABLE1, 'target_link:=hand'),
            "link 'hand' is not in the robot description; links: base_link, link1",
        ),
        (estimator, given('window'), "'-p window'"),
        (estimator, given('paper.total_angular_momentum:=[0,0,1.5]'), 'write all with a decimal point'),
        (estimator, ['--ros-args', '--params-file', '/no/file.yaml'], '/no/file.yaml'),
        (estimator, ['--ros-args', '-r', '__node:=9'], "'-r __node:=9'"),
        (estimator, ['--ros-args', '--colour'], '--colour'),
        (estimator, given('window:=-1.0'), "'window' is -1.0 s; accepted: a number > 0"),
        (
            simulator,
            given(TABLE1, 'nois.joint_position:=1.0'),
            "unknown parameter 'nois.joint_position'; known: noise.joint_position",
        ),
        (simulator, given(TABLE1, 'duration:=-1.0'), "'duration' is -1.0 s; accepted: a number >= 0 and <= 1e+06 s"),
        (simulator, given(TABLE1, 'robot_description_file:=/none.urdf'), "cannot read robot description '/none.urdf'"),
        (
            simulator,
            given(TABLE1, 'target_link:=hand'),
            "link 'hand' is not in the robot description; links: base_link",
        ),
        (simulator, given(TABLE1, 'initial.joint_positions:=[1.0]'), 'initial.joint_positions'),
        (player, ['/absent'], "bag '/absent' does not exist"),
        (player, [BAG, '--rate', '0'], "--rate: '0' is not accepted; accepted: a number > 0"),
        (player, [BAG, '--topics', '/pose'], "no topic '/pose'; topics: /joint_states, /odom, "),
        (player, [BAG, *given('rate:=2.0')], "unknown parameter 'rate'; known: none"),
        (player, [BAG, '--speed', '2'], "unknown argument '--speed'"),
        (recorder, ['run1'], 'run1'),
        (recorder, given('outputs:=x'), "unknown parameter 'outputs'; known: output, "),
        (recorder, given(f'output:={BAG}'), 'exists already'),
        (recorder, given('duration:=-1.0'), 'is -1.0 s; accepted: a number >= 0 and <= 1e+06 s'),
        (recorder, given('output'), 'output'),
        (
            recorder,
            given("topics:=['/odom', 'joint states']"),
            "parameter 'topics' names 'joint states': topic name must not contain characters other than",
        ),
        (recorder, given("topics:=['/arm/1st']"), 'topic name token must not start with a number'),
    ],
)
@pytest.mark.usefixtures('_domain')
def test_what_cannot_be_used_is_one_line(
    node: Any, arguments: list[str], text: str, capfd: pytest.CaptureFixture[str]
) -> None:
    refused(node, arguments, text, capfd)


@pytest.mark.parametrize('node', [estimator, simulator, recorder, player, watch], ids=lambda node: node.NAME)
@pytest.mark.usefixtures('_domain')
def test_a_parameter_file_without_a_section_for_the_node_is_refused(
    node: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The usual mistake: a bare name under a namespace."""
    file = tmp_path / 'mine.yaml'
    file.write_text(f'{node.NAME}: {{ros__parameters: {{}}}}\n')
    words = [
        *([BAG] if node is player else []),
        '--ros-args',
        '--params-file',
        str(file),
        '-r',
        '__ns:=/freeflyer',
        '-r',
        f'__node:={node.NAME}',
    ]
    full = f'/freeflyer/{node.NAME}'
    text = f"'{file}' has no section for node '{full}'; sections: /{node.NAME}; accepted: /** or {full}"
    refused(node, words, text, capfd)


def refused(node: Any, arguments: list[str], text: str, capfd: pytest.CaptureFixture[str]) -> None:
    command = partial(run, partial(run_node, node.NAME), name=node.NAME)
    error = answer(command, capfd, *arguments, code=2)
    assert error.startswith(f'mbaid_ros {node.NAME}: ')
    assert text in error
    assert '/src/' not in error


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_an_end_in_order(graph: Graph, number: signal.Signals) -> None:
    # A whole number is accepted where a broken one is meant.
    node = graph.start('estimator', *given(TABLE1, 'window:=1', 'noise.joint_position:=1e-5'))
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    graph.wait(lambda: estimates, 'the estimate that waits')
    assert node.stop(number) == 0
    assert not node.stdout
    assert all('[INFO]' in line for line in node.stderr.splitlines())


# -- Nodes that are interrupted while they start: nothing on stderr, and the exit code that shells give.

DELAYS = (0.0, 0.05, 0.15, 0.4, 0.8, 1.5)  # s after the process is able to take signals
PROGRAM = 'import sys; from mbaid_ros.nodes.start import {0}; sys.exit({0}())'
ARGUMENTS = {
    'estimator': [],
    'simulator': ['--ros-args', '-p', f'robot_description_file:={CONFIG / "table1.urdf"}'],
    'recorder': ['--ros-args', '-p', 'output:=run'],
}


def takes_signals(process: subprocess.Popen[str]) -> bool:
    """Return whether a handler for SIGTERM is there; Python itself has none."""
    status = Path(f'/proc/{process.pid}/status').read_text()
    caught = re.search(r'^SigCgt:\s*(\w+)$', status, re.MULTILINE)
    return caught is not None and bool(int(caught[1], 16) >> (signal.SIGTERM - 1) & 1)


def interrupted(name: str, number: signal.Signals, delay: float, folder: Path, domain: int) -> None:
    folder.mkdir()
    process = subprocess.Popen(
        [sys.executable, '-c', PROGRAM.format(name), *ARGUMENTS[name]],
        env={**os.environ, **LOCAL, 'ROS_DOMAIN_ID': str(domain)},
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while process.poll() is None and not takes_signals(process):
        time.sleep(0.001)
    time.sleep(delay)
    process.send_signal(number)
    _, error = process.communicate(timeout=PATIENCE)
    assert process.returncode in {0, 128 + number}, (delay, error)
    assert 'Traceback' not in error, delay


@pytest.mark.long
@pytest.mark.parametrize('number', SIGNALS)
@pytest.mark.parametrize('name', ARGUMENTS)
def test_an_interrupt_at_any_time_of_the_start(name: str, number: signal.Signals, tmp_path: Path) -> None:
    with reserved_domain() as (domain, _):
        for delay in DELAYS:
            interrupted(name, number, delay, tmp_path / str(delay), domain)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Give the process its own handlers back."""
    before = [signal.getsignal(number) for number in SIGNALS]
    yield
    for number, handler in zip(SIGNALS, before, strict=True):
        signal.signal(number, handler)


# -- The policy for SROS2 admits what the nodes do on the graph: no topic or service of theirs is missing in it.

POLICY = CONFIG / 'sros2' / 'mbaid_ros.policy.xml'
EVERYTHING = ['debris.report:=true', 'wheels.momentum_frame:=base_link']
MOVED = [
    f'robot_description_file:={CONFIG / "servicer7.urdf"}',
    'thrust.duration:=1.0',
    'publish_clock:=true',
    'imu.rate:=100.0',
]


def admitted(node: str) -> dict[str, set[str]]:
    """Return the full names that a node may subscribe to, publish and serve."""
    (enclave,) = ET.parse(POLICY).getroot().findall(f"enclaves/enclave[@path='/mbaid_ros/{node}']")
    (profile,) = enclave.findall('profiles/profile')
    assert (profile.get('ns'), profile.get('node')) == ('/', node)
    found: dict[str, set[str]] = {}
    for kind, what in (('subscribe', 'topic'), ('publish', 'topic'), ('reply', 'service')):
        names = [each.text or '' for each in profile.findall(f"*[@{kind}='ALLOW']/{what}")]
        found[kind] = {name.replace('~', f'/{node}') if name[0] in '~/' else f'/{name}' for name in names}
    return found


@pytest.mark.parametrize(
    ('make', 'parameters'),
    [(EstimatorNode, EVERYTHING), (EstimatorNode, ['pose.tf_child_frame:=base_link']), (SimulatorNode, MOVED)],
    ids=['estimator', 'on tf', 'simulator'],
)
def test_the_policy_admits_all_that_a_node_does(
    make: Callable[[], Node], parameters: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    with reserved_domain() as (domain, _):
        words = options(*parameters)
        rclpy.init(args=['', '--ros-args', *words], domain_id=domain)
        try:
            node = make()
            name = node.get_name()
            rules = admitted(name)
            done = {
                'subscribe': node.get_subscriber_names_and_types_by_node(name, '/'),
                'publish': node.get_publisher_names_and_types_by_node(name, '/'),
                'reply': node.get_service_names_and_types_by_node(name, '/'),
            }
        finally:
            rclpy.shutdown()
    for kind, pairs in done.items():
        names = {each for each, _ in pairs}
        assert names or kind == 'subscribe'
        assert names <= rules[kind]
