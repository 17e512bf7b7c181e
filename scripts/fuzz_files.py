"""Send damaged documents and databases through `replay`: robot descriptions, YAML, JSON, sqlite bags.

usage: fuzz_files.py [--inputs N] [--seed N] [--formats F ...]    (with `install/setup.bash` sourced)

Each has to end with 0, 2 or 3, a line of error at most, soon, in little memory. The damage is that of fuzz_bags.py, and
what the format has of its own: values of another size or type, elements twice, nested or gone, rows of other types.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import resource
import shutil
import signal
import sqlite3
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fuzz_bags import CONFIG, LONGEST, MEMORY, TYPES, TooLongError, cut, flipped, overwritten, spliced
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.bags.types import definition
from mbaid_ros.replay.replay import main

BAG = CONFIG.parent / 'bags' / 'table1_live'
MESSAGES = 600
_TOKEN = re.compile(rb'[-+]?\d+(\.\d+)?([eE][-+]?\d+)?|[A-Za-z_]\w*')
_VALUES = (
    *(
        b'0',
        b'-1',
        b'1e308',
        b'-1e-308',
        b'nan',
        b'inf',
        b'null',
        b'true',
        b'""',
        b'[]',
        b'{}',
        b'[[[[1]]]]',
        b'x' * 600,
    ),
    *(b'1' + b'0' * 400, b'0x' + b'f' * 5_000, b'1:' * 300 + b'1', b'*', b'**' * 50, b'<<', b'!!python/name:os', b'&a'),
)
_CELLS = ('NULL', "'text'", "x'00ff'", '1.5e300', '-1', '9223372036854775807', "''", 'zeroblob(100000)')

Damage = Callable[[bytes, np.random.Generator], bytes]


@dataclass
class Found:
    """What came out.

    Attributes
    ----------
    codes : how often each exit code came
    slowest : s
    wrong : what should not have been
    """

    codes: Counter[int] = field(default_factory=Counter)
    slowest: float = 0.0
    wrong: list[str] = field(default_factory=list)


def replaced(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the text with some numbers or words replaced."""
    for _ in range(int(generator.integers(1, 4))):
        tokens = list(_TOKEN.finditer(data))
        if tokens:
            chosen = tokens[int(generator.integers(0, len(tokens)))]
            data = data[: chosen.start()] + _VALUES[int(generator.integers(0, len(_VALUES)))] + data[chosen.end() :]
    return data


def shuffled(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the lines with one moved, repeated many times, or taken out."""
    lines = data.splitlines(keepends=True)
    taken = lines.pop(int(generator.integers(0, len(lines))))
    lines.insert(int(generator.integers(0, len(lines) + 1)), taken * int(generator.choice([0, 1, 2, 1_000])))
    return b''.join(lines)


def altered_rows(data: bytes, generator: np.random.Generator, folder: Path) -> bytes:
    """Return a database in which some cells are of another type or size."""
    path = folder / 'altered.db3'
    path.write_bytes(data)
    with contextlib.closing(sqlite3.connect(path)) as connection:
        for _ in range(int(generator.integers(1, 4))):
            table = str(generator.choice(['topics', 'messages', 'message_definitions']))
            columns = [row[1] for row in connection.execute(f'PRAGMA table_info({table})')]
            column, cell = str(generator.choice(columns)), _CELLS[int(generator.integers(0, len(_CELLS)))]
            some = f'abs(random()) % {int(generator.choice([1, 2, 50]))} = 0'
            with contextlib.suppress(sqlite3.Error):  # not every column takes every value
                connection.execute(f'UPDATE {table} SET {column} = {cell} WHERE {some}')
        connection.commit()
    return path.read_bytes()


def database(path: Path) -> bytes:
    """Return a small sqlite bag."""
    with contextlib.closing(sqlite3.connect(path)) as connection, BagReader(BAG) as bag:
        connection.executescript(
            'CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT);'
            "INSERT INTO schema VALUES (4, 'jazzy');"
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,'
            ' offered_qos_profiles TEXT, type_description_hash TEXT);'
            'CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT,'
            ' encoded_message_definition TEXT, type_description_hash TEXT);'
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);'
            'CREATE INDEX timestamp_idx ON messages (timestamp ASC);'
        )
        numbers = {}
        for number, (topic, kind) in enumerate(TYPES.items(), start=1):
            numbers[topic] = number
            meaning = (number, kind, 'ros2msg', definition(kind)[0], '')
            connection.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)', (number, topic, kind, 'cdr', '', ''))
            connection.execute('INSERT INTO message_definitions VALUES (?, ?, ?, ?, ?)', meaning)
        for _, (topic, data, when) in zip(range(MESSAGES), bag.raw(TYPES), strict=False):
            row = (None, numbers[topic], when, data)
            connection.execute('INSERT INTO messages VALUES (?, ?, ?, ?)', row)
        connection.commit()
    return path.read_bytes()


def short_bag(folder: Path) -> Path:
    """Write the first messages as a bag of MCAP, with the truth beside them; return its folder."""
    with BagReader(BAG) as whole, BagWriter(folder) as bag:
        for topic, kind in TYPES.items():
            bag.add_topic(topic, kind)
        for _, (topic, data, when) in zip(range(MESSAGES), whole.raw(TYPES), strict=False):
            bag.write_raw(topic, data, when)
    shutil.copy(BAG / 'truth.json', folder)
    return folder


def inputs(folder: Path) -> dict[str, tuple[Path, bytes, list[str]]]:
    """Return for each format the file to damage, what is in it, and the arguments of `replay` that read it."""
    urdf, bag = str(CONFIG / 'table1.urdf'), short_bag(folder / 'bag')
    document, yaml, told = folder / 'robot.urdf', folder / 'estimator.yaml', bag / 'metadata.yaml'
    truth, rows, page = bag / 'truth.json', folder / 'bag.db3', str(folder / 'report.html')
    small = str(folder / 'small.db3')
    content = database(rows)
    Path(small).write_bytes(content)
    return {
        'URDF': (document, Path(urdf).read_bytes(), [small, '--model', str(document)]),
        'YAML': (
            yaml,
            (CONFIG / 'table1_estimator.yaml').read_bytes(),
            [small, '--model', urdf, '--params', str(yaml)],
        ),
        'metadata': (told, told.read_bytes(), [str(bag), '--model', urdf]),
        'JSON': (truth, truth.read_bytes(), [small, '--model', urdf, '--truth', str(truth), '--report', page]),
        'sqlite': (rows, content, [str(rows), '--model', urdf]),
    }


def replay(arguments: list[str]) -> tuple[int, str, float]:
    """Return exit code, what was written to stderr, and the time it took."""
    error, begin = io.StringIO(), time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        with contextlib.redirect_stderr(error), contextlib.redirect_stdout(io.StringIO()):
            code = main(arguments)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return code, error.getvalue(), time.monotonic() - begin


def _on_alarm(_number: int, _frame: object) -> None:
    raise TooLongError(f'more than {LONGEST:g} s')


def fuzz(count: int, seed: int, formats: list[str] | None = None) -> dict[str, Found]:
    """Return what came of so many inputs of each format."""
    before = signal.signal(signal.SIGALRM, _on_alarm)
    at_start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    outcome: dict[str, Found] = {}
    with tempfile.TemporaryDirectory() as name:
        for kind, (path, content, arguments) in inputs(Path(name)).items():
            if formats and kind not in formats:
                continue
            found = outcome[kind] = Found()
            for number in tqdm(range(count), unit=f' {kind}', disable=None, leave=False):
                generator = np.random.default_rng([seed, number])
                path.write_bytes(_damaged(kind, content, generator, Path(name)))
                try:
                    code, error, taken = replay(arguments)
                except Exception as reason:  # noqa: BLE001 - that none comes out is what is tested
                    found.wrong.append(f'{kind} {number}: {type(reason).__name__}: {reason}')
                    continue
                found.codes[code] += 1
                found.slowest = max(found.slowest, taken)
                if code not in {0, 2, 3, 4} or error.count('\n') > (code == 2):
                    found.wrong.append(f'{kind} {number}: exit code {code}, {error!r}')
            path.write_bytes(content)
            memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - at_start) * 1024
            if memory > MEMORY:
                found.wrong.append(f'{memory / 1e6:.0f} MB more memory than at the start')
    signal.signal(signal.SIGALRM, before)
    return outcome


def _damaged(kind: str, content: bytes, generator: np.random.Generator, folder: Path) -> bytes:
    """Return what a file holds, damaged in one way."""
    ways: list[Damage] = [flipped, cut, spliced, overwritten]
    if kind == 'sqlite':
        if generator.random() < 0.5:
            return altered_rows(content, generator, folder)
    else:
        ways += [replaced, replaced, replaced, shuffled]
    return ways[int(generator.integers(0, len(ways)))](content, generator)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--inputs', type=int, default=400, metavar='N', help='of each format (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='N')
    parser.add_argument('--formats', nargs='+', metavar='F', help='URDF, YAML, metadata, JSON, sqlite (default: all)')
    return parser.parse_args()


if __name__ == '__main__':
    asked = _arguments()
    results = fuzz(asked.inputs, asked.seed, asked.formats)
    for each, found in results.items():
        codes = ', '.join(f'{number} with exit code {code}' for code, number in sorted(found.codes.items()))
        print(f'{each}: {codes}; slowest {found.slowest:.2f} s, {len(found.wrong)} failures')
        print(*found.wrong[:20], sep='\n', end='\n' if found.wrong else '')
    sys.exit(any(found.wrong for found in results.values()))
