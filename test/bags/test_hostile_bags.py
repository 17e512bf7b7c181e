"""Bags that were cut off, damaged, on a full disk, or mean harm: read up to there, or refused in one line."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from checked import answer
from hostile_bags import DAMAGED, REFUSED, many_bombs
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.core.errors import DataError
from mbaid_ros.replay.start import replay as main
from small_bags import COUNT, JOINT_STATE, everything, joint_state


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


@pytest.mark.parametrize('metadata', ['', ': [', 'rosbag2_bagfile_information: {version: 99}', 'a: 1'])
def test_a_folder_with_bad_metadata_is_read_by_its_files(recorded: Path, tmp_path: Path, metadata: str) -> None:
    (tmp_path / 'recorded.mcap').write_bytes((recorded / 'recorded.mcap').read_bytes())
    if metadata:
        (tmp_path / 'metadata.yaml').write_text(metadata)
    read, warnings = everything(tmp_path)
    assert len(read) == COUNT + 1
    assert 'metadata.yaml' in warnings[0]


# -- Bags on a disk that takes no more: one line, and a bag that can be read as far as it goes, or none.

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


# -- Bags that mean harm: one line of error or one warning, soon, in little memory.

CONFIG = Path(__file__).resolve().parents[2] / 'config'
MEMORY = 800_000_000  # bytes, more than before, for any of them


@pytest.fixture(autouse=True)
def _little_memory() -> object:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < MEMORY


def replay(bag: Path) -> int:
    return main([str(bag), '--model', str(CONFIG / 'table1.urdf')])


@pytest.mark.timeout(30)
@pytest.mark.parametrize('name', REFUSED)
def test_refused_in_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    error = answer(main, capsys, str(REFUSED[name](tmp_path)), '--model', str(CONFIG / 'table1.urdf'), code=2)
    assert len(error) < 1_000


@pytest.mark.timeout(30)
@pytest.mark.parametrize('name', DAMAGED)
def test_read_as_far_as_it_goes(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(DAMAGED[name](tmp_path)) in {2, 3}
    captured = capsys.readouterr()
    assert captured.err.count('\n') <= 1
    assert 'warning' in captured.out or 'no estimate' in captured.out or captured.err


@pytest.mark.timeout(60)
def test_messages_that_are_large_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(many_bombs(tmp_path)) in {2, 3}
    assert capsys.readouterr().err.count('\n') <= 1
