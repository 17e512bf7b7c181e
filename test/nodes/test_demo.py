"""The demo as `make demo` runs it, shortened, the live loop of plan and motion, and the simulator as a node."""

from __future__ import annotations

import itertools
import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import InertiaStamped
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from graph import PATIENCE, ROOT, Graph, Process
from mbaid_ros.bags import BagReader
from mbaid_ros.config.motion_files import as_yaml, read_trajectory
from mbaid_ros.estimate_messages import trajectory_message
from mbaid_ros.nodes.simulator import Pace
from mbaid_ros.nodes.subscriptions import TYPES, qos
from mbaid_ros.replay.arguments import plan as replay_plan
from planned import first_motion
from simulated import CONFIG, NOISE, assigned, options
from streams import run

SCRIPT = ROOT / 'scripts' / 'demo.py'


def start_demo(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True)


def processes_of(group: int) -> list[int]:
    """Return the processes of a process group."""
    members = []
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            fields = (folder / 'stat').read_text().rpartition(')')[2].split()
        except (FileNotFoundError, ProcessLookupError):  # ended in between
            continue
        if int(fields[2]) == group:
            members.append(int(folder.name))
    return members


def test_the_demo_shows_the_estimate_converging_to_the_truth(tmp_path: Path) -> None:
    demo = start_demo('--duration', 15, '--speed', 3, '--output', tmp_path)
    out, err = demo.communicate(timeout=3 * PATIENCE)
    assert (demo.returncode, err) == (0, '')
    assert not processes_of(demo.pid)
    assert '\x1b' not in out
    assert '\r' not in out
    assert re.search(r'truth +934\.45 +2\.3000 +0\.9000 +3435\.0', out)
    rows = re.findall(r'^ *(\d+\.\d) s  \w+', out, re.MULTILINE)
    assert rows[:3] == ['2.0', '4.0', '6.0']
    assert 'Every parameter is within 1 % of the truth' in out
    assert f'report    {tmp_path / "report.html"}' in out
    report = (tmp_path / 'report.html').read_text()
    assert report.lstrip().startswith('<!')
    assert 'Largest deviation from the truth beside the bag:' in report
    assert '>truth</th>' in report
    result = json.loads((tmp_path / 'report.json').read_text())
    assert result['estimate']['mass'] == pytest.approx(934.45, rel=0.01)
    assert result['span_s'] > 6.0  # the recorder finds the topics a moment after they appear, six times as fast as real


# -- The live loop: a simulated robot is identified, a motion planned, followed, and more is known than before.

PLAN = {'effort': 10, 'duration': 5.0, 'joint_velocity': 0.05, 'base_rotation': 0.02}


def stamp(message: Any) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec


def last_stamp(bag: Path) -> tuple[int, int]:
    """Return that of the last joint state in a bag so far."""
    with BagReader(bag) as reader:
        return max((stamp(message) for _, message, _ in reader.read(['/joint_states'])), default=(0, 0))


@pytest.mark.long
def test_a_planned_motion_is_followed_and_determines_the_uncertain_parameters(graph: Graph, tmp_path: Path) -> None:
    (tmp_path / 'first.yaml').write_text(as_yaml(first_motion('servicer7', 6.0)))
    plan = assigned({f'plan.{name}': value for name, value in PLAN.items()})
    file = CONFIG / 'servicer7_estimator.yaml'
    estimator = graph.start('estimator', '--ros-args', '--params-file', file, *plan)
    graph.start('recorder', '--ros-args', '-p', f'output:={tmp_path / "bag"}')
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    watch = graph.start('watch')
    states = graph.collect('/joint_states', JointState, qos(10_000))
    given = {
        'robot_description_file': CONFIG / 'servicer7.urdf', 'joint_rate': 20.0, 'odometry_rate': 20.0,
        'real_time_factor': 4.0, 'wait_for_subscribers': 2, 'motion.kind': 'trajectory',
        'motion.trajectory_file': tmp_path / 'first.yaml', **{f'noise.{name}': size for name, size in NOISE.items()},
    }  # fmt: skip
    graph.start('simulator', '--ros-args', *assigned(given))
    graph.wait(lambda: estimates and estimates[-1].span.sec >= 7, 'an estimate after the first motion')
    before = estimates[-1]
    graph.wait(lambda: 'next: best single joint: ' in estimator.stderr, 'in the log what would help')
    graph.wait(lambda: "key='next', value='best single joint: " in str(diagnostics), 'the same in the diagnostics')
    graph.wait(lambda: ', next: best single joint: ' in watch.stdout, 'the same in the terminal')
    # From the bag that is still being recorded, once a flush has brought it a sample of the robot at rest.
    motion, model, rested = tmp_path / 'motion.yaml', CONFIG / 'servicer7.urdf', stamp(states[-1])
    graph.wait(lambda: last_stamp(tmp_path / 'bag') >= rested, 'a flush of the recorder')
    planned = replay_plan(
        [str(tmp_path / 'bag'), '--model', str(model), '--params', str(file), *plan, '--yaml', str(motion)]
    )
    assert planned in {0, 3}  # whether it reaches the wanted precision or not
    trajectory = read_trajectory(motion)
    assert trajectory.duration == 5.0
    assert trajectory.position[0] == pytest.approx(np.array(states[-1].position), abs=2e-3)

    graph.publisher('/joint_trajectory', JointTrajectory).publish(trajectory_message(trajectory, TYPES))
    end = trajectory.position[-1]
    graph.wait(lambda: np.abs(np.array(states[-1].position) - end).max() < 2e-3, 'the end of the motion')
    done = estimates[-1].span.sec
    graph.wait(lambda: estimates[-1].span.sec > done, 'an estimate after the motion')
    assert np.all(estimates[-1].standard_deviation < before.standard_deviation)


DEEP = qos(10_000)


def start(graph: Graph, *parameters: str, ns: str = '/') -> Process:
    """Start a simulator of the paper's case."""
    words = options(f'robot_description_file:={CONFIG}/table1.urdf', *parameters)
    file = CONFIG / 'table1_simulator.yaml'
    return graph.start('simulator', '--ros-args', '--params-file', file, '-r', f'__ns:={ns}', *words)


def test_what_it_publishes(graph: Graph) -> None:
    joints = graph.collect('joint_states', JointState, DEEP)
    odometry = graph.collect('odom', Odometry, DEEP)
    descriptions = graph.collect('robot_description', String)
    truths = graph.collect('simulator/truth', InertiaStamped)
    node = start(graph, 'duration:=0')
    graph.wait(lambda: len(joints) > 20 and len(odometry) > 20 and descriptions and truths, 'every topic')
    assert node.stop(signal.SIGTERM) == 0
    assert 'Traceback' not in node.stderr

    assert descriptions[0].data == (CONFIG / 'table1.urdf').read_text()
    assert (truths[0].header.frame_id, truths[0].inertia.m) == ('link4', 934.45)
    assert (odometry[0].header.frame_id, odometry[0].child_frame_id) == ('odom', 'base_link')
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in joints]
    assert {later - earlier for earlier, later in itertools.pairwise(stamps)} == {10_000_000}


def test_it_is_the_run_of_the_core_and_ends_after_its_duration(graph: Graph) -> None:
    clock = graph.collect('/clock', Clock, DEEP)
    joints = graph.collect('joint_states', JointState, DEEP)
    odometry = graph.collect('odom', Odometry, DEEP)
    node = start(graph, 'publish_clock:=true', 'real_time_factor:=8', 'duration:=4', 'wait_for_subscribers:=1')
    graph.wait(lambda: len(joints) == len(odometry) == 401 and clock[-1].clock.sec == 4, 'every message')
    assert node.wait() == 0
    expected = run('table1', 4.01, start=0)
    assert joints == [timed.message for timed in expected if timed.topic == 'joint_states']
    assert odometry == [timed.message for timed in expected if timed.topic == 'odom']
    seconds = [message.clock.sec + 1e-9 * message.clock.nanosec for message in clock]
    assert seconds == sorted(seconds)


# --


def test_a_run_goes_by_the_clock_and_is_late_after_a_standstill() -> None:
    clock = [100.0]
    pace = Pace(10.0, 2.0, lambda: clock[0])
    pace.begin()
    assert pace.now() == 0.0
    for seconds in (0.125, 0.1875):  # less than may be printed at once
        clock[0] += seconds
        assert pace.now() == pytest.approx(10.0 * (clock[0] - 100.0))
        assert pace.late == 0.0
    clock[0] += 5.0  # 50 s of the run, of which 2 s are printed
    assert pace.now() == pytest.approx(5.125)
    assert pace.late == pytest.approx(4.8)
    assert pace.now() == pytest.approx(5.125)
    clock[0] += 0.1
    assert pace.now() == pytest.approx(6.125)
    assert pace.late == pytest.approx(4.8)
