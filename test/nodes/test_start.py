"""Nodes that are interrupted while they start: nothing on stderr, and the exit code that shells give."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from graph import LOCAL, free_domain
from simulated import CONFIG

DELAYS = (0.0, 0.05, 0.15, 0.4, 0.8, 1.5)  # s after the process is able to take signals
PROGRAM = 'import sys; from mbaid_ros.nodes.start import {0}; sys.exit({0}())'
ARGUMENTS = {
    'estimator': [],
    'simulator': ['--ros-args', '-p', f'robot_description_file:={CONFIG / "table1.urdf"}'],
    'recorder': ['--ros-args', '-p', 'output:=run'],
}


def takes_signals(process: subprocess.Popen[str]) -> bool:
    """Tell whether a handler for SIGTERM is there; Python itself has none."""
    status = Path(f'/proc/{process.pid}/status').read_text()
    caught = re.search(r'^SigCgt:\s*(\w+)$', status, re.MULTILINE)
    return caught is not None and bool(int(caught[1], 16) >> (signal.SIGTERM - 1) & 1)


def test_what_comes_before_the_signals_are_handled_takes_no_time() -> None:
    program = 'import sys, mbaid_ros.nodes.start; print(*(name for name in sys.modules if "mbaid_ros." in name))'
    ended = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=True)
    assert set(ended.stdout.split()) == {'mbaid_ros.nodes', 'mbaid_ros.nodes.start'}


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('name', ARGUMENTS)
def test_an_interrupt_at_any_time_of_the_start(name: str, number: signal.Signals, tmp_path: Path) -> None:
    with free_domain() as domain:
        environment = {**os.environ, **LOCAL, 'ROS_DOMAIN_ID': str(domain)}
        for delay in DELAYS:
            folder = tmp_path / str(delay)
            folder.mkdir()
            process = subprocess.Popen(
                [sys.executable, '-c', PROGRAM.format(name), *ARGUMENTS[name]],
                env=environment,
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            while process.poll() is None and not takes_signals(process):
                time.sleep(0.001)
            time.sleep(delay)
            process.send_signal(number)
            _, error = process.communicate(timeout=60)
            assert process.returncode in {0, 128 + number}, (delay, error)
            assert 'Traceback' not in error, delay
