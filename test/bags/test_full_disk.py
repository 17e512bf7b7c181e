"""Bags on a disk that takes no more: one line, and a bag that can be read as far as it goes, or none."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.core.errors import DataError
from small_bags import JOINT_STATE, joint_state

TOPIC = '/joint_states'


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let the system refuse what goes beyond so many bytes of any file, as it does on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def write(path: Path, count: int, at_once: int) -> None:
    with BagWriter(path) as bag:
        bag.add_topic(TOPIC, JOINT_STATE)
        for index in range(count):
            bag.write(TOPIC, joint_state(index), index)
            if index % at_once == at_once - 1:
                bag.flush()


@pytest.mark.parametrize(
    ('size', 'at_once', 'held'), [(60_000, 100, 100), (150_000, 100, 200), (600_000, 10_000, 1000)]
)
def test_a_bag_that_a_full_disk_ends_can_be_read_up_to_the_last_flush(
    tmp_path: Path, size: int, at_once: int, held: int
) -> None:
    path = tmp_path / 'run'
    with files_of_at_most(size), pytest.raises(DataError) as error:
        write(path, 3000, at_once)
    told = str(error.value)
    assert told.startswith(f"bag '{path}' cannot be written: File too large; it holds ")
    with BagReader(path) as bag:
        assert f'it holds {bag.messages} of ' in told
        assert 'was cut off' in bag.warnings[0]
        read = [message.header.stamp.nanosec // 10_000_000 for _, message, _ in bag.read([TOPIC])]
    assert read == [index % 100 for index in range(bag.messages)]
    assert bag.messages >= held
    assert [each.name for each in path.iterdir()] == ['run.mcap']


def test_a_bag_whose_index_finds_no_place_has_all_messages(tmp_path: Path) -> None:
    write(tmp_path / 'whole', 300, 100)
    size = (tmp_path / 'whole' / 'whole.mcap').stat().st_size
    with files_of_at_most(size - 40), pytest.raises(DataError, match='it holds 300 of 300 messages'):
        write(tmp_path / 'run', 300, 100)
    with BagReader(tmp_path / 'run') as bag:
        assert bag.messages == 300


def test_a_bag_without_any_message_is_removed(tmp_path: Path) -> None:
    with files_of_at_most(3_000), pytest.raises(DataError, match='File too large; nothing is left of it'):
        write(tmp_path / 'run', 100, 100)
    assert not (tmp_path / 'run').exists()


def test_a_bag_that_cannot_begin_leaves_no_folder(tmp_path: Path) -> None:
    with files_of_at_most(0), pytest.raises(DataError, match='cannot be made: File too large'):
        BagWriter(tmp_path / 'run')
    assert not (tmp_path / 'run').exists()
