"""The seven-joint servicer with the hand known and what it holds unknown, for the tests of the captured body."""

from __future__ import annotations

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.debris import Frame
from mbaid_ros.core.robot.inertia import physical, standard
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.urdf_output import replace_inertial
from simulated import CONFIG, robot

LINK = 'link7'
# The empty last link: (m, r_c, I_c), as the robot description's comment has it.
BARE = np.array([7.0, 0.010, -0.015, 0.150, 0.070, 0.001, -0.003, 0.075, 0.002, 0.040])
GRASP = Frame('grasp', np.asarray(pinocchio.rpy.rpyToMatrix(0.3, -0.5, 1.2)), np.array([0.05, 0.1, 0.2]))
_GRASP = (
    '<link name="grasp"/><joint name="to_grasp" type="fixed"><parent link="link7"/><child link="grasp"/>'
    '<origin xyz="0.05 0.1 0.2" rpy="0.3 -0.5 1.2"/></joint>'
)


def with_bare_link() -> str:
    """Return the robot description as it is before the capture, with the grasp frame on the last link."""
    text = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    return replace_inertial(text, LINK, BARE).replace('</robot>', f'{_GRASP}</robot>')


def alone() -> Array:
    """Return the captured body's (m, h, I_o) in the last link's frame."""
    return robot('servicer7').link(LINK).parameters - standard(BARE)


def alone_in_grasp() -> Array:
    """Return the captured body's (m, r_c, I_c) in the grasp frame."""
    back = GRASP.rotation.T
    return physical(express(alone(), back, -back @ GRASP.position))
