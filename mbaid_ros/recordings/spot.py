"""Robot description of a chaser on an air-bearing table: a base that slides and turns, and an arm of three joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.recordings.recording import Joints, Poses, Recording, turned_about_z
from mbaid_ros.recordings.tables import read_matlab

JOINTS = ('shoulder', 'elbow', 'wrist')
LINKS = ('upper_arm', 'forearm', 'hand')
BASE = 'base_link'


@dataclass(frozen=True)
class ArmLink:
    """One link of the arm, its joint at the origin, the next one along x.

    Attributes
    ----------
    mass, inertia : kg; kg m^2 about the centre of mass, about z
    com, length : m, along x, of the centre of mass and of the next joint
    """

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
    """A base with an arm.

    Attributes
    ----------
    name : of the robot
    mass, inertia : of the base, kg; kg m^2 about z
    shoulder : m, distance of the first joint from the base's origin, and rad, its direction there
    zero : rad, direction of the first link from the base's x axis where the first joint reads 0
    links : of the arm, from the base on
    """

    name: str
    mass: float
    inertia: float
    shoulder: tuple[float, float]
    zero: float
    links: tuple[ArmLink, ArmLink, ArmLink]


def planar_urdf(chaser: Chaser, source: str) -> str:
    """Return a robot description whose moments about x and y, which no planar motion shows, are half of those about z.

    Parameters
    ----------
    chaser : its numbers
    source : where each number is from, as a comment
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
_COLUMNS = 65
_POSITION, _HEADING = slice(4, 6), 6
# s: the thrusters stop at 40, the arm moves from 42 to 72 and lags behind; at 72 the thrusters start again.
_ARM, _SPAN = 42.0, (40.2, 72.0)
# Run_Initializer.m of 2021, model_param(1) and (2): kg, kg m^2.
_MASS, _INERTIA = 16.9478, 0.2709

_SOURCE = f"""
  The chaser RED of the SPOT facility, Carleton University, as flown on 6 March 2021.

  The base: mass and moment of inertia are model_param(1) and (2) in Projects/Combined_Experiment/Run_Initializer.m of
  the repository github.com/TheElectricDream/SPOT. Both are nominal: {COMMANDS_FILE} has 0.2974 kg m^2.
{SPOT_ARM_SOURCE}
  These are of 2023. {COMMANDS_FILE}, of 2017, has a lighter and shorter arm (0.273, 0.263,
  0.104 kg; 0.2889 m from joint to joint), but the markers on elbow and wrist in the logs of 2021 (columns 54 to 57)
  move on a circle of 0.306 m about the shoulder, and the base shifts by 1.46 times what the lighter arm would make it.
  The shoulder: (0.250, -0.0895) m from the origin of the poses, round which the elbow's marker goes in two of the runs
  (15_33 and 16_13). model_param(8) and (7), b0 and phi about an axis that is turned by 90 degrees against the
  motion capture's, have it 20 mm from there, at (0.239, -0.072) m; the origin of the poses is not the centre of mass.
  Moments about x and y do not matter on a table and are half of those about z.
"""

CHASER = Chaser('spot_red_2021', _MASS, _INERTIA, (0.2655, -0.3438), 0.0, SPOT_ARM)

_PARAMETERS = f"""\
# SPOT 2021: poses of the motion capture every 0.2 s, told twice each; joints as commanded, not as measured.
#
#   ros2 run mbaid_ros replay FOLDER --model FOLDER/robot.urdf --params FOLDER/estimator.yaml
/**:
  ros__parameters:
    target_link: {BASE}            # the base is what is looked for: the arm's links have been weighed
    maximum_gap: 0.5                  # s, between poses
    noise:
      joint_position: 2.0e-3          # rad: commands are smooth; how far the arm is off them is below
      base_position: 1.0e-3           # m
      base_orientation: 3.0e-3        # rad
    time_offset: {{prior_std: 0.5}}     # s, that the arm lags behind the command
    disturbance: {{constant: inertial}} # the table is not level
    target_prior: {{mass: 16.948, mass_std: 1.5}}   # kg, nominal
    known_links: {{relative_std: 0.02}}
    # tracking_*: in 15_33 the markers on elbow and wrist (columns 54 to 57) have shoulder and elbow 14 and 22 mrad
    # (RMS) off their commands of 0.22 s before, less the mean, 19 for both; a second apart that has a correlation of
    # 0.54, two seconds 0.33. The wrist is taken to be as the others.
    known_joints: {{zero_std: 0.05, origin_std: 0.01, axis_std: 0.0, tracking_std: 0.02}}
"""


def read_spot_2021(path: Path, commands: Path | None = None) -> Recording:
    """Return a run of 2021.

    Parameters
    ----------
    path : a ``*__stitched.mat``
    commands : the file of the arm's motion; None looks for it in the folders above the log

    Raises
    ------
    DataError
        A file is not what it should be.
    """
    table = np.asarray(read_matlab(path, ('rt_dataPacket',))['rt_dataPacket'])
    if table.ndim != 2 or table.shape[1] != _COLUMNS or not np.issubdtype(table.dtype, np.floating):
        raise DataError(
            f"'{path}' has rt_dataPacket of shape {table.shape}; accepted: rows of {_COLUMNS} numbers, as in 2021"
        )
    table = table[np.all(np.isfinite(table[:, : _HEADING + 1]), axis=1)]
    time = table[:, 0]
    primal = read_matlab(commands or _beside(path), ('primal',))['primal']
    nothing = np.full((len(table), 6), np.nan)
    position = np.column_stack((table[:, _POSITION], np.zeros(len(table))))
    poses = Poses(time, position, turned_about_z(table[:, _HEADING]), nothing)
    joints = Joints(JOINTS, time, _commanded(primal, time - _ARM, path))
    return Recording(
        joints,
        poses,
        robot=planar_urdf(CHASER, _SOURCE),
        parameters=_PARAMETERS,
        notes=(
            'joint states are commands: the arm lags behind them',
            'the moment of inertia of the base is not known: there is no truth.json',
        ),
        span=_SPAN,
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
