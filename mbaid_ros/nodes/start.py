"""The executables' entry points: what a signal does while a node is still being imported, which takes seconds.

Nothing has begun by then, so that there is nothing to complete: the process ends at once, as a shell expects. This is
why the nodes' modules are imported in a function.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module
from types import FrameType

from mbaid_ros.cli import run
from mbaid_ros.nodes.arguments import PARSERS

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def _leave(number: int, _frame: FrameType | None) -> None:
    os._exit(128 + number)


def _start(name: str) -> int:
    """Import a node and run it; it has its own way with signals from `runner.ros` on."""
    if not {'-h', '--help'}.isdisjoint(sys.argv):
        return run(lambda argv: bool(PARSERS[name]().parse(argv)), name=name)
    for number in _SIGNALS:
        signal.signal(number, _leave)
    code: int = import_module(f'mbaid_ros.nodes.{name}').main()
    return code


def estimator() -> int:
    """Run the node `estimator` and return the exit code."""
    return _start('estimator')


def player() -> int:
    """Run the node `player` and return the exit code."""
    return _start('player')


def recorder() -> int:
    """Run the node `recorder` and return the exit code."""
    return _start('recorder')


def simulator() -> int:
    """Run the node `simulator` and return the exit code."""
    return _start('simulator')


def watch() -> int:
    """Run `watch` and return its exit code."""
    return _start('watch')
