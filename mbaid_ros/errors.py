"""The exceptions: one root; each message is one line with the parameter or file, its value and the accepted ones."""

from __future__ import annotations

from collections.abc import Iterable


class MbaidError(Exception):
    """Root of every error a user can cause; its text is one line, ready to be shown."""


class ModelError(MbaidError):
    """A robot description that cannot be used."""


class DataError(MbaidError):
    """Recorded or received data that cannot be used."""


class ParameterError(MbaidError):
    """A parameter or argument out of its range, of the wrong type, or unknown."""


def listing(names: Iterable[str], limit: int = 20) -> str:
    """Return names as ``a, b, c`` for a message, cut after `limit` entries and 60 characters each."""
    known = [name if len(name) <= 60 else name[:57] + '...' for name in names]
    if len(known) > limit:
        known = [*known[:limit], f'... ({len(known) - limit} more)']
    return ', '.join(known) or 'none'
