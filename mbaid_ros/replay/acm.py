"""Mass properties as a CCSDS Attitude Comprehensive Message (CCSDS 504.0-B-2), in keyword-value notation."""

from __future__ import annotations

from datetime import datetime, timezone

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.replay.read_back import Identified

# The standard writes the products with a minus sign into the matrix (annex F6): they are opposite to its elements.
_SIGNS = np.array([1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0])
_ORDER = (4, 7, 9, 5, 6, 8)  # of the standard: IXX, IYY, IZZ, IXY, IXZ, IYZ


def acm(body: Identified) -> str:
    """Return a message with the block PHYS; centre of mass and covariance, which the standard lacks, are user-defined.

    Numbers have the sixteen digits that the standard allows.
    """
    values = body.parameters * _SIGNS
    covariance = body.covariance * np.outer(_SIGNS, _SIGNS)
    now = datetime.now(timezone.utc).isoformat(timespec='seconds')
    rows = [
        'CCSDS_ACM_VERS = 2.0',
        f'CREATION_DATE = {_time(now)}',
        'ORIGINATOR = MBAID_ROS',
        '',
        'META_START',
        f'OBJECT_NAME = {_ascii(body.link)}',
        'TIME_SYSTEM = UTC',
        f'EPOCH_TZERO = {_time(body.date or now)}',
        'ACM_DATA_ELEMENTS = PHYS, USER',
        'META_STOP',
        '',
        'PHYS_START',
        'COMMENT SC_BODY_1 has the axes of the link in the robot description; inertia about the centre of mass',
        'COMMENT Products of inertia have the sign of annex F6: opposite to the element of the matrix, as in a URDF',
        f'WET_MASS = {_number(values[0])} [kg]',
        'INERTIA_REF_FRAME = SC_BODY_1',
        *(f'{PARAMETERS[place].upper()} = {_number(values[place])} [kg*m**2]' for place in _ORDER),
        'PHYS_STOP',
        '',
        'USER_START',
        'COMMENT COM: centre of mass in the frame of the link, m',
        'COMMENT COV_A_B: covariance of two of MASS, COM and the elements above, with their signs, SI units',
        *(f'USER_DEFINED_{PARAMETERS[place].upper()} = {_number(values[place])}' for place in (1, 2, 3)),
        *_covariance(covariance),
        'USER_STOP',
        '',
    ]
    return '\n'.join(rows)


def _covariance(matrix: Array) -> list[str]:
    """Return the elements of the lower triangle that are known."""
    names = [name.upper() for name in PARAMETERS]
    return [
        f'USER_DEFINED_COV_{names[row]}_{names[column]} = {_number(matrix[row, column])}'
        for row in range(len(names))
        for column in range(row + 1)
        if np.isfinite(matrix[row, column])
    ]


def _number(value: float) -> str:
    return f'{value + 0.0:.15E}'  # the sum has no negative zero, which the standard excludes


def _time(text: str) -> str:
    return datetime.fromisoformat(text).astimezone(timezone.utc).strftime('%Y-%m-%dT%H:%M:%S')


def _ascii(name: str) -> str:
    return ''.join(char if ' ' <= char <= '~' else '_' for char in name) or 'UNKNOWN'
