"""SPOT, Carleton University: a planar chaser on an air-bearing table with an arm of three joints, in 2021 and 2023."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.recordings.recording import Joints, Poses, Recording, Thrust, resource, turned_about_z
from mbaid_ros.recordings.tables import read_matlab, read_table

JOINTS = ('shoulder', 'elbow', 'wrist')
LINKS = ('upper_arm', 'forearm', 'hand')
BASE = 'base_link'


@dataclass(frozen=True)
class ArmLink:
    """One link of the arm: kg, kg m^2 about CoM and z, and m along x from its joint to the CoM and the next joint."""

    mass: float
    inertia: float
    com: float
    length: float


# The arm of SPOT's chaser: model_param(7) to (20) of the run initializer of 2023.
SHOULDER = 0.25, math.radians(73.2749)
SPOT_ARM = (
    ArmLink(0.345, 0.003704, 0.196822, 0.196822 + 0.107678),
    ArmLink(0.335, 0.003506, 0.198152, 0.198152 + 0.106348),
    ArmLink(0.111, 0.000106, 0.062097, 0.062097 + 0.025153),
)
SPOT_ARM_SOURCE = """\
  The arm: model_param(7) to model_param(20) in Projects/Combined_Experiment/Run_Initializer.m of the repository
  github.com/TheElectricDream/AlexCrain-SPOT: masses m1 to m3, moments of inertia I1 to I3 about the centres of mass,
  a1 to a3 from each joint to the centre of mass of its link, b1 and b2 from there to the next joint, b0 and phi the
  place of the shoulder."""


@dataclass(frozen=True)
class Chaser:
    """A base with an arm."""

    name: str  # of the robot
    mass: float  # of the base, kg
    inertia: float  # of the base about z, kg m^2
    shoulder: tuple[float, float]  # m, distance of the first joint from the base's origin, and rad, its direction there
    zero: float  # rad, direction of the first link from the base's x axis where the first joint reads 0
    links: tuple[ArmLink, ArmLink, ArmLink]  # of the arm, from the base on


def planar_urdf(chaser: Chaser, source: str) -> str:
    """Return a robot description with the source of its numbers as a comment.

    Moments about x and y, which no planar motion shows, are half of those about z.
    """
    distance, direction = chaser.shoulder
    places = [(distance * math.cos(direction), distance * math.sin(direction), chaser.zero)]
    places += [(link.length, 0.0, 0.0) for link in chaser.links[:2]]
    parts = [_link(BASE, chaser.mass, 0.0, chaser.inertia)]
    for parent, (name, link), joint, (x, y, yaw) in zip(
        (BASE, *LINKS), zip(LINKS, chaser.links, strict=True), JOINTS, places, strict=False
    ):
        parts.append(
            f'  <joint name="{joint}" type="continuous">\n'
            f'    <parent link="{parent}"/>\n    <child link="{name}"/>\n'
            f'    <origin xyz="{x:.6g} {y:.6g} 0" rpy="0 0 {yaw:.6g}"/>\n    <axis xyz="0 0 1"/>\n  </joint>'
        )
        parts.append(_link(name, link.mass, link.com, link.inertia))
    body = '\n'.join(parts)
    return f'<?xml version="1.0"?>\n<!--\n{source.strip()}\n-->\n<robot name="{chaser.name}">\n{body}\n</robot>\n'


def _link(name: str, mass: float, com: float, inertia: float) -> str:
    half = inertia / 2.0
    return (
        f'  <link name="{name}">\n    <inertial>\n      <origin xyz="{com:.6g} 0 0"/>\n'
        f'      <mass value="{mass:.6g}"/>\n'
        f'      <inertia ixx="{half:.6g}" ixy="0" ixz="0" iyy="{half:.6g}" iyz="0" izz="{inertia:.6g}"/>\n'
        '    </inertial>\n  </link>'
    )


COMMANDS_FILE = '100NodeSolution_FreeFloating_DIDO.mat'
_COLUMNS_2021 = 65
_POSITION_2021, _HEADING_2021 = slice(4, 6), 6
# s: the thrusters stop at 40, the arm moves from 42 to 72 and lags behind; at 72 the thrusters start again.
_ARM, _SPAN_2021 = 42.0, (40.2, 72.0)

_SOURCE_2021 = f"""
  The chaser RED of the SPOT facility, Carleton University, as flown on 6 March 2021.

  The base: mass and moment of inertia are model_param(1) and (2) in Projects/Combined_Experiment/Run_Initializer.m of
  the repository github.com/TheElectricDream/SPOT. The mass was weighed: Useful_Code/EstimateCOG/Estimate_COG.m has four
  weighings, 16.881 to 16.980 kg. The moment is nominal: {COMMANDS_FILE} has 0.2974 kg m^2.
{SPOT_ARM_SOURCE}
  These are of 2023; of the arm of 2021 no link has been weighed by itself. {COMMANDS_FILE}, of 2017, has a
  lighter and shorter arm (0.273, 0.263, 0.104 kg; 0.2889 m from joint to joint), but the markers on elbow and wrist in
  the logs of 2021 (columns 54 to 57)
  move on a circle of 0.306 m about the shoulder, and the base shifts 1.46 times as far as with the lighter arm.
  The shoulder: (0.250, -0.0895) m from the origin of the poses, round which the elbow's marker goes in two of the runs
  (15_33 and 16_13). model_param(8) and (7), b0 and phi about an axis that is turned by 90 degrees against the
  motion capture's, have it 20 mm from there, at (0.239, -0.072) m; the origin of the poses is not the centre of mass.
  Moments about x and y do not matter on a table and are half of those about z.
"""

CHASER_2021 = Chaser('spot_red_2021', 16.9478, 0.2709, (0.2655, -0.3438), 0.0, SPOT_ARM)


def read_spot_2021(path: Path, commands: Path | None = None) -> Recording:
    """Return the run of a ``*__stitched.mat``; without `commands`, the arm's motion is a file in a folder above it.

    Raises DataError: A file has another format.
    """
    table = np.asarray(read_matlab(path, ('rt_dataPacket',))['rt_dataPacket'])
    if table.ndim != 2 or table.shape[1] != _COLUMNS_2021 or not np.issubdtype(table.dtype, np.floating):
        raise DataError(
            f"'{path}' has rt_dataPacket of shape {table.shape}; accepted: rows of {_COLUMNS_2021} numbers, as in 2021"
        )
    table = table[np.all(np.isfinite(table[:, : _HEADING_2021 + 1]), axis=1)]
    time = table[:, 0]
    primal = read_matlab(commands or _beside(path), ('primal',))['primal']
    nothing = np.full((len(table), 6), np.nan)
    position = np.column_stack((table[:, _POSITION_2021], np.zeros(len(table))))
    poses = Poses(time, position, turned_about_z(table[:, _HEADING_2021]), nothing)
    joints = Joints(JOINTS, time, _commanded(primal, time - _ARM, path))
    return Recording(
        joints,
        poses,
        robot=planar_urdf(CHASER_2021, _SOURCE_2021),
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

_SOURCE_2023 = f"""
  The chaser RED of the SPOT facility, Carleton University, as flown in March and April 2023.

  The base: mass and moment of inertia about z are model_param(1) and (2) in
  Projects/Combined_Experiment/Run_Initializer.m of the repository github.com/TheElectricDream/AlexCrain-SPOT.
{SPOT_ARM_SOURCE}
  phi is about an axis that is turned by 90 degrees against the motion capture's: the shoulder is at phi - 90 degrees.
  Moments about x and y do not matter on a table and are half of those about z.

  The bodies to be captured, of the same file: in March BLACK, 12.039 kg and 0.225692 kg m^2; in April BLUE, 10.726 kg
  and 0.194438 kg m^2.
"""

CHASER_2023 = Chaser('spot_red_2023', 11.211, 0.20215, (SHOULDER[0], SHOULDER[1] - math.pi / 2.0), 0.0, SPOT_ARM)


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
        robot=planar_urdf(CHASER_2023, _SOURCE_2023),
        parameters=resource('spot_2023.yaml'),
        notes=(
            'thrust is the commanded one, turned into axes of the base',
            'the body to be captured is nowhere held firmly: there is no truth.json',
        ),
        span=_SPAN_2023,
    )
