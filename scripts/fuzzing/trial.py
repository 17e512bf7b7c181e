"""One input through an executable in this process: exit code, stderr of Python and C++, processor time, memory."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import io
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

LONGEST, HANG = 10.0, 30.0  # s, of processor time and on the wall
MEMORY = 1_000_000_000  # bytes, beyond the memory before the input
_STUCK = 3 * HANG  # s, after which not even a signal's handler has run: this process ends with a traceback
_ACCEPTED = {0, 2, 3, 4}
_STDERR = 2
_NOTE = re.compile('mbaid_ros convert: note: .*\n')

Main = Callable[[Sequence[str]], int]


class TooLongError(BaseException):
    """An input takes too long; a reader's `except Exception` does not catch it."""


@dataclass(frozen=True)
class Trial:
    """The outcome of one input."""

    code: int
    error: str  # all of stderr
    taken: float  # s, of the processor
    memory: int  # bytes, at most, beyond those before

    def wrong(self, reported: Collection[int] = (2,)) -> str:
        """Return its fault; empty for none. Some exit codes need a line of error."""
        lines = [line for line in self.error.splitlines(keepends=True) if not _NOTE.match(line)]
        one = len(lines) == 1 and lines[0].startswith('mbaid_ros ') and lines[0].endswith('\n')
        if self.code not in _ACCEPTED or (lines and not one) or bool(lines) != (self.code in reported):
            return f'exit code {self.code}, {self.error[:1000]!r}'
        if self.memory > MEMORY:
            return f'{self.memory / 1e6:.0f} MB'
        return f'{self.taken:.1f} s' if self.taken > LONGEST else ''


@dataclass
class Found:
    """The outcome of many inputs."""

    inputs: int = 0
    codes: Counter[int] = field(default_factory=Counter)
    slowest: float = 0.0  # s, of the processor
    largest: int = 0  # bytes
    spent: float = 0.0  # s, by all
    wrong: list[str] = field(default_factory=list)

    def measured(self, taken: float, memory: int) -> None:
        """Count one input that took so many seconds and bytes."""
        self.inputs += 1
        self.spent += taken
        self.slowest = max(self.slowest, taken)
        self.largest = max(self.largest, memory)

    def __str__(self) -> str:
        """Return a line, and one for each of the first faults."""
        codes = ', '.join(f'{number} with exit code {code}' for code, number in sorted(self.codes.items()))
        each = 1e3 * self.spent / max(1, self.inputs)
        line = (
            f'{self.inputs} inputs{f" ({codes})" if codes else ""}; {each:.0f} ms each, slowest {self.slowest:.2f} s, '
            f'largest {self.largest / 1e6:.0f} MB; {len(self.wrong)} failures'
        )
        return '\n'.join([line, *self.wrong[:20]])


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """End a block by TooLongError after `LONGEST` of the processor or `HANG` on the wall."""

    def on_signal(number: int, _frame: object) -> None:
        limit = f'{LONGEST:g} s of the processor' if number == signal.SIGPROF else f'{HANG:g} s'
        raise TooLongError(f'more than {limit}')

    before = [(number, signal.signal(number, on_signal)) for number in (signal.SIGPROF, signal.SIGALRM)]
    faulthandler.dump_traceback_later(_STUCK, exit=True, file=sys.__stderr__ or _STDERR)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    signal.setitimer(signal.ITIMER_REAL, HANG)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()
        for number, handler in before:
            signal.signal(number, handler)


def memory_begins() -> int:
    """Reset the peak of this process's memory; return its present memory, bytes."""
    Path('/proc/self/clear_refs').write_text('5', encoding='ascii')
    return _memory('VmRSS')


def memory_peak() -> int:
    """Return the peak memory of this process since, bytes."""
    return _memory('VmHWM')


def _memory(name: str) -> int:
    lines = Path('/proc/self/status').read_text(encoding='ascii').splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(f'{name}:'))


def tried(main: Main, arguments: Sequence[str], words: BinaryIO) -> Trial:
    """Return the outcome of an executable; `words` is an open file for the lines that C++ writes on stderr."""
    error = io.StringIO()
    gc.unfreeze()  # otherwise `replay` counts all that earlier ones have frozen
    words.seek(0)
    words.truncate()
    usual = os.dup(_STDERR)
    os.dup2(words.fileno(), _STDERR)
    at_first, begin = memory_begins(), time.process_time()
    try:
        with (
            contextlib.redirect_stderr(error),
            contextlib.redirect_stdout(io.StringIO()),
            warnings.catch_warnings(),
            bounded(),
        ):
            for kind in (RuntimeWarning, UserWarning, FutureWarning):
                warnings.simplefilter('always', kind)  # otherwise the first input with a warning hides later ones
            code = main(arguments)
    finally:
        taken, memory = time.process_time() - begin, memory_peak() - at_first
        os.dup2(usual, _STDERR)
        os.close(usual)
    words.seek(0)
    return Trial(code, error.getvalue() + words.read().decode(errors='replace'), taken, memory)


def alone(main: Main, arguments: Sequence[str]) -> tuple[int, str]:
    """Return exit code and stderr of the same in a process of its own."""
    start = f'import sys; from {main.__module__} import {main.__name__} as main; sys.exit(main())'
    done = subprocess.run([sys.executable, '-c', start, *arguments], capture_output=True, timeout=HANG, check=False)
    return done.returncode, done.stderr.decode(errors='replace')
