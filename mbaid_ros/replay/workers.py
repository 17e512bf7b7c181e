"""Processes that work beside this one, and end with it."""

from __future__ import annotations

import argparse
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import active_children, get_context, parent_process
from types import TracebackType
from typing import TypeVar

T = TypeVar('T')


def add_processes_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that says how many processes work at the same time."""
    parser.add_argument(
        '--processes',
        type=_count,
        default=_cores(),
        metavar='N',
        help='that work at the same time (default: one a core)',
    )


class Workers:
    """A pool of processes, as a context: at its end they end; after an error or an interrupt, at once.

    They are new ones (spawn), not copies of this one with locks that its threads hold. An interrupt from the terminal,
    which reaches every process, is left to this one, and they end when it is killed.

    What goes to and fro should fit into a pipe's buffer (64 kB): of a larger message a process that is ended may leave
    a part, whose rest would be waited for without end. What is large belongs in the common argument, or in files.

    Parameters
    ----------
    count : how many, at most
    common : first argument of every call
    """

    def __init__(self, count: int, common: object) -> None:
        self._others = set(active_children())
        self._pool = ProcessPoolExecutor(count, get_context('spawn'), _begin, (common,))

    def submit(self, function: Callable[..., T], *arguments: object) -> Future[T]:
        """Have a function called in one of the processes, with the common argument and others.

        Raises
        ------
        BrokenProcessPool
            One of the processes has died.
        """
        # A process starts here where one is needed; it inherits the mask, for it could be interrupted before _begin.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(_call, function, *arguments)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def __enter__(self) -> Workers:
        """Return the pool."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the processes."""
        if kind is not None:
            for process in set(active_children()) - self._others:
                process.terminate()
        self._pool.shutdown(cancel_futures=True)


_common: list[object] = []  # in a worker process: the first argument of every call


def _begin(common: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _common.append(common)


def _call(function: Callable[..., T], *arguments: object) -> T:
    return function(_common[0], *arguments)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: a whole number >= 1")
    return int(text)


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))
