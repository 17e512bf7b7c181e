"""The files that are damaged, each with what damages it and the executable that reads it."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fuzzing.damage import Damage, of_text
from fuzzing.databases import database, in_database
from fuzzing.mcap_files import CONFIG, in_bytes, in_meaning, in_records, in_schemas
from fuzzing.meanings import TYPES
from fuzzing.trial import Main
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.recordings.convert import main as convert
from mbaid_ros.replay.export import FORMATS
from mbaid_ros.replay.export import main as export
from mbaid_ros.replay.replay import main as replay

BAG = CONFIG.parent / 'bags' / 'table1_live'
_MESSAGES = 600
_METHODS = ('difference', 'paper_difference') * 10 + ('trajectory',)  # which takes ten times as long
_LINES = 200  # of a log
_TABLE = 't,x,y,yaw,q1,qd1,fx\n'
_MAPPING = """\
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


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes
    ----------
    path : of the file
    content : of one that is not damaged
    damaged : makes another one of it
    main : of the executable that reads it
    arguments : its, of the input of a number
    told : exit codes with which it writes a line on stderr
    left : folder that it writes, which has to go before the next one; None if there is none
    """

    path: Path
    content: bytes
    damaged: Damage
    main: Main
    arguments: Callable[[int], Sequence[str]]
    told: tuple[int, ...] = (2,)
    left: Path | None = None


def formats(folder: Path) -> dict[str, Format]:
    """Return all kinds of files by name, with what they need besides in a folder."""
    robot = ['--model', str(_URDF)]
    rows, small = folder / 'bag.db3', folder / 'small.db3'
    content = database(small, BAG, _MESSAGES)
    return {
        **_mcap(folder / 'bag.mcap', robot),
        'sqlite': Format(rows, content, in_database, replay, lambda _: [str(rows), *robot]),
        'metadata': _metadata(folder / 'bag', robot),
        **_documents(folder, str(small)),
        'results': _results(folder / 'results.json'),
        'calibration': _calibration(folder / 'calibration.json', [str(small), *robot]),
        **_logs(folder),
    }


def _mcap(path: Path, robot: list[str]) -> dict[str, Format]:
    ways: dict[str, Damage] = {'bytes': in_bytes, 'records': in_records, 'schemas': in_schemas, 'messages': in_meaning}

    def arguments(number: int) -> list[str]:
        return [str(path), *robot, '--method', _METHODS[number % len(_METHODS)], '--json', '-']

    return {f'MCAP {name}': Format(path, b'', way, replay, arguments) for name, way in ways.items()}


def _metadata(bag: Path, robot: list[str]) -> Format:
    with BagReader(BAG) as whole, BagWriter(bag) as short:
        for topic, kind in TYPES.items():
            short.add_topic(f'/{topic}', kind)
        topics = [f'/{topic}' for topic in TYPES]
        for _, (topic, data, when) in zip(range(_MESSAGES), whole.raw(topics), strict=False):
            short.write_raw(topic, data, when)
    told = bag / 'metadata.yaml'
    return Format(told, told.read_bytes(), of_text, replay, lambda _: [str(bag), *robot])


def _documents(folder: Path, small: str) -> dict[str, Format]:
    """Return what a run needs besides its bag."""
    robot, yaml, truth = folder / 'robot.urdf', folder / 'estimator.yaml', folder / 'truth.json'
    page, urdf = str(folder / 'report.html'), str(_URDF)
    parameters = (CONFIG / 'table1_estimator.yaml').read_bytes()
    compared = [small, '--model', urdf, '--truth', str(truth), '--report', page]
    return {
        'URDF': Format(robot, _URDF.read_bytes(), of_text, replay, lambda _: [small, '--model', str(robot)]),
        'YAML': Format(yaml, parameters, of_text, replay, lambda _: [small, '--model', urdf, '--params', str(yaml)]),
        'truth': Format(truth, (BAG / 'truth.json').read_bytes(), of_text, replay, lambda _: compared),
    }


def _results(path: Path) -> Format:
    """Return what `export` reads, without most of its history, at which it does not look."""
    of = CONFIG / 'servicer7'
    given = ['--model', f'{of}.urdf', '--params', f'{of}_estimator.yaml', '--method', 'difference', '--json', str(path)]
    with contextlib.redirect_stdout(io.StringIO()):
        if replay([str(BAG.parent / 'servicer7_mid'), *given]) != 0:
            raise RuntimeError('the bag leads to no estimate')
    found = json.loads(path.read_text(encoding='utf-8'))
    content = json.dumps({**found, 'history': found['history'][:2]}, indent=1).encode()

    def arguments(number: int) -> list[str]:
        form = FORMATS[number % len(FORMATS)]
        return [str(path), '--format', form, *(['--model', f'{of}.urdf'] if form == 'urdf' else [])]

    return Format(path, content, of_text, export, arguments, told=(2, 3, 4))


def _calibration(path: Path, arguments: list[str]) -> Format:
    """Return a calibration of two links and all joints."""
    model = load_model(_URDF.read_text(encoding='utf-8'))
    links = {link.name: link.parameters for link in model.links[:2]}
    frames = zip(model.joint_names, model.positions.tolist(), model.rotations.tolist(), strict=True)
    joints = {name: {'position': position, 'rotation': rotation} for name, position, rotation in frames}
    values = [*np.concatenate(list(links.values())).tolist(), *[1e-3] * (6 * len(joints) + 6)]
    matrix = np.diag(1e-4 * np.maximum(np.square(values), 1e-6)).tolist()
    content = {
        'status': 'calibrated',
        'links': {name: {} for name in links},
        'joints': joints,
        'covariance': {'values': values, 'matrix': matrix},
    }
    given = [*arguments, '-p', f'known_links.calibration:={path}']
    return Format(path, json.dumps(content, indent=1).encode(), of_text, replay, lambda _: given)


def _logs(folder: Path) -> dict[str, Format]:
    """Return a log as a table, and what says what its columns are."""
    table, columns, output = folder / 'run.csv', folder / 'columns.yaml', folder / 'converted'
    lines = [f'{10 * k},{k / 7},{k / 9},{k % 90},{k / 3},{1 / 3},0.5\n' for k in range(_LINES)]
    given = ['csv', str(table), '--columns', str(columns), '--output', str(output)]
    contents = {'CSV': (table, (_TABLE + ''.join(lines)).encode()), 'columns': (columns, _MAPPING.encode())}
    for path, content in contents.values():
        path.write_bytes(content)
    return {
        name: Format(path, content, of_text, convert, lambda _: given, left=output)
        for name, (path, content) in contents.items()
    }


def clear(kind: Format) -> None:
    """Take away what the last input has left."""
    if kind.left is not None:
        shutil.rmtree(kind.left, ignore_errors=True)
