"""Which readings show a symptom, since when, and with what repair: tables of evidence on either side of each limit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.faults import JointFaults, JointRates, joints_in_degrees, reversed_joints, swapped_joints
from mbaid_ros.core.joints.stream import joint_channels
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import JointStream, Samples, Stamps
from random_robots import random_inertial
from unchanged import Unchanged
from windowed import joint_window

COUNT, SPACING, NOISE = 200, 20_000_000, 1e-4
KINDS = ('revolute', 'prismatic', 'continuous', 'revolute')
GRID = np.geomspace(0.5, 2.0, 7)  # times a limit
TIME = 1e-9 * SPACING * np.arange(COUNT)


def chain() -> RobotModel:
    """Return an arm with a joint of each kind."""
    rng = np.random.default_rng(0)
    parts = [f'<link name="base_link">{random_inertial(rng)}</link>']
    for place, kind in enumerate(KINDS):
        parent = f'link{place}' if place else 'base_link'
        parts += [
            f'<link name="link{place + 1}">{random_inertial(rng)}</link>',
            f'<joint name="joint{place + 1}" type="{kind}"><parent link="{parent}"/><child link="link{place + 1}"/>',
            f'<origin xyz="0.1 0.2 0.5"/><axis xyz="{place % 2} {1 - place % 2} 0"/>',
            '<limit lower="-3.5" upper="0.9" effort="9" velocity="9"/></joint>',
        ]
    return load_model(f'<robot name="chain">{"".join(parts)}</robot>')


MODEL = chain()


def moving(noise: float = NOISE) -> Array:
    """Return four joints that move smoothly."""
    rates = np.array([0.3, 0.2, 0.5, 0.4])
    errors = np.random.default_rng(1).normal(size=(COUNT, 4))
    return np.asarray(0.4 * np.sin(rates * TIME[:, None] + np.arange(4.0)) + noise * errors)


def symptoms(position: Array, velocity: Array | None = None, stamps: Stamps | None = None, pieces: int = 1) -> object:
    """Return each symptom with the reading that makes it certain, and what follows from it."""
    faults = JointFaults(MODEL, range(4), NOISE)
    velocity = np.full(position.shape, np.nan) if velocity is None else velocity
    stamps = SPACING * np.arange(len(position)) if stamps is None else stamps
    found: dict[str, object] = {}
    for piece in np.array_split(np.arange(len(position)), pieces):
        for symptom, *rest in faults.add(JointStream(stamps[piece], position[piece], velocity[piece])):
            found.setdefault(symptom, rest)
    return found


def jumped(size: float) -> Array:
    position = moving()
    position[100:, :2] += 30.0 * NOISE * size
    return position


def jumped_beside_a_motion(size: float) -> Array:
    position = moving() + 2e-3 * np.arange(COUNT)[:, None]
    position[100:, 3] += 5e-3 * size
    return position


def jumped_in_large_noise(size: float) -> Array:
    position = moving(10.0 * NOISE)
    position[100:, 3] += 400.0 * NOISE * size
    return position


def spiked(size: float) -> Array:
    position = moving()
    position[3::9, 1] += 0.3 * size
    return position


def counted(size: float) -> Array:
    return np.round(moving() * 12.5 * size)


def held(size: float) -> Array:
    position = moving()
    position[:, 3] *= size
    position[:, 3] = position[np.arange(COUNT) // 4 * 4, 3]
    return position


def coarse(size: float) -> Array:
    position, step = moving(), 20.0 * NOISE * size
    position[:, :2] = step * np.round(0.3 * position[:, :2] / step)
    return position


def partly_coarse(size: float) -> Array:
    """Return readings of which a part is beside the steps of an encoder."""
    position, step = moving(), 40.0 * NOISE
    position[:, 0] = step * np.round(position[:, 0] / step)
    position[:: max(round(20.0 / size), 1), 0] += 0.3 * step
    return position


def beyond(size: float) -> Array:
    return moving() * np.array([7.0, 5.0, 16.0, 18.0]) * size


def fast(size: float) -> Array:
    position = moving()
    position[:, 2] = 0.5 * np.pi * size * np.arange(COUNT)
    return position


def wrapped(size: float) -> Array:
    position = fast(size)
    position[:, [0, 2]] = np.angle(np.exp(1j * position[:, 2:3]))
    return position


EVIDENCE: dict[str, Callable[[float], Array]] = {
    each.__name__: each
    for each in (
        jumped,
        jumped_beside_a_motion,
        jumped_in_large_noise,
        spiked,
        counted,
        held,
        coarse,
        partly_coarse,
        beyond,
        fast,
        wrapped,
    )
}


@pytest.mark.parametrize('name', EVIDENCE)
def test_symptoms_of_readings(name: str, unchanged: Unchanged) -> None:
    found = [symptoms(EVIDENCE[name](size)) for size in GRID.tolist()]
    assert found[-1] == symptoms(EVIDENCE[name](GRID[-1]), pieces=23)
    assert len({str(each) for each in found}) > 1
    unchanged.values(found=found)


@pytest.mark.parametrize('step', [2.0, 7.0, -4.0])
def test_symptoms_of_wheels_by_how_their_velocity_fits(step: float, unchanged: Unchanged) -> None:
    """Each reading turns by so much, as a part of the velocities says, which change."""
    position, rate = moving(), step * (1.0 + 0.1 * np.sin(np.arange(COUNT)))
    position[:, 2] = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))))
    found = []
    for part in (0.0, 0.5, 0.8, 0.9, 0.95, 1.0, 1.1, 1.3, 2.0):
        velocity = np.zeros((COUNT, 4))
        velocity[:, 2] = part * rate / (1e-9 * SPACING)
        found.append(symptoms(position, velocity))
    unchanged.values(found=found)


@pytest.mark.parametrize('whole', [*product((False, True), repeat=3)])
def test_a_reading_far_from_both_neighbours_is_wrong_but_not_that_of_an_encoder_that_flips(
    whole: tuple[bool, bool, bool],
) -> None:
    """Where all three are whole numbers."""
    position = moving()
    position[:, 3] = 1.003
    for place, (level, flag) in enumerate(zip((1.0, 2.0, 1.0), whole, strict=True)):
        position[2 + place :: 9, 3] = level + 0.001 * (not flag) * place
    position[2::9, 3] += 0.002 * (not whole[0])
    found = symptoms(position)
    assert isinstance(found, dict)
    assert ('wrong values' in found) is not all(whole)


@pytest.mark.parametrize('late', [0.2, 0.4, 0.6, 0.9])
def test_a_second_source_comes_between_the_readings(late: float, unchanged: Unchanged) -> None:
    rows = np.arange(COUNT)
    other, found = rows % 7 == 6, []
    for around in (1.0, 1.4, 1.6, 2.0):
        interval = np.where(other, late, 1.0) * np.where(np.roll(other, 1), around - late, 1.0)
        position = moving()
        position[other] = 0.3
        stamps: Stamps = np.round(SPACING * np.cumsum(interval)).astype(np.int64)
        found.append(symptoms(position, stamps=stamps))
    unchanged.values(found=found)


def test_the_size_of_a_jump_is_as_uncertain_as_four_readings_make_it() -> None:
    rng, off = np.random.default_rng(3), []
    for _ in range(40):
        position = 0.4 * np.sin(0.3 * TIME[:, None] + np.arange(4.0)) + NOISE * rng.normal(size=(COUNT, 4))
        position[100:, 0] += 0.05
        found = JointFaults(MODEL, range(4), NOISE).add(
            JointStream(SPACING * np.arange(COUNT), position, np.full(position.shape, np.nan))
        )
        (repair,) = (each[3] for each in found if each[3] is not None and each[3].conversion is not None)
        value, std = (float(np.array(each, dtype=float)) for each in (repair.value, repair.std))
        off.append((value - 0.05) / std)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.3)


def test_a_step_beside_a_missing_message_is_no_jump(unchanged: Unchanged) -> None:
    found = []
    for place in range(96, 104):
        stamps = SPACING * np.arange(COUNT) + SPACING * (np.arange(COUNT) > place)
        found.append(symptoms(jumped(4.0), stamps=stamps))
    assert found[0] != found[3]
    unchanged.values(found=found)


def window(position: Array, velocity: Array) -> Samples:
    count, nothing = len(position), np.zeros((len(position), 3))
    unit, covariance = np.tile(np.eye(3), (count, 1, 1)), np.tile(np.eye(6), (count, 1, 1))
    time = 3.0 + 0.02 * np.arange(count)  # a window begins at any time
    return Samples(time, position, velocity, nothing, unit, nothing, nothing, covariance, covariance)


@pytest.mark.parametrize(
    ('noise', 'rate_noise', 'amplitude', 'times'),
    [
        (0.0, 0.0, 5e-4, 1.0),
        (1e-3, 0.0, 7e-3, 1.0),
        (0.0, 5e-3, 5e-3, 1.0),
        (1e-5, 1e-4, 0.1, 0.5),
        (1e-3, 0.0, 2e-2, 0.5),
    ],
)
def test_velocities_that_are_no_rates(
    noise: float, rate_noise: float, amplitude: float, times: float, unchanged: Unchanged
) -> None:
    """Of a joint that moves so far and another that rests: reversed, zero or too fast; each window seen by itself."""
    time, found = 0.02 * np.arange(25), []
    for size in GRID.tolist():
        rng, still = np.random.default_rng(3), np.zeros(25)
        rates = JointRates(['elbow', 'wrist'])
        for place in range(5):
            far = amplitude * size if times == 1.0 else amplitude
            angle = 4.0 * time + place
            position = np.column_stack((far * np.sin(angle), still)) + noise * rng.normal(size=(25, 2))
            part = (-1.0, 0.0, 1.0 + times * size)[place % 3] if times < 1.0 else -1.0
            velocity = np.column_stack((4.0 * part * far * np.cos(angle), still))
            velocity += rate_noise * rng.normal(size=(25, 2))
            passed = rates.with_valid_rates(window(position, velocity))
            found.append((bool(np.isnan(passed.joint_velocity).all()), rates.reason()))
    unchanged.values(found=found)


def test_a_window_of_too_few_samples_or_without_velocities_passes_as_it_is() -> None:
    position = np.linspace(0.0, 1.0, 5)[:, None]
    for one in (window(position, 0.0 * position), window(np.zeros((9, 0)), np.zeros((9, 0)))):
        assert JointRates(['elbow'][: one.joint_position.shape[1]]).with_valid_rates(one) is one
    longer = window(np.linspace(0.0, 1.0, 6)[:, None], np.zeros((6, 1)))
    assert JointRates(['elbow']).with_valid_rates(longer) is not longer
    without = window(longer.joint_position, np.full((6, 1), np.nan))
    assert JointRates(['elbow']).with_valid_rates(without) is without


def test_velocities_wrong_in_a_quarter_of_the_windows_with_motion_are_wrong_all_along() -> None:
    """From the third such window on; the others are left out by themselves."""
    time = 0.02 * np.arange(25)[:, None]
    right, still = window(np.sin(time), np.cos(time)), window(0.0 * time, 0.0 * time)
    wrong = window(np.sin(time), -np.cos(time))
    for rights, named in ((7, True), (8, True), (9, False)):  # 3 of 11, and of 12
        rates = JointRates(['elbow'])
        for each in (*(still,) * 20, *(right,) * (rights - 1), wrong, wrong):
            rates.with_valid_rates(each)
        assert rates.reason() is None
        assert rates.with_valid_rates(right) is right
        rates.with_valid_rates(wrong)
        assert (rates.reason() is not None) is named
        passed = rates.with_valid_rates(right)
        assert bool(np.isnan(passed.joint_velocity).all()) is named


def test_how_joints_may_be_meant_otherwise(unchanged: Unchanged) -> None:
    kernel = MomentumKernel(MODEL, 'link4')
    windows = [joint_window(moving()[20 * place : 20 * place + 20], 0.5 * place) for place in range(2)]
    every = [each for make in (reversed_joints, swapped_joints, joints_in_degrees) for each in make(kernel)]
    assert len(every) == 4 + 6 + 1
    read = [each.windows(windows)[1].knots.joint_position[3] for each in every]
    unchanged.values(read=read, meant=[(each.text, each.joint_range, each.misfit_left, each.repair) for each in every])


def test_outliers_of_joints_are_looked_for_joint_by_joint() -> None:
    """By how far each is from where it began, beside the declared noise."""
    (channels,) = joint_channels(0.3)
    position = moving()
    read = JointStream(SPACING * np.arange(COUNT), position, position)
    assert channels.values(read)[:, :, 0] == pytest.approx(position)
    assert channels.declared(read) == pytest.approx(np.full((COUNT, 4), 0.3))
    away = channels.local(read)[:, :, 0]
    assert not away[0].any()
    assert np.diff(away, axis=0) == pytest.approx(np.diff(position, axis=0))


@pytest.mark.parametrize(('size', 'fast'), [(2.0, True), (2.5, False), (4.0, False), (600.0, True)])
def test_a_joint_is_too_fast_by_a_quarter_turn_within_a_turn_or_by_a_half_where_none_reaches(
    size: float, fast: bool
) -> None:
    """Its readings are by turns as far on either side; beyond a turn an arm may as well be read so."""
    position = moving()
    position[:, 0] = size * (-1.0) ** np.arange(COUNT)
    found = symptoms(position)
    assert isinstance(found, dict)
    assert ('too fast' in found) is fast
