"""One input through an executable in this process: exit code, stderr of Python and C++, processor time, memory."""

import contextlib
import faulthandler
import gc
import io
import os
import re
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

LONGEST, HANG = 10.0, 30.0  # s, of processor time and on the wall
MEMORY = 500_000_000  # bytes, beyond the memory before the input
_STUCK = 3 * HANG  # s, after which not even a signal's handler has run: this process ends with a traceback
_ACCEPTED = {0, 2, 3, 4}
_STDERR = 2
_NOTE = re.compile('mbaid_ros convert: note: .*\n')

Main = Callable[[Sequence[str]], int]


class TooLongError(BaseException):
    """An input takes too long; a reader's `except Exception` does not catch it."""


@dataclass
class Found:
    """The outcome of many inputs."""

    codes: Counter[int] = field(default_factory=Counter)
    slowest: float = 0.0  # s, of the processor
    largest: int = 0  # bytes, beyond those before
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        """Return a line, and one for each of the first faults."""
        codes = ', '.join(f'{number} with exit code {code}' for code, number in sorted(self.codes.items()))
        cost = f'slowest {self.slowest:.2f} s, largest {self.largest / 1e6:.0f} MB'
        return '\n'.join([f'{codes}; {cost}; {len(self.wrong)} failures', *self.wrong[:20]])

    def add(self, main: Main, arguments: Sequence[str], reported: Collection[int]) -> str:
        """Run an executable, count its outcome and return its fault, empty for none; some exit codes need a line."""
        gc.unfreeze()  # otherwise `replay` counts all that earlier ones have frozen
        # Bytes: the peak of this process's memory is counted anew from here on.
        Path('/proc/self/clear_refs').write_text('5', encoding='ascii')
        at_first, begin = memory_of('VmRSS'), time.process_time()
        try:
            with _stderr() as words, contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(), _bounded():
                for kind in (RuntimeWarning, UserWarning, FutureWarning):
                    warnings.simplefilter('always', kind)  # otherwise the first input with a warning hides later ones
                code = main(arguments)
            words.seek(0)
            error = words.read()
        except (Exception, TooLongError) as reason:  # noqa: BLE001 - that none comes out is what is tested
            return f'{type(reason).__name__}: {reason}'
        taken, memory = time.process_time() - begin, memory_of('VmHWM') - at_first
        self.codes[code] += 1
        self.slowest, self.largest = max(self.slowest, taken), max(self.largest, memory)
        lines = [line for line in error.splitlines(keepends=True) if not _NOTE.match(line)]
        one = len(lines) == 1 and lines[0].startswith('mbaid_ros ') and lines[0].endswith('\n')
        if code not in _ACCEPTED or (lines and not one) or bool(lines) != (code in reported):
            return f'exit code {code}, {error[:1000]!r}'
        return f'{memory / 1e6:.0f} MB' if memory > MEMORY else f'{taken:.1f} s' if taken > LONGEST else ''


@contextlib.contextmanager
def _stderr() -> Iterator[TextIO]:
    """Collect in a file what Python and C++ write on stderr."""
    words = tempfile.TemporaryFile('w+', encoding='utf-8', errors='replace')  # noqa: SIM115 - read after the block
    usual = os.dup(_STDERR)
    os.dup2(words.fileno(), _STDERR)
    try:
        with contextlib.redirect_stderr(words):
            yield words
    finally:
        words.flush()
        os.dup2(usual, _STDERR)
        os.close(usual)


@contextlib.contextmanager
def _bounded() -> Iterator[None]:
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


def memory_of(name: str) -> int:
    """Return one of the sizes that /proc has of this process, bytes."""
    lines = Path('/proc/self/status').read_text(encoding='ascii').splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(f'{name}:'))
