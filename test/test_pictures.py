"""The pictures of README and pages are what scripts/make_pictures.py makes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from documents import README, ROOT
from make_pictures import DRAWINGS, IMAGES, REPORTS, STYLE, ReportPicture, numbers, readme_run


def test_the_numbers_of_the_captions_are_those_of_the_command() -> None:
    stored = json.loads((IMAGES / 'numbers.json').read_text(encoding='utf-8'))['readme']
    found = numbers(readme_run())
    assert found['status'] == stored['status'] == 'converged'
    assert [found[name] for name in ('mass', 'band')] == pytest.approx([stored['mass'], stored['band']], rel=1e-6)
    text = README.read_text(encoding='utf-8')
    assert f'{stored["mass"]:.2f} ± {stored["band"]:.2f} kg' in text
    assert 'replay bags/servicer7_mid --model config/servicer7.urdf' in text


@pytest.mark.parametrize(('name', 'draw'), DRAWINGS.items())
def test_the_drawings_are_those_of_the_script(name: str, draw: Callable[[Path], None], tmp_path: Path) -> None:
    with plt.style.context(str(STYLE)):
        draw(tmp_path / name)
    made, stored = ((where / name).read_text(encoding='utf-8') for where in (tmp_path, IMAGES))
    assert len(re.findall('<path', made)) == len(re.findall('<path', stored)), 'run `make pictures`'


@pytest.mark.parametrize('picture', REPORTS, ids=lambda each: each.page)
def test_pictures_of_reports_are_of_the_commands_above_them(picture: ReportPicture) -> None:
    """A long test runs these commands and compares the picture."""
    stored = json.loads((IMAGES / 'numbers.json').read_text(encoding='utf-8'))['commands']
    assert stored[picture.page] == picture.sha256, 'the commands have changed: run `make pictures`'
    page = (ROOT / 'docs' / picture.page).read_text(encoding='utf-8')
    assert page.index(picture.report) < page.index(picture.picture)


def test_pictures_are_small() -> None:
    assert [path.name for path in IMAGES.iterdir() if path.stat().st_size > 150_000] == []


def test_every_picture_is_used() -> None:
    pages = ''.join(page.read_text(encoding='utf-8') for page in (README, *ROOT.glob('docs/**/*.md')))
    unused = [
        path.name for path in IMAGES.iterdir() if path.suffix in {'.svg', '.gif', '.png'} and path.name not in pages
    ]
    assert unused == []
