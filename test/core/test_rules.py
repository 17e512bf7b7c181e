"""Rules of the core on drawn evidence and streams, on both sides of their thresholds, as they were."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from mbaid_ros.core import noise
from mbaid_ros.core.filter.posterior import PriorComparison, VarianceComponents
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.results import verdict
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import standard
from mbaid_ros.core.robot.model import Plane
from mbaid_ros.core.samples import BaseStream, JointStream, Samples
from observed import MID
from unchanged import Unchanged
from windowed import base_stream

BODY = np.array([120.0, 0.3, -0.2, 0.7, 28.0, -3.0, 1.3, 37.0, -1.0, 30.0])
PLANE = Plane(np.array([0.6, 0.0, 0.8]), np.array([[0.0, 1.0, 0.0], [0.8, 0.0, -0.6]]))
BEGIN = 1_700_000_000_000_000_000
DECLARED = np.array([getattr(MID, name) for name in list(vars(MID))[:6]])


def draws(count: int) -> Iterator[tuple[int, np.random.Generator]]:
    return ((seed, np.random.default_rng(seed)) for seed in range(count))


def covariance(rng: np.random.Generator, size: int, least: float = 0.01) -> Array:
    """Return a drawn covariance with eigenvalues from `least` to 1."""
    directions = np.linalg.qr(rng.normal(size=(size, size)))[0]
    return np.asarray(directions * np.exp(rng.uniform(np.log(least), 0.0, size)) @ directions.T)


@pytest.mark.parametrize('time', [0.0, 0.3])
@pytest.mark.parametrize('declared', ['no', 'yes', 'trusted'])
def test_errors_of_a_sensor(declared: str, time: float, unchanged: Unchanged) -> None:
    found: list[object] = []
    for _, rng in draws(30):
        strides, models = np.array([1, 2, 4, 8, 16, 32]) * rng.choice([0.005, 0.02, 0.1]), []
        for _ in range(2):
            kept = strides / rng.choice([1e-6, 0.05, 0.3, 3.0])
            moves = rng.choice([0.0, 1e-6, 1e-3]) * (strides / strides[0]) ** rng.choice([3.0, 6.0])
            level = rng.choice([1.0, 1.1, 1.7, 30.0]) * -np.expm1(-kept) + moves
            counts = np.maximum(rng.choice([40, 300, 3000]) // np.array([[1, 2, 4, 8, 16, 32]] * 2), 1)
            seen = level * np.exp(rng.normal(size=counts.shape) / np.sqrt(0.15 * counts))
            models.append(noise.candidates(noise.DifferenceVariances(seen, counts, strides), time, declared))
        drift = -np.expm1(-16.0 * strides / rng.choice([0.3, 3.0])) * rng.choice([1.0, 3.0], (2, 1))
        drifts = noise.DifferenceVariances(drift, counts * 5 // 2, 16.0 * strides)
        best = noise.likeliest(models[0], models[1], drifts, rng.choice([0.1, 1.0, 10.0], 2))
        rows = [(len(each.time), each.cost.min(), each.level[0], each.contradicted[0]) for each in models]
        found.append([rows, best])
    unchanged.values(found=found)


def drawn_poses(rng: np.random.Generator, count: int, size: float = 1.0, kept: float = 0.0, rate: float = 50.0) -> Any:
    """Return a moving base with errors so many times as large as declared, a part of each kept to the next."""
    base = base_stream(BEGIN + np.round(1e9 / rate * np.arange(count)).astype(np.int64))
    error = size * DECLARED[2:, None, None] * rng.normal(size=(4, count, 3))
    error[:2] = lfilter([np.sqrt(1.0 - kept**2)], [1.0, -kept], error[:2], axis=1)
    pose, turn = base.position + error[0], exp(error[1]) @ base.rotation
    linear, angular = base.linear_velocity + error[2], base.angular_velocity + error[3]
    of_pose, of_twist = (np.tile(each, (count, 1, 1)) for each in (MID.pose_covariance(), MID.twist_covariance()))
    return BaseStream(base.stamp, pose, turn, linear, angular, of_pose, of_twist)


def drawn_joints(rng: np.random.Generator, stamps: Any, size: float = 1.0, count: int = 3) -> JointStream:
    angle = 1e-9 * (stamps - stamps[0])[:, None] * rng.uniform(0.2, 0.6, count) + rng.uniform(0.0, 6.0, count)
    errors = size * DECLARED[:2, None, None] * rng.normal(size=(2, *angle.shape))
    return JointStream(stamps, 0.4 * np.sin(angle) + errors[0], 0.2 * np.cos(angle) + errors[1])


def samples(joint: JointStream, base: BaseStream) -> Samples:
    values: Any = [getattr(base, each) for each in list(BaseStream.__dataclass_fields__)[1:7]]
    made = Samples((joint.stamp - BEGIN) * 1e-9, joint.position, joint.velocity, *values)
    return replace(made, apart=np.full(len(made), 0.02))


@pytest.mark.parametrize('kept', [0.0, 0.95])
@pytest.mark.parametrize('given', ['declared', 'estimated', 'trusted', 'undeclared', 'poses alone'])
def test_noise_of_a_run(given: str, kept: float, unchanged: Unchanged) -> None:
    found: list[object] = []
    for (_, rng), size in zip(draws(2), (1.0, 6.0), strict=True):
        base = drawn_poses(rng, 800, size, kept)
        joint, undeclared = drawn_joints(rng, base.stamp, size), given == 'undeclared'
        base = replace(base, declared=np.full((800, 4), not undeclared) | (np.arange(800) > 500)[:, None])
        flags = {'estimate': given == 'estimated', 'trusted': given == 'trusted'}
        estimator = noise.NoiseEstimator(MID, 3, np.full(6, undeclared), passive=[1], **flags)
        if given == 'poses alone':
            base = replace(base, angular_velocity=np.full((800, 3), np.nan))
        for begin in range(0, 800, 50):
            part = slice(begin, begin + 50)
            estimator.add_readings(joint[part], base[part])
            made = estimator.windows_with_noise([samples(joint[part], base[part])], BEGIN, last=begin == 750)
            for window, levels in made[:1] if begin % 150 == 0 else ():
                covariances = [np.diag(each[3])[[0, 4]] for each in (window.pose_covariance, window.twist_covariance)]
                texts = [levels.warnings, levels.rows(), levels.differences()]
                found.append([window.time[0], covariances, window.noise[-1], levels, ''.join(map(str, texts))])
    unchanged.values(found=found)


def test_what_is_published_of_a_solution(unchanged: Unchanged) -> None:
    reporting = verdict.Reporting(np.repeat([600.0, 1800.0, 5400.0], (1, 3, 6)), 0.5, 0.01, 2.0)
    found = dict[str, object]()
    for seed, rng in draws(30):
        body = BODY * rng.uniform(0.5, 1.5, 10)
        body[4] *= 0.2 if seed % 3 == 0 else 1.0  # of no real body
        size = np.concatenate((np.abs(standard(BODY)), np.ones(6)))
        root = size[:, None] * np.linalg.cholesky(covariance(rng, 16, 1e-3)) * rng.choice([0.003, 0.03, 0.1, 0.3])
        own = root @ root.T
        shifts = rng.normal(size=(2, 10)) @ root[:10, :10].T * rng.choice([0.1, 0.6])
        bent = verdict.Nonlinearity(shifts, own[:10, :10], covariances=own[:10, :10] * rng.uniform(0.7, 1.6, (2, 1, 1)))
        x, wider = np.concatenate((standard(body), rng.normal(size=6))), own * rng.uniform(1.0, 1.5)
        fit = 600.0 * rng.choice([1.0, 3.0, 5.0]), int(rng.choice([10, 600])), rng.normal(size=3)
        plane, bends = (PLANE if seed % 5 == 1 else None), (bent,) * (seed % 2)
        made = verdict.Solution(x, own, wider, *fit, plane, bends)
        estimate = reporting.estimate(made, Estimate('trajectory', 'waiting'))
        judged = verdict.imprecise(estimate, 0.02), bent.is_nonlinear, estimate.consistency_correction
        found[f'{seed}'] = [estimate.status, estimate.warnings, estimate.parameters, estimate.std, judged]
    unchanged.values(**found)


def test_priors_that_are_too_narrow(unchanged: Unchanged) -> None:
    causes = ('zero:a', 'zero:b', 'axis:a', 'axis:a', 'mount', 'mount', 'mount', *('link:l',) * 4, *('link:m',) * 4)
    parts = ('',) * 7 + ('mass:l', '', '', '', 'mass:m', '', '', '')
    count, along, found = len(causes), np.repeat([0.0, 0.5, 0.0], (7, 4, 4)), dict[str, object]()
    for seed, rng in draws(25):
        posterior = covariance(rng, count)
        values = np.linalg.cholesky(np.eye(count) * (1.0 + 1e-9) - posterior) @ rng.normal(size=count)
        values *= np.repeat(rng.choice([1.0, 3.0, 6.0], 5), (2, 2, 3, 4, 4))
        moved = rng.normal(size=(2, count)) * rng.choice([0.05, 0.4])
        numbers = PriorComparison.from_posterior(values[7:11], posterior[7:11, 7:11], moved[:, 7:11])
        made = VarianceComponents.from_posterior(values, posterior, causes, parts, moved, {'density:l': along})
        found[f'{seed}'] = [made.scales, made.distances, made.factors, made.likeliest, made.significant]
        found[f'{seed} alone'] = [
            numbers.gain(30.0),
            numbers.gain(1e4),
            numbers.distances,
            numbers.likely_scales(0.05, 0.1),
        ]
        if not made.as_declared:
            found[f'{seed} columns'] = made.added_columns(1.0 + np.arange(count)[:, None]).ravel()
    unchanged.values(**found)
