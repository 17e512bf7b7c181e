"""Carleton University's SPOT facility in 2023: planar chaser with an arm that is measured, thrusters on nearly always.

A log (``ExpLog*``) is a table in text without a line of names, 80 or 81 columns at 20 Hz, which are those of
``ApplyDataDictionaryCE.m``; the pose of the motion capture is new 16 times a second.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mbaid_ros.core.errors import DataError
from mbaid_ros.recordings.recording import Joints, Poses, Recording, Thrust, turned_about_z
from mbaid_ros.recordings.spot import (
    BASE,
    JOINTS,
    SHOULDER,
    SPOT_ARM,
    SPOT_ARM_SOURCE,
    Chaser,
    planar_urdf,
)
from mbaid_ros.recordings.tables import read_table

_COLUMNS = (80, 81)
_TIME, _WRENCH, _POSITION, _HEADING = 0, slice(1, 4), slice(4, 6), 6
_ANGLES, _RATES = slice(64, 67), slice(67, 70)

_SPAN = 165.0, math.inf  # s: before that the arm rests, folded
_MASS, _INERTIA = 11.211, 0.20215

_SOURCE = f"""
  The chaser RED of the SPOT facility, Carleton University, as flown in March and April 2023.

  The base: mass and moment of inertia about z are model_param(1) and (2) in
  Projects/Combined_Experiment/Run_Initializer.m of the repository github.com/TheElectricDream/AlexCrain-SPOT.
{SPOT_ARM_SOURCE}
  phi is about an axis that is turned by 90 degrees against the motion capture's: the shoulder is at phi - 90 degrees.
  Moments about x and y do not matter on a table and are half of those about z.

  What was to be captured, of the same file: in March BLACK, 12.039 kg and 0.225692 kg m^2; in April BLUE, 10.726 kg and
  0.194438 kg m^2.
"""

CHASER = Chaser('spot_red_2023', _MASS, _INERTIA, (SHOULDER[0], SHOULDER[1] - math.pi / 2.0), 0.0, SPOT_ARM)

_PARAMETERS = """\
# SPOT 2023: joints as measured, thrusters as commanded: on nearly always, and nobody knows how strong.
#
#   ros2 run mbaid_ros replay FOLDER --model FOLDER/robot.urdf --params FOLDER/estimator.yaml
/**:
  ros__parameters:
    target_link: hand
    maximum_gap: 0.3                  # s, between poses
    noise:
      joint_position: 1.5e-3          # rad, one step of the encoders
      joint_velocity: 2.0e-2          # rad/s
      base_position: 1.0e-4           # m
      base_orientation: 3.0e-4        # rad
    time_offset: {prior_std: 0.1}     # s
    thrust: {scale_std: 0.5, direction_std: 0.05}
    known_links: {relative_std: 0.05}
    known_joints: {zero_std: 0.05, origin_std: 5.0e-3, axis_std: 0.0}
"""


def read_spot_2023(path: Path) -> Recording:
    """Return a run of 2023.

    Parameters
    ----------
    path : an ``ExpLog*`` of the chaser RED

    Raises
    ------
    DataError
        It is none.
    """
    table = read_table(path, header=False).values
    if table.shape[1] not in _COLUMNS:
        raise DataError(f"log '{path}' has {table.shape[1]} columns; accepted: 80 or 81, as SPOT logged in 2023")
    used = np.all(np.isfinite(table[:, : _RATES.stop]), axis=1)
    table = table[used & np.any(table[:, _POSITION] != 0.0, axis=1)]  # before the first pose all is 0
    table = table[np.concatenate(([True], np.diff(table[:, _TIME]) > 0.0))[: len(table)]]  # a row may be told again
    time = table[:, _TIME]
    told = np.any(table[:, _ANGLES] != 0.0, axis=1)  # before the arm answers its joints are 0
    position = np.column_stack((table[:, _POSITION], np.zeros(len(table))))
    wrench = np.zeros((len(table), 6))
    # Commanded along the table's axes; the thrusters that turn this into pulses are on the base.
    along, across = np.cos(table[:, _HEADING]), np.sin(table[:, _HEADING])
    x, y, wrench[:, 5] = table[:, _WRENCH].T
    wrench[:, 0], wrench[:, 1] = along * x + across * y, along * y - across * x
    return Recording(
        Joints(JOINTS, time[told], table[told, _ANGLES], table[told, _RATES]),
        Poses(time, position, turned_about_z(table[:, _HEADING]), np.full((len(table), 6), np.nan)),
        Thrust(time, wrench, BASE),
        robot=planar_urdf(CHASER, _SOURCE),
        parameters=_PARAMETERS,
        notes=(
            'thrust is what was commanded, turned into axes of the base',
            'what was to be captured is nowhere held firmly: there is no truth.json',
        ),
        span=_SPAN,
    )
