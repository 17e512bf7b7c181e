"""The derivatives of a window's equations by each measurement, where a known thrust and an orbit act as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import assert_derivative, generic
from mbaid_ros.core.difference import _derivatives, window_rows
from mbaid_ros.core.geometry import Array, exp, rotate
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples, SensorNoise
from random_robots import random_storage, spatial

NOISE = SensorNoise(*(1e-3,) * 6)
ORIGIN = generic(7, 3)


def sample(kernel: MomentumKernel, seed: int) -> Samples:
    """Return one sample in which nothing is zero or parallel to anything else."""
    joints, bodies = kernel.model.joints, kernel.model.joints + 1
    return Samples(
        np.zeros(1),
        generic(seed, 1, joints),
        generic(seed + 10, 1, joints),
        generic(seed + 20, 1, 3),
        exp(generic(seed + 30, 1, 3)),
        generic(seed + 40, 1, 3),
        generic(seed + 50, 1, 3),
        np.eye(6)[None],
        np.eye(6)[None],
        impulse=generic(seed + 60, 1, 6),
        stored=generic(seed + 70, 1, kernel.storage.count),
        gravity_columns=0.1 * generic(seed + 80, 1, 60 * bodies),
    )


def measured(exact: Samples, error: Array) -> Samples:
    """Return the sample with errors of joints, base position and orientation, velocities, and stored momentum."""
    joints = exact.joint_position.shape[1]
    position, velocity, place, turn, linear, angular, stored = np.split(
        error, np.cumsum([joints, joints, 3, 3, 3, 3]).tolist()
    )
    rotation = exp(turn) @ exact.base_rotation
    moved = (
        rotate(rotation, part[None] + rotate(np.swapaxes(exact.base_rotation, 1, 2), read))
        for part, read in ((linear, exact.base_linear_velocity), (angular, exact.base_angular_velocity))
    )
    return replace(
        exact,
        joint_position=exact.joint_position + position,
        joint_velocity=exact.joint_velocity + velocity,
        base_position=exact.base_position + place,
        base_rotation=rotation,
        stored=exact.stored + stored,
        **dict(zip(('base_linear_velocity', 'base_angular_velocity'), moved, strict=True)),
    )


@pytest.mark.parametrize('seed', range(3))
def test_the_equations_depend_on_each_measurement_as_their_derivatives_say(seed: int) -> None:
    model = spatial(seed)
    kernel = MomentumKernel(model, model.last_link)
    kernel = kernel.with_storage(random_storage(np.random.default_rng(seed), model))
    exact = sample(kernel, seed)

    def equations(error: Array) -> Array:
        blocks = window_rows(kernel, [measured(exact, error)], NOISE, ORIGIN)
        return np.concatenate((blocks.offset[0][:, None], blocks.rows[0]), axis=1)

    known, rows = _derivatives(kernel, exact)
    found = np.moveaxis(np.concatenate((known, rows), axis=3)[0], 1, 2)
    assert_derivative(found, equations, np.zeros(found.shape[-1]))
