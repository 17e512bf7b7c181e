"""Opening the files of a bag, and saying in one line why one cannot be opened."""

from __future__ import annotations

import re
import shlex
from contextlib import ExitStack
from itertools import islice
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory

from backports.zstd import ZstdError
from rosbags.rosbag2 import ReaderError

from mbaid_ros import limits
from mbaid_ros.bags.chunks import MCAP_MAGIC
from mbaid_ros.bags.compression import unpack_file
from mbaid_ros.bags.salvage import SalvagedSource
from mbaid_ros.bags.sources import DAMAGE, IndexedSource
from mbaid_ros.bags.writer import parse_yaml
from mbaid_ros.errors import DataError
from mbaid_ros.files import require_regular

BAG_FILES = ('.mcap', '.db3', '.mcap.zstd', '.db3.zstd', '.mcap.zst', '.db3.zst')
ROS1_MAGIC = b'#ROSBAG V2.0'
Source = IndexedSource | SalvagedSource  # one file; `left_out` counts messages of another type by topic


def reason_of(error: Exception) -> str:
    """Return an error in one line."""
    return ' '.join(str(error).split())[:200] or type(error).__name__


def files_of(folder: Path) -> tuple[list[Path], str]:
    """Return the files of a bag in their order, and why its metadata do not name them; empty where they do."""
    try:
        return _declared(folder / 'metadata.yaml'), ''
    except ReaderError as error:
        reason = reason_of(error)
    entries = list(islice(folder.iterdir(), limits.FOLDER_FILES + 1))
    if len(entries) > limits.FOLDER_FILES:
        raise DataError(f"folder '{folder}' contains more than {limits.FOLDER_FILES} files, which is the limit")
    files = [path for path in sorted(entries, key=_natural_order) if path.name.endswith(BAG_FILES)]
    if not files:
        why = f'there is no .mcap and no .db3 file in it; metadata.yaml: {reason}'
        raise DataError(f"folder '{folder}' is not a bag: {why}")
    return files, reason


def _declared(path: Path) -> list[Path]:
    """Return the files that metadata name; a ReaderError if they name none, or one that is not there."""
    if not path.exists():
        raise ReaderError('it does not exist')
    require_regular(path, 'metadata')
    with path.open('rb') as file:
        content = file.read(limits.METADATA_BYTES + 1)
    if len(content) > limits.METADATA_BYTES:
        raise DataError(f"metadata '{path}' has more than {limits.METADATA_BYTES} bytes, which is the limit")
    try:
        names = parse_yaml(content.decode())['rosbag2_bagfile_information']['relative_file_paths']
        files = [path.with_name(PurePath(name).name) for name in names]
    except (LookupError, TypeError, ValueError) as error:
        raise ReaderError('it names no files') from error
    if len(files) > limits.FOLDER_FILES or len(set(files)) < len(files):
        raise DataError(f"metadata '{path}' name {len(files)} files; accepted: {limits.FOLDER_FILES}, each once")
    missing = [file for file in files if not file.exists()]
    if missing or not files:
        raise ReaderError(f"file '{missing[0]}' is missing" if missing else 'it names no files')
    return files


def open_file(file: Path, scratch: ExitStack) -> Source:
    """Return a file's messages; a DataError has the reason if there are none.

    A file that was compressed as a whole (``.zstd``) is unpacked into a folder that lasts as long as `scratch`.
    """
    require_regular(file, 'bag')
    if file.suffix in {'.zst', '.zstd'}:
        inner = Path(scratch.enter_context(TemporaryDirectory())) / file.stem
        try:
            unpack_file(file, inner)
        except (ZstdError, EOFError) as error:
            raise DataError(f"bag '{file}' cannot be decompressed: {error}") from error
        return open_file(inner, scratch)
    try:
        return IndexedSource(file)
    except OSError as error:
        raise DataError(f"bag '{file}' cannot be read: {error.strerror or error}") from error
    except DAMAGE as error:
        with file.open('rb') as stream:
            head = stream.read(len(MCAP_MAGIC))
        if head == MCAP_MAGIC:
            return SalvagedSource(file)
        if not head or (file.suffix == '.mcap' and MCAP_MAGIC.startswith(head)):
            raise DataError(f"bag '{file}' contains no messages: it was cut off before the first one") from error
        if head == ROS1_MAGIC[: len(head)] and head:
            command = f'rosbags-convert --src {file.name} --dst FOLDER'
            raise DataError(f"bag '{file}' is one of ROS 1; accepted: the same converted, by {command}") from error
        if log := unread_log(file):
            raise DataError(f"bag '{file}' cannot be read: {log}") from error
        raise DataError(f"'{file}' is not a bag; accepted: a rosbag2 folder, an .mcap file or a .db3 file") from error


def unread_log(file: Path) -> str:
    """Return a warning about the log that a killed writer leaves beside a database; empty where there is none."""
    log = file.with_name(f'{file.name}-wal')
    if not log.is_file() or not log.stat().st_size:
        return ''
    command = shlex.join(['sqlite3', str(file), 'PRAGMA wal_checkpoint(TRUNCATE)'])
    return f"'{log}' contains messages not yet written into its bag, and is not read: {command} writes them there"


def _natural_order(path: Path) -> list[int | str]:
    """Sort ``bag_2`` before ``bag_10``, as the recorder numbers the parts of a bag."""
    return [int(part) if part.isdecimal() else part for part in re.split(r'(\d+)', path.name)]
