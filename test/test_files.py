"""Files that are written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from mbaid_ros.files import write_text


def test_a_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / ('a' * 250)
    for text in ('first', 'second'):
        write_text(path, text)
        assert path.read_text() == text
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / 'file'
    path.write_text('before')
    with pytest.raises(UnicodeEncodeError):
        write_text(path, '\ud800')
    assert path.read_text() == 'before'
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link_and_a_device_a_device(tmp_path: Path) -> None:
    (tmp_path / 'link').symlink_to(tmp_path / 'file')
    write_text(tmp_path / 'link', 'text')
    assert (tmp_path / 'link').is_symlink()
    assert (tmp_path / 'file').read_text() == 'text'
    (tmp_path / 'null').symlink_to('/dev/null')
    write_text(tmp_path / 'null', 'text')
    assert (tmp_path / 'null').is_symlink()
