"""Planar robots are recognised by their mechanism and their motion, and tilted or noisy ones not taken for others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.difference.window_rows import subspace, window_rows
from mbaid_ros.core.geometry import Array, exp, rotate, unvec
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth
from observed import MID, kernel, observe, windows
from random_robots import random_inertial, random_urdf
from simulated import robot


def arm(axes: list[str], kinds: list[str], turn: str = '0 0 0') -> RobotModel:
    """Return a chain with one joint for each axis, its links turned by `turn` to their parents at the first joint."""
    rng = np.random.default_rng(0)
    parts = [f'<robot name="r"><link name="link0">{random_inertial(rng)}</link>']
    for index, (axis, kind) in enumerate(zip(axes, kinds, strict=True)):
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind == 'prismatic' else ''
        parts += [
            f'<link name="link{index + 1}">{random_inertial(rng)}</link><joint name="j{index}" type="{kind}">',
            f'<origin xyz="1 0.1 0" rpy="{turn if index == 0 else "0 0 0"}"/><axis xyz="{axis}"/>{limit}',
            f'<parent link="link{index}"/><child link="link{index + 1}"/></joint>',
        ]
    return load_model(''.join([*parts, '</robot>']))


def turning_about(axis: Array, count: int = 25) -> Samples:
    """Return samples of a base that turns about a fixed axis."""
    model = robot('table1')
    time = 0.02 * np.arange(count)
    zero = np.zeros((count, 3))
    truth = Truth(
        time, *(np.zeros((count, model.joints)),) * 3, zero, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), zero, zero
    )
    return replace(
        observe(truth, MID),
        base_rotation=exp(0.3 * time[:, None] * axis),
        base_angular_velocity=np.tile(0.3 * axis, (count, 1)),
    )


Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ('axes', 'kinds', 'planar'),
    [
        (['0 0 1', '0 0 -1'], ['continuous', 'continuous'], True),
        (['0 0 1', '1 0 0'], ['continuous', 'prismatic'], True),
        (['1 1 0', '0 0 1'], ['prismatic', 'continuous'], True),
        (['0 0 1', '0 1 0'], ['continuous', 'continuous'], False),
        (['0 0 1', '0 0 1'], ['continuous', 'prismatic'], False),
        (['1 0 0', '0 1 0'], ['prismatic', 'prismatic'], False),  # nothing fixes the plane
    ],
)
def test_the_mechanism_decides_first(axes: list[str], kinds: list[str], planar: bool) -> None:
    assert PlaneDetector(arm(axes, kinds)).planar == planar


def test_parallel_in_one_posture_is_not_planar() -> None:
    # The third axis is parallel to the first at zero angles only.
    assert not PlaneDetector(arm(['0 0 1', '1 0 0', '0 0 1'], ['continuous'] * 3)).planar
    assert not PlaneDetector(robot('servicer7')).planar
    assert not PlaneDetector(load_model('<robot name="r"><link name="base"/></robot>')).planar
    assert not any(PlaneDetector(load_model(random_urdf(np.random.default_rng(seed)))).planar for seed in range(5))


def test_the_plane_in_the_links_own_frame() -> None:
    model = robot('table1')
    detector = PlaneDetector(model)
    plane = some(detector.plane(model.link('link4')))
    assert plane.normal == pytest.approx(Z)
    assert plane.across == pytest.approx(np.eye(3)[:2])
    # A link that is mounted askew: the normal is none of its axes.
    model = arm(['0.6 0 0.8', '0.6 0 0.8'], ['continuous', 'continuous'], turn='0.3 0.4 0.5')
    plane = some(PlaneDetector(model).plane(model.link('link2')))
    assert plane.normal == pytest.approx([0.6, 0.0, 0.8])
    frame = np.vstack((plane.across, plane.normal))
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert plane.basis.T @ plane.basis == pytest.approx(np.eye(4), abs=1e-12)
    inertia = unvec(plane.basis[4:, 3])
    assert inertia / np.trace(inertia) == pytest.approx(plane.normal[:, None] * plane.normal)


def test_three_equations_hold_in_a_plane() -> None:
    detector = PlaneDetector(robot('table1'))
    assert np.array_equal(detector.rows(), np.eye(6))  # before the first window
    detector.update(turning_about(Z))
    rows = detector.rows()
    assert rows @ rows.T == pytest.approx(np.eye(3), abs=1e-12)
    assert rows[:2, [2, 3, 4, 5]] == pytest.approx(np.zeros((2, 4)), abs=1e-12)
    assert rows[2] == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], abs=1e-12)


def test_a_base_that_starts_askew_moves_in_a_plane_too() -> None:
    tilt = exp(np.array([0.5, -0.3, 0.2]))
    samples = turning_about(Z)
    samples = replace(
        samples,
        base_rotation=tilt @ samples.base_rotation,
        base_angular_velocity=samples.base_angular_velocity @ tilt.T,
    )
    detector = PlaneDetector(robot('table1'))
    detector.update(samples)
    assert detector.planar
    assert detector.rows()[2, 3:] == pytest.approx(rotate(tilt, Z))


@pytest.mark.parametrize('axis', [np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.1, 1.0])])
def test_turning_out_of_the_plane_is_spatial_for_good(axis: Array) -> None:
    detector = PlaneDetector(robot('table1'))
    detector.update(turning_about(Z))
    detector.update(turning_about(axis))
    assert not detector.planar
    assert detector.plane(robot('table1').link('link4')) is None
    detector.update(turning_about(Z))
    assert not detector.planar
    assert np.array_equal(detector.rows(), np.eye(6))


def test_the_unknowns_of_a_plane(planar: Truth) -> None:
    servicer = kernel('table1')
    part = windows(observe(planar, MID))[:3]
    detector = PlaneDetector(servicer.model)
    detector.update(part[0])
    chosen = subspace(detector, servicer)
    assert chosen.planar
    assert chosen.basis.shape == (16, 7)
    assert chosen.basis.T @ chosen.basis == pytest.approx(np.eye(7), abs=1e-12)
    blocks = window_rows(servicer, part, MID, np.zeros(3))
    reduced = chosen.of(blocks)
    assert reduced.rows.shape == (3, 3, 7)
    # What the plane leaves out of the unknowns has no part in its equations.
    outside = np.eye(16) - chosen.basis @ chosen.basis.T
    assert chosen.rows @ blocks.rows @ outside == pytest.approx(np.zeros((3, 3, 16)), abs=1e-12)
    covariance = chosen.lift(np.diag(np.arange(1.0, 8.0)), np.full(16, 1e6))
    assert chosen.basis.T @ covariance @ chosen.basis == pytest.approx(np.diag(np.arange(1.0, 8.0)))
    assert outside @ covariance @ outside == pytest.approx(1e6 * outside)
