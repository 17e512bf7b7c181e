"""Single readings that are off, and readings that are repeated, of the base and of joints."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.geometry import Array, Flags, exp, log
from mbaid_ros.core.joints.stream import JointMerge, joint_channels
from mbaid_ros.core.odometry.stream import POSE
from mbaid_ros.core.outliers import (
    FLIPPED,
    JOINT_OUTLIER,
    JOINTS_HELD,
    OUTLIER,
    QUARTILE_OF_ONE,
    REPEATED_POSE,
    Copies,
    Flips,
    FrameJumps,
    MisfitScale,
    Outliers,
    Repeats,
    _first_of_equals,
    _leaps,
    _ScoredReadings,
)
from mbaid_ros.core.samples import BaseStream, JointStream, Stamps
from windowed import base_stream, piece

GAP = 100_000_000  # ns
POSITION, ORIENTATION = 1e-3, 1e-4  # m, rad: noise


def noisy(count: int, seed: int, understated: float = 1.0) -> BaseStream:
    """Return poses with noise, of which less is declared."""
    rng = np.random.default_rng(seed)
    base = base_stream(1_700_000_000_000_000_000 + np.round(1e7 * np.arange(count)).astype(np.int64))
    declared = np.diag(np.repeat([POSITION, ORIENTATION], 3) / understated) ** 2
    return replace(
        base,
        position=base.position + POSITION * rng.normal(size=(count, 3)),
        rotation=exp(ORIENTATION * rng.normal(size=(count, 3))) @ base.rotation,
        pose_covariance=np.repeat(declared[None], count, axis=0),
    )


def thrown(base: BaseStream, hit: Flags, seed: int, length: float = 0.2, angle: float = 0.087) -> BaseStream:
    """Return poses of which some are off by a length (m) and an angle (rad)."""
    way = np.random.default_rng([seed, 1]).normal(size=(len(hit), 2, 3))
    way *= hit[:, None, None] / np.linalg.norm(way, axis=2, keepdims=True)
    return replace(base, position=base.position + length * way[:, 0], rotation=exp(angle * way[:, 1]) @ base.rotation)


def passed(base: BaseStream, cuts: list[int] | None = None) -> tuple[Stamps, int]:
    """Return the stamps of what passes, handed over in pieces, and how many are dropped."""
    outliers = Outliers(GAP, POSE)
    parts = [
        outliers.push(piece(base, begin, end)) for begin, end in pairwise([0, *sorted(cuts or []), len(base.stamp)])
    ]
    return np.concatenate([part.stamp for part in parts if part is not None]), outliers.dropped[OUTLIER]


def hits(share: float, count: int, seed: int) -> Flags:
    """Return which poses are hit; none of the first and last few, of which less is known."""
    hit = np.random.default_rng([seed, 2]).random(count) < share
    hit[:8] = hit[-5:] = False
    return np.asarray(hit)


@pytest.mark.parametrize('understated', [1.0, 10.0])
@pytest.mark.parametrize('share', [0.01, 0.05])
def test_all_outliers_go_and_nothing_else(share: float, understated: float) -> None:
    for seed in range(4):
        hit = hits(share, 3000, seed)
        base = thrown(noisy(3000, seed, understated=understated), hit, seed)
        stamps, dropped = passed(base)
        np.testing.assert_array_equal(stamps, base.stamp[~hit])
        assert dropped == np.sum(hit)


@pytest.mark.parametrize('place', [2, 3, 7])
def test_the_first_poses_may_be_outliers(place: int) -> None:
    for seed in range(8):
        hit = np.arange(100) == place
        base = thrown(noisy(100, seed), hit, seed)
        np.testing.assert_array_equal(passed(base)[0], base.stamp[~hit])


@pytest.mark.parametrize(('after', 'kept'), [(3, True), (4, False)])
def test_an_outlier_beside_a_gap_is_kept_as_one_neighbour_after_it_shows_no_motion(after: int, kept: bool) -> None:
    """So many readings after it, of which the first two are suspicious, too, then nothing for ten seconds."""
    hit = np.arange(100) == 50
    base = thrown(noisy(100, 0), hit, 0)
    base = replace(base, stamp=base.stamp + 10_000_000_000 * (np.arange(100) > 50 + after))
    assert passed(base)[1] == (not kept)


@pytest.mark.parametrize(('count', 'dropped'), [(38, 38), (40, 0), (120, 0)])
def test_more_suspicious_poses_in_a_row_than_any_fault_makes_are_kept(count: int, dropped: int) -> None:
    place = np.arange(400)
    base = thrown(noisy(400, 0), (place >= 100) & (place < 100 + count), 0)
    assert passed(base)[1] == dropped


@pytest.mark.parametrize(('length', 'angle'), [(0.2, 0.0), (0.0, 0.087)])
def test_a_pose_that_is_off_in_one_part_is_an_outlier(length: float, angle: float) -> None:
    hit = hits(0.01, 2000, 1)
    base = thrown(noisy(2000, 1), hit, 1, length, angle)
    np.testing.assert_array_equal(passed(base)[0], base.stamp[~hit])


@pytest.mark.parametrize('understated', [0.3, 1.0, 3.0, 10.0])
def test_noise_alone_is_no_outlier(understated: float) -> None:
    assert not sum(passed(noisy(3000, seed, understated=understated))[1] for seed in range(5))


@pytest.mark.parametrize('jump', [0.01, 0.2, 3.0])
def test_a_jump_that_stays_is_none(jump: float) -> None:
    base = noisy(400, 3)
    base.position[200:] += jump
    assert passed(base)[1] == 0


def test_a_sudden_change_of_the_velocity_is_none() -> None:
    base = noisy(400, 4)
    later = np.maximum(np.arange(400) - 200, 0)[:, None]
    base = replace(
        base, position=base.position + 0.01 * later, rotation=exp(0.002 * later * np.ones(3)) @ base.rotation
    )
    assert passed(base)[1] == 0


def test_a_motion_without_noise_that_begins_and_ends_has_none() -> None:
    time = 0.01 * np.arange(600)
    way = np.clip(time - 1.0, 0.0, 2.0)
    base = noisy(600, 0, understated=1e9)
    moving = replace(
        base,
        position=0.02 * (way - np.sin(np.pi * way) / np.pi)[:, None] * np.ones(3),
        rotation=exp(0.1 * (way - np.sin(np.pi * way) / np.pi)[:, None] * np.ones(3)),
    )
    assert passed(moving)[1] == 0


SECOND = 1_000_000_000


def repeated_poses(plateaus: list[int], step: int = 10_000_000) -> tuple[BaseStream, Stamps]:
    """Return odometry of which each pose comes so many times, every step (ns), and where each comes first."""
    source = np.repeat(np.cumsum([0, *plateaus[:-1]]), plateaus)
    stamps = 1_700_000_000 * SECOND + step * np.arange(len(source))
    moving = base_stream(stamps)
    held = {item.name: getattr(moving, item.name)[source] for item in fields(BaseStream) if item.name != 'stamp'}
    return BaseStream(stamp=stamps, **held), np.unique(source)


def without_repeats(base: BaseStream, cuts: list[int]) -> tuple[Stamps, int]:
    """Return the stamps of what passes, handed over in pieces, and how many are dropped."""
    repeats = Repeats(POSE)
    ends = [0, *sorted(cuts), len(base.stamp)]
    parts = [repeats.push(piece(base, begin, end)) for begin, end in pairwise(ends)]
    stamps = [part.stamp for part in parts if part is not None]
    return np.concatenate([np.zeros(0, dtype=np.int64), *stamps]), repeats.dropped[REPEATED_POSE]


def test_a_base_that_stands_still_goes_on() -> None:
    base, _ = repeated_poses([5, 101, 3])
    stamps, dropped = without_repeats(base, [])
    # The one of five and the one of three, and the second at rest from its begin on.
    np.testing.assert_array_equal(stamps, base.stamp[[0, *range(5, 107)]])
    assert dropped == 4  # the last two are not known yet to be repeated or at rest


@pytest.mark.parametrize('pieces', [1, 7, 400])
@pytest.mark.parametrize('late', [0, 1, 15, 45])
def test_copies_are_dropped_however_late(late: int, pieces: int) -> None:
    stream = motion(1)
    order = np.argsort(np.concatenate((np.arange(COUNT), np.arange(COUNT) + late + 0.5)), kind='stable') % COUNT
    arrived = stream[order]
    copies = Copies[JointStream](lambda joints: joints.position, SECOND)
    ends = np.linspace(0, len(order), pieces + 1).astype(int).tolist()
    parts = [copies.push(arrived[begin:end]) for begin, end in pairwise(ends) if end > begin]
    left = JointStream.concatenate([part for part in parts if part is not None])
    np.testing.assert_array_equal(left.stamp, stream.stamp)
    np.testing.assert_array_equal(left.position, stream.position)
    assert sum(copies.dropped.values()) == COUNT


def test_another_reading_of_the_same_stamp_is_no_copy() -> None:
    stream = motion(2)
    copies = Copies[JointStream](lambda joints: joints.position, SECOND)
    assert copies.push(stream) is stream
    other = copies.push(with_positions(stream, stream.position + 1e-9)[-20:])
    assert other is not None
    assert len(other.stamp) == 20


RATE, COUNT, JOINTS = 50, 600, 4


def motion(seed: int, noise: float = 1e-4) -> JointStream:
    generator = np.random.default_rng(seed)
    time = np.arange(COUNT) / RATE
    rate = generator.uniform(0.1, 0.6, JOINTS)
    position = 0.4 * np.sin(rate * time[:, None] + generator.uniform(0.0, 6.0, JOINTS))
    position += noise * generator.standard_normal(position.shape)
    return JointStream(np.round(time * 1e9).astype(np.int64), position, np.full(position.shape, np.nan))


def with_positions(stream: JointStream, position: Array) -> JointStream:
    return JointStream(stream.stamp, position, stream.velocity)


def held() -> Repeats[JointStream]:
    return Repeats[JointStream](joint_channels(1e-4), JOINTS_HELD, together=True)


def let_through(gate: Repeats[JointStream] | Outliers[JointStream], stream: JointStream, pieces: int) -> JointStream:
    parts = [gate.push(stream[piece]) for piece in np.array_split(np.arange(COUNT), pieces)]
    return stream.concatenate([part for part in parts if part is not None])


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
@pytest.mark.parametrize('joints', [[2], [0, 1, 2, 3]], ids=['one joint', 'all'])
def test_single_outliers_are_dropped_and_counted(joints: list[int], pieces: int) -> None:
    stream = motion(1)
    wrong = np.arange(120, COUNT - 10, 97)
    position = stream.position.copy()
    position[wrong[:, None], joints] = 1.5
    gate = Outliers[JointStream](200_000_000, joint_channels(1e-4), JOINT_OUTLIER)
    kept = let_through(gate, with_positions(stream, position), pieces)
    assert gate.dropped[JOINT_OUTLIER] == len(wrong) == COUNT - len(kept.stamp)
    assert not np.isin(kept.stamp, stream.stamp[wrong]).any()
    assert gate.by_channel == dict.fromkeys(joints, len(wrong))


@pytest.mark.parametrize('noise', [0.0, 1e-4, 1e-3])
def test_clean_readings_pass_as_they_are(noise: float) -> None:
    for seed in range(5):
        stream = motion(seed, noise)
        outliers = Outliers[JointStream](200_000_000, joint_channels(1e-4), JOINT_OUTLIER)
        kept = some(outliers.push(held().push(stream)))
        assert not +outliers.dropped
        assert len(kept.stamp) >= COUNT - 4
        assert np.array_equal(kept.position, stream.position[: len(kept.stamp)])


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
@pytest.mark.parametrize('every', [3, 5, 10])
def test_readings_that_a_driver_holds_are_dropped(every: int, pieces: int) -> None:
    stream = motion(2)
    gate = held()
    kept = let_through(gate, with_positions(stream, stream.position[np.arange(COUNT) // every * every]), pieces)
    assert np.array_equal(kept.stamp, stream.stamp[::every])
    assert gate.dropped[JOINTS_HELD] == COUNT - len(kept.stamp) - (every - 1)  # the last ones may be those of a rest


@pytest.mark.parametrize('pieces', [1, COUNT])
def test_coarse_steps_and_rests_are_kept(pieces: int) -> None:
    stream = motion(3, 0.0)
    coarse = np.round(stream.position / 0.02) * 0.02
    assert len(let_through(held(), with_positions(stream, coarse), pieces).stamp) == COUNT
    resting = stream.position.copy()
    resting[200:400] = resting[200]
    gate = held()
    assert len(let_through(gate, with_positions(stream, resting), pieces).stamp) == COUNT
    assert not gate.dropped[JOINTS_HELD]


def parts(stream: JointStream, *joints: tuple[int, ...]) -> dict[tuple[int, ...], JointStream]:
    return {each: JointStream(stream.stamp, stream.position[:, each], stream.velocity[:, each]) for each in joints}


@pytest.mark.parametrize('pieces', [1, 12, COUNT])
def test_a_message_with_all_joints_counts_among_messages_with_some(pieces: int) -> None:
    stream = motion(4)
    merge = JointMerge(np.ones(JOINTS, dtype=bool), 100_000_000, 0)
    merged = []
    for part in np.array_split(np.arange(COUNT), pieces):
        some = stream[part[part % 50 != 20]]
        whole = stream[part[part % 50 == 20]]
        given = {each: part for each, part in parts(some, (0, 1), (2, 3)).items() if len(part.stamp)}
        given |= {tuple(range(JOINTS)): whole} if len(whole.stamp) else {}
        merged.append(merge.push(given))
    found = stream.concatenate([part for part in merged if part is not None])
    assert np.array_equal(found.stamp, stream.stamp)
    assert np.array_equal(found.position, stream.position)


def test_a_slow_part_serves_often_only_while_it_rests() -> None:
    stream = motion(5)
    resting = with_positions(stream, np.where(np.arange(JOINTS) == 3, 0.3, stream.position))
    for given, every_one in ((resting, True), (stream, False)):
        merge = JointMerge(np.ones(JOINTS, dtype=bool), 100_000_000, 0, noise=1e-4)
        merged = some(merge.push(parts(given, (0, 1, 2)) | parts(given[::10], (3,))))
        assert (len(merged.stamp) > COUNT - 11) is every_one


def without_flips(flipped: Flags, pieces: int = 7, angle: float = np.pi) -> tuple[BaseStream, BaseStream, Flips]:
    """Return poses, those passed on where some are flipped, and what has passed them on."""
    base, flips = noisy(len(flipped), 4), Flips()
    turned = base.rotation @ exp(np.array([0.0, 0.0, angle]))
    read = replace(base, rotation=np.where(flipped[:, None, None], turned, base.rotation))
    places = np.linspace(0, len(flipped), pieces + 1).astype(int)
    parts = [flips.push(piece(read, begin, end)) for begin, end in pairwise(places.tolist())]
    return base, BaseStream.concatenate([part for part in parts if part is not None]), flips


@pytest.mark.parametrize('pieces', [1, 7, 400])
def test_single_flips_of_a_marker_set_are_left_out(pieces: int) -> None:
    flipped = np.random.default_rng(3).random(400) < 0.3
    flipped[0] = False
    base, passed_on, flips = without_flips(flipped, pieces)
    np.testing.assert_array_equal(passed_on.stamp, base.stamp[~flipped])
    np.testing.assert_array_equal(passed_on.rotation, base.rotation[~flipped])
    assert flips.dropped == {FLIPPED: int(flipped.sum())}
    assert 'by 180 degrees about (0, 0, ' in flips.text


@pytest.mark.parametrize('degrees', [180, 120, 90])  # in half a second a robot may turn by as much as the last two
def test_another_orientation_that_lasts_is_turned_back_after_a_gap(degrees: int) -> None:
    time = np.arange(600)
    flipped = (time >= 100) & (time < 350)
    base, passed_on, flips = without_flips(flipped, angle=np.deg2rad(degrees))
    assert f'by {degrees} degrees about' in flips.text  # the way back as well
    kept = (time < 100) | ((time >= 150) & (time < 350)) | (time >= 400)
    np.testing.assert_array_equal(passed_on.stamp, base.stamp[kept])
    np.testing.assert_allclose(passed_on.rotation, base.rotation[kept], atol=3e-4)  # not a step of the motion
    np.testing.assert_array_equal(passed_on.rotation[-200:], base.rotation[-200:])
    assert np.isnan(passed_on.angular_velocity[100:300]).all()


def test_a_robot_that_turns_does_not_flip() -> None:
    base, passed_on, flips = without_flips(np.zeros(300, dtype=bool))
    np.testing.assert_array_equal(passed_on.rotation, base.rotation)
    assert not flips.dropped


@pytest.mark.parametrize(('apart', 'largest'), [(0.0, 0.5), (0.1, 0.8), (0.5, 2.0)])
def test_a_turn_is_a_leap_where_no_robot_turns_as_fast(apart: float, largest: float) -> None:
    """By half a radian and three a second; after long gaps none is."""
    axis, stamps = np.array([2.0, -1.0, 2.0]) / 3.0, np.full(2, round(1e9 * apart))
    turned = exp(np.outer([0.99 * largest, 1.01 * largest], axis))
    begin = exp(np.array([[0.3, -0.4, 0.5]] * 2))
    assert _leaps(begin, turned @ begin, stamps).tolist() == [False, True]
    assert not _leaps(begin, turned @ begin, stamps + 2_000_000_000).any()


def smooth(count: int, seed: int, spacing: float, *, twist: bool) -> BaseStream:
    """Return poses with noise, s apart, with an exact twist or none."""
    base = base_stream(1_700_000_000_000_000_000 + np.round(1e9 * spacing * np.arange(count)).astype(np.int64))
    declared = np.diag(np.repeat([POSITION, ORIENTATION], 3) ** 2)
    rng = np.random.default_rng(seed)
    unknown = np.full((count, 3), np.nan)
    return replace(
        base,
        position=base.position + POSITION * rng.normal(size=(count, 3)),
        rotation=exp(ORIENTATION * rng.normal(size=(count, 3))) @ base.rotation,
        linear_velocity=base.linear_velocity if twist else unknown,
        angular_velocity=base.angular_velocity if twist else unknown,
        pose_covariance=np.repeat(declared[None], count, axis=0),
    )


def map_corrected(base: BaseStream, first: int, turn: Array, step: Array) -> BaseStream:
    """Return poses of which those from one on are in a map turned (rad) about the base and displaced (m) there."""
    after = np.arange(len(base.stamp)) >= first
    turned: Array = exp(turn)
    place = base.position[first]
    moved = replace(
        base,
        position=place + step + (base.position - place) @ turned.T,
        rotation=turned @ base.rotation,
        linear_velocity=base.linear_velocity @ turned.T,
        angular_velocity=base.angular_velocity @ turned.T,
    )
    return BaseStream.concatenate([base[~after], moved[after]])


def in_first_frame(base: BaseStream, cuts: list[int] | None = None) -> tuple[BaseStream, FrameJumps]:
    jumps = FrameJumps()
    parts = [jumps.push(piece(base, begin, end)) for begin, end in pairwise([0, *(cuts or []), len(base.stamp)])]
    return BaseStream.concatenate([part for part in parts if part is not None]), jumps


AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


@pytest.mark.parametrize('twist', [True, False])
@pytest.mark.parametrize('spacing', [0.01, 1.0 / 30.0])
@pytest.mark.parametrize(
    ('step', 'degrees', 'text'),
    [
        (0.02, 0.0, r'by \d\d mm at 1.2 s'),
        (0.2, 0.0, r'by [12]\d\d mm at 1.2 s'),
        (0.0, 2.0, r'by 2 degrees at 1.2 s'),
        (0.12, 2.1, r'by 1\d\d mm and 2.1 degrees at 1.2 s'),
    ],
)
def test_poses_after_a_correction_of_the_map_are_read_in_the_first_frame(
    step: float, degrees: float, text: str, spacing: float, twist: bool
) -> None:
    """A second later they are as far away as the error of the correction turns and moves them."""
    first = round(1.2 / spacing)
    base = smooth(2 * first, 5, spacing, twist=twist)
    found, jumps = in_first_frame(map_corrected(base, first, np.radians(degrees) * AXIS, step * AXIS[::-1]))
    (jump,) = jumps.found
    assert jump.stamp == base.stamp[first]
    assert re.search(text, jumps.text(jump.stamp, int(base.stamp[0])))
    assert not jumps.text(jump.stamp - 1, int(base.stamp[0]))
    np.testing.assert_array_equal(found.stamp, base.stamp)
    np.testing.assert_array_equal(found.position[:first], base.position[:first])
    turn, displacement = np.sqrt(jump.variance)
    assert turn < 3.0 * ORIENTATION  # of ten poses on either side
    assert displacement < 3.0 * POSITION
    np.testing.assert_allclose(found.rotation, base.rotation, atol=4.0 * turn)
    away = np.max(np.abs(base.position[first:] - base.position[first]))
    np.testing.assert_allclose(found.position, base.position, atol=4.0 * (displacement + turn * away))
    if twist:
        np.testing.assert_allclose(found.angular_velocity, base.angular_velocity, atol=10.0 * turn)


@pytest.mark.parametrize('twist', [True, False])
def test_the_error_of_a_correction_is_as_large_as_expected(twist: bool) -> None:
    squares = []
    for seed in range(60):
        base = smooth(60, seed, 0.01, twist=twist)
        found, jumps = in_first_frame(map_corrected(base, 30, 0.05 * AXIS, 0.1 * AXIS))
        (jump,) = jumps.found
        errors = log(found.rotation[30] @ base.rotation[30].T), found.position[30] - base.position[30]
        squares.append(np.mean(np.square(errors), axis=1) / jump.variance)
    assert np.mean(squares, axis=0) == pytest.approx([1.0, 1.0], abs=0.4)


@pytest.mark.parametrize('twist', [True, False])
def test_three_corrections_of_a_map_however_the_calls_are_cut(twist: bool) -> None:
    base = smooth(400, 8, 0.01, twist=twist)
    read = base
    for first, step, degrees in ((50, 0.05, 1.0), (190, 0.2, 0.0), (300, 0.02, 5.0)):
        read = map_corrected(read, first, np.radians(degrees) * AXIS, step * AXIS[::-1])
    found, jumps = in_first_frame(read)
    assert [jump.stamp for jump in jumps.found] == base.stamp[[50, 190, 300]].tolist()
    assert 'jump by up to 200 mm and 5 degrees at 0.5, 1.9 and 3.0 s' in jumps.text(2**62, int(base.stamp[0]))
    np.testing.assert_allclose(found.rotation, base.rotation, atol=2e-3)
    variances = jumps.variances(base.stamp)
    assert not variances[:50].any()
    assert np.all(np.diff(variances[[49, 50, 189, 190, 299, 300]], axis=0)[::2] > 0.0)
    for cuts in ([50], [190, 300], [51, 55, 191, 192, 305], list(range(1, 400))):
        again, _ = in_first_frame(read, cuts)
        for item in fields(BaseStream):
            np.testing.assert_array_equal(getattr(again, item.name), getattr(found, item.name))


def pushed(base: BaseStream, first: int) -> BaseStream:
    """Return poses of a base that a contact pushes: 0.3 m/s and 0.1 rad/s more from one instant on."""
    time = 1e-9 * (base.stamp - base.stamp[first])
    after = np.where(time > 0.0, time, 0.0)[:, None]
    faster = (time > 0.0)[:, None]
    return replace(
        base,
        position=base.position + 0.3 * after * AXIS,
        rotation=exp(0.1 * after * AXIS) @ base.rotation,
        linear_velocity=base.linear_velocity + 0.3 * faster * AXIS,
        angular_velocity=base.angular_velocity + 0.1 * faster * AXIS,
    )


NO_JUMPS: dict[str, Callable[[BaseStream], BaseStream]] = {
    'noise': lambda base: base,
    'a contact': lambda base: pushed(base, 150),
    'a thrust pulse of 50 ms': lambda base: pushed(pushed(pushed(base, 150), 152), 155),
    'a gap': lambda base: base[np.abs(np.arange(300) - 150) > 8],
    'a gap and a jump': lambda base: map_corrected(base, 150, 0.05 * AXIS, 0.1 * AXIS)[
        np.abs(np.arange(300) - 150) > 8
    ],
    'single poses lost': lambda base: base[np.arange(300) % 7 > 0],
    'a few deviations': lambda base: map_corrected(base, 150, 3.0 * ORIENTATION * AXIS, 3.0 * POSITION * AXIS),
    'five poses elsewhere': lambda base: map_corrected(
        map_corrected(base, 150, 0.05 * AXIS, 0.1 * AXIS), 155, -0.05 * AXIS, -0.1 * AXIS
    ),
    'a jump in the first readings': lambda base: map_corrected(base, 5, 0.05 * AXIS, 0.1 * AXIS),
    'no position': lambda base: replace(
        base, position=0.0 * base.position, pose_covariance=np.where(np.eye(6) > 0.5, np.nan, base.pose_covariance)
    ),
}


@pytest.mark.parametrize('twist', [True, False])
@pytest.mark.parametrize('spacing', [0.01, 1.0 / 30.0])
@pytest.mark.parametrize('what', NO_JUMPS)
def test_what_is_no_jump_passes_to_the_bit(what: str, spacing: float, twist: bool) -> None:
    for seed in range(4):
        read = NO_JUMPS[what](smooth(300, seed, spacing, twist=twist))
        found, jumps = in_first_frame(read)
        assert not jumps.found
        for item in fields(BaseStream):
            np.testing.assert_array_equal(getattr(found, item.name), getattr(read, item.name))


def test_orientations_alone_jump_as_well() -> None:
    base = NO_JUMPS['no position'](smooth(300, 3, 0.01, twist=False))
    covariance = np.where(np.arange(6) > 2, ORIENTATION**2, np.nan) * np.where(np.eye(6) > 0.5, 1.0, 0.0)
    base = replace(base, pose_covariance=np.tile(covariance, (300, 1, 1)))
    found, jumps = in_first_frame(map_corrected(base, 150, 0.05 * AXIS, np.zeros(3)))
    assert 'by 2.9 degrees at' in jumps.text(2**62, 0)
    assert jumps.found[0].variance[1] == 0.0
    np.testing.assert_allclose(found.rotation, base.rotation, atol=1e-3)


@pytest.mark.parametrize('pieces', [1, 5])
def test_the_scale_of_misfits_is_their_size_as_soon_as_enough_are_known(pieces: int) -> None:
    """Of lengths of vectors and of single numbers; it starts at ten times the declared noise, and is never less."""
    rng, count = np.random.default_rng(0), 10_000
    vectors, single = np.linalg.norm(rng.normal(size=(count, 3)), axis=1), np.abs(rng.normal(size=count))
    misfit = np.column_stack((5.0 * vectors, 7.0 * single, 0.1 * single))
    declared, quartiles = np.tile([1.0, 2.0, 3.0], (count, 1)), np.array([1.10, QUARTILE_OF_ONE, QUARTILE_OF_ONE])
    scale, parts = MisfitScale(), np.array_split(np.arange(count), pieces)
    found = np.concatenate([scale.of_next(misfit[part], declared[part], quartiles) for part in parts])
    assert found[0] == pytest.approx([10.0, 20.0, 30.0])
    assert np.mean(found[100:], axis=0) == pytest.approx([5.0, 7.0, 3.0], rel=0.08)
    np.testing.assert_array_equal(found[100:, 2], 3.0)


@pytest.mark.parametrize('uneven', [False, True])
def test_noise_leads_readings_as_far_astray_as_two_uneven_steps_make_it(uneven: bool) -> None:
    """White noise of a steady motion has the scale of its own deviation, however far readings are apart."""
    rng, count = np.random.default_rng(1), 20_000
    steps = rng.integers(5_000_000, 40_000_000, count) if uneven else np.full(count, 10_000_000)
    stamps: Stamps = 1_700_000_000_000_000_000 + np.cumsum(steps)
    time = 1e-9 * (stamps - stamps[0])
    position = 0.3 * time[:, None] + 0.01 * rng.normal(size=(count, 2))
    read = JointStream(stamps, position, np.full_like(position, np.nan))
    judged = Outliers[JointStream](200_000_000, joint_channels(5e-3), JOINT_OUTLIER)._score(read)
    assert np.mean(judged.suspicious) < 1e-3
    assert np.mean(judged.scale[200:], axis=0) == pytest.approx([0.0105, 0.0105], rel=0.07)


def judged_beside(apart: int, before: int, after: int, off: float) -> tuple[bool, dict[int, int]]:
    """Return whether a reading that is off is an outlier, by so many readings before and after it, ns apart."""
    count = before + 1 + after
    stamps: Stamps = apart * np.arange(count)
    time = 1e-9 * (stamps - stamps[before])
    position = np.column_stack((0.3 + 0.2 * time - 0.5 * time**2, -0.1 * time))
    position[before, 1] += off
    read = JointStream(stamps, position, np.full_like(position, np.nan))
    gate = Outliers[JointStream](200_000_000, joint_channels(1e-4), JOINT_OUTLIER)
    judged = _ScoredReadings(read, np.arange(count) == before, np.full((count, 2), 1e-4))
    around = [place for place in range(count) if place != before]
    (far,) = gate._far(judged, around, range(before, before + 1))
    return bool(far), dict(gate.by_channel)


@pytest.mark.parametrize(
    ('apart', 'before', 'after', 'off', 'outlier'),
    [
        (10_000_000, 4, 3, 2e-3, True),
        (10_000_000, 4, 3, -2e-3, True),
        (10_000_000, 4, 3, 6e-4, False),  # seven deviations, and the parabola's own
        (10_000_000, 2, 2, 1e-2, True),
        (10_000_000, 1, 3, 1e-2, False),  # one reading shows no motion
        (10_000_000, 4, 1, 1e-2, False),
        (300_000_000, 4, 3, 1e-2, True),
        (399_000_000, 2, 2, 1e-2, True),  # within four of the longest intervals
        (401_000_000, 2, 2, 1e-2, False),
    ],
)
def test_a_reading_is_an_outlier_far_from_a_parabola_through_those_beside(
    apart: int, before: int, after: int, off: float, outlier: bool
) -> None:
    assert judged_beside(apart, before, after, off) == (outlier, {1: 1} if outlier else {})


@pytest.mark.parametrize(
    ('stamps', 'numbers', 'new'),
    [
        ([1, 2, 3], [0.0, 0.0, 0.0], [True, True, True]),
        ([1, 2, 1], [0.0, 0.0, 0.0], [True, True, False]),
        ([1, 1, 1, 1], [0.0, 1.0, 1.0, 0.0], [True, True, False, False]),
        ([1, 1], [0.0, -0.0], [True, False]),
        ([2, 1, 2, 1], [0.0, 0.0, 1.0, 0.0], [True, True, True, False]),
    ],
)
def test_a_copy_has_the_stamp_and_the_numbers_of_a_reading_before(
    stamps: list[int], numbers: list[float], new: list[bool]
) -> None:
    assert _first_of_equals(np.array(stamps), np.array(numbers)[:, None]).tolist() == new


@pytest.mark.parametrize(('span', 'dropped'), [(30, 1), (20, 0)])
def test_copies_are_looked_for_among_the_latest_stamps(span: int, dropped: int) -> None:
    copies = Copies[JointStream](lambda joints: joints.position, span)
    for stamp, value in ((0, 1.0), (10, 2.0), (25, 3.0), (0, 1.0)):
        copies.push(JointStream(np.array([stamp]), np.array([[value]]), np.array([[np.nan]])))
    assert sum(copies.dropped.values()) == dropped


@pytest.mark.parametrize(
    ('moving', 'changes', 'apart', 'new'),
    [
        ([False, False], [[1, 1], [1, 1]], False, [False, False, False]),
        ([True, True], [[1, 0], [1, 1]], True, [True, True, True]),  # the second has changed before, and not now
        ([True, False], [[1, 0], [1, 0]], False, [True, True, False]),  # one alone: as well of coarse steps
        ([True, False], [[0, 1], [1, 1]], True, [True, True, True]),
        ([False, False], [[1, 1], [1, 0]], True, [False, True, True]),
        ([True, True], [[0, 0], [1, 1]], False, [True, False, False]),
    ],
)
def test_channels_that_change_apart_have_coarse_steps(
    moving: list[bool], changes: list[list[int]], apart: bool, new: list[bool]
) -> None:
    repeats = held()
    repeats._moving = np.array(moving)
    assert repeats._coarse(np.array(changes, dtype=bool)).tolist() == new
    assert repeats._apart is apart
    # From then on nothing is held.
    assert repeats._coarse(np.array([[1, 1]], dtype=bool)).tolist() == [apart, apart]
