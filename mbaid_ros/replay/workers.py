"""Processes that work beside this one, and end with it."""

from __future__ import annotations

import argparse
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from traceback import format_exc
from types import TracebackType
from typing import TypeVar, cast

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


class ProcessDiedError(Exception):
    """A process has died over its work: it was killed, or memory ran out."""


class Workers:
    """Processes that work, as a context: at its end they end; after an error or an interrupt, at once.

    They are new ones (spawn), not copies of this one with locks that its threads hold. Each has a pipe of its own and a
    thread here that waits for it: none shares a lock or a queue with another, which one that is killed could keep. An
    interrupt from the terminal, which reaches every process, is left to this one, and they end when it is killed.

    Parameters
    ----------
    count : how many
    common : first argument of every call
    """

    def __init__(self, count: int, common: object) -> None:
        context = get_context('spawn')
        self._threads = ThreadPoolExecutor(count)
        self._idle: SimpleQueue[Connection] = SimpleQueue()
        self._processes: list[SpawnProcess] = []
        for _ in range(count):
            ours, theirs = context.Pipe()
            process = context.Process(target=_work, args=(theirs, common), daemon=True)
            # It inherits the mask, for it could be interrupted before it begins to ignore that.
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                process.start()
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()
            self._processes.append(process)
            self._idle.put(ours)

    def submit(self, function: Callable[..., T], *arguments: object) -> Future[T]:
        """Have a function called in one of the processes, with the common argument and others.

        The result raises what the function raises, and ProcessDiedError where its process has died.
        """
        return self._threads.submit(self._called, function, *arguments)

    def _called(self, function: Callable[..., T], *arguments: object) -> T:
        """Return what a function leads to in a process that is idle: there are as many of them as threads."""
        pipe = self._idle.get()
        try:
            pipe.send((function, arguments))
            result, error, trace = pipe.recv()
        except (EOFError, OSError) as lost:
            raise ProcessDiedError from lost
        finally:
            self._idle.put(pipe)
        if error is not None:
            raise error from RuntimeError(trace)  # where it was raised
        return cast('T', result)

    def __enter__(self) -> Workers:
        """Return the processes."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the processes."""
        if kind is not None:
            for process in self._processes:
                process.kill()
        self._threads.shutdown(cancel_futures=True)
        while not self._idle.empty():
            self._idle.get().close()
        for process in self._processes:
            process.join()


def _work(pipe: Connection, common: object) -> None:
    """Call what comes through a pipe until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            function, arguments = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send((function(common, *arguments), None, ''))
        except Exception as error:  # noqa: BLE001  # raised where the result is asked for
            pipe.send((None, error, format_exc()))


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
