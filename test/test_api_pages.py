"""The pages about Python modules: their examples run and print what stands below them."""

from __future__ import annotations

from pathlib import Path

import pytest

from documents import ROOT, outputs, python_blocks

PAGES = sorted(page for page in (ROOT / 'docs' / 'api').glob('*.md') if python_blocks(page))


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_the_example_prints_what_the_page_shows(
    page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile('\n'.join(python_blocks(page)), str(page), 'exec'), {})
    assert capsys.readouterr().out == ''.join(outputs(page))


def test_every_page_but_the_list_has_an_example() -> None:
    assert {page.stem for page in PAGES} == {page.stem for page in (ROOT / 'docs' / 'api').glob('*.md')} - {'modules'}
