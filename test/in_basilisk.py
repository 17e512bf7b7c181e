"""Robots in Basilisk (pip install bsk): an arm on springs, and what it records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from mbaid_ros.core.geometry import Array, rotate_back, rotation_from_quaternion, unvec
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.simulation.simulation import Truth


def column(values: Array) -> list[list[float]]:
    return [[float(value)] for value in values]


@dataclass(frozen=True, eq=False)
class InOrbit:
    """Where the craft is in the frame that falls along, and its mean motion (rad/s).

    Its centre of mass is at the frame's origin, but for what it has strayed, (N, 3) m.
    """

    truth: Truth
    mean_motion: float
    strayed: Array


def craft_of(model: RobotModel, springs: Sequence[float]) -> tuple[Any, Any]:
    """Return a robot as Basilisk has it, and its arm on springs."""
    bodies = [physical(body) for body in model.body_parameters()]
    craft = import_module('Basilisk.simulation.spacecraft').Spacecraft()
    craft.hub.mHub, craft.hub.r_BcB_B = float(bodies[0][0]), column(bodies[0][1:4])
    craft.hub.IHubPntBc_B = unvec(bodies[0][4:]).tolist()
    module = import_module('Basilisk.simulation.spinningBodyNDOFStateEffector')
    arm = module.SpinningBodyNDOFStateEffector()
    for number, body in enumerate(bodies[1:]):
        part = module.SpinningBody()
        part.setMass(float(body[0]))
        part.setISPntSc_S(unvec(body[4:]).tolist())
        part.setR_ScS_S(column(body[1:4]))
        part.setSHat_S(column(model.axes[number]))
        part.setR_SP_P(column(model.positions[number]))
        part.setDCM_S0P(model.rotations[number].T.tolist())
        part.setThetaInit(0.5 * (-1) ** number)
        part.setK(springs[number])
        arm.addSpinningBody(part)
    craft.addStateEffector(arm)
    return craft, arm


def seen_falling(base: Any, joints: list[Any], mean_motion: float, radius: float) -> InOrbit:
    """Return what Basilisk has recorded, in the frame that falls along a circle."""
    time = base.times() * 1e-9
    angle = mean_motion * time
    up = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(len(angle))))
    along = np.column_stack((-np.sin(angle), np.cos(angle), np.zeros(len(angle))))
    parameters = np.array(base.sigma_BN)  # modified Rodrigues parameters
    square = np.sum(parameters**2, axis=1, keepdims=True)
    orientation = np.column_stack((2.0 * parameters, 1.0 - square)) / (1.0 + square)
    velocity = np.array(base.v_BN_N) - radius * mean_motion * along
    truth = Truth(
        time=time,
        joint_position=np.array([each.theta for each in joints]).T,
        joint_velocity=np.array([each.thetaDot for each in joints]).T,
        joint_effort=np.zeros((len(time), len(joints))),
        base_position=np.array(base.r_BN_N) - radius * up,
        base_orientation=orientation,
        base_linear_velocity=rotate_back(rotation_from_quaternion(orientation), velocity),
        base_angular_velocity=np.array(base.omega_BN_B),
    )
    return InOrbit(truth, mean_motion, np.array(base.r_CN_N) - radius * up)
