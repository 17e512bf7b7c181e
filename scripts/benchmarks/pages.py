"""Markdown: tables, and what a page says of where its numbers come from."""

from __future__ import annotations

import datetime as dt
import platform
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

_UNTELLING = ('--output', '--processes', '--store')


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, words: bool = False) -> str:
    """Return a Markdown table; the first column to the left, the others to the right unless they hold words."""
    lines = [header, ['---', *['---' if words else '---:'] * (len(header) - 1)], *rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def replace_marked(page: Path, name: str, writer: str, text: str) -> None:
    """Put a text between the marks that a page has for what a script writes.

    Raises
    ------
    ValueError
        The page has no such marks.
    """
    head, tail = f'<!-- {name}: written by {writer} -->\n', f'\n<!-- end of {name} -->'
    before, there, rest = page.read_text(encoding='utf-8').partition(head)
    _, closed, after = rest.partition(tail)
    if not there or not closed:
        raise ValueError(f"{page} has no place for '{name}'")
    page.write_text(before + head + text + tail + after, encoding='utf-8')


def put_section(page: Path, head: str, section: str, order: Sequence[str]) -> None:
    """Write a section into a page that scripts write a part at a time: in the place of the one with its heading.

    Parameters
    ----------
    page : Path
    head : what comes before the sections, anew
    section : Markdown that begins with its heading, ##
    order : of the headings
    """
    sections = page.read_text(encoding='utf-8').split('\n## ')[1:] if page.is_file() else []
    known = {text.partition('\n')[0]: text.rstrip('\n') for text in (*sections, section.removeprefix('## '))}
    ordered = [known[heading] for heading in order if heading in known]
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text('\n'.join([head, *(f'## {text}\n' for text in ordered)]), encoding='utf-8')


def number(value: float, digits: int = 2) -> str:
    """Return a number for a table: a dash for NaN, no decimals from 100 on."""
    if not np.isfinite(value):
        return '-'
    if abs(value) >= 1e4:
        return f'{value:.0e}'.replace('e+0', 'e')
    return f'{value:.0f}' if abs(value) >= 100.0 else f'{value:.{digits}f}'


def percent(share: float) -> str:
    """Return a share in per cent, a dash for NaN."""
    return f'{100.0 * share:.0f} %' if np.isfinite(share) else '-'


def write(folder: Path, name: str, text: str) -> None:
    """Write a page into a folder, which is made where there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text, encoding='utf-8')


def provenance(note: str = '', command: str = '') -> str:
    """Return the line that says by which command (this one, if none is given), where and when numbers were made."""
    command = command or ' '.join((f'scripts/{Path(sys.argv[0]).name}', *_telling(sys.argv[1:])))
    today = dt.datetime.now(tz=dt.timezone.utc).date().isoformat()
    parts = [f'Written by `{command}`', note, f'{machine()}', today]
    return '; '.join(part for part in parts if part) + '.'


def _telling(arguments: Sequence[str]) -> list[str]:
    """Return those that numbers depend on: not how many processes make them, nor where they are kept."""
    kept, left = [], iter(arguments)
    for argument in left:
        name, _, value = argument.partition('=')
        if name in _UNTELLING:
            if not value:
                next(left, None)
        else:
            kept.append(shlex.quote(argument))
    return kept


def machine() -> str:
    """Return processor, Python and NumPy in words."""
    return f'{_processor()}, one core a run, Python {platform.python_version()}, NumPy {np.__version__}'


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
