"""Readings that are meant otherwise in several ways at once: what was done to them is found, and how to undo it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from checked import generic, returned
from mbaid_ros.core.clocks import restamped
from mbaid_ros.core.diagnosis.readings import (
    as_read,
    joints_by_another_clock,
    mapped_joints,
    placed_bases,
    scaled_positions,
)
from mbaid_ros.core.geometry import Array, exp, mirror, rotation_from_quaternion
from mbaid_ros.core.windows import Window
from observed import MID, configured_motion, kernel, observe
from unchanged import Unchanged
from windowed import half_second_windows

JOINTS = [f'joint{number}' for number in range(1, 8)]
MOUNT = np.array([0.785, -0.873, 0.576, -0.1, 0.4, 0.2])  # rad, 75 degrees in all, and m


@cache
def windows() -> tuple[Window, ...]:
    """Return 22 s of servicer7 in windows of half a second."""
    return tuple(half_second_windows(observe(configured_motion('servicer7', 25.0, 100.0), MID, 3)))


def joints_read(change: Callable[[Array], Array]) -> list[Window]:
    """Return the windows with other joint positions."""
    return [
        replace(each, knots=replace(each.knots, joint_position=change(each.knots.joint_position))) for each in windows()
    ]


def poses_read(change: Callable[[Array, Array], tuple[Array, Array]]) -> list[Window]:
    """Return the windows with other rotations and positions."""
    found = []
    for each in windows():
        rotation, position = change(each.knots.base_rotation, each.knots.base_position)
        found.append(replace(each, knots=replace(each.knots, base_rotation=rotation, base_position=position)))
    return found


def read_as(
    columns: Sequence[int] = range(7), gains: dict[int, float] | None = None, zeros: Any = None
) -> list[Window]:
    """Return windows whose joint i reads gain_i times its motion plus zero_i (degrees), in other columns then."""
    gain, zero = np.ones(7), np.zeros(7)
    for joint, value in (gains or {}).items():
        gain[joint] = value
    for joint, value in (zeros or {}).items():
        zero[joint] = np.radians(value)
    return joints_read(lambda position: (position * gain + zero)[:, list(columns)])


def wrong(**changes: Any) -> Callable[[], list[Window]]:
    """Return what makes such windows: nothing is simulated while tests are collected."""
    return partial(read_as, **changes)


@pytest.mark.parametrize(
    ('read', 'said'),
    [
        (wrong(zeros={1: 30.0, 2: -30.0}), 'the zeros are off, of joint2 by +30'),
        (wrong(zeros={0: 25.0, 3: -40.0, 5: 60.0}), 'the zeros are off, of joint1 by +2'),
        (wrong(gains={2: -1.0}, zeros={0: 45.0}), 'the sign of joint3 is wrong, the zero is off, of joint1 by +4'),
        (wrong(gains={1: 2.0}, zeros={3: 35.0}), 'joint2 reads 2 times its motion, the zero is off, of joint4 by +3'),
        (wrong(columns=[0, 3, 2, 1, 4, 5, 6], zeros={4: 50.0}), 'joint2 and joint4 are swapped, the zero is off'),
        pytest.param(wrong(columns=[1, 2, 3, 4, 5, 6, 0]), 'names, moved by 1', marks=pytest.mark.long),
        pytest.param(wrong(columns=range(6, -1, -1)), 'in reversed order', marks=pytest.mark.long),
        pytest.param(wrong(columns=[2, 1, 0, 5, 4, 3, 6]), 'joint1 and joint3 and', marks=pytest.mark.long),
        pytest.param(wrong(gains=dict.fromkeys(range(6), -1.0)), 'the signs of joint1,', marks=pytest.mark.long),
        pytest.param(
            wrong(columns=[3, 5, 0, 1, 6, 2, 4]), 'stand under the wrong names: publish joint1 = joint3;',
            marks=pytest.mark.long,
        ),
    ],
)  # fmt: skip
def test_several_wrong_joints_are_named_together_and_undone(
    read: Callable[[], list[Window]], said: str, unchanged: Unchanged
) -> None:
    wrong_windows = read()
    (found,) = returned(mapped_joints(kernel('servicer7'), wrong_windows))
    assert said in found.text
    unchanged.values(meant=(found.text, found.misfit_left, found.repair))
    for undone, true in zip(found.windows(wrong_windows), windows(), strict=True):
        away = undone.knots.joint_position - true.knots.joint_position
        # Nothing shows the zero of the joint that carries the target.
        assert np.max(np.abs(away[:, :6])) < 0.02
    assert found.repair is not None


def test_signs_come_before_zeros_of_nearly_all_joints() -> None:
    few = read_as(gains=dict.fromkeys((0, 1, 3, 4, 5, 6), -1.0))[:24]
    (found,) = returned(mapped_joints(kernel('servicer7'), few))
    assert found.text.startswith('the signs of joint1, joint2, joint4,')


def test_joints_as_they_are_meant_are_not_mapped() -> None:
    assert returned(mapped_joints(kernel('servicer7'), windows())) == []


@pytest.mark.parametrize('clock', [0.92, 1.06])
def test_joints_by_a_clock_of_another_rate_are_named_and_undone(clock: float, unchanged: Unchanged) -> None:
    read = restamped(windows(), rate=1.0 / clock)
    (found,) = returned(joints_by_another_clock(kernel('servicer7'), read))
    assert f'the stamps of the joint states run {clock:g}' in found.text
    assert found.repair is not None
    unchanged.values(meant=(found.text, found.misfit_left, found.repair))
    assert found.repair.conversion is not None
    assert found.repair.conversion.clock == pytest.approx(clock, abs=2e-3)
    true = {each.start: each for each in windows()}
    for undone in found.windows(read):
        away = undone.knots.joint_position - true[undone.start].knots.joint_position
        assert np.max(np.abs(away)) < 0.005


def test_joints_by_the_clock_of_the_poses_have_no_other_rate() -> None:
    assert returned(joints_by_another_clock(kernel('servicer7'), windows())) == []


def mounted(rotation: Array, position: Array) -> tuple[Array, Array]:
    """Return the poses of a frame that is away from the base."""
    turn = exp(MOUNT[:3])
    return rotation @ turn.T, position - rotation @ turn.T @ MOUNT[3:]


def turned_round(rotation: Array, position: Array) -> tuple[Array, Array]:
    """Return the inverse poses of that frame."""
    rotation, position = mounted(rotation, position)
    back = np.swapaxes(rotation, -1, -2)
    return back, -np.einsum('nij,nj->ni', back, position)


def mirrored(rotation: Array, position: Array) -> tuple[Array, Array]:
    """Return the poses of that frame in left-handed axes."""
    rotation, position = mounted(rotation, position)
    return mirror(rotation, 1), position * [1.0, -1.0, 1.0]


@pytest.mark.parametrize(
    ('change', 'said'), [(mounted, 'the frame'), (turned_round, 'turned round'), (mirrored, 'left-handed')]
)
def test_the_poses_of_another_frame_on_the_base_are_placed(
    change: Callable[[Array, Array], tuple[Array, Array]], said: str, unchanged: Unchanged
) -> None:
    read = poses_read(change)
    (found,) = returned(placed_bases(kernel('servicer7'), read, None))
    assert said in found.text
    unchanged.values(meant=(found.text, found.misfit_left, found.repair))
    assert 'turned by 75 degrees about' in found.text
    for undone, true in zip(found.windows(read), windows(), strict=True):
        change_of_pose = np.swapaxes(undone.knots.base_rotation[:-1], -1, -2) @ undone.knots.base_rotation[1:]
        true_change = np.swapaxes(true.knots.base_rotation[:-1], -1, -2) @ true.knots.base_rotation[1:]
        np.testing.assert_allclose(change_of_pose, true_change, atol=1e-3)
    assert found.repair is not None
    assert found.repair.conversion is not None
    assert found.repair.conversion.mount == pytest.approx(MOUNT, abs=0.02)


@pytest.mark.parametrize(
    ('times', 'said'),
    [(1e3, 'in millimetres'), (100.0, 'in centimetres'), (1.0 / 0.0254, 'in inches'), (1.0 / 3.0, 'too small')],
)
def test_a_length_scale_is_named_by_its_unit_or_size(times: float, said: str, unchanged: Unchanged) -> None:
    read = poses_read(lambda rotation, position: (rotation, times * position))
    (found,) = returned(scaled_positions(kernel('servicer7'), read))
    assert said in found.text
    unchanged.values(meant=(found.text, found.misfit_left, found.repair))
    assert found.repair is not None
    assert found.repair.conversion is not None
    assert found.repair.conversion.scale * times == pytest.approx(1.0, rel=0.2)


def test_few_windows_name_no_unit_smaller_than_the_scale() -> None:
    """Noise makes the first scales too small: what looks like 1.55 cm may be an inch."""
    read = poses_read(lambda rotation, position: (rotation, position / 0.0155))
    assert returned(scaled_positions(kernel('servicer7'), read[:26])) == []


def test_metres_are_no_other_unit() -> None:
    assert returned(scaled_positions(kernel('servicer7'), windows())) == []


def test_joints_that_are_swapped_are_no_other_unit_of_the_positions() -> None:
    """No scale explains them, however large the misfit of the one that fits best."""
    assert returned(scaled_positions(kernel('servicer7'), read_as(columns=[0, 3, 2, 1, 4, 5, 6]))) == []


def test_the_mount_that_is_named_can_be_pasted() -> None:
    (found,) = returned(placed_bases(kernel('servicer7'), poses_read(mounted), None))
    place, turn = (np.array(each.partition(']')[0].split(', '), float) for each in found.text.split('[')[1:])
    np.testing.assert_allclose(rotation_from_quaternion(turn), exp(MOUNT[:3]).T, atol=0.02)
    np.testing.assert_allclose(place, -exp(MOUNT[:3]).T @ MOUNT[3:], atol=0.02)


def test_meanings_change_one_after_the_other_as_at_once() -> None:
    """By numbers that add up, gains and the scale by factors, the turn of the frame in its own axes."""
    step = generic(1, 11)
    one, two = (as_read(2).changed(each) for each in (step, 2.0 * step))
    for made, times in ((one, 1.0), (one.changed(step), 2.0), (two, 2.0)):
        assert made.zeros == pytest.approx(times * step[:2])
        assert made.gains == pytest.approx(np.exp(times * step[2:4]))
        assert made.turn == pytest.approx(times * step[4:7])
        assert made.lever == pytest.approx(times * step[7:10])
        assert made.scale == pytest.approx(float(np.exp(times * step[10])))
