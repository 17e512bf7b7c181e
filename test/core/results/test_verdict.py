"""The evidence of innovations against their distribution on white noise, and the verdict that a run gets by it."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.innovations import BASE_SENSORS, Innovations, widening
from mbaid_ros.core.results.verdict import Distance, Evidence, Verdict, judge

SOURCES = tuple(name for name in (*BASE_SENSORS, 'imu') for _ in range(3))  # in space
NUMBERS = len(SOURCES)
ALL = np.arange(NUMBERS)


def followed(normalised: Array) -> Innovations:
    """Return the sums over windows' innovations (W, 15), NaN where not measured, as a filter hands them over."""
    found = Innovations.none(SOURCES)
    for row in normalised:
        measured = np.flatnonzero(np.isfinite(row))[::-1]  # in any order
        found = found.with_window(row[measured], measured)
    return found


def autoregressive(rng: np.random.Generator, count: int, correlation: Array | float) -> Array:
    """Return a series (W, 15) of unit variance in which neighbours correlate."""
    kept = np.broadcast_to(correlation, NUMBERS)
    rows = [rng.normal(size=NUMBERS)]
    for _ in range(count - 1):
        rows.append(kept * rows[-1] + np.sqrt(1.0 - kept**2) * rng.normal(size=NUMBERS))
    return np.array(rows)


def judged(innovations: Innovations, nis: float = 1.0, **changes: object) -> Verdict:
    """Return the verdict on a run with these innovations and nothing else against it, but for some changes."""
    plain: dict[str, object] = {
        'distances': {},
        'jumps': 0,
        'unconfirmed': (),
        'hypothesis': '',
        'physical': True,
        'gain': 0.0,
        'instead': ('', 0.0),
    }
    return judge(Evidence(nis, innovations, **(plain | changes)))  # type: ignore[arg-type]


def summed(ratio: float, correlation: float, count: float = 500.0) -> Innovations:
    """Return the sums over so many windows with exactly this mean square and this product of neighbours."""
    numbers = np.ones(NUMBERS)
    return Innovations(
        SOURCES, count * np.array([ratio * numbers, correlation * numbers]), count * np.ones((2, NUMBERS)), numbers
    )


@pytest.mark.parametrize(('times', 'deviation'), [(1.0, 1.0), (2.0, 1.0), (0.5, 0.25)])
def test_significances_of_white_noise_have_unit_variance(times: float, deviation: float) -> None:
    """That of the correlation also of larger noise than declared; of smaller noise it is so much less significant."""
    rng = np.random.default_rng(0)
    ratios, correlations = [], []
    for _ in range(300):
        series = times * rng.normal(size=(600, NUMBERS))
        sums = np.array([(series**2).sum(axis=0), (series[1:] * series[:-1]).sum(axis=0)])
        found = Innovations(SOURCES, sums, np.repeat([[600.0], [599.0]], NUMBERS, axis=1), series[-1])
        ratios.append(found.ratio_significance)
        correlations.append(found.correlation_significance)
    # Of 1500 numbers a standard deviation is known to 1.8 %.
    assert np.std(correlations) == pytest.approx(deviation, rel=0.06)
    assert np.mean(correlations) == pytest.approx(0.0, abs=0.1)
    assert times != 1.0 or np.std(ratios) == pytest.approx(1.0, rel=0.06)
    assert times != 1.0 or np.mean(ratios) == pytest.approx(0.0, abs=0.1)


def test_each_sensor_has_its_own_ratio_and_correlation() -> None:
    """Orientation and position, angular and linear velocity, gyro: in this order, three numbers of each."""
    sizes, kept = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([0.0, 0.2, 0.4, 0.6, 0.8])
    rng = np.random.default_rng(1)
    found = followed(np.repeat(sizes, 3) * autoregressive(rng, 3000, np.repeat(kept, 3)))
    assert found.count == pytest.approx(np.full(5, 9000.0))
    assert found.pairs == pytest.approx(np.full(5, 8997.0))
    assert found.ratio == pytest.approx(sizes**2, rel=0.1)
    assert found.correlation == pytest.approx(kept * sizes**2, rel=0.1, abs=0.1)


def test_only_neighbouring_windows_that_both_measure_a_number_count_as_a_pair() -> None:
    nan = np.nan
    rows = np.full((4, NUMBERS), nan)
    rows[:, 0] = 1.0, 2.0, nan, 4.0
    rows[:, 3] = nan, 5.0, 6.0, 7.0
    found = followed(rows)
    assert found.count[:2] == pytest.approx([3.0, 3.0])
    assert found.pairs[:2] == pytest.approx([1.0, 2.0])
    assert found.correlation[:2] == pytest.approx([2.0, (30.0 + 42.0) / 2.0])
    assert np.isnan(found.ratio[2:]).all()
    assert np.isnan(found.correlation[2:]).all()


def test_a_plane_has_one_angle_and_two_positions() -> None:
    nothing = Innovations.none(tuple(np.repeat((*BASE_SENSORS, 'imu'), (1, 2, 1, 2, 1)).tolist()))
    found = nothing.with_window(np.array([1.0, 2.0, 2.0, 3.0, 4.0, 4.0, 5.0]), np.arange(7))
    assert found.ratio == pytest.approx([1.0, 4.0, 9.0, 16.0, 25.0])
    assert found.count.tolist() == [1, 2, 1, 2, 1]


def test_correlated_neighbours_are_a_reason_a_cause_and_widen_the_intervals() -> None:
    rng = np.random.default_rng(2)
    white, coloured = followed(autoregressive(rng, 400, 0.0)), followed(autoregressive(rng, 400, 0.5))
    assert judged(white).adequate
    assert judged(white).causes == ()
    assert judged(white).widening == 1.0
    verdict = judged(coloured)
    assert coloured.correlation == pytest.approx(np.full(5, 0.5), abs=0.1)
    assert any('neighbouring windows are correlated' in reason for reason in verdict.reasons)
    assert sum('correlated over more than a window' in cause.text for cause in verdict.causes) == 5


@pytest.mark.parametrize(
    ('correlation', 'nis', 'factor'),
    [(0.0, 1.0, 1.0), (0.5, 1.0, 3.0), (0.8, 1.0, 9.0), (0.5, 1.4, 4.2), (0.0, 0.5, 1.0), (5.0, 1.0, 19.0)],
)
def test_variances_grow_by_correlation_and_size_of_the_innovations(
    correlation: float, nis: float, factor: float
) -> None:
    """By (1 + r) / (1 - r), as those of a mean of numbers that correlate by r^k; by .9 at most."""
    assert widening(summed(max(nis, 1.0), correlation), nis) == pytest.approx(factor)


def test_a_correlation_by_chance_widens_nothing() -> None:
    count = 12.0  # windows, of three numbers of each sensor
    assert widening(summed(1.0, 2.5 / 6.0, count), 1.0) == 1.0
    assert widening(summed(1.0, 3.5 / 6.0, count), 1.0) > 3.0


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'nis': 1.4}, ''),
        ({'nis': 1.6}, 'innovations 1.3 times the noise, 0 jumps'),
        ({'jumps': 3}, ''),
        ({'jumps': 4}, 'innovations 1.0 times the noise, 4 jumps'),
        ({'unconfirmed': (2.0, 3.5)}, 'seems to jump at 2.0, 3.5 s'),
        ({'hypothesis': 'drift', 'physical': False}, 'drift: a random walk fits any data'),
        ({'hypothesis': 'leak', 'gain': 20.0, 'instead': ('link a', 30.0)}, 'leak, or link a is set too'),
        ({'hypothesis': 'leak', 'gain': 30.0, 'instead': ('link a', 20.0)}, ''),
        ({'instead': ('link a', 20.0)}, ''),
        ({'distances': {'link a': Distance(60.0, 50.0, 3)}}, 'more than specified: link a'),
        ({'distances': {'link a': Distance(60.0, 15.0, 3)}}, ''),  # likely if twice as far off
        ({'distances': {'link a': Distance(30.0, 29.0, 3)}}, ''),  # once in a million
        ({'distances': {'link a': Distance(60.0, 50.0, 0)}}, ''),
    ],
)
def test_each_evidence_has_its_reason(changes: dict[str, object], reason: str) -> None:
    verdict = judged(summed(1.0, 0.0), **{'nis': 1.0} | changes)  # type: ignore[arg-type]
    assert verdict.adequate is not bool(reason)
    assert len(verdict.reasons) == bool(reason)
    assert reason in ''.join(verdict.reasons)


@pytest.mark.parametrize(
    ('ratio', 'correlation', 'count', 'reason'),
    [
        (2.0, 0.0, 500.0, 'the noise of a sensor is not as specified'),
        (2.0, 0.0, 20.0, ''),  # 5.5 standard deviations of sixty numbers
        (1.3, 0.0, 500.0, ''),  # certain, and too little to matter
        (1.0, 0.3, 500.0, 'the innovations of neighbouring windows are correlated'),
        (1.0, 0.3, 100.0, ''),  # 5.2 standard deviations of 300 pairs
        (1.0, 0.2, 5000.0, ''),  # certain, and too little to matter
        (1.0, -0.5, 5000.0, ''),
    ],
)
def test_a_deviation_of_the_innovations_is_a_reason_if_large_and_certain(
    ratio: float, correlation: float, count: float, reason: str
) -> None:
    verdict = judged(summed(ratio, correlation, count))
    assert len(verdict.reasons) == bool(reason)
    assert reason in ''.join(verdict.reasons)


def test_causes_stand_by_their_gain_and_a_walk_last() -> None:
    def names(hypothesis: str, *, physical: bool) -> list[str]:
        distances = {'far': Distance(80.0, 60.0, 3), 'near': Distance(40.0, 30.0, 3), 'no': Distance(20.0, 9.0, 3)}
        changes = {'hypothesis': hypothesis, 'gain': 30.0, 'physical': physical, 'distances': distances}
        return [cause.text.split()[0] for cause in judged(summed(1.0, 0.0), **changes).causes]  # type: ignore[arg-type]

    assert names('leak', physical=True) == ['far', 'leak', 'near']
    assert names('drift', physical=False) == ['far', 'near', 'drift']
    assert names('', physical=True) == ['far', 'near']


def test_a_noisier_sensor_is_a_cause_that_gains_what_its_variance_explains() -> None:
    series = np.tile([1.0, -1.0], (1, 1000)).T * np.where(np.isin(ALL, [3, 4, 5]), 2.0, 1.0)
    series[::4] *= -1.0  # neighbours agree as often as not
    series[3::4] *= -1.0
    found = followed(series)
    verdict = judged(found)
    assert verdict.reasons == ('the noise of a sensor is not as specified',)
    (cause,) = verdict.causes
    assert cause.text == 'noise.base_position is 2.0 times too small, or the model is wrong'
    # Of n numbers with four times the variance: n / 2 (4 - 1 - log 4).
    assert cause.gain == pytest.approx(0.5 * 6000.0 * (3.0 - np.log(4.0)))
