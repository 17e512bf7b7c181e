"""The demo as `make demo` runs it, shortened: what it prints, what it leaves, and that it leaves no process behind."""

from __future__ import annotations

import json
import os
import re
import runpy
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Inertia
from mbaid_msgs.msg import InertiaEstimate

from graph import PATIENCE, ROOT

SCRIPT = ROOT / 'scripts' / 'demo.py'


def start(*arguments: object) -> subprocess.Popen[str]:
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
    demo = start('--duration', 12, '--speed', 6, '--output', tmp_path)
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
    assert 'Furthest from the truth that came with the bag is' in report
    assert '>truth</th>' in report
    result = json.loads((tmp_path / 'report.json').read_text())
    assert result['estimate']['mass'] == pytest.approx(934.45, rel=0.01)
    assert result['span_s'] > 6.0  # the recorder finds the topics a moment after they appear, six times as fast as real


def test_an_interrupted_demo_leaves_no_process_behind(tmp_path: Path) -> None:
    demo = start('--output', tmp_path)
    assert demo.stdout is not None
    while 'truth' not in demo.stdout.readline():
        assert demo.poll() is None
    os.kill(demo.pid, signal.SIGTERM)
    demo.communicate(timeout=PATIENCE)
    assert demo.returncode == 130
    assert not processes_of(demo.pid)


def inertia(**changed: float) -> Any:
    values = {'m': 934.45, 'izz': 3435.0, 'x': 2.3, 'y': 0.9, **changed}
    made = Inertia(m=values['m'], izz=values['izz'])
    made.com.x, made.com.y = values['x'], values['y']
    return made


def test_the_demo_fails_where_a_parameter_is_off_or_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, 'environ', dict(os.environ))  # of which the script changes some
    demo = runpy.run_path(str(SCRIPT))
    assert demo['judge'](InertiaEstimate(inertia=inertia(m=926.0)), inertia()) == ''
    wrong = InertiaEstimate(inertia=inertia(x=2.33, y=float('nan')))
    assert demo['judge'](wrong, inertia()) == 'x_c is off by +1.30 %, y_c is not determined'
