"""Robot description of a chaser on an air-bearing table: a base that slides and turns, and an arm of three joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
