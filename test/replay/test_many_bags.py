"""`replay` of many bags: on all cores, with the results of one after the other."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

import recorded
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.report import html
from mbaid_ros.replay.run import replay_bag
from mbaid_ros.replay.start import replay as main
from simulated import CONFIG

MODEL = str(CONFIG / 'table1.urdf')
QUICK = ('--model', MODEL, '--method', 'difference')
DURATIONS = (8.0, 3.0, 5.0)


@pytest.fixture(scope='module', name='bags')
def three_bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp('many')
    return [str(recorded.papers_case(folder / f'{length:g}_s', length, 20.0)) for length in DURATIONS]


def test_many_bags_lead_to_what_each_leads_to_alone(
    capsys: pytest.CaptureFixture[str], bags: list[str], tmp_path: Path
) -> None:
    alone = []
    for bag in bags:
        main([bag, *QUICK, '--json', '-'])
        alone.append(without_origin(capsys.readouterr().out))
    report = tmp_path / 'report.html'
    main([*bags, *QUICK, '--json', '-', '--report', str(report), '--processes', '2'])
    together = capsys.readouterr()
    assert together.err == ''
    assert [without_origin(json.dumps(result)) for result in json.loads(together.out)] == alone
    urdf = Path(MODEL).read_text()
    runs = [replay_bag(bag, EstimatorConfig(method='difference'), urdf, Inputs()) for bag in bags]
    page, foot = report.read_text().split('<footer>')
    assert page == html(runs, [None] * len(runs)).split('<footer>')[0]
    assert foot.count('SHA-256') == 1 + len(bags)


def without_origin(text: str) -> str:
    """Return a result without the command and the date that made it."""
    result = json.loads(text)
    assert result.pop('made_by')['robot']['name'] == 'table1'
    return json.dumps(result)


@contextmanager
def on_a_terminal(*arguments: str) -> Iterator[tuple[subprocess.Popen[bytes], Iterator[str]]]:
    """Run `replay` with a terminal; give the process, and what it shows until it and all that it started have ended."""
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack('4H', 24, 100, 0, 0))  # a terminal without a width shows no bar
    command = [sys.executable, '-c', 'from mbaid_ros.replay.start import replay; exit(replay())', *arguments]
    process = subprocess.Popen(
        command,
        stdin=its,
        stdout=its,
        stderr=its,
        start_new_session=True,
        preexec_fn=_interruptible,  # noqa: PLW1509 - one call of the kernel
    )
    os.close(its)
    try:
        yield process, shown_on(ours)
    finally:
        process.kill()
        process.wait()
        os.close(ours)


def _interruptible() -> None:
    """Take interrupts as on a terminal: what a shell starts in the background ignores them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def shown_on(terminal: int) -> Iterator[str]:
    with suppress(OSError):  # nobody has the terminal open any more
        while True:
            yield os.read(terminal, 65536).decode(errors='replace')


def at_work(shown: Iterator[str]) -> str:
    """Read until the bar shows that a part of the bags is done; return what was shown."""
    text = ''
    while not re.search(r'\| (?!0\.0)\d+\.\d/\d+ bags', text):
        text += next(shown)
    return text


def test_an_interrupt_ends_all_processes_without_a_word(bags: list[str]) -> None:
    with on_a_terminal(*bags * 200, '--model', MODEL, '--processes', '2') as (process, shown):
        text = at_work(shown)
        os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does
        text += ''.join(shown)
        assert process.wait() == 130
    assert 'Traceback' not in text
    assert len(set(re.findall(r'/(\d+) bags', text))) == 1
