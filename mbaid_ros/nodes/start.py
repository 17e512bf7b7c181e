"""The executables' entry points: what a signal does while a node is still being imported, which takes seconds.

Nothing has begun by then, so that there is nothing to complete: the process ends at once, as a shell expects. This is
why all that takes time is imported in a function.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def _leave(number: int, _frame: FrameType | None) -> None:
    os._exit(128 + number)


def _start(name: str) -> int:
    """Import a node and run it; it has its own way with signals from `runner.ros` on."""
    for number in _SIGNALS:
        signal.signal(number, _leave)
    if not {'-h', '--help'}.isdisjoint(sys.argv):
        from mbaid_ros.cli import run  # noqa: PLC0415 - after the signals
        from mbaid_ros.nodes.runner import PARSERS  # noqa: PLC0415

        return run(lambda argv: bool(PARSERS[name]().parse(argv)), name=name)
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
