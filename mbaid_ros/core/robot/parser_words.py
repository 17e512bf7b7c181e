"""What pinocchio's URDF parser writes on stderr by itself, past Python, kept from there."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_STDERR = 2  # descriptor of the stream that the parser complains on
_COMPLAINT = re.compile(r'^Error:\s+(.*)$', re.MULTILINE)
_MOST = 10_000  # bytes that are looked at: a broken file has no end of complaints
_one_at_a_time = threading.Lock()


@contextmanager
def kept_words(complaints: list[str]) -> Iterator[None]:
    """Keep what C++ code writes on stderr during a block, and add its complaints to a list, the first ones first."""
    with _one_at_a_time:
        try:
            usual = os.dup(_STDERR)
        except OSError:  # a process without stderr has nothing to keep clean
            yield
            return
        with tempfile.TemporaryFile() as kept:
            with suppress(AttributeError):  # no stream of Python's, as under pythonw
                sys.stderr.flush()
            os.dup2(kept.fileno(), _STDERR)
            try:
                yield
            finally:
                os.dup2(usual, _STDERR)
                os.close(usual)
                kept.seek(0)
                complaints += _COMPLAINT.findall(kept.read(_MOST).decode(errors='replace'))
