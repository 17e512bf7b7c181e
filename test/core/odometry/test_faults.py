"""Checks of the odometry by tables of evidence: rates against steps, two dimensions, and another frame on the base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.odometry.faults import (
    PlanarPoses,
    _twist_motion,
    other_frame_text,
)
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import BaseStream, Samples
from random_robots import two_links

SECOND = 10**9  # ns


def test_steps_and_rates_differ_by_as_much_as_their_noise() -> None:
    """Of a base at rest, whose windows begin at any time."""
    rng, squares, count = np.random.default_rng(0), [], 25
    pose, twist = np.diag([4e-6] * 3 + [9e-6] * 3), np.diag([4e-4] * 3 + [1e-4] * 3)  # linear first
    nothing = np.zeros((count, 1))
    for _ in range(300):
        place, turn, linear, angular = np.split(
            rng.normal(size=(count, 12)) * np.sqrt(np.concatenate((np.diag(pose), np.diag(twist)))), 4, axis=1
        )
        time = 7.0 + 0.02 * np.arange(count)
        covariances = np.tile(pose, (count, 1, 1)), np.tile(twist, (count, 1, 1))
        motion = some(_twist_motion(Samples(time, nothing, nothing, place, exp(turn), linear, angular, *covariances)))
        squares.append(((motion.step - motion.read) / motion.noise)[0] ** 2)
    assert np.mean(squares, axis=0) == pytest.approx(np.ones(6), abs=0.25)


@pytest.mark.parametrize('of_joints', [0.0, np.nan])
@pytest.mark.parametrize('of_base', [0.0, np.nan])
def test_steps_are_compared_with_the_twist_if_there_is_one_with_or_without_rates_of_joints(
    of_joints: float, of_base: float
) -> None:
    count = 25
    nothing, covariance = np.zeros((count, 3)), np.tile(np.eye(6), (count, 1, 1))
    joints, twist = np.full((count, 1), of_joints), np.full((count, 3), of_base)
    turns = exp(nothing)
    samples = Samples(0.02 * np.arange(count), joints, joints, nothing, turns, twist, twist, covariance, covariance)
    assert (_twist_motion(samples) is None) is bool(np.isnan(of_base))


def poses(*rows: tuple[float, Array, Array]) -> BaseStream:
    """Return poses of some times, s, positions and rotation vectors."""
    time, place, turn = (np.array(each) for each in zip(*rows, strict=True))
    unknown, covariance = np.full((len(rows), 3), np.nan), np.tile(np.eye(6), (len(rows), 1, 1))
    stamp = np.round(SECOND * time).astype(np.int64)
    return BaseStream(stamp, place, exp(turn), unknown, unknown, covariance, covariance)


BENT = load_model(two_links('type="revolute"', 'type="revolute"').replace('xyz="0 0 1"', 'xyz="1 0 0"', 1))


def verdict(rows: Sequence[tuple[float, Array, Array]], angles: list[float]) -> list[tuple[str, float]]:
    """Return the faults and since when, s, where j1, which tilts the base, has angles at 0, 1, ... s."""
    planar, stamp = PlanarPoses(BENT), SECOND * np.arange(len(angles))
    for row in rows:  # as they arrive
        planar.add_poses(poses(row))
    planar.add_joints(BENT.joint_names, stamp, np.column_stack((angles, 9.0 * np.arange(len(angles)))))
    return [(fault, since / SECOND) for fault, since, _ in planar.found()]


@pytest.mark.parametrize(
    ('moved', 'left', 'angles', 'found'),
    [
        (2.0, None, [0.5, 0.6, 0.6, 0.71, 0.5], [('planar', 3.0)]),
        (4.0, None, [0.5, 0.2, 0.5], [('planar', 4.0)]),
        (4.0, None, [0.5, 0.6, 0.4, 0.65], []),  # the other joint turns far, but stays in the plane
        (2.0, 2.5, [0.5, 0.6, 0.5, 0.8], []),
        (2.0, 3.5, [0.5, 0.6, 0.5, 0.8], [('planar', 3.0)]),  # until then all has been in the plane
    ],
)
def test_poses_are_planar_that_never_left_the_plane_before_base_and_a_tilting_joint_have_moved(
    moved: float, left: float | None, angles: list[float], found: list[tuple[str, float]]
) -> None:
    place, still = np.array([5.0, -2.9, 0.0]), np.zeros(3)
    rows = [(0.0, np.array([5.0, -3.0, 0.0]), still), (moved, place, np.array([0.0, 0.0, 0.5]))]
    rows += [] if left is None else [(left, place, np.array([0.1, 0.0, 0.0]))]
    assert verdict(rows, angles) == found


def test_another_frame_on_the_base_is_named_by_where_it_is() -> None:
    turned = other_frame_text(np.array([0.0, 0.0, -0.5 * np.pi, 0.1, 0.2, -0.3]), None)
    assert 'turned by 90 degrees about (0, 0, 1) and (200, -100, 300) mm away relative to the base link: ' in turned
    assert 'is (-30, 0, 0) mm away relative to' in other_frame_text(np.array([0.0, 0.01, 0.0, 0.03, 0.0, 0.0]), None)
