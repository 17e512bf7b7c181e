"""The frames that parameters name, found on the robot."""

from __future__ import annotations

import numpy as np

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.geometry import rotation_from_quaternion
from mbaid_ros.core.results.publication import Frame
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.sensors.base import AttachedFrame
from mbaid_ros.messages import ImuReader

PRINCIPAL = 'principal'

_UNIT = 1e-3  # largest difference of a quaternion parameter from unit length


def marker_frame(config: EstimatorConfig) -> AttachedFrame | None:
    """Return the frame that the parameters place on the base.

    Raises
    ------
    ParameterError
        The orientation is no unit quaternion.
    """
    quaternion = np.array(config.marker.orientation)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > _UNIT:
        raise ParameterError(
            f"parameter 'marker.orientation' has length {length:g}; accepted: a quaternion x, y, z, w of length 1"
        )
    if not config.marker.position:
        return None
    return AttachedFrame(rotation_from_quaternion(quaternion), np.array(config.marker.position))


def imu_link(config: EstimatorConfig, model: RobotModel) -> Link | None:
    """Return the link that the parameters say an IMU is on, where joints move it; None on the base.

    Raises
    ------
    ParameterError
        There is no such link, or it moves with the target.
    """
    given, links = config.imu.frame, {config.frame_prefix + link.name: link for link in model.links}
    if not given:
        return None
    target, ancestors = model.link(config.target_link or model.last_link).body, Kinematics(model).ancestors
    carried = [target > 0 and (body == target or bool(ancestors[body, target - 1])) for body in range(len(ancestors))]
    accepted = [name for name, link in links.items() if not carried[link.body] and not (config.imu.alone and link.body)]
    if given not in accepted:
        why = ''
        if given in links:
            why = ', which moves with the target' if carried[links[given].body] else ", and 'imu.alone' is true"
        raise ParameterError(f"parameter 'imu.frame' is '{given}'{why}; accepted: {listing(accepted)}")
    return links[given] if links[given].body else None


def imu_reader(config: EstimatorConfig, model: RobotModel) -> ImuReader:
    """Return what reads an IMU, in base axes, or in its own where joints move it.

    Raises
    ------
    ParameterError
        The frame that the parameters name is none that it can be on.
    """
    axes = {config.frame_prefix + link.name: link.rotation for link in model.links if link.body == 0}
    if imu_link(config, model) is not None:
        axes = {config.imu.frame: np.eye(3)}
    of_orientation = config.noise.declared.base_orientation if config.imu.orientation else None
    return ImuReader(axes, config.imu.frame, of_orientation)


def debris_frame(name: str, model: RobotModel, target: Link) -> Frame:
    """Return the frame that the captured body is to be given in; of its principal axes only what they are called.

    Parameters
    ----------
    name : of a link, PRINCIPAL, or empty for the target link
    model : RobotModel
    target : the target link

    Raises
    ------
    ParameterError
        There is no such link, or it moves against the target link.
    """
    if name == PRINCIPAL:
        return Frame(f'{target.name}_{PRINCIPAL}', np.eye(3), np.zeros(3))
    fixed = {link.name: link for link in model.links if link.body == target.body}
    if name and name not in fixed:
        known = any(link.name == name for link in model.links)
        problem = f"moves against the target link '{target.name}'" if known else 'is not in the robot description'
        raise ParameterError(
            f"parameter 'debris.frame': link '{name}' {problem}; accepted: {listing(fixed)}, or {PRINCIPAL}"
        )
    link = fixed[name or target.name]
    back = target.rotation.T
    return Frame(link.name, back @ link.rotation, back @ (link.position - target.position))
