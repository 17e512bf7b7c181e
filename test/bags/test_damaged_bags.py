"""Bags that were cut off or damaged: read up to there, with a warning."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from hostile_bags import folder_of, metadata
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.core.errors import DataError
from small_bags import COUNT, STRING, everything, string


def cuts(size: int) -> Iterator[int]:
    yield from (0, 1, 7, 8, 9, 20, 40, 60)
    yield from np.linspace(100, size - 1, 60).astype(int).tolist()
    yield from (size - 1, size - 8, size - 9, size - 37, size - 38)


def test_a_bag_cut_off_anywhere_is_read_up_to_the_cut(mcap: Path, tmp_path: Path) -> None:
    content = mcap.read_bytes()
    whole, _ = everything(mcap)
    path = tmp_path / 'cut.mcap'
    numbers = []
    for cut in cuts(len(content)):
        path.write_bytes(content[:cut])
        if cut < 100:
            with pytest.raises(DataError, match=r'holds no messages|is not a bag'):
                everything(path)
            continue
        try:
            read, warnings = everything(path)
        except DataError:
            assert cut < len(content) / 3  # before the first block of the first chunk
            continue
        assert read == whole[: len(read)]
        if cut < len(content) - 8:  # beyond, only the closing mark is missing
            assert len(warnings) == 1
            assert 'cut off' in warnings[0]
        numbers.append(len(read))
    assert sorted(numbers[:-5]) == numbers[:-5]
    assert numbers[-1] == COUNT + 1
    assert len(set(numbers)) > 6  # more than there are chunks: parts of chunks are read, too


def test_a_writer_that_is_killed_loses_only_what_it_did_not_flush(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / 'bag')
    bag.add_topic('/a', STRING)
    for index in range(100):
        bag.write('/a', string(str(index)), index)
        if index == 49:
            bag.flush()
    read, warnings = everything(tmp_path / 'bag')
    assert len(read) == 50
    assert 'cut off' in warnings[0]
    bag.close()
    assert len(everything(tmp_path / 'bag')[0]) == 100


def test_a_writer_that_is_killed_at_once_leaves_a_bag_that_is_empty(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / 'bag')
    bag.add_topic('/a', STRING)
    bag.write('/a', string(''), 0)
    with pytest.raises(DataError, match='holds no messages: it was cut off before the first one'):
        everything(tmp_path / 'bag')
    bag.close()


@pytest.mark.parametrize('content', [b'', b'\x89MCAP'])
def test_a_file_that_had_no_time_to_begin(tmp_path: Path, content: bytes) -> None:
    (tmp_path / 'bag.mcap').write_bytes(content)
    with pytest.raises(DataError, match='holds no messages: it was cut off before the first one'):
        everything(tmp_path)


def test_a_folder_with_metadata_and_a_cut_file(recorded: Path, tmp_path: Path) -> None:
    content = (recorded / 'recorded.mcap').read_bytes()
    (tmp_path / 'recorded.mcap').write_bytes(content[: len(content) // 2])
    (tmp_path / 'metadata.yaml').write_text((recorded / 'metadata.yaml').read_text())
    read, warnings = everything(tmp_path)
    assert 0 < len(read) < COUNT
    assert 'cut off' in warnings[0]


@pytest.mark.parametrize('metadata', ['', ': [', 'rosbag2_bagfile_information: {version: 99}', 'a: 1'])
def test_a_folder_with_bad_metadata_is_read_by_its_files(recorded: Path, tmp_path: Path, metadata: str) -> None:
    (tmp_path / 'recorded.mcap').write_bytes((recorded / 'recorded.mcap').read_bytes())
    if metadata:
        (tmp_path / 'metadata.yaml').write_text(metadata)
    read, warnings = everything(tmp_path)
    assert len(read) == COUNT + 1
    assert 'metadata.yaml' in warnings[0]


def test_why_the_metadata_cannot_be_used_is_told(recorded: Path, tmp_path: Path) -> None:
    (tmp_path / 'recorded.mcap').write_bytes((recorded / 'recorded.mcap').read_bytes())
    (tmp_path / 'metadata.yaml').write_text('rosbag2_bagfile_information: {version: 99}')
    _, (warning,) = everything(tmp_path)
    assert 'cannot be used (metadata of version 99; accepted: up to 9): its files are read in' in warning
    (tmp_path / 'recorded.mcap').rename(tmp_path / 'recorded.mcap.lz4')
    folder_of(tmp_path, metadata(['recorded.mcap.lz4'], 'mcap', 'file', compression_format='lz4'))
    with pytest.raises(DataError, match=r"no .db3 file in it; metadata.yaml: compression 'file' as 'lz4' is not known"):
        BagReader(tmp_path)


@pytest.mark.parametrize('seed', range(60))
def test_damaged_bytes_end_in_messages_or_in_a_data_error(mcap: Path, tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    content = bytearray(mcap.read_bytes())
    # Damage where the structure is: the head, the tail, and anywhere.
    start, stop = ((0, 400), (len(content) - 1500, len(content)), (0, len(content)))[seed % 3]
    for place in random.integers(start, stop, size=random.integers(1, 6)):
        content[place] = random.integers(256)
    path = tmp_path / 'damaged.mcap'
    path.write_bytes(content)
    with suppress(DataError), BagReader(path) as bag:
        for topic in bag.topics:
            list(bag.read([topic]))
