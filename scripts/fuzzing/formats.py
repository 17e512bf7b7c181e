"""The damaged files, each with its damage and the executable that reads it."""

import contextlib
import io
import json
import re
import sqlite3
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from mcap.writer import CompressionType

from fuzzing.plain_bags import BAG, CONFIG, TYPES, database, mcap, recorded
from fuzzing.trial import Main
from mbaid_ros.bags import BagWriter
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.recordings.convert import main as convert
from mbaid_ros.replay.arguments import FORMATS, export, replay

Damage = Callable[[bytes, np.random.Generator], bytes]
_Item = TypeVar('_Item')
_TOKEN = re.compile(rb'[-+]?\d+(\.\d+)?([eE][-+]?\d+)?|[A-Za-z_]\w*')
_VALUES = (
    *(b'0', b'-1', b'1e308', b'-1e-308', b'nan', b'inf', b'null', b'true', b'""', b'[]', b'{}', b'[[[[1]]]]'),
    *(b'x' * 600, b'1' + b'0' * 400, b'0x' + b'f' * 5_000, b'1:' * 300 + b'1', b'*', b'**' * 50, b'<<'),
    *(b'!!python/name:os', b'&a'),
)
NUMBERS = (0, 1, 2**31 - 1, 2**32 - 1, 2**40, 2**63, 2**64 - 1)


def one(choices: Sequence[_Item], generator: np.random.Generator) -> _Item:
    """Return one of some things."""
    return choices[int(generator.integers(0, len(choices)))]


def flipped(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with some bits flipped."""
    array = np.frombuffer(data, dtype=np.uint8).copy()
    for place in generator.integers(0, len(array), generator.integers(1, 20)) if len(array) else ():
        array[place] ^= 1 << int(generator.integers(0, 8))
    return array.tobytes()


def cut(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the beginning of the bytes."""
    return data[: int(generator.integers(0, len(data) + 1))]


def spliced(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with one part put into another place, or taken out."""
    begin, end, place = sorted(int(x) for x in generator.integers(0, len(data) + 1, 3))
    if generator.random() < 0.5:
        return data[:begin] + data[end:]
    return data[:place] + data[begin:end] + data[place:]


def overwritten(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with a number written over them: lengths that ask for gigabytes, zeros, ones."""
    value, size = one(NUMBERS, generator), one((4, 8), generator)
    place = int(generator.integers(0, max(1, len(data) - size)))
    return data[:place] + (value % 2 ** (8 * size)).to_bytes(size, 'little') + data[place + size :]


def replaced(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the text with some numbers or words replaced."""
    for _ in range(int(generator.integers(1, 4))):
        tokens = list(_TOKEN.finditer(data))
        if tokens:
            chosen = one(tokens, generator)
            data = data[: chosen.start()] + one(_VALUES, generator) + data[chosen.end() :]
    return data


def shuffled(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the lines with one moved, repeated many times, or taken out."""
    lines = data.splitlines(keepends=True)
    taken = lines.pop(int(generator.integers(0, len(lines))))
    lines.insert(int(generator.integers(0, len(lines) + 1)), taken * one((0, 1, 2, 1_000), generator))
    return b''.join(lines)


OF_BYTES: tuple[Damage, ...] = (flipped, cut, spliced, overwritten)


def of_bytes(data: bytes, generator: np.random.Generator) -> bytes:
    """Return any bytes damaged in one way."""
    return one(OF_BYTES, generator)(data, generator)


def of_text(data: bytes, generator: np.random.Generator) -> bytes:
    """Return a text damaged in one way."""
    return one((*OF_BYTES, replaced, replaced, replaced, shuffled), generator)(data, generator)


_MESSAGES = 600
_METHODS = ('difference', 'paper_difference') * 10 + ('trajectory',)  # which takes ten times as long
_LINES = 200  # of a log
CONVERTED = 'converted'  # folder of the output of `convert`
MAPPING = """\
time: {column: t, scale: 1.0e-3}
base:
  frame: plate
  missing: 0.0
  position: [x, {column: y, offset: 1.0}]
  heading: {column: yaw, scale: 0.017453292519943295}
joints:
  elbow: {position: {column: q1, scale: 0.1}, velocity: qd1}
thrust: {frame: plate, force: [fx, {constant: 0.0}, {constant: -1}]}
"""
_URDF = CONFIG / 'table1.urdf'
_bag = cache(mcap)  # that nothing is wrong with
_CELLS = ('NULL', "'text'", "x'00ff'", '1.5e300', '-1', '9223372036854775807', "''", 'zeroblob(100000)')
_CONTRADICTIONS = (
    ('float64[] position', 'float64[1000000000] position'),
    ('float64[] position', 'string position'),
    ('float64[36] covariance', 'float64[3600000] covariance'),
    ('float64[] velocity', ''),
    ('string[] name', 'string name'),
    ('std_msgs/Header header', 'uint8 header'),
    ('float64 x', 'x float64'),
    ('geometry_msgs/Point position', 'geometry_msgs/Pose position'),
)
_NUMBERS_TO = 'WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n WHERE x < {})'
_ENDLESS = 'WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)'
_ROW = "SELECT x, '/' || x, 'std_msgs/msg/String', 'cdr', '', '' FROM n"
# Tables that compute, have no end, or join with themselves.
_PROGRAMS = (
    f"DROP TABLE messages; CREATE VIEW messages AS {_ENDLESS} SELECT 1 topic_id, x timestamp, x'00' data FROM n",
    f'DROP TABLE schema; CREATE VIEW schema AS {_ENDLESS} SELECT max(x) AS schema_version FROM n',
    f'CREATE VIEW other AS {_ENDLESS} SELECT x FROM n',
    'ALTER TABLE messages ADD COLUMN size AS (length(hex(zeroblob(50000000))))',
    'CREATE INDEX slow ON messages(hex(zeroblob(100000)), timestamp)',
    'CREATE INDEX slow ON messages(timestamp) WHERE topic_id IN (1, 2)',
    f'DELETE FROM topics; {_NUMBERS_TO.format(200_000)} INSERT INTO topics {_ROW}',
    f'DROP TABLE topics; CREATE TABLE topics AS {_NUMBERS_TO.format(9_000)} {_ROW.replace("x,", "1 AS id,", 1)}',
    'CREATE TRIGGER other AFTER INSERT ON messages BEGIN DELETE FROM messages; END',
    "ALTER TABLE messages ADD COLUMN more BLOB DEFAULT x'" + '00' * 100_000 + "'",
)
_TABLES = ('topics', 'messages', 'message_definitions')


@dataclass(frozen=True)
class Format:
    """A kind of file."""

    path: Path
    content: bytes  # undamaged
    damaged: Damage
    main: Main  # of the executable that reads it
    arguments: Callable[[int], Sequence[str]]  # by the number of the input
    reported: tuple[int, ...] = (2,)  # exit codes with a line on stderr


def formats(folder: Path) -> dict[str, Format]:
    """Return all kinds of files by name, with the other files that they need in a folder."""
    rows, small, model = folder / 'bag.db3', str(folder / 'small.db3'), ['--model', str(_URDF)]
    robot, yaml, truth = folder / 'robot.urdf', folder / 'estimator.yaml', folder / 'truth.json'
    content = database(Path(small), _MESSAGES).read_bytes()
    compared = [small, *model, '--truth', str(truth), '--report', str(folder / 'report.html')]
    parameters, body = (CONFIG / 'table1_estimator.yaml').read_bytes(), (BAG / 'truth.json').read_bytes()
    return {
        **_mcap(folder / 'bag.mcap', model),
        'sqlite': Format(rows, content, _in_database, replay, lambda _: [str(rows), *model]),
        'sqlite programs': Format(rows, content, _with_program, replay, lambda _: [str(rows), *model]),
        'metadata': _metadata(folder / 'bag', model),
        'URDF': Format(robot, _URDF.read_bytes(), of_text, replay, lambda _: [small, '--model', str(robot)]),
        'YAML': Format(yaml, parameters, of_text, replay, lambda _: [small, *model, '--params', str(yaml)]),
        'truth': Format(truth, body, of_text, replay, lambda _: compared),
        'results': _results(folder / 'results.json'),
        'calibration': _calibration(folder / 'calibration.json', [small, *model]),
        **_logs(folder),
    }


def _mcap(path: Path, model: list[str]) -> dict[str, Format]:
    def arguments(number: int) -> list[str]:
        return [str(path), *model, '--method', _METHODS[number % len(_METHODS)], '--json', '-']

    def in_bytes(_data: bytes, generator: np.random.Generator) -> bytes:
        return of_bytes(_bag(_MESSAGES, one((CompressionType.NONE, CompressionType.ZSTD), generator)), generator)

    ways = {'bytes': in_bytes, 'schemas': _in_schemas}
    return {f'MCAP {name}': Format(path, b'', way, replay, arguments) for name, way in ways.items()}


def _in_schemas(_data: bytes, generator: np.random.Generator) -> bytes:
    """Return a bag whose schemas contradict its messages and whose bytes are damaged, or with damaged schemas."""
    plain = CompressionType.NONE
    if generator.random() < 0.5:
        old, new = one(_CONTRADICTIONS, generator)
        return of_bytes(mcap(_MESSAGES, plain, lambda text: text.replace(old, new)), generator)
    return mcap(_MESSAGES, plain, lambda text: of_bytes(text.encode(), generator).decode(errors='replace'))


def _with_program(data: bytes, generator: np.random.Generator) -> bytes:
    """Return a database with one or two tables that compute."""
    with contextlib.closing(sqlite3.connect(':memory:')) as connection:
        connection.deserialize(data)
        for _ in range(int(generator.integers(1, 3))):
            with contextlib.suppress(sqlite3.Error):  # a second one may not fit the first
                connection.executescript(one(_PROGRAMS, generator))
        connection.commit()
        return connection.serialize()


def _metadata(bag: Path, model: list[str]) -> Format:
    with BagWriter(bag) as short:
        for topic, kind in TYPES.items():
            short.add_topic(topic, kind)
        for message in recorded(_MESSAGES):
            short.write_raw(*message)
    path = bag / 'metadata.yaml'
    return Format(path, path.read_bytes(), of_text, replay, lambda _: [str(bag), *model])


def _in_database(data: bytes, generator: np.random.Generator) -> bytes:
    """Return a database with damaged bytes, or with some cells of another type or size."""
    if generator.random() < 0.5:
        return of_bytes(data, generator)
    with contextlib.closing(sqlite3.connect(':memory:')) as connection:
        connection.deserialize(data)
        for _ in range(int(generator.integers(1, 4))):
            table = one(_TABLES, generator)
            columns = [row[1] for row in connection.execute(f'PRAGMA table_info({table})')]
            column, cell = one(columns, generator), one(_CELLS, generator)
            some = f'(rowid * {int(generator.integers(1, 10**6))}) % {one((1, 2, 50), generator)} = 0'
            with contextlib.suppress(sqlite3.Error):  # not every column takes every value
                connection.execute(f'UPDATE {table} SET {column} = {cell} WHERE {some}')
        connection.commit()
        return connection.serialize()


def _results(path: Path) -> Format:
    """Return the input of `export`, without most of its history, which it ignores."""
    of = CONFIG / 'servicer7'
    given = ['--model', f'{of}.urdf', '--params', f'{of}_estimator.yaml', '--method', 'difference', '--json', str(path)]
    with contextlib.redirect_stdout(io.StringIO()):
        if replay([str(BAG.parent / 'servicer7_mid'), *given]) != 0:
            raise RuntimeError('the bag gives no estimate')
    found = json.loads(path.read_text(encoding='utf-8'))
    content = json.dumps({**found, 'history': found['history'][:2]}, indent=1).encode()

    def arguments(number: int) -> list[str]:
        form = FORMATS[number % len(FORMATS)]
        return [str(path), '--format', form, *(['--model', f'{of}.urdf'] if form == 'urdf' else [])]

    return Format(path, content, of_text, export, arguments, reported=(2, 3, 4))


def _calibration(path: Path, arguments: list[str]) -> Format:
    """Return a calibration of two links and all joints."""
    model = load_model(_URDF.read_text(encoding='utf-8'))
    links = {link.name: link.parameters for link in model.links[:2]}
    frames = zip(model.joint_names, model.positions.tolist(), model.rotations.tolist(), strict=True)
    joints = {name: {'position': position, 'rotation': rotation} for name, position, rotation in frames}
    values = [*np.concatenate(list(links.values())).tolist(), *[1e-3] * (6 * len(joints) + 6)]
    matrix = np.diag(1e-4 * np.maximum(np.square(values), 1e-6)).tolist()
    covariance = {'values': values, 'matrix': matrix}
    status = {'status': 'calibrated', 'links': {name: {} for name in links}}
    content = json.dumps({**status, 'joints': joints, 'covariance': covariance}, indent=1)
    given = [*arguments, '-p', f'known_links.calibration:={path}']
    return Format(path, content.encode(), of_text, replay, lambda _: given)


def _logs(folder: Path) -> dict[str, Format]:
    """Return a log as a table, and the mapping of its columns."""
    table, columns = folder / 'run.csv', folder / 'columns.yaml'
    lines = [f'{10 * k},{k / 7},{k / 9},{k % 90},{k / 3},{1 / 3},0.5\n' for k in range(_LINES)]
    given = ['csv', str(table), '--columns', str(columns), '--output', str(folder / CONVERTED)]
    contents = {
        'CSV': (table, ('t,x,y,yaw,q1,qd1,fx\n' + ''.join(lines)).encode()),
        'columns': (columns, MAPPING.encode()),
    }
    for path, content in contents.values():
        path.write_bytes(content)
    return {name: Format(*content, of_text, convert, lambda _: given) for name, content in contents.items()}
