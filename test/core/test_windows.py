"""Which windows a run of knots gives where samples are missing: a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import generic
from mbaid_ros.core.contracts import NominalModel, Stack
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.windows import (
    Averaged,
    KnotAveraging,
    Knots,
    Window,
    _halves,
    _with_course,
    knots_per_window,
    midpoints,
)
from observed import MID, configured_motion, kernel, observe, windows
from windowed import joint_window

FIRST, ALONE, LATER, LAST = (14, 0, 10), (10, 0, 9), (17, 3, 13), (13, 3, 12)  # knots, own intervals from and to
Made = tuple[float, float, tuple[int, int, int]]  # start, gap (s), shape


@pytest.fixture(scope='module')
def samples() -> Samples:
    """Return 4 s of two samples a knot."""
    return observe(configured_motion('table1', 4.0, 40.0), MID, 1)


def averaged(samples: Samples, begin: float = 0.0, end: float = 0.0, at_once: int = 100) -> list[Averaged]:
    """Return what comes of windows of 0.5 s, those of half a second's ten knots, without the samples of some time."""
    kept = (samples.time < begin - 1e-9) | (samples.time > end - 1e-9)
    pieces, averaging = windows(samples[np.flatnonzero(kept)]), KnotAveraging(MID, 0.5)
    return [
        each for place in range(0, len(pieces), at_once) for each in averaging.average(pieces[place : place + at_once])
    ]


def made(window: Window | None) -> Made | None:
    if window is None:
        return None
    assert window.after_gap == (window.inside.start == 0)
    assert np.all(np.isfinite(window.knots.base_position))
    return window.start, window.gap, window.shape


WHOLE = [(0.5 * place, 0.0, LATER if place else FIRST) for place in range(7)]


@pytest.mark.parametrize('at_once', [100, 1, 3])
@pytest.mark.parametrize(
    ('begin', 'end', 'ready'),
    [
        (0.0, 0.0, WHOLE),
        (1.6, 1.65, WHOLE),  # one knot is bridged, also at a limit of windows
        (2.0, 2.05, WHOLE),
        (1.95, 2.0, WHOLE),
        (1.6, 1.75, [*WHOLE[:2], (2.0, 1.0, FIRST), *WHOLE[5:]]),  # several are a gap, of at least a window
        (1.9, 2.0, [*WHOLE[:2], (2.0, 1.0, FIRST), *WHOLE[5:]]),
        (1.95, 2.05, [*WHOLE[:3], (2.5, 1.0, FIRST), *WHOLE[6:]]),
        (2.0, 2.5, [*WHOLE[:3], (2.5, 1.0, FIRST), *WHOLE[6:]]),
    ],
)
def test_windows_around_missing_samples(
    samples: Samples, begin: float, end: float, at_once: int, ready: list[Made]
) -> None:
    found = averaged(samples, begin, end, at_once)
    assert [each for window in found if (each := made(window.ready))] == ready


def test_the_latest_window_is_there_without_its_successor(samples: Samples) -> None:
    """Without its last interval, and not where its last knot is missing."""
    whole = [made(each.still_open) for each in averaged(samples)]
    assert whole == [(0.5 * place, 0.0, LAST if place else ALONE) for place in range(8)]
    without_end = [made(each.still_open) for each in averaged(samples, 1.95, 2.0)]
    assert without_end == [*whole[:3], None, *whole[4:]]
    without_outer = averaged(samples, 1.85, 1.9)  # neighbours bridge a knot: there are none at an outer end
    assert [made(each.still_open) for each in without_outer] == [*whole[:4], (2.0, 0.0, (12, 2, 11)), *whole[5:]]
    assert made(without_outer[5].ready) == (2.0, 0.0, (16, 2, 12))
    assert made(averaged(samples, 2.15, 2.2)[4].ready) == (1.5, 0.0, (16, 3, 13))
    after_gap = [made(each.still_open) for each in averaged(samples, 1.95, 2.05)]
    assert after_gap == [*whole[:3], None, None, (2.5, 1.0, ALONE), *whole[6:]]


@pytest.mark.parametrize('at_once', [100, 1, 3])
@pytest.mark.parametrize(
    ('jump', 'ready'),
    [
        (1.72, [*WHOLE[:2], (2.0, 1.0, FIRST), *WHOLE[5:]]),  # within a window, which is left out
        (2.0, [*WHOLE[:3], (2.0, 0.5, FIRST), *WHOLE[5:]]),  # between two
        (0.2, [(0.5, 0.0, FIRST), *WHOLE[2:]]),  # within the first: nothing goes on from before it
    ],
)
def test_windows_begin_anew_after_poses_that_jump(
    samples: Samples, jump: float, at_once: int, ready: list[Made]
) -> None:
    frame = np.where(samples.time[:, None] >= jump - 1e-9, [4e-8, 9e-6], 0.0)
    found = [each.ready for each in averaged(replace(samples, frame=frame), at_once=at_once)]
    assert [each for window in found if (each := made(window))] == ready
    for window in found:
        moved = window is not None and window.gap > 0.0
        np.testing.assert_array_equal(np.zeros(2) if window is None else window.frame, [4e-8 * moved, 9e-6 * moved])


def test_a_joint_has_moved_once_it_leaves_its_noise(samples: Samples) -> None:
    """By ten standard deviations: before, windows of a robot at rest go by without a solution."""
    still = replace(samples, joint_position=np.tile(samples.joint_position[:1], (len(samples), 1)))
    assert not any(each.joints_moved for each in averaged(still))
    step = np.where(samples.time >= 2.0, 1.0, 0.0)[:, None]
    for size, moved in ((9.0, False), (11.0, True)):
        stepped = replace(still, joint_position=still.joint_position + size * MID.joint_position * step)
        assert [each.joints_moved for each in averaged(stepped)] == [False] * 4 + [moved] * 4


@pytest.mark.parametrize(
    ('rate', 'wanted', 'alike', 'count'),
    [
        (100.0, 0.05, False, 10),
        (100.0, 0.06, False, 8),
        (100.0, 0.06, True, 10),  # 50 samples: as many in each
        (13.0, 0.05, False, 6),  # no more knots than samples
        (4.0, 0.05, False, 5),  # and no fewer than the formulas need
    ],
)
def test_knots_of_a_window(samples: Samples, rate: float, wanted: float, *, alike: bool, count: int) -> None:
    time: Array = np.arange(0.0, 0.5 - 1e-9, 1.0 / rate)
    window = replace(samples[: len(time)], time=time)
    assert knots_per_window(window, 0.5, wanted, alike=alike) == count


@pytest.mark.parametrize(('fastest', 'knots'), [(0.0, 10), (1.0, 10), (2.4, 20), (400.0, 20)])
def test_a_spring_has_ten_knots_a_period_with_as_many_samples_each(
    samples: Samples, fastest: float, knots: int
) -> None:
    """Of 20 samples: 12 knots would do, but not all alike; without a spring they may differ."""
    averaging = KnotAveraging(MID, 0.5, fastest=fastest)
    averaging.average(windows(samples)[:1])
    assert averaging._knots_per_window == knots
    slower = replace(samples[:18], time=np.arange(18) / 36.0)  # 18 samples a window
    averaging = KnotAveraging(MID, 0.5, fastest=fastest)
    averaging.average([slower])
    assert averaging._knots_per_window == (18 if fastest else 10)


def test_readings_of_a_window_are_summed_by_the_halves_of_its_knots() -> None:
    """A sample at a border, but for rounding, is in the half that begins there; none is outside of the window."""
    times = np.array([0.0, 0.0499, 0.05 - 1e-12, 0.1, 0.1499, 0.2, 0.3, -1e-3, 0.31])
    readings = np.outer(2.0 ** np.arange(len(times)), [1.0, -1.0])
    begin = np.array([0, 0, 0, 0, 0, 2, 2, 0, 2])
    found = _halves(readings, np.where(begin, times - 0.2, times), begin, 0.1, 3)
    assert found[:, :, 0].tolist() == [[1.0 + 2.0 + 128.0, 4.0], [8.0 + 16.0, 0.0], [32.0, 64.0 + 256.0]]
    assert np.array_equal(found[:, :, 1], -found[:, :, 0])
    assert _halves(np.zeros((9, 0)), times, begin, 0.1, 3).shape == (3, 2, 0)


def test_errors_of_a_gyro_turn_an_orientation_that_follows_it_alone() -> None:
    """By the integral of their part in its rate, in the axes of the odometry, up to the middle of each knot."""
    count, spacing, rng = 12, 0.05, np.random.default_rng(4)
    rotation, angle = exp(rng.normal(size=(count, 3))), rng.normal(size=(count, 3))
    shapes = (1,), (3, 3), (3,), (6,), (), (), (6,), (0,), (0,), (0,), (5,), (36,)
    still = Knots(*(np.zeros((count, *shape)) for shape in shapes))
    knots = replace(still, base_rotation=rotation, further=np.hstack((angle, np.ones((count, 2)))))
    bias, scale, turn, shared = errors = generic(5, 4, 3)
    begin = generic(6, 36)
    followed, end = _with_course(knots, spacing, begin)
    rate = np.gradient(angle, spacing, axis=0)
    x, y, z = rate.T
    # A cross axis error of one number for two axes: each reads as much of the other.
    crossing = np.stack((shared[2] * y + shared[1] * z, shared[2] * x + shared[0] * z, shared[1] * x + shared[0] * y))
    added = bias + scale * rate + np.cross(rate, turn) + crossing.T
    steps = spacing * np.einsum('nij,nj->ni', rotation, added)
    before = begin.reshape(3, 12) @ errors.ravel()
    middle = before + np.cumsum(steps, axis=0) - 0.5 * steps
    assert followed.attitude_sensitivity.reshape(count, 3, 12) @ errors.ravel() == pytest.approx(middle)
    assert end.reshape(3, 12) @ errors.ravel() == pytest.approx(before + np.sum(steps, axis=0))


def test_an_orientation_by_a_gyro_alone_and_its_rate_are_corrected_by_the_errors_of_the_gyro() -> None:
    """Those of its rate depend on the rate itself, in its axes: that of the corrected orientation."""
    count, errors = 17, generic(7, 12)
    window, angle = joint_window(np.zeros((count, 1)), 0.0), 0.1 * np.arange(count)[:, None]
    true = exp(angle * [0.5, -0.4, 0.3]) @ exp(angle**2 * [0.2, 0.3, -0.1])
    away, further = 0.1 * generic(8, count, 3, 12), np.hstack((np.sin(generic(9, 3) * angle), angle))
    read, turned = (exp(sign * (away @ errors)) for sign in (1.0, -1.0))
    assert turned @ (read @ true) == pytest.approx(true)
    knots = replace(window.knots, base_rotation=read @ true, further=further)
    knots = replace(knots, attitude_sensitivity=away.reshape(count, 36))
    stack = Stack((replace(window, knots=knots),), (0,))
    nominal = replace(NominalModel.nominal(kernel('table1')), gyro=errors)
    found, own = stack.motion(nominal)
    inside = slice(window.inside.start - 1, window.inside.stop + 1)
    expected = midpoints(replace(knots, base_rotation=true), window.spacing)[inside]
    assert found.base_rotation[:, 0] == pytest.approx(expected.base_rotation)
    assert found.turn[:, 0] == pytest.approx(expected.turn)
    rate = np.einsum('nji,nj->ni', expected.base_rotation, expected.turn) / window.spacing
    bias, scale, turn, (a, b, c) = errors.reshape(4, 3)
    x, y, z = rate.T
    wrong = bias + scale * rate + np.cross(rate, turn) + np.stack((c * y + b * z, c * x + a * z, b * x + a * y), axis=1)
    assert found.further[:, 0, :3] == pytest.approx(expected.further[:, :3] - wrong)
    assert found.further[:, 0, 3:] == pytest.approx(expected.further[:, 3:])
    assert own == slice(1, 1 + window.inside.stop - window.inside.start)
