"""Reports on an estimate: the terminal of the node, its diagnostics, and `watch`."""

from __future__ import annotations

import os
import pty
import subprocess
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mbaid_msgs.msg import InertiaEstimate

from graph import PATIENCE, Graph, executable
from made_runs import BODY, HOSTILE, budget, estimate, planar
from mbaid_ros.core.noise import NoiseLevels
from mbaid_ros.estimate_messages import Frames, estimate_message
from mbaid_ros.nodes import diagnostics, publishers
from mbaid_ros.nodes.diagnostics import ERROR, OK, Diagnostics, RunState, estimate_report
from mbaid_ros.nodes.publishers import RunLog, headline
from mbaid_ros.nodes.subscriptions import LATCHED, TYPES
from mbaid_ros.nodes.watch import drawn, line, screen
from mbaid_ros.session.model_summary import summarise
from simulated import robot


class Log:
    """What a node logs, by level."""

    def __init__(self) -> None:
        self.reported: list[tuple[str, str]] = []

    def __getattr__(self, level: str) -> Any:
        return lambda text: self.reported.append((level, text))

    def at(self, level: str) -> list[str]:
        """Return what has been logged at a level."""
        return [text for each, text in self.reported if each == level]


@pytest.fixture(name='log')
def fresh_log() -> Log:
    return Log()


def test_the_robot_is_logged_with_its_oddities(log: Log) -> None:
    odd = replace(summarise(robot('servicer7'), 'link7', chosen=False), bare=('base_link',))
    RunLog(log).robot(odd, 'trajectory')
    assert log.at('info')[0].startswith("robot 'servicer7': 'base_link' floats")
    assert 'a guess' in log.at('info')[1]
    assert log.at('info')[-1] == 'method trajectory'
    assert "base 'base_link' has no inertia" in log.at('warning')[0]


def test_an_estimate_is_logged_when_its_status_is_new(log: Log) -> None:
    narrator = RunLog(log)
    course = ['waiting', 'estimating', 'estimating', 'converged', 'converged', 'estimating']
    for second, status in enumerate(course):
        narrator.estimate(estimate(time=float(second), status=status))
    reported = log.at('info')
    assert [text.split(':')[0] for text in reported] == [
        'first estimate, estimating after 1.0 s',
        'converged after 3.0 s',
        'estimating after 5.0 s',
    ]
    assert 'mass 162.000 ± 0.059 kg, com_x 0.33000 ± 0.00020 m' in reported[1]
    assert ', ± 95 %, ' in reported[1]
    assert len(log.at('debug')) == len(course)
    narrator.begin()
    narrator.estimate(estimate(status='estimating'))
    assert log.at('info')[-1].startswith('first estimate')


def test_data_that_contradict_the_model_are_a_warning_with_the_cause(log: Log) -> None:
    causes = (('the mass of link2 is off', 12.0),)
    RunLog(log).estimate(estimate(status='inconsistent', causes=causes, residual=7.0))
    assert log.at('warning')[0].endswith('residual 7, difference, likely cause: the mass of link2 is off')
    nothing = estimate(status='not_identifiable', parameters=np.full(10, np.nan), warnings=('nothing moves',))
    assert headline(nothing) == 'residual 1, difference, nothing moves'


# -- What the estimator's diagnostics say of an estimate.


def test_the_main_causes_of_the_variance_are_reported_without_a_warning() -> None:
    level, text, values = estimate_report(
        RunState(estimate=estimate(method='trajectory', stage='difference', budget=budget()))
    )
    reported = dict(values)
    assert (level, text) == (OK, 'converged')
    assert reported['stage'] == 'difference'
    assert str(reported['main causes of the variance']).startswith(
        'link base_link (71 % of mass), zero of joint6 (60 % '
    )
    assert reported['mass (kg)'] == '162.000 +- 0.059 (95 %)'
    assert reported['com_x (m)'] == '0.33000 +- 0.00020 (95 %)'


def test_the_likeliest_cause_of_a_contradiction_comes_first() -> None:
    causes = tuple((f'cause {number}', 50.0 - number) for number in range(5))
    level, text, values = estimate_report(
        RunState(estimate=estimate(status='inconsistent', warnings=('w',), causes=causes))
    )
    assert (level, text) == (ERROR, 'inconsistent: likely cause: cause 0')
    assert [value for key, value in values if key.startswith('likely cause')] == ['cause 0', 'cause 1', 'cause 2']
    _, text, values = estimate_report(RunState(estimate=estimate(warnings=('w',), causes=causes)))
    assert text == 'converged: w'
    assert not any(key.startswith('likely cause') for key, _ in values)


def test_the_noise_that_counts_is_reported_first() -> None:
    levels = NoiseLevels(
        declared=np.array([1e-4, np.nan, 1e-3, np.nan, 1e-3, 1e-4]),
        estimated=np.array([2e-4, 1e-3, np.nan, np.nan, 1e-3, 1e-4]),
        assumed=np.array([np.nan, np.nan, np.nan, 1e-4, np.nan, np.nan]),
        correlation_time=0.0,
        used=np.array([False, True, False, False, True, False]),
    )
    reported = dict(estimate_report(RunState(estimate=estimate(noise=levels)))[2])
    assert reported['noise of joint position (rad)'] == '0.0001 set, 0.0002 estimated'
    assert reported['noise of joint velocity (rad/s)'] == '0.001 estimated'
    assert reported['noise of base position (m)'] == '0.001 set'
    assert reported['noise of base orientation (rad)'] == '0.0001 assumed'
    assert reported['noise of base linear velocity (m/s)'] == '0.001 estimated, 0.001 set'


def test_a_wait_is_logged_once_for_each_reason(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    narrator = RunLog(log)
    monkeypatch.setattr(publishers, 'monotonic', lambda: np.inf)
    for reason in ('nothing publishes it', 'nothing publishes it', 'remap by -r pose:=/mocap/pose'):
        narrator.waiting([reason])
    assert log.at('warning') == ['waiting for nothing publishes it', 'waiting for remap by -r pose:=/mocap/pose']


def test_a_node_that_was_held_up_does_not_call_its_data_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(diagnostics, 'monotonic', lambda: clock[-1])
    topic: Any = SimpleNamespace(topic='/odom', received=9, lost=0, best_effort=False, publishers=list)
    topic.type_name = 'nav_msgs/msg/Odometry'
    found = Diagnostics({'odom': topic}, topic, '')
    found._used = -1  # a sample by the first report
    # Two and a half seconds without a report: its messages wait.
    for moment, silence in ((1.0, ''), (3.5, ''), (4.5, 'no messages on /odom for more than 2 s')):
        clock.append(moment)
        found.statuses(RunState(), 'estimator')
        assert found.silence(RunState()) == silence


def message(final: Any = None, link: str = 'link7', warnings: tuple[str, ...] = ()) -> InertiaEstimate:
    made: InertiaEstimate = estimate_message(
        estimate() if final is None else final, TYPES, Frames(link, 'odom'), warnings
    )
    return made


def test_a_screen_of_eighty_columns() -> None:
    lines = screen(message(warnings=('the base drifts',)), '/estimator/estimate', 80)
    assert lines[:3] == ['/estimator/estimate', 'converged: link7', '10.0 s, 1000 samples, difference']
    assert lines[4].startswith('mass     162.000 ±0.059    kg')
    assert lines[4].endswith(']')
    assert lines[-1] == '! the base drifts'


def test_one_line_has_everything() -> None:
    text = line(message(warnings=('one', 'two')))
    assert text.startswith('10.0 s, converged, mass 162.000 ±0.059 kg, com_x 0.33000 ±0.00020 m')
    assert text.endswith('! one; two')
    advice = 'best single joint: joint7'
    assert screen(message(warnings=('one',)), '/estimate', 80, advice=advice)[-2:] == [f'next: {advice}', '! one']
    assert line(message(warnings=('one',)), advice=advice).endswith(f', next: {advice}, ! one')


def test_hostile_names_are_text() -> None:
    hostile = message(estimate(budget=budget(HOSTILE)), HOSTILE, (HOSTILE,))
    hostile.method = hostile.stage = hostile.status = HOSTILE
    for text in (*screen(hostile, HOSTILE, 80), line(hostile)):
        assert text.isprintable()
    assert '\\x1b[2J' in line(hostile)
    assert drawn(screen(hostile, HOSTILE, 80), 50).replace('\x1b[H', '').replace('\x1b[K', '').count('\x1b') == 1


def test_piped_it_writes_a_line_an_update_of_any_or_a_named_namespace(graph: Graph) -> None:
    watch = graph.start('watch')
    publisher = graph.publisher('/servicer/one/estimate', InertiaEstimate, LATCHED)
    publisher.publish(message())
    graph.wait(lambda: watch.stdout.count('\n') == 1, 'a line')
    publisher.publish(message(planar()))
    graph.wait(lambda: watch.stdout.count('\n') == 2, 'another line')
    assert '\x1b' not in watch.stdout
    assert watch.stop() == 0
    # On a machine that stalls, it may have hinted before there was an estimator.
    assert all('no estimator in ROS_DOMAIN_ID' in each for each in watch.stderr.splitlines())
    named = graph.node.create_publisher(InertiaEstimate, '/servicer/estimator/estimate', LATCHED)
    named.publish(message(estimate(parameters=2.0 * BODY)))
    once = graph.start('watch', '/servicer/estimator', '--once')
    graph.wait(lambda: not once.running, 'the end')
    assert 'mass 324.000' in once.stdout
    assert once.stdout.count('\n') == 1


def test_a_terminal_shows_the_screen(graph: Graph, tmp_path: Path) -> None:
    """A pseudo-terminal of 40 columns: what it is sent, read back."""
    ours, theirs = pty.openpty()
    environment = {**graph.environment, 'TERM': 'xterm', 'COLUMNS': '40', 'LINES': '24'}
    with (tmp_path / 'err').open('w') as errors:
        process = subprocess.Popen([executable('watch')], stdout=theirs, stderr=errors, env=environment)
    os.close(theirs)
    os.set_blocking(ours, False)
    seen = b''

    def read() -> bool:
        nonlocal seen
        with suppress(OSError):  # nothing there yet, or the other end is closed
            seen += os.read(ours, 65536)
        return b'\x1b[J' in seen

    try:
        publisher = graph.publisher('/estimator/estimate', InertiaEstimate, LATCHED)
        publisher.publish(message())
        graph.wait(read, 'a screen')
    finally:
        process.terminate()
        end = time.monotonic() + PATIENCE
        while process.poll() is None and time.monotonic() < end:
            read()
        process.wait(PATIENCE)
        os.close(ours)
    assert b'waiting for an estimator' in seen
    text = seen.decode().split('\x1b[H')[-1].replace('\x1b[K', '').replace('\x1b[J', '')
    assert max(map(len, text.splitlines())) <= 40
    assert 'converged: link7' in text
    assert process.returncode == 0
