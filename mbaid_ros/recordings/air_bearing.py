"""A body on air bearings that eight thrusters move, with a published log and load cell measurements."""

from __future__ import annotations

import csv
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError
from mbaid_ros.files import read_text
from mbaid_ros.recordings.recording import Recording, resource, turned_about_z
from mbaid_ros.sensor_messages import Joints, Poses, Thrust

BASE = 'base_link'
# N, of each thruster by itself on a load cell: THRUSTER_FORCES of config/physics.py.
FORCES = (0.441450, 0.430659, 0.427716, 0.438017, 0.468918, 0.446846, 0.466956, 0.484124)
# kg, the loads on the three air bearings, as config/physics.py and model.py have them.
WEIGHINGS = ((7.614, 7.724, 7.752), (7.358, 8.074, 8.392))
_COLUMNS = ('Control_Time', 'Telemetry_X_mm', 'Telemetry_Z_mm', 'Telemetry_Yaw_deg', 'Command_Vector')
_FEWEST = 10  # rows
# s from the pose of a row to the effect of its command: link, relay and valve. By the rotation of the published run.
LATE = 0.12
# s: the table's slope has moved the body by then as much as its thrusters have.
_SPAN = (0.0, 54.0)
_REPEATED = 8  # rows, after which a command that goes on is repeated: it acts for 1 s at most


def read_air_bearing_thrusters(path: Path) -> Recording:
    """Return the run of a ``real_test_data.csv``: motion capture, and which of eight thrusters were on.

    Raises DataError: It is no such log.
    """
    time, pose, commands = _read(path)
    count = len(time)
    position = np.column_stack((1e-3 * pose[:, :2], np.zeros(count)))
    poses = Poses(time, position, turned_about_z(np.unwrap(np.radians(pose[:, 2]))), np.full((count, 6), np.nan))
    thrust = []
    for place, force in enumerate(FORCES):
        on = commands[:, place]
        sent = np.flatnonzero((np.diff(on, prepend=0.0) != 0.0) | ((on > 0.0) & (np.arange(count) % _REPEATED == 0)))
        wrench = np.zeros((len(sent), 6))
        wrench[:, 0] = force * on[sent]  # along x of the thruster's link
        thrust.append(Thrust(time[sent] + LATE, wrench, f'thruster{place + 1}'))
    return Recording(
        Joints((), time, np.zeros((count, 0))),
        poses,
        tuple(thrust),
        robot=resource('air_bearing_thrusters.urdf'),
        parameters=resource('air_bearing_thrusters.yaml'),
        truth=_truth(),
        notes=(
            'thrust is as commanded, of the size that each thruster had on a load cell by itself',
            'thruster 2 shows no thrust in the published run',
            'times count turns of the control loop, of 60 ms at least: no clock was logged',
        ),
        span=_SPAN,
    )


def _truth() -> dict[str, Any]:
    """Return what was weighed; no moment was measured."""
    masses = [round(sum(each), 3) for each in WEIGHINGS]
    return {'target_link': BASE, 'weighed': {'mass': masses, 'loads': [list(each) for each in WEIGHINGS]}}


def _read(path: Path) -> tuple[Array, Array, Array]:
    """Return times (N,) s, x and y in mm with the heading in degrees (N, 3), and commands (N, 8), 0 or 1."""
    text = read_text(path, 'log', limits.LOG_BYTES, 'accepted: a table of text', DataError)
    reader = csv.reader(text.splitlines())
    try:
        names = next(reader, [])
        missing = [name for name in _COLUMNS if name not in names]
        if missing:
            raise DataError(f"log '{path}' lacks the column '{missing[0]}'; accepted: {', '.join(_COLUMNS)}")
        places = [names.index(name) for name in _COLUMNS]
        rows = [[row[place] for place in places] for row in islice(reader, limits.LOG_BYTES)]
        numbers = np.array([[float(field) for field in row[:4]] for row in rows]).reshape(-1, 4)
        commands = np.array([_command(row[4]) for row in rows], dtype=float).reshape(-1, len(FORCES))
    except (csv.Error, IndexError, ValueError) as error:
        raise DataError(f"log '{path}' has a row that is none of such a run: {error}") from error
    used = np.all(np.isfinite(numbers), axis=1)
    used[1:] &= np.diff(numbers[:, 0]) > 0.0
    if np.sum(used) < _FEWEST:
        raise DataError(f"log '{path}' has {int(np.sum(used))} rows of use; accepted: {_FEWEST} or more")
    return numbers[used, 0], numbers[used, 1:], commands[used]


def _command(text: str) -> list[int]:
    """Return the eight commands in a text such as [1, 0, 1, 0, 1, 0, 1, 0]."""
    values = [int(each) for each in text.strip('[] ').split(',')]
    if len(values) != len(FORCES) or not set(values) <= {0, 1}:
        raise ValueError(f'{text[:40]!r} is no list of eight commands')
    return values
