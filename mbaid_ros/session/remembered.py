"""What a run has come to know as plain numbers, and back: how a motion is planned from a result that was written."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.trajectory.knowledge import FIRST, End, Knowledge, Sensing
from mbaid_ros.core.trajectory.state import layout_of
from mbaid_ros.core.trajectory.variables import variables
from mbaid_ros.core.unknowns.hypotheses import hypotheses
from mbaid_ros.session.known import known_side

_OF_END = ('joint_position', 'joint_velocity', 'stored', 'base_rotation', 'base_position', 'origin', 'brought')


def as_numbers(knowledge: Knowledge) -> dict[str, Any]:
    """Return all of it: `covariance_factor` has the rows of an upper triangle T, from its diagonal on: T^T T."""
    end, sensing = knowledge.end, knowledge.end.sensing
    return {
        'time': end.time,
        'hypothesis': knowledge.hypothesis.name,
        'mean': knowledge.mean[FIRST:].tolist(),
        'covariance_factor': [row[place:].tolist() for place, row in enumerate(knowledge.triangle)],
        'joints': list(knowledge.layout.kernel.model.joint_names),
        **{name: getattr(end, name).tolist() for name in _OF_END},
        'plane_normal': None if end.normal is None else end.normal.tolist(),
        'rate': sensing.rate,
        'joint_position_std': sensing.joint_position,
        'pose_covariance': sensing.pose.tolist(),
        'twist_covariance': sensing.twist.tolist() if sensing.measures_twist else None,
    }


def from_numbers(numbers: Mapping[str, Any], config: EstimatorConfig, kernel: MomentumKernel) -> Knowledge:
    """Return what a run came to know.

    Parameters
    ----------
    numbers : as `as_numbers` has them
    config : of the run
    kernel : of its robot, with the errors of its known bodies

    Raises
    ------
    DataError
        They are of another robot, or of a run with other parameters.
    KeyError, TypeError, ValueError
        They are no such numbers.
    """
    known = known_side(config, kernel)
    model = known.kernel.model
    if tuple(numbers['joints']) != model.joint_names:
        raise DataError('its state is of other joints than the robot description has; accepted: the same robot')
    normal = None if numbers['plane_normal'] is None else _array(numbers['plane_normal'], 3)
    detector = PlaneDetector.decided(model, normal)
    layout = layout_of(known.kernel, known.uncertainty, detector)
    size = layout.size - FIRST
    if len(numbers['mean']) != size:
        raise DataError(
            f'its state has {len(numbers["mean"])} numbers, and {size} with these parameters: known_links, '
            'known_joints, odometry_mount and their like are others; accepted: those of the run'
        )
    twist = numbers['twist_covariance']
    sensing = Sensing(
        _positive(numbers['rate']),
        _positive(numbers['joint_position_std']),
        _array(numbers['pose_covariance'], 6, 6),
        np.full((6, 6), np.nan) if twist is None else _array(twist, 6, 6),
    )
    joints = model.joints
    shapes = ((joints,), (joints,), (known.kernel.storage.count,), (3, 3), (3,), (3,), (6,))
    (joint_position, joint_velocity, stored, rotation, position, origin, brought) = (
        _array(numbers[name], *shape) for name, shape in zip(_OF_END, shapes, strict=True)
    )
    joints_then = joint_position, joint_velocity, stored
    end = End(sensing, float(numbers['time']), *joints_then, rotation, position, origin, brought, normal)
    mass = float(np.sum(known.kernel.known[:, 0]))
    constant = config.disturbance.constant
    bank = hypotheses(mass, config.noise.declared.base_position, constant, adapt=True)  # type: ignore[arg-type]
    hypothesis = next((each for each in bank if each.name == numbers['hypothesis']), bank[0])
    mean = np.concatenate((np.zeros(FIRST), _array(numbers['mean'], size)))
    triangle = np.zeros((size, size))
    for place, row in enumerate(numbers['covariance_factor']):
        triangle[place, place:] = _array(row, size - place)
    return Knowledge(layout, variables(layout, detector, known.uncertainty), hypothesis, mean, triangle, end)


def _array(values: Any, *shape: int) -> Array:
    found = np.array(values, dtype=float)
    if found.shape != shape or not np.all(np.isfinite(found)):
        raise ValueError(f'its state has numbers of shape {found.shape} where {shape} belongs, or not finite ones')
    return found


def _positive(value: Any) -> float:
    if not float(value) > 0.0:
        raise ValueError(f'its state has {value} where a number > 0 belongs')
    return float(value)
