"""SPOT, Carleton University: a planar chaser on an air-bearing table with an arm of three joints, in 2021 and 2023."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError
from mbaid_ros.recordings.recording import Recording, resource, turned_about_z
from mbaid_ros.recordings.table_files import read_matlab, read_table
from mbaid_ros.sensor_messages import Joints, Poses, Thrust

JOINTS = ('shoulder', 'elbow', 'wrist')
BASE = 'base_link'

COMMANDS_FILE = '100NodeSolution_FreeFloating_DIDO.mat'
_COLUMNS_2021 = (65, 71)  # in March and in May
_PERIOD = 0.1  # s, of the rows in March
_POSITION_2021, _HEADING_2021 = slice(4, 6), 6
# s: the thrusters stop at 40, the arm moves from 42 to 72 and lags behind; at 72 the thrusters start again.
_ARM, _SPAN_2021 = 42.0, (40.2, 72.0)


def read_spot_2021(path: Path, commands: Path | None = None) -> Recording:
    """Return the run of a ``*__stitched.mat``; without `commands`, the arm's motion is a file in a folder above it.

    Raises DataError: A file has another format.
    """
    table = np.asarray(read_matlab(path, ('rt_dataPacket',))['rt_dataPacket'])
    if table.ndim != 2 or table.shape[1] not in _COLUMNS_2021 or not np.issubdtype(table.dtype, np.floating):
        raise DataError(
            f"'{path}' has rt_dataPacket of shape {table.shape}; accepted: rows of 65 or 71 numbers, as in 2021"
        )
    table = table[np.all(np.isfinite(table[:, : _HEADING_2021 + 1]), axis=1)]
    table = table[np.diff(table[:, 0], prepend=-np.inf) > 0.0]
    time = table[:, 0]
    primal = read_matlab(commands or _beside(path), ('primal',))['primal']
    nothing = np.full((len(table), 6), np.nan)
    position = np.column_stack((table[:, _POSITION_2021], np.zeros(len(table))))
    poses = Poses(time, position, turned_about_z(table[:, _HEADING_2021]), nothing)
    # Of commands, which are known at any time, a log of few poses has few.
    sparse = len(time) > 1 and np.median(np.diff(time)) >= 2.0 * _PERIOD
    often = np.arange(time[0], time[-1], _PERIOD) if sparse else time
    joints = Joints(JOINTS, often, _commanded(primal, often - _ARM, path))
    if len(time) < 2:
        raise DataError(f"'{path}' has {len(time)} rows of increasing time and finite poses; accepted: two or more")
    return Recording(
        joints,
        poses,
        robot=resource('spot_2021.urdf'),
        parameters=resource('spot_2021.yaml'),
        notes=(
            'joint states are commands: the arm lags behind them',
            'the moment of inertia of the base is not known: there is no truth.json',
        ),
        span=_SPAN_2021,
    )


def _beside(path: Path) -> Path:
    """Return the file of the arm's motion in one of the folders above a log."""
    for folder in path.resolve().parents:
        if (folder / COMMANDS_FILE).is_file():
            return folder / COMMANDS_FILE
    raise DataError(
        f"no {COMMANDS_FILE} in a folder above '{path}'; accepted: --commands FILE, or the log in its clone"
    )


def _commanded(primal: Any, time: Array, path: Path) -> Array:
    """Return the commanded joint positions, (N, 3) rad."""
    try:
        own = np.atleast_1d(np.asarray(primal.time, dtype=float))
        states = np.atleast_2d(np.asarray(primal.states, dtype=float))
    except (AttributeError, TypeError, ValueError) as error:
        raise DataError(f"the arm's motion for '{path}' has no primal.time and primal.states of numbers") from error
    if own.ndim != 1 or states.shape[1:] != own.shape or len(states) < 6 or not np.all(np.diff(own) > 0.0):
        raise DataError(
            f"the arm's motion for '{path}' has primal.states of shape {states.shape}; accepted: (12, times)"
        )
    return np.column_stack([np.interp(time, own, states[row]) for row in (3, 4, 5)])


_COLUMNS_2023 = (80, 81)
_TIME, _WRENCH, _POSITION_2023, _HEADING_2023 = 0, slice(1, 4), slice(4, 6), 6
_ANGLES, _RATES = slice(64, 67), slice(67, 70)

_SPAN_2023 = 165.0, math.inf  # s: before that the arm rests, folded


def read_spot_2023(path: Path) -> Recording:
    """Return the run of an ``ExpLog*`` of the chaser RED: text without names, 80 or 81 columns at 20 Hz.

    The columns are those of ``ApplyDataDictionaryCE.m``; the pose of the motion capture is new 16 times a second.

    Raises DataError: It is none.
    """
    table = read_table(path, header=False).values
    if table.shape[1] not in _COLUMNS_2023:
        raise DataError(f"log '{path}' has {table.shape[1]} columns; accepted: 80 or 81, as SPOT logged in 2023")
    used = np.all(np.isfinite(table[:, : _RATES.stop]), axis=1)
    table = table[used & np.any(table[:, _POSITION_2023] != 0.0, axis=1)]  # before the first pose all is 0
    table = table[np.concatenate(([True], np.diff(table[:, _TIME]) > 0.0))[: len(table)]]  # a row may repeat
    time = table[:, _TIME]
    answered = np.any(table[:, _ANGLES] != 0.0, axis=1)  # before the arm answers its joints are 0
    position = np.column_stack((table[:, _POSITION_2023], np.zeros(len(table))))
    wrench = np.zeros((len(table), 6))
    # Commanded along the table's axes; the thrusters that turn this into pulses are on the base.
    along, across = np.cos(table[:, _HEADING_2023]), np.sin(table[:, _HEADING_2023])
    x, y, wrench[:, 5] = table[:, _WRENCH].T
    wrench[:, 0], wrench[:, 1] = along * x + across * y, along * y - across * x
    return Recording(
        Joints(JOINTS, time[answered], table[answered, _ANGLES], table[answered, _RATES]),
        Poses(time, position, turned_about_z(table[:, _HEADING_2023]), np.full((len(table), 6), np.nan)),
        Thrust(time, wrench, BASE),
        robot=resource('spot_2023.urdf'),
        parameters=resource('spot_2023.yaml'),
        notes=(
            'thrust is the commanded one, turned into axes of the base',
            'the body to be captured is nowhere attached firmly: there is no truth.json',
        ),
        span=_SPAN_2023,
    )
