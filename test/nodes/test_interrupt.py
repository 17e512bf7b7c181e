"""An interrupt: noticed between callbacks, never in the middle of one."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

from mbaid_ros.nodes.runner import Interrupt

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Give the process its own handlers back."""
    before = [signal.getsignal(number) for number in SIGNALS]
    yield
    for number, handler in zip(SIGNALS, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize('number', SIGNALS)
def test_what_runs_when_a_signal_comes_is_not_cut_short(number: signal.Signals) -> None:
    interrupt = Interrupt()
    assert not interrupt.requested
    for _ in range(2):  # a launcher and a terminal may both send one
        os.kill(os.getpid(), number)
    assert interrupt.requested
