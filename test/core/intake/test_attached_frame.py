"""A frame on the base: its motion and its noise as those of the base link."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, cross, exp, log, rotate
from mbaid_ros.core.samples import BaseStream
from mbaid_ros.core.sensors.base import AttachedFrame
from observed import MID

GENERATOR = np.random.default_rng(1)
FRAME = AttachedFrame(exp(np.array([0.4, -1.1, 0.7])), np.array([0.3, -0.2, 0.5]))
COUNT = 5


def base() -> BaseStream:
    rotation = exp(GENERATOR.normal(size=(COUNT, 3)))
    return BaseStream(
        np.arange(COUNT),
        *(GENERATOR.normal(size=(COUNT, 3)), rotation),
        *(GENERATOR.normal(size=(COUNT, 3)), GENERATOR.normal(size=(COUNT, 3))),
        *(np.tile(MID.pose_covariance(), (COUNT, 1, 1)), np.tile(MID.twist_covariance(), (COUNT, 1, 1))),
    )


def measured(stream: BaseStream) -> BaseStream:
    """Return what is measured of the frame."""
    lever = rotate(stream.rotation, FRAME.position)
    return replace(
        stream,
        position=stream.position + lever,
        rotation=stream.rotation @ FRAME.rotation,
        linear_velocity=stream.linear_velocity + cross(stream.angular_velocity, lever),
    )


def test_pose_and_twist_are_those_of_the_base() -> None:
    stream = base()
    back = FRAME.to_base(measured(stream))
    for name in ('position', 'rotation', 'linear_velocity', 'angular_velocity'):
        assert getattr(back, name) == pytest.approx(getattr(stream, name), abs=1e-12), name
    assert not FRAME.is_base
    assert AttachedFrame(np.eye(3), np.zeros(3)).is_base


def test_covariances_are_those_of_the_errors() -> None:
    stream = measured(base())
    converted = FRAME.to_base(stream)
    step = 1e-6

    def spread(change: list[BaseStream], pick: str) -> Array:
        """Return the covariance that small errors of the frame lead to, by differences."""
        columns = []
        for moved in change:
            back = FRAME.to_base(moved)
            if pick == 'pose':
                turn = log(back.rotation @ np.swapaxes(converted.rotation, 1, 2))
                columns.append(np.concatenate((back.position - converted.position, turn), axis=1) / step)
            else:
                change_of = (
                    back.linear_velocity - converted.linear_velocity,
                    back.angular_velocity - converted.angular_velocity,
                )
                axes = np.swapaxes(converted.rotation, 1, 2)
                columns.append(np.concatenate([rotate(axes, value) for value in change_of], axis=1) / step)
        jacobian = np.stack(columns, axis=-1)
        covariance = stream.pose_covariance if pick == 'pose' else stream.twist_covariance
        return jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)

    errors = step * np.eye(3)
    poses = [replace(stream, position=stream.position + error) for error in errors]
    poses += [replace(stream, rotation=exp(error) @ stream.rotation) for error in errors]
    twists = [replace(stream, linear_velocity=stream.linear_velocity + rotate(stream.rotation, e)) for e in errors]
    twists += [replace(stream, angular_velocity=stream.angular_velocity + rotate(stream.rotation, e)) for e in errors]
    assert converted.pose_covariance == pytest.approx(spread(poses, 'pose'), rel=1e-4, abs=1e-12)
    assert converted.twist_covariance == pytest.approx(spread(twists, 'twist'), rel=1e-4, abs=1e-12)
