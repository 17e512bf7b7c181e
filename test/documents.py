"""The documents and their blocks of shell commands.

Above every block stands what becomes of it in the tests:

- `<!-- run -->`: it is run, after the blocks before it, in a copy of the project's folder.
- `<!-- live -->`: it starts a node, which runs until it is interrupted.
- `<!-- on the graph: why -->`: what it asks of the graph is asked of a running node, where there is no `ros2`.
- `<!-- run with stand-ins: which -->`: it is run with programs of stand_ins.py in place of those named.
- `<!-- run by FILE: how -->`: the test in that file runs it.
- `<!-- collected: why -->`: it calls pytest, which finds the tests that it names and does not run them once more.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from make_pictures import PROJECT

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / 'README.md'
REFERENCE = ROOT / 'docs' / 'reference'
INSTALL = ROOT / 'docs' / 'how-to' / 'install.md'
TUTORIAL = ROOT / 'docs' / 'tutorials' / 'first-verdict.md'
CAMPAIGNS = ROOT / 'docs' / 'how-to' / 'campaigns.md'
PAGES = sorted(set(ROOT.glob('docs/**/*.md')) - {ROOT / 'docs' / 'overview.md'})  # that one is made by `make docs`
DOCUMENTS = [README, *PAGES, ROOT / 'bags' / 'README.md']
_BLOCK = re.compile(r'(?:<!-- (?P<mark>[^>]*) -->\n)?^```(?:sh|bash)\n(?P<text>.*?)^```$', re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A block of shell commands and what is said above it."""

    mark: str
    text: str


def blocks(document: Path, kind: str = '') -> list[Block]:
    """Return the blocks of a document, or those of one kind: whose marks say nothing else before the colon."""
    found = [Block(each['mark'] or '', each['text']) for each in _BLOCK.finditer(document.read_text(encoding='utf-8'))]
    return [block for block in found if not kind or block.mark.partition(':')[0] == kind]


def outputs(document: Path) -> list[str]:
    """Return the blocks of text below commands: lines that these print, in this order."""
    return re.findall(r'^```text\n(.*?)^```$', document.read_text(encoding='utf-8'), re.DOTALL | re.MULTILINE)


def python_blocks(document: Path) -> list[str]:
    """Return the blocks of Python in a document, which belong together."""
    return re.findall(r'^```python\n(.*?)^```$', document.read_text(encoding='utf-8'), re.DOTALL | re.MULTILINE)


def names(documents: list[Path]) -> list[str]:
    """Return the paths of documents in the project."""
    return [str(path.relative_to(ROOT)) for path in documents]


@contextmanager
def project(folder: Path) -> Iterator[Path]:
    """Give a folder that looks like the project's, for commands that write into the current one."""
    if not (ROOT / 'install' / 'setup.bash').is_file():
        pytest.skip('not built in this folder')
    folder.mkdir(parents=True, exist_ok=True)
    for name in PROJECT:
        (folder / name).symlink_to(ROOT / name)
    yield folder


def prelude() -> list[str]:
    """Return the README's first block, which gives the environment."""
    first = [block.text for block in blocks(README, 'run')][:1]
    assert first == ['. install/setup.bash\n']
    return first


def with_ros2(environment: dict[str, str]) -> dict[str, str]:
    """Return an environment with scripts/ros2, which `make setup` puts on the path where there is no `ros2`."""
    return {**environment, 'PATH': f'{environment["PATH"]}:{ROOT / "scripts"}'}


def bash(commands: str, folder: Path, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """Run commands up to the first that fails."""
    return subprocess.run(
        ['bash', '-ec', commands],
        cwd=folder,
        env=with_ros2({**os.environ, **(environment or {})}),
        capture_output=True,
        text=True,
        check=False,
    )
