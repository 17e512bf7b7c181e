"""Joints whose reading jumps, stands still, or is as if its far side swung; and stamps that are plainly wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import generic, some
from mbaid_ros.core.clocks import StampPattern
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.joints.faults import (
    loose_joint_text,
    reversed_joints,
    stopped_readings,
    swapped_joints,
    swinging,
)
from mbaid_ros.core.repair import Conversion
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.robot.urdf import Transmission
from mbaid_ros.core.samples import Stamps
from mbaid_ros.core.state import Layout
from mbaid_ros.core.windows import AFTER, BEFORE, Window
from mbaid_ros.simulation.simulation import Truth
from observed import MID, observe
from random_robots import two_links
from windowed import JOINT as JOINT_NOISE
from windowed import joint_window, window_model, window_of

JOINTS = ('shoulder', 'elbow', 'wrist')
KNOTS = BEFORE + 20 + AFTER


def standing(still: Flags) -> list[Window]:
    """Return standing in which joints stand still or not, (W, 3)."""
    moving = np.random.default_rng(4).normal(size=(len(still), KNOTS, 3))
    positions = np.where(still[:, None], moving[:, :1], moving)
    return [joint_window(each, float(start)) for start, each in enumerate(positions)]


def test_windows_in_which_one_joint_stands_still_and_their_neighbours_are_left_out() -> None:
    still = np.zeros((9, 3), dtype=bool)
    still[3:5, 1] = True
    ((text, others, stretches),) = stopped_readings(standing(still), JOINTS)
    assert text.startswith('the reading of elbow repeats from 3.0 to 5.0 s')
    assert [each.start for each in others] == [0.0, 1.0, 6.0, 7.0, 8.0]
    assert stretches == ((2.0, 6.0),)  # with the windows beside
    assert [each.after_gap for each in others] == [False, False, True, False, False]


def test_the_joint_that_stands_still_longest_comes_first_and_few_times_are_reported() -> None:
    still = np.zeros((12, 3), dtype=bool)
    still[::2, 2], still[4, 0] = True, True
    found = stopped_readings(standing(still), JOINTS)
    assert [text.split()[3] for text, *_ in found] == ['wrist', 'shoulder']
    assert found[0][0].count(' to ') == 3
    assert 'and more' in found[0][0]


@pytest.mark.parametrize('still', [np.zeros((5, 3), dtype=bool), np.ones((5, 3), dtype=bool)])
def test_nothing_is_found_where_all_move_or_all_rest(still: Flags) -> None:
    assert stopped_readings(standing(still), JOINTS) == []


def test_joints_that_never_move_are_not_named() -> None:
    still = np.zeros((9, 3), dtype=bool)
    still[:, 0] = still[3:5, 1] = True
    assert [text.split()[3] for text, *_ in stopped_readings(standing(still), JOINTS)] == ['elbow']


def test_a_follower_has_no_readings_to_convert_and_moves_with_its_leader() -> None:
    text = two_links('type="revolute"', 'type="revolute"', '<mimic joint="j1" multiplier="-2" offset="0.1"/>')
    follows = MomentumKernel(load_model(text), 'link2')
    assert follows.model.independent_joints == ('j1',)
    first, second = reversed_joints(follows)
    assert some(first.repair).conversion == Conversion(factors={'j1': -1.0})
    assert second.repair is None
    (window,) = first.windows([joint_window(np.array([[0.3, -0.5]] * KNOTS), 0.0)])
    assert window.knots.joint_position[0] == pytest.approx([-0.3, 0.7])
    assert list(swapped_joints(follows)) == []


def test_a_follower_has_no_encoder_that_stops() -> None:
    still = np.zeros((5, 3), dtype=bool)
    still[2, :2] = True  # the first follows the second
    found = stopped_readings(standing(still), JOINTS[1:], (1, 2))
    assert [text.split()[3] for text, *_ in found] == [JOINTS[1]]


def test_a_followers_noise_is_that_of_its_leader() -> None:
    moved = Transmission(np.array([0]), np.array([0, 0]), np.array([1.0, -2.0]), np.zeros(2), direct=False)
    columns = generic(5, 6, 2)
    found = moved.by_noise(np.array([0.3, 7.0]), columns)
    assert found[:, 0] == pytest.approx(0.3 * (columns[:, 0] - 2.0 * columns[:, 1]))
    assert not found[:, 1].any()


def test_a_reading_that_is_missing_does_not_stand_still() -> None:
    (first, *others) = standing(np.zeros((5, 3), dtype=bool))
    positions = first.knots.joint_position.copy()
    positions[:, 0] = np.nan
    lost = replace(first, knots=replace(first.knots, joint_position=positions))
    assert stopped_readings([lost, *others], JOINTS) == []


STEP, JOINT, TIMES = 0.05, 3, 30.0


@pytest.fixture(scope='module')
def window(servicer: Truth) -> Window:
    return window_of(observe(servicer, MID), STEP)


def covariances(robot: MomentumKernel, window: Window) -> tuple[Array, Array]:
    """Return those of the means of a window's pose and twist, at rest and with the body that is described."""
    layout = Layout.from_unknowns(robot, ())
    point = layout.point(np.concatenate((np.zeros(12), robot.target.parameters)))
    model = window_model(layout, window, point)
    return model.pose.covariance, model.rates.covariance


def test_a_joint_that_swings_moves_the_base_in_one_direction(robot: MomentumKernel, window: Window) -> None:
    (loose,) = swinging([window], JOINT, TIMES, robot.model.joints)
    for before, after in zip(covariances(robot, window), covariances(robot, loose), strict=True):
        sizes = np.linalg.eigvalsh(after - before)
        assert sizes[-1] > 0.0
        assert np.abs(sizes[:-1]).max() < 1e-9 * sizes[-1]


def test_joints_that_are_all_alike_are_as_noisy_as_with_one_number(robot: MomentumKernel, window: Window) -> None:
    noise = replace(window.noise, joint_position=np.full(robot.model.joints, window.noise.joint_position))
    for one, each in zip(covariances(robot, window), covariances(robot, replace(window, noise=noise)), strict=True):
        assert np.array_equal(one, each)


def test_the_size_is_that_of_a_windows_mean(window: Window, robot: MomentumKernel) -> None:
    (loose,) = swinging([window], JOINT, TIMES, robot.model.joints)
    larger = np.where(np.arange(robot.model.joints) == JOINT, TIMES, 1.0)
    assert loose.noise.joint_position == pytest.approx(JOINT_NOISE * larger)
    size = 1e3 * TIMES * JOINT_NOISE / np.sqrt(window.noise.samples)
    assert f'its load swings by about {size:.1g} mrad' in loose_joint_text('elbow', [window], TIMES)


COUNT, SPACING = 600, 20_000_000
REGULAR: Stamps = 1_700_000_000_000_000_000 + SPACING * np.arange(COUNT)
TIME = 1e-9 * SPACING * np.arange(COUNT)
RANDOM = np.random.default_rng(5)


def found(stamp: Stamps, pieces: int = 1, position: Array | None = None) -> list[str]:
    """Return the faults that are found."""
    return [text for _, text in found_since(stamp, pieces, position)]


def found_since(stamp: Stamps, pieces: int = 1, position: Array | None = None) -> list[tuple[int, str]]:
    """Return since which stamp each fault is found, and its text, by symptom."""
    moving = np.column_stack((np.sin(0.3 * TIME), np.cos(0.2 * TIME)))[: len(stamp)]
    pattern = StampPattern('the joint states', 1e-4)
    lines: dict[str, tuple[int, str]] = {}
    for piece in np.array_split(np.arange(len(stamp)), pieces):
        part = (moving if position is None else position)[piece]
        for symptom, since, text in pattern.add(stamp[piece], part):
            lines.setdefault(symptom, (since, text))
    return list(lines.values())


@pytest.mark.parametrize('pieces', [1, 13, COUNT])
def test_regular_jittering_late_and_missing_messages_are_no_fault(pieces: int) -> None:
    order = np.arange(COUNT)
    order[[200, 201, 300, 310]] = order[[201, 200, 310, 300]]
    jitter = np.round(4e6 * RANDOM.standard_normal(COUNT)).astype(np.int64)
    random = REGULAR[0] + np.cumsum(np.round(SPACING * RANDOM.exponential(size=COUNT)).astype(np.int64) + 1)
    for stamp in (REGULAR, REGULAR + jitter, REGULAR[order], random):
        assert found(stamp, pieces) == []
    kept = np.r_[0:200, 240:COUNT]
    position = np.column_stack((np.sin(0.3 * TIME), np.cos(0.2 * TIME)))
    assert found(REGULAR[kept], pieces, position[kept]) == []


def test_readings_of_which_a_third_is_lost_are_none_that_scatter() -> None:
    time = 0.02 * np.arange(3000)
    kept = np.random.default_rng(3).random(len(time)) > 1.0 / 3.0
    position = np.column_stack((np.sin(0.3 * time), np.cos(0.2 * time))) + 1e-4 * RANDOM.standard_normal((3000, 2))
    stamp = REGULAR[0] + SPACING * np.arange(3000)
    assert found(stamp[kept], 13, position[kept]) == []


@pytest.mark.parametrize('pieces', [1, 13, COUNT])
def test_readings_older_than_their_stamps_by_chance_are_named(pieces: int) -> None:
    count = 3 * COUNT
    stamp = REGULAR[0] + SPACING * np.arange(count)
    late = 1e-9 * SPACING * np.arange(count) - 0.02 * np.random.default_rng(1).random(count)
    noise = 1e-5 * np.random.default_rng(2).normal(size=(count, 2))

    def read(time: Array) -> Array:
        return np.column_stack((0.4 * np.sin(0.3 * time), 0.3 * np.cos(0.2 * time)))

    (text,) = found(stamp, pieces, read(late) + noise)
    # Uniform over 20 ms: a standard deviation of 5.8 ms.
    assert 4.5 < float(text.split(' by ')[1].split(' ms')[0]) < 7.0
    # Noise of any size is none, nor steps of a coarse encoder.
    time = 1e-9 * SPACING * np.arange(count)
    assert found(stamp, pieces, read(time) + 30.0 * noise) == []
    assert found(stamp, pieces, 6e-3 * np.round(read(time) / 6e-3)) == []


@pytest.mark.parametrize('pieces', [1, 13, COUNT])
@pytest.mark.parametrize('size', [3, 5, 20])
def test_batches_are_named(size: int, pieces: int) -> None:
    number = np.arange(COUNT)
    stamp = REGULAR[np.minimum(number - number % size + size - 1, COUNT - 1)] + 100_000 * (number % size)
    (text,) = found(stamp, pieces)
    assert text.startswith('the joint states come in batches of about ')
    # As far as the first sixty readings show it: of three batches of twenty the first has no mean to be short beside.
    about = float(text.split('of about ')[1].split(',')[0])
    assert about == pytest.approx({3: 3, 5: 5, 20: 4}[size], rel=0.3)


@pytest.mark.parametrize('pieces', [1, 13, COUNT])
@pytest.mark.parametrize(
    ('step', 'how'), [(-0.4, 'went back by 0.4 s at 6.0 s'), (0.4, 'went forward by 0.42 s at 6.0 s')]
)
def test_a_clock_that_was_set_is_named(step: float, how: str, pieces: int) -> None:
    stamp = REGULAR + round(1e9 * step) * (np.arange(COUNT) > 300)
    ((since, text),) = found_since(stamp, pieces)
    assert f'the stamps of the joint states {how}' in text
    assert since == max(stamp[300], stamp[306])  # as long as it takes to see that they go on
