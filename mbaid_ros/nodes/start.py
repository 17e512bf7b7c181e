"""The executables' entry points: they end at once on a signal while a node is being imported, which takes seconds.

Nothing has begun by then that would need completion. This is why everything slow is imported in a function.
"""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from importlib import import_module
from types import FrameType


def _leave(number: int, _frame: FrameType | None) -> None:
    os._exit(128 + number)


def _start(name: str) -> int:
    """Import a node, run it and return the exit code; `runner.ros` handles signals from its call on."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)
    from mbaid_ros.cli import run  # noqa: PLC0415 - after the signals
    from mbaid_ros.nodes.arguments import PARSERS  # noqa: PLC0415

    if not {'-h', '--help'}.isdisjoint(sys.argv):
        return run(lambda argv: bool(PARSERS[name]().parse(argv)), name=name)
    return run(import_module(f'mbaid_ros.nodes.{name}').main)


estimator, player, recorder, simulator, watch = (
    partial(_start, name) for name in ('estimator', 'player', 'recorder', 'simulator', 'watch')
)
