"""Joint readings that add nothing: single outliers, and readings that a driver repeats under new stamps."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import JointStream
from mbaid_ros.core.sensors.joints import JointMerge
from mbaid_ros.core.sensors.outliers import JOINT_OUTLIER, JOINTS_HELD, Outliers, Repeats, joint_channels

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


def passed(gate: Repeats[JointStream] | Outliers[JointStream], stream: JointStream, pieces: int) -> JointStream:
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
    kept = passed(gate, with_positions(stream, position), pieces)
    assert gate.dropped[JOINT_OUTLIER] == len(wrong) == COUNT - len(kept.stamp)
    assert not np.isin(kept.stamp, stream.stamp[wrong]).any()
    assert gate.by_channel == dict.fromkeys(joints, len(wrong))


@pytest.mark.parametrize('noise', [0.0, 1e-4, 1e-3])
def test_clean_readings_pass_as_they_are(noise: float) -> None:
    for seed in range(5):
        stream = motion(seed, noise)
        outliers = Outliers[JointStream](200_000_000, joint_channels(1e-4), JOINT_OUTLIER)
        kept = outliers.push(held().push(stream))
        assert kept is not None
        assert not +outliers.dropped
        assert len(kept.stamp) >= COUNT - 4
        assert np.array_equal(kept.position, stream.position[: len(kept.stamp)])


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
@pytest.mark.parametrize('every', [3, 5, 10])
def test_readings_that_a_driver_holds_are_dropped(every: int, pieces: int) -> None:
    stream = motion(2)
    gate = held()
    kept = passed(gate, with_positions(stream, stream.position[np.arange(COUNT) // every * every]), pieces)
    assert np.array_equal(kept.stamp, stream.stamp[::every])
    assert gate.dropped[JOINTS_HELD] == COUNT - len(kept.stamp) - (every - 1)  # the last ones may be those of a rest


@pytest.mark.parametrize('pieces', [1, COUNT])
def test_coarse_steps_and_rests_are_kept(pieces: int) -> None:
    stream = motion(3, 0.0)
    coarse = np.round(stream.position / 0.02) * 0.02
    assert len(passed(held(), with_positions(stream, coarse), pieces).stamp) == COUNT
    resting = stream.position.copy()
    resting[200:400] = resting[200]
    gate = held()
    assert len(passed(gate, with_positions(stream, resting), pieces).stamp) == COUNT
    assert not gate.dropped[JOINTS_HELD]


def parts(stream: JointStream, *joints: tuple[int, ...]) -> dict[tuple[int, ...], JointStream]:
    return {each: JointStream(stream.stamp, stream.position[:, each], stream.velocity[:, each]) for each in joints}


@pytest.mark.parametrize('pieces', [1, 12, COUNT])
def test_a_message_with_all_joints_counts_among_messages_with_some(pieces: int) -> None:
    stream = motion(4)
    merge = JointMerge(np.ones(JOINTS, dtype=bool), 100_000_000, 0)
    merged = []
    for piece in np.array_split(np.arange(COUNT), pieces):
        some = stream[piece[piece % 50 != 20]]
        whole = stream[piece[piece % 50 == 20]]
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
        merged = merge.push(parts(given, (0, 1, 2)) | parts(given[::10], (3,)))
        assert merged is not None
        assert (len(merged.stamp) > COUNT - 11) is every_one
