"""`watch`: what is shown on a terminal of any width, in a pipe, and of hostile names."""

from __future__ import annotations

import os
import pty
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from mbaid_msgs.msg import InertiaEstimate

from graph import PATIENCE, Graph, executable
from made_runs import BODY, HOSTILE, budget, estimate, planar
from mbaid_ros.nodes.subscriptions import LATCHED, TYPES
from mbaid_ros.nodes.watch import drawn, line, screen
from mbaid_ros.outgoing import Frames, estimate_message


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
    assert (watch.stop(), watch.stderr) == (0, '')
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
