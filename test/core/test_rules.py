"""Rules of the core on drawn evidence and streams, on both sides of their thresholds, as they were."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from mbaid_ros.core import noise, outliers
from mbaid_ros.core.diagnosis.isolation import CandidateCause, IsolationResult, likeliest_kinds, ranked
from mbaid_ros.core.filter.posterior import End, PriorComparison, VarianceComponents
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.joints.stream import TurnCounter, joint_channels
from mbaid_ros.core.odometry import faults
from mbaid_ros.core.odometry.stream import POSE
from mbaid_ros.core.results import verdict
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.innovations import BASE_SENSORS, Innovations, widening
from mbaid_ros.core.robot.body import standard
from mbaid_ros.core.robot.model import Plane, PlaneDetector
from mbaid_ros.core.samples import BaseStream, JointStream, Samples
from observed import MID
from simulated import robot
from unchanged import Unchanged
from windowed import base_stream

BODY = np.array([120.0, 0.3, -0.2, 0.7, 28.0, -3.0, 1.3, 37.0, -1.0, 30.0])
SOURCES = (*np.repeat(BASE_SENSORS, 3).tolist(), 'imu', 'imu', 'poses.mocap')
MOCAP = {'poses.mocap.position_std': 2e-3, 'poses.mocap.orientation_std': 0.0}
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
        estimator = noise.NoiseEstimator(MID, 3, np.full(6, undeclared), unread=[1], **flags)
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


def test_readings_that_are_far(unchanged: Unchanged) -> None:
    found: list[object] = []
    for seed, rng in draws(16):
        base = drawn_poses(rng, 300, rng.choice([0.3, 1.0, 4.0]), rate=rng.choice([4.0, 20.0, 100.0]))
        gaps = np.cumsum(rng.choice([0, 400_000_000], 300, p=[0.98, 0.02])) + np.arange(300) % 2 * 2_000_000
        wrong = np.zeros((300, 1))
        for place in rng.choice(300, 6, replace=False):
            wrong[place : place + rng.choice([1, 1, 2, 3, 5, 38, 42])] = rng.uniform(4.0, 60.0)
        off = wrong * DECLARED[2:4, None, None] * rng.normal(size=(2, 300, 3)) * (rng.random((2, 1, 1)) < 0.7)
        base = replace(
            base, stamp=base.stamp + gaps, position=base.position + off[0], rotation=exp(off[1]) @ base.rotation
        )
        joint = drawn_joints(rng, base.stamp)
        joint.position[:, :2] += off[0, :, :2] / 10.0
        gates: Any = outliers.Outliers(1_000_000_000, POSE), outliers.Outliers(300_000_000, joint_channels(DECLARED[0]))
        gate = outliers.ResidualGate(2)
        for part in np.array_split(np.arange(300), 1 if seed % 2 else 40):
            passed = [each.push(stream[part]) for each, stream in zip(gates, (base, joint), strict=True)]
            found += [-1 if each is None else (np.sum(each.stamp - BEGIN) * 1e-9, len(each.stamp)) for each in passed]
            found += [gates[0].waiting_since is None, gates[1].waiting_since is None]
            residual = off[:, part].swapaxes(0, 1) + DECLARED[2:4, None] * rng.normal(size=(len(part), 2, 3))
            found.append(np.flatnonzero(gate.outliers(residual, np.tile(DECLARED[2:4], (len(part), 1)))))
        found += [(sum(each.dropped.values()), sorted(each.by_channel.items())) for each in gates]
    unchanged.values(found=found)


def test_flips_and_repeated_readings(unchanged: Unchanged) -> None:
    found: list[object] = []
    turns = exp(np.array([[0.0, 0.0, np.pi], [0.0, 2.1, 0.0], [0.0, 2.13, 0.0], [0.9, 0.0, 0.0]]))
    for seed, rng in draws(8):
        base, flips = drawn_poses(rng, 240, rate=rng.choice([10.0, 40.0])), outliers.Flips()
        for begin in rng.choice(240, 6).tolist():
            own = slice(begin, begin + int(rng.choice([1, 4, 15, 30])))
            base.rotation[own] = base.rotation[own] @ turns[rng.integers(4)]
        joint, held = drawn_joints(rng, base.stamp, 0.0), np.arange(240) // rng.choice([1, 3, 5]) * 5
        position = joint.position[held.clip(max=239)] if seed % 2 else np.round(joint.position / 0.02) * 0.02
        position[100 : 100 + rng.choice([10, 60])] = position[100]
        joint = replace(joint, position=position)
        repeats = outliers.Repeats[JointStream](joint_channels(1e-4), together=seed % 3 > 0)
        copies = outliers.Copies[JointStream](lambda each: each.position, 1_000_000_000)
        echoed = np.concatenate([[each, max(each - rng.choice([0, 2, 50]), 0)] for each in range(240)])
        for part in np.array_split(np.arange(240), 30):
            passed = flips.push(base[part])
            found += [0 if passed is None else (len(passed.stamp), np.sum(passed.rotation[:, 0]), flips.text)]
            for each in (repeats.push(joint[part]), copies.push(joint[echoed[part]])):
                found += [-1 if each is None else (np.sum(each.stamp - BEGIN) * 1e-9, len(each.stamp))]
            found += [repeats.interval, repeats.waiting_since is None]
        found += [sum(each.dropped.values()) for each in (flips, repeats, copies)]
    unchanged.values(found=found)


def test_axes_swings_and_turns(unchanged: Unchanged) -> None:
    """Of readings: axes that fit, frequencies of swings, turns of wheels."""
    found: list[object] = []
    for _, rng in draws(40):
        step = rng.normal(size=(30, 3)) * np.array([1.0, 0.7, rng.choice([0.5, 0.05])])
        axes = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3) * rng.choice([1.0, 1.05, 1.2, 4.5, 6.0], 3)
        errors, sizes = 0.02 * rng.normal(size=(30, 3)), np.full((30, 3), 0.02)
        meant, words = faults.axes_between(step, step @ axes + errors, sizes)
        turn, about = faults.turn_between(step, step @ exp(rng.uniform(0.0, 2.0) * rng.uniform(0.3, 1.0, 3)), sizes)
        count = int(rng.integers(10, 60))
        time = np.arange(count)[:, None]
        values = rng.normal(size=(count, 6)) + 0.1 * time + 1e-3 * time**2
        for frequency in rng.uniform(0.02, 0.5, 2):
            values += rng.uniform(0.5, 4.0) * np.sin(2.0 * np.pi * frequency * time + np.arange(6.0))
        values[rng.integers(count)] += rng.choice([0.0, 30.0])
        rate = rng.choice([3.0, 12.0, 28.0, 50.0], 2) * (1.0 + 0.2 * np.sin(0.1 * time))
        angle = np.cumsum(0.1 * rate, axis=0)
        angle[rng.integers(count)] += rng.uniform(1.0, 3.0)
        stream = JointStream(
            100_000_000 * time[:, 0], np.angle(np.exp(1j * angle)), rate * rng.choice([1.0, 1.02, 1.3, np.nan], 2)
        )
        counter = TurnCounter(2)
        turned = [counter.turn_counts(stream[part])[-1] for part in np.array_split(np.arange(count), 4)]
        found.append([np.sum(meant, axis=0), words, turn[0], about, faults.vibration_frequencies(values, 0.5), turned])
    unchanged.values(found=found)


@pytest.mark.parametrize('name', ['table1', 'servicer7'])
def test_motions_that_leave_the_plane(name: str, unchanged: Unchanged) -> None:
    found: list[object] = []
    body = robot(name)
    for seed, rng in draws(24):
        base, off = drawn_poses(rng, 60), rng.choice([0.0, 1e-4, 1e-3, 0.1]) * rng.uniform(0.3, 1.0, 3)
        about = np.outer(np.sin(np.arange(60) / 9.0), [0.0, 0.0, 1.0])
        turn = exp(np.outer(0.02 * np.arange(60), off)) @ exp(about) @ exp(1e-4 * rng.normal(size=(60, 3)))
        base = replace(base, rotation=turn, angular_velocity=off + 1e-4 * rng.normal(size=(60, 3)))
        detector = PlaneDetector(body, rng.choice([0.0, 1e-3]))
        whole = samples(drawn_joints(rng, base.stamp, count=body.joints), base)
        if seed % 3 == 0:
            whole = replace(whole, further=np.cumsum(base.angular_velocity, axis=0) / 50.0)
            whole.pose_covariance[:] = np.nan
        for begin in range(0, 60, 20):
            detector.update(whole[begin : begin + 20])
            found += [detector.planar, detector.equation_selection() @ np.arange(1.0, 7.0)]
    unchanged.values(found=found)


def test_verdicts(unchanged: Unchanged) -> None:
    found: dict[str, object] = {}
    names, degrees = (
        ('the zeros', 'the mount', 'the mount of mocap', 'the links', 'the bias'),
        np.array([0, 1, 3, 6, 1]),
    )
    for seed, rng in draws(40):
        counts = np.repeat(rng.choice([0, 1, 40, 400], 6), (3, 3, 3, 3, 2, 1)) * np.ones((2, 1))
        ratio = np.repeat(rng.choice([0.4, 1.0, 1.3, 1.6, 4.0], 6), (3, 3, 3, 3, 2, 1)) * rng.uniform(0.9, 1.1, 15)
        sums = counts * ratio * np.array([[1.0], [rng.choice([0.0, 0.2, 0.5])]])
        innovations, (few, square) = Innovations(SOURCES, sums, counts, counts[0]), rng.uniform(0.5, 2.5, (2, 5))
        square = square * (28.0 + 6.0 * degrees)
        distances = map(verdict.Distance, square, few * (10.0 + 3.0 * degrees), degrees)
        pushed, physical = bool(rng.random() < 0.5), bool(rng.random() < 0.7)
        evidence = verdict.Evidence(
            nis=float(rng.choice([0.9, 1.4, 1.6])),
            innovations=innovations,
            distances=dict(zip(names, distances, strict=True)),
            jumps=int(rng.integers(2, 6)),
            unconfirmed=(3.0,) if rng.random() < 0.3 else (),
            hypothesis='a force pushes' if pushed or not physical else '',
            physical=physical,
            gain=float(rng.uniform(0.0, 60.0)),
            instead=('the links', float(rng.uniform(0.0, 60.0))),
            noises={'poses.mocap': MOCAP, 'imu': {'imu.noise_density': 0.0}},
        )
        made = verdict.judge(evidence)
        causes = ranked({'a': (9.0, True), 'b': (9.2, False)}, innovations, square[0])
        found[f'{seed}'] = [
            (made.adequate, made.widening, made.reasons, widening(innovations, 0.5)),
            [(each.text, each.gain, each.repair and (each.repair.cause, each.repair.value)) for each in made.causes],
            [(each.name, each.count, each.residual, each.share) for each in innovations.fits],
            verdict.residual_reason(1.0 + 0.2 * few[0], int(rng.integers(0, 60)), determined=bool(seed % 2)).severity,
            [(each.text, each.gain) for each in causes],
        ]
    unchanged.values(**found)


def test_which_causes_lead(unchanged: Unchanged) -> None:
    found = []
    for _, rng in draws(80):
        of_kind = partial(rng.choice, ['link', 'density', 'zero', 'axis', 'mount'])
        gains = {f'{of_kind()}:{rng.integers(4)}': float(rng.uniform(0.0, 90.0)) for _ in range(14)}
        gain = np.sort(rng.uniform(0.0, 60.0, 4))[::-1].tolist()
        flags = rng.random((4, 2)) < 0.6
        causes = tuple(CandidateCause('', each, a, of_twist=b) for each, (a, b) in zip(gain, flags, strict=True))
        leading = IsolationResult(causes, Innovations.none(SOURCES)).leading
        found.append([likeliest_kinds(gains), -1.0 if leading is None else leading.gain])
    unchanged.values(found=found)


def test_the_end_of_a_run(unchanged: Unchanged) -> None:
    found = []
    for seed, rng in draws(8):
        base = drawn_poses(rng, int(rng.integers(2, 9)))
        last = samples(drawn_joints(rng, base.stamp), base)
        last.joint_velocity[:] += np.nan if seed % 2 else 0.0
        last.base_angular_velocity[:] += np.nan if seed % 3 else 0.0
        found.append(End.from_window(last, MID, 0.5, rng.normal(size=3), rng.normal(size=6)))
    unchanged.values(found=found)
