"""Stamps and clocks: which patterns are named, and since when, on either side of each limit; other clocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.clocks import (
    Reorder,
    StampPattern,
    TimeOffsetConfig,
    UnevenStamps,
    clock_drift,
    declared_drift,
    declared_offset,
    joints_stamped_late,
    restamped,
    time_offset,
)
from mbaid_ros.core.contracts import CLEAR, NominalModel
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import JointStream, Stamps
from observed import kernel
from unchanged import Unchanged
from windowed import SPACING as KNOTS
from windowed import joint_window

COUNT, SPACING, NOISE, START = 400, 20_000_000, 1e-4, 1_700_000_000_000_000_000
GRID = np.geomspace(0.5, 2.0, 9)  # times a limit
NUMBER = np.arange(COUNT)
EVEN: Stamps = START + SPACING * NUMBER
Evidence = tuple[Stamps, Array]


def motion(seconds: Array, speed: float = 1.0) -> Array:
    """Return two joints that move smoothly."""
    return np.column_stack((np.sin(0.3 * speed * seconds), 0.7 * np.cos(0.5 * speed * seconds)))


def read(stamps: Stamps, since: Array | None = None, noise: float = NOISE) -> Evidence:
    """Return stamps, and what was read after so many s; as stamped by default."""
    seconds = 1e-9 * (stamps - START) if since is None else since
    return stamps, motion(seconds) + noise * np.random.default_rng(0).normal(size=(len(stamps), 2))


TRUE = 1e-9 * SPACING * NUMBER


def repeated(size: float) -> Evidence:
    """Return a part of the stamps as those before."""
    return read(START + SPACING * np.floor(NUMBER * (1.0 - 0.49 * size)).astype(np.int64), TRUE)


def whole_seconds(size: float) -> Evidence:
    step = 10**9 if size < 1.0 else round(10**9 * 1.5)
    return read((EVEN - START) // step * step + START, TRUE)


def short(size: float) -> Evidence:
    """Return every second stamp soon after the one before."""
    return read(np.asarray(START + SPACING * (NUMBER - NUMBER % 2 * (1.0 - 0.2 * size)), dtype=np.int64), TRUE)


def batched(size: float) -> Evidence:
    """Return batches, of which so many readings follow the first at once."""
    place = NUMBER % 10
    early = np.minimum(place, round(4.0 * size))
    return read(EVEN - np.asarray(0.95 * SPACING * early, dtype=np.int64), TRUE)


def set_back(size: float) -> Evidence:
    return read(EVEN - round(50e6 * size) * (NUMBER > 200), TRUE)


def set_back_early(size: float) -> Evidence:
    return read(EVEN - round(1e8) * (round(60 * size) < NUMBER), TRUE)


def set_back_beside_jitter(size: float) -> Evidence:
    uneven = np.round(0.25 * SPACING * size * np.random.default_rng(1).uniform(-1.0, 1.0, COUNT)).astype(np.int64)
    return read(EVEN - round(1e8) * (NUMBER > 200) + uneven, TRUE)


def crept(size: float) -> Evidence:
    """Return a clock that is set back by a part of an interval."""
    return read(EVEN - round(0.5 * size * SPACING) * (NUMBER > 200), TRUE)


def crept_beside_jitter(size: float) -> Evidence:
    uneven = np.round(0.01 * SPACING * size * np.random.default_rng(1).uniform(-1.0, 1.0, COUNT)).astype(np.int64)
    return read(EVEN - round(0.8 * SPACING) * (NUMBER > 200) + uneven, TRUE)


def set_forward(size: float) -> Evidence:
    return read(EVEN + round(1e8 * size) * (NUMBER > 200), TRUE)


def set_forward_with_a_part_of_the_motion(size: float) -> Evidence:
    return read(EVEN + round(4e8) * (NUMBER > 200), TRUE + 0.3 * size * 0.4 * (NUMBER > 200))


def set_forward_beside_noise(size: float) -> Evidence:
    return read(EVEN + round(4e8) * (NUMBER > 200), TRUE, NOISE * 15.0 * size)


def set_forward_of_a_slow_motion(size: float) -> Evidence:
    stamps = EVEN + round(2e8) * (NUMBER > 200)
    return stamps, motion(TRUE, 0.07 * size) + 1e-6 * np.random.default_rng(0).normal(size=(COUNT, 2))


def slow(size: float) -> Evidence:
    """Return readings so far apart that the motion around a step is not known."""
    apart = round(2e8 * size)
    return read(START + apart * NUMBER - round(1.2 * apart) * (NUMBER > 200), 1e-9 * apart * NUMBER)


EVIDENCE: dict[str, Callable[[float], Evidence]] = {
    each.__name__: each
    for each in (
        repeated,
        whole_seconds,
        short,
        batched,
        set_back,
        set_back_early,
        set_back_beside_jitter,
        crept,
        crept_beside_jitter,
        set_forward,
        set_forward_with_a_part_of_the_motion,
        set_forward_beside_noise,
        set_forward_of_a_slow_motion,
        slow,
    )
}


def named(stamps: Stamps, position: Array, pieces: int = 1) -> dict[str, object]:
    pattern, found = StampPattern('the joint states', NOISE), dict[str, object]()
    for piece in np.array_split(np.arange(len(stamps)), pieces):
        for symptom, since, text in pattern.add(stamps[piece], position[piece]):
            found.setdefault(symptom, (since - START, text))
    return found


@pytest.mark.parametrize('name', EVIDENCE)
def test_patterns_of_stamps(name: str, unchanged: Unchanged) -> None:
    found = [named(*EVIDENCE[name](size)) for size in GRID.tolist()]
    assert found[-1] == named(*EVIDENCE[name](GRID[-1]), pieces=29)
    assert len({str(each) for each in found}) > 1
    unchanged.values(found=found)


@pytest.mark.parametrize('kind', ['jitter', 'noise', 'steps', 'lost', 'few', 'by speed'])
def test_readings_that_scatter_in_time(kind: str, unchanged: Unchanged) -> None:
    """By jitter, beside white noise, by coarse steps, with lost readings, in few blocks, and by noise of the speed."""
    count, rng = 1500, np.random.default_rng(2)
    seconds, stamps = 0.02 * np.arange(count), START + SPACING * np.arange(count)
    drawn, noise, found = rng.normal(size=count), rng.normal(size=(count, 2)), []
    for size in GRID.tolist():
        late = 1e-3 * (size if kind == 'jitter' else 4.0) * drawn
        position = motion(seconds - late) + NOISE * noise
        kept = np.ones(count, dtype=bool)
        if kind == 'noise':
            position += 4e-4 * size * noise
        elif kind == 'steps':
            position = 2e-3 * size * np.round(position / (2e-3 * size))
        elif kind == 'lost':
            kept = rng.random(count) > 0.02 * size
        elif kind == 'few':
            kept[round(720 * size) :] = False
        elif kind == 'by speed':
            rate = np.gradient(motion(seconds), 0.02, axis=0)
            position = motion(seconds) + 4e-3 * np.abs(rate) ** size * noise
        found.append(named(stamps[kept], position[kept]))
    assert len({str(each) for each in found}) > 1
    unchanged.values(found=found)


@pytest.mark.parametrize(
    ('kind', 'size', 'symptom'),
    [
        ('jitter', 4.0, 'jitter: the joint states'),
        ('arrival', 2.5, 'jitter: the joint states'),
        ('float32', 1.0, 'jitter: the joint states'),
        ('jitter', 3.0, ''),
        ('cut', 1.0, ''),
        ('measured', 5.0, ''),
        ('step', 2.0, 'step: the joint states'),
        ('step', -3.0, 'step: the joint states'),
        ('step', 0.5, ''),
        ('paused', 5.0, ''),
        ('lost', 1.0, ''),
        ('gap', 0.0, ''),
    ],
)
def test_uneven_stamps_are_named_where_the_readings_are_even(kind: str, size: float, symptom: str) -> None:
    """By jitter, stamped on arrival or in float32; uneven readings, a clock that is set, a reading lost, a gap."""
    count, spacing, rng = 1300 if kind == 'gap' else 1000, 10_000_000, np.random.default_rng(4)
    number = np.arange(count)
    even: Stamps = START + spacing * number
    late = {
        'arrival': rng.exponential(abs(size), count),
        'float32': 1e3 * np.asarray(1e5 + 0.01 * number, dtype=np.float32).astype(float) - 1e8 - 10.0 * number,
        'step': size * (number > 500),
        'cut': np.where(number % 100 < 10, 90.0 * (number % 100), 0.0),
        'paused': size * (number > 500),
    }.get(kind, abs(size) * rng.uniform(-1.0, 1.0, count))
    stamps = even + np.round(1e6 * late).astype(np.int64)
    if kind in {'lost', 'gap'}:
        stamps = even = np.delete(even, 500 if kind == 'lost' else slice(850, 1050))
    read_at = stamps if kind in {'measured', 'paused'} else even
    read_at = np.minimum(read_at, START + round(9.2e9)) if kind == 'gap' else read_at  # the robot stops meanwhile
    found = named(stamps, read(even, 1e-9 * (read_at - START))[1])
    assert list(found) == [symptom] * bool(symptom)
    assert found == named(stamps, read(even, 1e-9 * (read_at - START))[1], pieces=29)
    assert kind != 'step' or all(f'{size:+.2g} ms' in str(each) for each in found.values())


def test_readings_wait_half_as_long_again_as_one_was_late() -> None:
    """From then on, and no longer than the limit; one that is later than that is lost, and makes nothing wait."""
    for late, hold in ((10, 15), (39, 58), (40, 60), (41, 60), (60, 60), (61, 0)):
        reorder = Reorder[JointStream](60)
        for stamp in (100, 200, 200 - late):
            reorder.push(JointStream(np.array([stamp]), np.zeros((1, 1)), np.zeros((1, 1))))
        assert reorder.hold == hold
        released = reorder.push(JointStream(np.array([300]), np.zeros((1, 1)), np.zeros((1, 1))))
        assert (released is None) is (hold > 0)
        if hold:
            reorder.push(JointStream(np.array([299 + hold]), np.zeros((1, 1)), np.zeros((1, 1))))
            later = reorder.push(JointStream(np.array([300 + hold]), np.zeros((1, 1)), np.zeros((1, 1))))
            assert some(later).stamp.tolist() == [300]


def curve(time: Array) -> Array:
    """Return joints on a straight line: interpolation is exact."""
    return np.column_stack((0.3 + 0.2 * time, 1.0 - 0.1 * time))


@pytest.mark.parametrize(('delay', 'rate'), [(0.1, 1.0), (-0.15, 1.0), (0.05, 1.02)])
def test_joints_by_another_clock_are_those_read_then(delay: float, rate: float) -> None:
    """Windows that reach beyond the readings are left out; missing readings stay missing."""
    starts = 0.5 * np.arange(8)
    offsets = KNOTS * (np.arange(14) - joint_window(np.zeros((14, 2)), 0.0).inside.start)
    every = [joint_window(curve(start + offsets), float(start)) for start in starts]
    every[3].knots.joint_position[5] = np.nan
    found = restamped(every, delay, rate)
    assert 4 <= len(found) < 8
    for window in found:
        then = rate * (window.start + offsets) + delay
        lost = np.isnan(window.knots.joint_position).any(axis=1)
        assert np.flatnonzero(lost).tolist() == ([5] if window.start == 1.5 else [])
        assert window.knots.joint_position[~lost] == pytest.approx(curve(then)[~lost], abs=1e-9)
    known = [np.all(rate * (each + offsets) + delay > offsets[0] - 1e-9) for each in starts]
    ends = [np.all(rate * (each + offsets) + delay < 3.5 + offsets[-1] + 1e-9) for each in starts]
    assert [each.start for each in found] == starts[np.array(known) & np.array(ends)].tolist()


def test_delays_that_are_tried_and_how_a_run_takes_each_into_account(unchanged: Unchanged) -> None:
    servicer = kernel('servicer7')
    every = [*joints_stamped_late(servicer)]
    assert len(every) == 20
    offset, drift = time_offset(0.02), clock_drift(5e-5)
    sizes = np.array([0.034]), np.array([0.002])
    repairs = [each.repair('', *sizes, servicer) for each in (offset, drift)]
    unchanged.values(delays=[(each.text, each.delay, each.repair) for each in every], repairs=repairs)
    assert offset.linearisation_value(np.array([1.0]), np.array([0.1])) == pytest.approx([1.0])
    assert offset.linearisation_value(np.array([-1.0]), np.array([2.0])) == pytest.approx([0.0])
    config = TimeOffsetConfig(prior_std=0.03, drift_std=4e-5)
    assert [declared_offset(config).factor[0, 0], declared_drift(config).factor[0, 0]] == [0.03, 4e-5]
    off = TimeOffsetConfig(estimate=False)
    for each in (declared_offset(off), declared_drift(off), declared_offset(config, jointed=False)):
        assert not each.factor.any()
    assert not declared_drift(config, jointed=False).factor.any()


@pytest.mark.parametrize(('value', 'taken'), [(0.031, 0.031), (-0.031, -0.031), (0.029, 0.0), (-0.029, 0.0)])
def test_joints_are_taken_later_by_a_delay_that_is_clearly_one(value: float, taken: float) -> None:
    offset = time_offset(0.05)
    found = offset.linearisation_value(np.array([value]), np.array([0.03 / CLEAR]))
    assert found.tolist() == [taken]
    nominal = NominalModel(kernel('servicer7'), np.zeros(7), np.zeros(6), 0.2)
    assert offset.applied_to(nominal, np.array([value])).delay == pytest.approx(0.2 + value)


@pytest.mark.parametrize(
    ('followed', 'scatter', 'squares', 'alone'),
    [
        (0.0, 1.0, 20.0, True),
        (0.4, 1.0, 80.0, True),
        (0.4, 1.0, 46.0, True),  # of noise without what they follow
        (0.4, 1.0, 43.0, False),
        (0.6, 1.0, 1000.0, False),  # the readings follow more than half of it
        (0.0, 1.0, 15.0, False),  # by chance: sixteen are four deviations
        (0.0, 1.0, 17.0, True),
        (0.0, 2.0, 60.0, False),  # of noise twice as large
        (0.0, 2.0, 70.0, True),
        (0.0, 0.1, 15.0, False),  # declared noise counts at least
    ],
)
def test_stamps_are_uneven_alone_where_the_readings_do_not_follow_them(
    followed: float, scatter: float, squares: float, alone: bool
) -> None:
    """Readings of unit noise: a part of what the stamps would move them by, beside a scatter."""
    stamps, number = UnevenStamps('readings', 1.0), 100.0
    products = followed * squares
    rest = number * scatter**2 + products**2 / squares
    found = stamps._alone(np.array([number, number * 4e-6, squares, products, rest]))
    assert found == (pytest.approx(2e-3) if alone else 0.0)


def test_a_clock_that_is_off_is_estimated_even_where_that_was_forbidden() -> None:
    value, std = np.array([0.02]), np.array([1e-3])
    for unknown, name in ((time_offset(0.01), 'prior_std'), (clock_drift(1e-5), 'drift_std')):
        found = unknown.repair('a clock', value, std, kernel('servicer7'))
        assert {*some(found.parameters)} == {'time_offset.estimate', f'time_offset.{name}'}
        assert some(found.parameters)['time_offset.estimate'] is True
