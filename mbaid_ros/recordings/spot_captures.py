"""SPOT, Carleton University, July and August 2021: a chaser grasps a weighed body that spins on the same table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError
from mbaid_ros.recordings.recording import Recording, resource, turned_about_z
from mbaid_ros.recordings.spot import BASE, JOINTS
from mbaid_ros.recordings.table_files import read_matlab
from mbaid_ros.sensor_messages import Joints, Poses

TRACKED = ('body_x', 'body_y', 'body_turn')  # joints that stand for the body's place relative to the base
COLUMNS = 92
TIME, BASE_PLACE, BASE_HEADING, BODY_PLACE, BODY_HEADING = 0, slice(4, 6), 6, slice(24, 26), 26
ANGLES, FLAG = slice(74, 77), 83
NO_ANSWER = -np.pi  # rad, that an encoder reads which does not answer; where none of them does, all may read 0
_ANSWERS = -3.1  # rad: below that it does not
# m: shoulder in the base's frame, from joint to joint, and to the tip of the hand, as in spot_capture.urdf.
_SHOULDER, _LENGTHS = (0.068008, 0.242131), (0.3045, 0.3045, 0.08725)
_STRETCHED = np.pi / 2.0  # rad, heading of the stretched arm in the base's frame
_PERIOD = 0.1  # s, of the motion capture
_HALF = 0.25  # of that, by which a gap of one and a half counts as one
_AFTER, _CHECKED = 0.5, 2.5  # s after the capture, between which the hand has to stay where it is on the body
_STAYS = 0.02  # m, from there: in the first captures 5 mm, in one that fails 29 mm
_SLOWER, _AROUND = 0.6, 0.5  # of the speed then, s: below that, in a second, one of them has touched something
_BEFORE_THAT = 1.0  # s
_FEWEST = 15  # poses
WEIGHED = {'mass': 12.039, 'izz': 0.225692}  # kg, kg m^2: Estimate_COG.m


def read_spot_capture(path: Path) -> Recording:
    """Return the flight from the capture on in a ``Kirk_Phase3_*__stitched.mat``.

    Raises DataError: It is no such log, or nothing is captured in it.
    """
    table = np.asarray(read_matlab(path, ('rt_dataPacket',))['rt_dataPacket'])
    if table.ndim != 2 or table.shape[1] != COLUMNS or not np.issubdtype(table.dtype, np.floating):
        raise DataError(f"'{path}' has rt_dataPacket of shape {table.shape}; accepted: rows of {COLUMNS} numbers")
    table = table[np.all(np.isfinite(table), axis=1)]
    table = table[np.diff(table[:, TIME], prepend=-np.inf) > 0.0]
    grasped = table[:, FLAG] > 0.0
    edges = np.flatnonzero(grasped[1:] & ~grasped[:-1]) + 1
    if not edges.size or not grasped[-1]:
        raise DataError(f"'{path}' has no capture: its flag, column {FLAG}, does not stay set")
    capture = float(table[edges[-1], TIME])  # earlier edges are false ones
    # Each pose stands in two rows; that of the flag may repeat an older one.
    table = table[np.any(np.diff(table[:, 4:7], axis=0, prepend=np.nan) != 0.0, axis=1)]
    table = table[table[:, TIME] >= capture]
    for column in (BASE_HEADING, BODY_HEADING):
        table[:, column] = np.unwrap(table[:, column])
    end = _end(_answered(table), capture, path)
    table[:, TIME] = _sampled(table[:, TIME])
    return _recording(table[table[:, TIME] <= end])


def _answered(table: Array) -> Array:
    """Return the rows in which the encoders answer."""
    angles = table[:, ANGLES]
    return np.asarray(table[np.all(angles > _ANSWERS, axis=1) & np.any(angles != 0.0, axis=1)])


def _end(table: Array, capture: float, path: Path) -> float:
    """Return until when both bodies fly freely, s.

    Raises DataError: The hand does not hold the body.
    """
    table = table[table[:, TIME] >= capture + _AFTER]
    time = table[:, TIME]
    first = time <= capture + _CHECKED
    if len(table) < _FEWEST or not first.any():
        raise DataError(f"'{path}' has {len(table)} poses after the capture; accepted: {_FEWEST} or more")
    place = _hand(table)
    away = np.linalg.norm(place - np.median(place[first], axis=0), axis=1)
    if np.max(away[first]) > _STAYS:
        slides = f'{1e3 * np.max(away[first]):.0f} mm'
        raise DataError(f"'{path}' has no capture: the hand slides by {slides} over the body after the flag")
    speed = np.array([_speed(table[np.abs(time - now) <= _AROUND]) for now in time])
    ends = time[(away > _STAYS) | (speed < _SLOWER * np.median(speed[first]))]
    return float(ends[0] if ends.size else time[-1]) - _BEFORE_THAT


def _speed(table: Array) -> float:
    """Return the speed of the middle between base and body, m/s: blows in the grasp hardly change it."""
    line = np.column_stack((np.ones(len(table)), table[:, TIME] - table[0, TIME]))
    middle = 0.5 * (table[:, BASE_PLACE] + table[:, BODY_PLACE])
    return float(np.linalg.norm(np.linalg.lstsq(line, middle, rcond=None)[0][1]))


def _hand(table: Array) -> Array:
    """Return the place of the hand's tip in the body's frame, (N, 2) m."""
    heading = table[:, BASE_HEADING]
    tip = table[:, BASE_PLACE] + turned(heading, np.tile(_SHOULDER, (len(table), 1)))
    heading = heading + _STRETCHED
    for length, angle in zip(_LENGTHS, table[:, ANGLES].T, strict=True):
        heading = heading + angle
        tip = tip + length * np.column_stack((np.cos(heading), np.sin(heading)))
    return turned(-table[:, BODY_HEADING], tip - table[:, BODY_PLACE])


def turned(angle: Array, vector: Array) -> Array:
    """Return vectors (N, 2) turned by angles (N,), rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack((cos * vector[:, 0] - sin * vector[:, 1], sin * vector[:, 0] + cos * vector[:, 1]))


def _sampled(time: Array) -> Array:
    """Return when the motion capture took its poses, s, by the times (N,) of the rows that have them.

    It takes one each 0.1 s. Rows come each 0.05 s, and a pose may come one row late: 2 mm at the speed of the base.
    """
    steps = np.maximum(np.round(np.diff(time) / _PERIOD - _HALF), 1.0)
    return np.asarray(time[0] + _PERIOD * np.concatenate(([0.0], np.cumsum(steps))))


def _recording(table: Array) -> Recording:
    """Return the readings in rows of a table."""
    position = np.column_stack((table[:, BASE_PLACE], np.zeros(len(table))))
    nothing = np.full((len(table), 6), np.nan)
    poses = Poses(table[:, TIME], position, turned_about_z(table[:, BASE_HEADING]), nothing, BASE)
    table = _answered(table)
    heading = table[:, BASE_HEADING]
    place = turned(-heading, table[:, BODY_PLACE] - table[:, BASE_PLACE])
    joints = np.column_stack((table[:, ANGLES], place, table[:, BODY_HEADING] - heading))
    return Recording(
        Joints((*JOINTS, *TRACKED), table[:, TIME], joints),
        poses,
        robot=resource('spot_capture.urdf'),
        parameters=resource('spot_capture.yaml'),
        truth={'target_link': 'target', 'weighed': WEIGHED},
        notes=(
            'body_x, body_y and body_turn are no joints: the motion capture has the body there, relative to the base',
        ),
    )
