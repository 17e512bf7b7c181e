"""Conventions that poses, joints and the target may be in: the true one fits best, and none where nothing is wrong."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.conventions import Convention, axis_conventions, conventions, fitted, inverted_marker
from mbaid_ros.core.filter.knots import AFTER, BEFORE, averages
from mbaid_ros.core.filter.window import Window, WindowNoise
from mbaid_ros.core.geometry import Array, exp, rotation_from_quaternion
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.base import AttachedFrame
from observed import MID, configured_motion, kernel, observe
from simulated import CONFIG

SPACING, LENGTH = 0.05, 0.5  # s, between knots, of a window


@cache
def measured() -> Samples:
    return observe(configured_motion('servicer7', 25.0, 100.0), MID, 3)


def windows_of(samples: Samples) -> list[Window]:
    count = BEFORE + round(LENGTH / SPACING) + AFTER
    noise = WindowNoise(50, MID.joint_position, np.eye(6) * 1e-6, np.eye(6) * 1e-6, 0.0, 0.0)
    found = []
    for start in np.arange(1.0, 23.0, LENGTH):
        begin = start - BEFORE * SPACING
        first, last = np.searchsorted(samples.time, [begin - 1e-6, begin + count * SPACING - 1e-6])
        knots = averages([samples[int(first) : int(last)]], np.array([begin]), SPACING, count, np.zeros(3))
        found.append(Window(knots, slice(BEFORE, count - AFTER), SPACING, noise, float(start), fresh=False))
    return found


def texts(samples: Samples) -> list[str]:
    """Return the axes that samples may be in, the likeliest first."""
    robot, windows = kernel('servicer7'), windows_of(samples)
    declared, *fits = (fitted(windows, each, 2) for each in (Convention('', robot), *axis_conventions(robot)))
    likely = [fit for fit in fits if fit.exists and fit.misfit < fit.convention.left * declared.misfit]
    return [fit.convention.text for fit in sorted(likely, key=lambda fit: fit.misfit)]


def test_poses_as_declared_are_in_no_other_axes() -> None:
    assert texts(measured()) == []


@pytest.mark.parametrize(
    ('axes', 'named'),
    [
        ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], '(x, -z, y)'),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], '(y, x, z)'),
        ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], '(x, y, -z)'),
        ([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], '(-z, -x, y)'),
    ],
)
def test_positions_in_other_axes_are_named(axes: list[list[int]], named: str) -> None:
    samples = measured()
    changed = replace(samples, base_position=samples.base_position @ np.array(axes, dtype=float).T)
    assert texts(changed)[0].startswith(f'the positions of the odometry are {named} in the axes')


@pytest.mark.parametrize(
    ('turn', 'named'),
    [
        (np.pi * np.array([1.0, 0.0, 0.0]), '180 degrees about (1, 0, 0)'),
        (0.5 * np.pi * np.array([0.0, 0.0, -1.0]), '90 degrees about (0, 0, -1)'),
        (0.5 * np.pi * np.array([0.0, 1.0, 0.0]), '90 degrees about (0, 1, 0)'),
        (2.0 / 3.0 * np.pi * np.ones(3) / np.sqrt(3.0), '120 degrees about (0.58, 0.58, 0.58)'),
    ],
)
def test_a_frame_that_is_turned_is_named(turn: Array, named: str) -> None:
    samples = measured()
    text = texts(replace(samples, base_rotation=samples.base_rotation @ exp(turn)))[0]
    assert named in text
    position, orientation = pasted(text)
    assert not np.any(position)
    assert rotation_from_quaternion(orientation) == pytest.approx(exp(turn), abs=1e-4)


def pasted(text: str) -> list[Array]:
    """Return the parameters marker.position and .orientation that a text has to be copied."""
    return [np.array(numbers.split(', '), dtype=float) for numbers in re.findall(r'\[(.*?)\]', text)]


def test_a_marker_declared_the_wrong_way_round_is_named_with_its_parameters() -> None:
    samples, position, turn = measured(), np.array([0.3, -0.2, 0.1]), exp(np.array([0.1, 0.5, -0.2]))
    declared = AttachedFrame(turn.T, -turn.T @ position)
    rotation = samples.base_rotation @ turn @ turn
    place = samples.base_position + samples.base_rotation @ position - rotation @ declared.position
    text = likeliest(kernel('servicer7'), replace(samples, base_rotation=rotation, base_position=place), declared)
    assert text.startswith('marker.position and marker.orientation look inverted')
    found = pasted(text)
    assert found[0] == pytest.approx(position, abs=1e-4)
    assert rotation_from_quaternion(found[1]) == pytest.approx(turn, abs=1e-4)


def likeliest(robot: MomentumKernel, samples: Samples, marker: AttachedFrame | None = None) -> str:
    windows, every = windows_of(samples), (*conventions(robot), *inverted_marker(robot, marker))
    fits = [fitted(windows, each, 4) for each in every if each.possible(windows)]
    return min((fit for fit in fits if fit.exists), key=lambda fit: fit.misfit).convention.text


@pytest.mark.parametrize('joint', [1, *(pytest.param(joint, marks=pytest.mark.long) for joint in (0, 2, 3, 4, 5, 6))])
def test_a_joint_with_the_wrong_sign_fits_best(joint: int) -> None:
    samples = measured()
    signs = np.where(np.arange(7) == joint, -1.0, 1.0)
    assert likeliest(kernel('servicer7'), replace(samples, joint_position=samples.joint_position * signs)).startswith(
        f'the sign of joint{joint + 1} is wrong'
    )


def test_joints_that_are_stamped_far_off_fit_best() -> None:
    samples = measured()
    off = replace(samples, joint_position=samples.joint_position[np.maximum(np.arange(len(samples)) - 20, 0)])
    assert likeliest(kernel('servicer7'), off).startswith('the joints are stamped some 200 ms late')


@pytest.mark.parametrize('declared', ['link6', 'base_link'])
def test_the_link_that_holds_the_body_fits_best(declared: str) -> None:
    text = (CONFIG / 'servicer7.urdf').read_text()
    link = re.search(r'<link name="link7">.*?</inertial>', text, re.DOTALL)
    assert link is not None
    empty = re.sub('mass value="162"', 'mass value="9"', re.sub(r'(i..)="[^"]*"', r'\1="0"', link[0]))
    empty = re.sub('ixx="0"(.*?)iyy="0"(.*?)izz="0"', r'ixx="1"\1iyy="1"\2izz="1"', empty)
    robot = MomentumKernel(load_model(text.replace(link[0], empty)), declared)
    assert likeliest(robot, measured()).startswith(f'the unknown body seems to be held by link7, not {declared}')
