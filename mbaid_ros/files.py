"""Whole files: regular ones only, read up to a bound, as text or JSON; written so that none is ever half there."""

from __future__ import annotations

import codecs
import json
import math
import os
import re
import stat
from pathlib import Path
from typing import Any

from mbaid_ros import limits
from mbaid_ros.errors import DataError, MbaidError, ParameterError

# Byte order marks, longer ones first, and XML's beginning without one.
_MARKS = (
    *((codecs.BOM_UTF32_LE, 'utf-32'), (codecs.BOM_UTF32_BE, 'utf-32'), (codecs.BOM_UTF8, 'utf-8-sig')),
    *((codecs.BOM_UTF16_LE, 'utf-16'), (codecs.BOM_UTF16_BE, 'utf-16')),
    *((b'<\0?\0', 'utf-16-le'), (b'\0<\0?', 'utf-16-be')),
)
_DECLARED = re.compile(rb"""\s*<\?xml[^>]*?\bencoding\s*=\s*["']([\w.:-]{1,40})["']""")
_DECLARATION = re.compile(r"""(\s*<\?xml[^>]*?\bencoding\s*=\s*["'])[\w.:-]+""")
# Encodings of texts among Python's codecs, others of which unpack, escape or take long.
_ENCODINGS = re.compile(
    r'ascii|utf-(8|16|32).*|iso(8859|2022).*|cp\d+|gb2312|gbk|gb18030|hz|big5.*|euc_.*|shift_jis.*|johab|koi8.*|mac-.*'
    r'|tis-620|kz1048|ptcp154'
)
_PART = 40  # characters of a name that the name of a file in the making has


def require_regular(path: str | Path, kind: str, error: type[MbaidError] = DataError) -> None:
    """Raise an error about a `kind` of file if it is no regular file: opening a pipe or a device may never end."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError) as reason:
        raise error(f"cannot read {kind} '{path}': {_why(reason)}") from reason
    if not stat.S_ISREG(mode):
        raise error(f"cannot read {kind} '{path}': it is {_named(mode)}; accepted: a regular file")


def read_text(
    path: str | Path, kind: str, limit: int, accepted: str = '', error: type[MbaidError] = ParameterError
) -> str:
    """Return the content of a text file of at most `limit` characters, without a byte order mark.

    Raises MbaidError: The file cannot be read, is no regular file, is no text (`accepted` ends that message), or is
    longer.
    """
    require_regular(path, kind, error)
    try:
        # Should it have become a pipe by now, this does not wait for someone to write.
        with open(path, encoding='utf-8-sig', opener=_without_waiting) as file:
            text = file.read(limit + 1)
    except OSError as reason:
        raise error(f"cannot read {kind} '{path}': {_why(reason)}") from reason
    except UnicodeDecodeError as reason:
        hint = f'; {accepted}' if accepted else ''
        raise error(f"{kind} '{path}' is not text in UTF-8{hint}") from reason
    if len(text) > limit:
        raise error(f"{kind} '{path}' has more than {limit} characters, which is the limit")
    return text


def read_xml(path: str | Path, kind: str, limit: int, error: type[MbaidError]) -> str:
    """Return the text of an XML document of at most `limit` characters, which then declares to be in UTF-8.

    It is read in the encoding of its byte order mark, or else in the one that it declares.

    Raises MbaidError: The file cannot be read, is no regular file, is no text of that encoding, or is longer.
    """
    require_regular(path, kind, error)
    try:
        with open(path, 'rb', opener=_without_waiting) as file:
            content = file.read(4 * limit + 5)  # of the widest characters, and a mark
    except OSError as reason:
        raise error(f"cannot read {kind} '{path}': {_why(reason)}") from reason
    name, declared = 'utf-8', _DECLARED.match(content)
    if declared:
        name = declared[1].decode('ascii')
    name = next((encoding for mark, encoding in _MARKS if content.startswith(mark)), name)
    try:
        if not _ENCODINGS.fullmatch(codecs.lookup(name).name):
            raise LookupError
        text = content.decode(name).removeprefix('\ufeff')
    except LookupError as reason:
        raise error(f"{kind} '{path}' states the encoding '{name}', which is not known; accepted: UTF-8") from reason
    except UnicodeError as reason:
        hint = 'as it states' if declared else 'and states no other encoding'
        raise error(f"{kind} '{path}' is not text in {name.upper()}, {hint}; save it in UTF-8") from reason
    if len(text) > limit:
        raise error(f"{kind} '{path}' has more than {limit} characters, which is the limit")
    return _DECLARATION.sub(r'\g<1>utf-8', text, count=1) if _DECLARATION.match(text) else text


def require_writable(option: str, path: str | None) -> None:
    """Refuse, before the long work, a file of an option that could not be written after it; None is no file.

    Raises ParameterError: It is in no folder that exists, or a folder itself.
    """
    if path is not None and (not path or not Path(path).parent.is_dir() or Path(path).is_dir()):
        raise ParameterError(f"{option} '{path}' cannot be written; accepted: a file in a folder that exists")


def write_text(path: str | Path, text: str) -> None:
    """Write a file so that at every instant it is there as a whole; a device is written to. Escapes as `as_utf8`.

    Raises OSError: It cannot be written; the old file stays.
    """
    target = Path(path).resolve()
    device = target.exists() and not target.is_file()
    new = target if device else target.with_name(f'.{target.name[:_PART]}.{os.getpid()}.new')
    try:
        new.write_text(as_utf8(text), encoding='utf-8')
        if not device:
            new.replace(target)
    except OSError as reason:  # which names the temporary file, or none
        raise OSError(reason.errno, reason.strerror, str(path)) from reason
    finally:
        if not device:
            new.unlink(missing_ok=True)


def as_utf8(text: str) -> str:
    """Return a text with bytes outside UTF-8, as in names of files, escaped as in JSON, which reads it back."""
    return text.encode('utf-8', 'backslashreplace').decode('utf-8')


def parse_json(text: str) -> Any:
    """Return the contents of a JSON document; numbers that no float can hold are refused.

    Raises ValueError: It is no JSON, too large, nested too deeply, or a number in it has too many digits or is not
    finite.
    """
    if sum(map(text.count, ',:[{')) > limits.JSON_VALUES:
        raise ValueError(f'it has more than {limits.JSON_VALUES} values, which is the limit')
    try:
        return json.loads(text, parse_int=_integer, parse_float=_number, parse_constant=_constant)
    except RecursionError as error:
        raise ValueError('nested too deeply') from error


def read_json(path: str | Path, kind: str, limit: int, accepted: str) -> Any:
    """Return the content of a JSON file of at most `limit` characters.

    Raises DataError: The file cannot be read, or is not JSON.
    """
    text = read_text(path, kind, limit, accepted, DataError)
    try:
        return parse_json(text)
    except ValueError as error:
        raise DataError(f"{kind} '{path}' is not JSON: {error}; {accepted}") from error


def _integer(text: str) -> int:
    if len(text) > limits.DIGITS or not math.isfinite(float(text)):
        raise ValueError(f'an integer of {len(text)} digits, {text[:20]}..., is too large')
    return int(text)


def _number(text: str) -> float:
    value = float(text)
    if len(text) > limits.DIGITS or not math.isfinite(value):
        raise ValueError(f'the number {text[:20]} is too large or too long')
    return value


def _constant(text: str) -> float:
    raise ValueError(f'{text} is no number of JSON')


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)


def _why(reason: OSError | ValueError) -> str:
    return (reason.strerror if isinstance(reason, OSError) else None) or str(reason)


def _named(mode: int) -> str:
    names = {stat.S_IFDIR: 'a folder', stat.S_IFIFO: 'a pipe', stat.S_IFSOCK: 'a socket'}
    return names.get(stat.S_IFMT(mode), 'a device')
