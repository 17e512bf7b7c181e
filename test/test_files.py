"""Files that are written whole or not at all."""

from __future__ import annotations

import json
import os
import resource
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
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))  # as a full disk
    try:
        with pytest.raises(OSError, match=r'File too large.*/file'):
            write_text(path, 'x' * 200)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_text() == 'before'
    assert list(tmp_path.iterdir()) == [path]


def test_what_utf_8_has_not_is_written_as_json_escapes_it(tmp_path: Path) -> None:
    odd = os.fsdecode(b'caf\xe9')  # the name of a file, of another encoding
    write_text(tmp_path / 'file', f'"{odd} \u00e9"')
    assert (tmp_path / 'file').read_bytes() == b'"caf\\udce9 \xc3\xa9"'
    assert json.loads((tmp_path / 'file').read_text(encoding='utf-8')) == f'{odd} \u00e9'


def test_a_link_stays_a_link_and_a_device_a_device(tmp_path: Path) -> None:
    (tmp_path / 'link').symlink_to(tmp_path / 'file')
    write_text(tmp_path / 'link', 'text')
    assert (tmp_path / 'link').is_symlink()
    assert (tmp_path / 'file').read_text() == 'text'
    (tmp_path / 'null').symlink_to('/dev/null')
    write_text(tmp_path / 'null', 'text')
    assert (tmp_path / 'null').is_symlink()
