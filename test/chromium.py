"""A headless browser, where this machine has one."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

_NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
_OPTIONS = ('--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', '--hide-scrollbars')


class Chromium:
    """The browser, with a profile of its own.

    Parameters
    ----------
    folder : where the profile goes
    """

    def __init__(self, folder: Path) -> None:
        found = next(filter(None, map(shutil.which, _NAMES)), None)
        if found is None:
            pytest.skip(f'no headless browser on this machine: none of {", ".join(_NAMES)}')
        self._command = [found, *_OPTIONS, f'--user-data-dir={folder / "profile"}']

    def screenshot(self, page: Path, picture: Path, *options: str, height: int = 3000) -> bytes:
        """Return a page as PNG."""
        self._run(f'--window-size=1100,{height}', f'--screenshot={picture}', *options, page.as_uri())
        return picture.read_bytes()

    def document(self, page: Path) -> str:
        """Return the document after every script has run."""
        return self._run('--dump-dom', page.as_uri())

    def pdf(self, page: Path, file: Path) -> bytes:
        """Return a page as it is printed."""
        self._run(f'--print-to-pdf={file}', '--no-pdf-header-footer', page.as_uri())
        return file.read_bytes()

    def _run(self, *arguments: str) -> str:
        run = subprocess.run([*self._command, *arguments], capture_output=True, text=True, timeout=100, check=True)
        return run.stdout
