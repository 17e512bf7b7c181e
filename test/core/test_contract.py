"""What every method of identification keeps, on the paper's planar case: one suite over all of them."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import BuiltinFunctionType, FunctionType, ModuleType

import numpy as np
import pytest
from scipy.stats import chi2

from checked import same
from floating import make
from mbaid_ros.core.geometry import exp
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import Samples
from mbaid_ros.session import methods
from mbaid_ros.simulation.simulation import Truth
from observed import LOW, MID, configured_motion, estimator, kernel, nees, observe, true_body, windows
from unchanged import Unchanged

SECONDS, RATE = 16.0, 50.0
IN_PLANE = [0, 1, 2, 9]  # m, x_c, y_c, Izz
MOMENTUM = 4597.634  # N m s
ROBOT = kernel('table1')
TRUE = true_body(ROBOT)
WAYS: dict[str, dict[str, object]] = {'difference': {}, 'two stages': {'method': 'trajectory'}}
MAKE: dict[str, Callable[[], Estimator]] = {
    'paper main': lambda: estimator(
        ROBOT, LOW, method='paper_main', paper__total_angular_momentum=[0.0, 0.0, MOMENTUM]
    ),
    'paper difference': lambda: estimator(ROBOT, LOW, method='paper_difference'),
    'difference': lambda: estimator(ROBOT, LOW, **WAYS['difference']),
    'trajectory filter': lambda: make(ROBOT, LOW),
    'two stages': lambda: estimator(ROBOT, LOW, **WAYS['two stages']),
}
RECURSIVE = {'paper main', 'paper difference'}  # which know no noise, and no covariance
every_method = pytest.mark.parametrize('method', MAKE)
weighted = pytest.mark.parametrize('method', [name for name in MAKE if name not in RECURSIVE])
# Both stages have the contract each: what holds for the one and the other is tried with both among the long tests.
each_stage = pytest.mark.parametrize(
    'method', ['difference', 'trajectory filter', pytest.param('two stages', marks=pytest.mark.long)]
)


@pytest.fixture(autouse=True)
def few_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let so short a motion have windows that are marginalised, or linearised no more."""
    monkeypatch.setattr(methods, '_SOLVED_WINDOWS', 10)
    monkeypatch.setattr(methods, '_RELINEARISED_WINDOWS', 12)


@cache
def motion() -> Truth:
    return configured_motion('table1', SECONDS, RATE)


def seen(method: str, seed: int = 1) -> Samples:
    return observe(motion(), LOW, None if method in RECURSIVE else seed)


def locked(samples: Samples) -> Samples:
    """Return samples of a base that turns evenly about its normal, its joints locked: noise is all that they show."""
    count, turn = len(samples), 0.03 * np.array([0.0, 0.0, 1.0])
    noise, none = 1e-5 * np.random.default_rng(1).normal(size=(count, 4)), np.zeros((count, 3))
    return replace(
        samples,
        joint_position=samples.joint_position[:1] + noise,
        joint_velocity=noise,
        base_position=none,
        base_rotation=exp(samples.time[:, None] * turn),
        base_linear_velocity=none,
        base_angular_velocity=none + turn,
    )


def held(method: object) -> int:
    """Return the bytes of all arrays that an object holds."""
    stack, found, size = [method], set[int](), 0
    while stack:
        thing = stack.pop()
        if id(thing) in found or isinstance(thing, type | ModuleType | FunctionType | BuiltinFunctionType):
            continue
        found.add(id(thing))
        if isinstance(thing, np.ndarray):
            size += thing.nbytes
        else:
            stack += gc.get_referents(thing)
    return size


@cache
def followed(method: str) -> list[Estimate]:
    """Return the estimates of windows one by one, with work done in between."""
    made, estimates = MAKE[method](), []
    for number, window in enumerate(windows(seen(method))):
        estimates += made.update([window], 0)
        # What is put off is done in between, all of it or some, or at the next window.
        for _ in range(number % 3 * 2):
            made.tasks.run_slice()
    return estimates


@every_method
def test_windows_together_are_windows_one_by_one_and_stay_as_they_are(method: str) -> None:
    cut, before = windows(seen(method)), windows(seen(method))
    together, one_by_one = MAKE[method]().update(cut, 0), followed(method)
    assert same(together, one_by_one)
    assert same(cut, before)


@each_stage
def test_memory_is_bounded(method: str, spatial_minute: Truth) -> None:
    """Most is held after 80 windows: so many serve to isolate a fault."""
    servicer = kernel('servicer7')
    made = make(servicer, MID, kept=12) if method == 'trajectory filter' else estimator(servicer, MID, **WAYS[method])
    sizes = []
    for window in windows(observe(spatial_minute, MID, 2)):
        made.update([window], 0)
        sizes.append(held(made))
    assert max(sizes[-15:]) <= 1.1 * max(sizes[80:95])


@every_method
def test_a_plane_shows_four_parameters(method: str, unchanged: Unchanged) -> None:
    for estimate in followed(method):
        assert set(np.flatnonzero(estimate.identifiable)) <= set(IN_PLANE)
        assert np.array_equal(np.isfinite(estimate.parameters), estimate.identifiable)
        if method in RECURSIVE:  # a parameter is published once a fiftieth of the start is left
            assert np.all(np.abs(estimate.parameters / TRUE - 1.0)[estimate.identifiable] < 0.1)
    last = unchanged.course(followed(method))
    assert last.status in {'estimating', 'converged'}
    assert np.flatnonzero(last.identifiable).tolist() == IN_PLANE
    assert not last.events
    error = (last.parameters - TRUE)[IN_PLANE]
    assert np.all(np.abs(error) < (0.01 * np.abs(TRUE) if method in RECURSIVE else 4.0 * last.std)[IN_PLANE])
    assert all('planar' in warning or 'first estimate' in warning for warning in last.warnings)


@each_stage
def test_exact_data_give_the_exact_body(method: str) -> None:
    last = MAKE[method]().update(windows(observe(motion(), LOW)), 0)[-1]
    assert np.all(np.abs(last.parameters - TRUE)[IN_PLANE] < 0.1 * last.std[IN_PLANE])


@weighted
def test_errors_are_as_large_as_the_covariance_says(method: str, unchanged: Unchanged) -> None:
    last = unchanged.course(followed(method))
    assert last.residual == pytest.approx(1.0, abs=0.25)
    assert nees(last, TRUE) < 1.25 * chi2.isf(1e-3, 4)
    assert abs(last.momentum[5] - MOMENTUM) < 4.5 * np.sqrt(last.momentum_covariance[5, 5])


@weighted
def test_locked_joints_and_a_single_sample_tell_nothing(method: str) -> None:
    resting = locked(seen(method)[:400])
    for given in (windows(resting), [resting[:1]]):
        estimates = MAKE[method]().update(given, 0)
        assert {each.status for each in estimates} <= {'not_identifiable', 'waiting'}
        assert all(np.isnan(each.parameters).all() for each in estimates)


@pytest.mark.parametrize('method', ['paper main', 'paper difference', 'difference'])
def test_the_origin_of_the_odometry_does_not_count(method: str) -> None:
    samples, shift = seen(method), np.array([1000.0, -500.0, 200.0])
    moved = replace(samples, base_position=samples.base_position + shift)
    here, there = followed(method)[-1], MAKE[method]().update(windows(moved), 0)[-1]
    size = np.abs(TRUE) if method in RECURSIVE else here.std
    np.testing.assert_allclose(there.parameters / size, here.parameters / size, rtol=0.0, atol=1e-4)


def test_a_filter_that_is_restarted_waits_and_finds_the_body_again(spatial: Truth) -> None:
    servicer = kernel('servicer7')
    made, cut = make(servicer, MID), windows(observe(spatial, MID, 2))
    made.update(cut[:16], 0)
    made.restart()
    after = made.update(cut[16:], 0)
    assert after[0].status == 'waiting'
    assert nees(after[-1], true_body(servicer)) < chi2.isf(1e-3, 10)
