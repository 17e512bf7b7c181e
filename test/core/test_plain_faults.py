"""Faults that are plain in readings, robot description or windows, before any identification."""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from benchmarks.honesty.robots import in_millimetres
from checked import some
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.joints.faults import CHECKS, JointFaults, JointRates
from mbaid_ros.core.odometry import faults
from mbaid_ros.core.odometry.faults import HELD, HeldBase, PlanarPoses, _is_held, twist_check
from mbaid_ros.core.pipeline import PlainFaults, WindowChecks
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf import scale_lengths
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, Stamps
from mbaid_ros.session.repairing import described
from observed import HIGH, MID, configured_motion, kernel, observe, windows
from random_robots import two_links
from simulated import CONFIG, robot

WITHOUT_LIMITS = (CONFIG / 'servicer7.urdf').read_text().replace('revolute', 'continuous')
COUNT, JOINTS, SPACING = 400, 7, 20_000_000
ALL = tuple(range(JOINTS))


def motion(seed: int, noise: float = 1e-4) -> Array:
    generator = np.random.default_rng(seed)
    time = np.arange(COUNT)[:, None] * SPACING * 1e-9
    rate, phase = generator.uniform(0.1, 0.6, JOINTS), generator.uniform(0.0, 6.0, JOINTS)
    return np.asarray(0.5 * np.sin(rate * time + phase) + noise * generator.standard_normal((COUNT, JOINTS)))


def found(position: Array, pieces: int, stamp: int = 10**18, stamps: Stamps | None = None) -> Estimate:
    faults = PlainFaults(robot('servicer7'), 1e-4)
    stamps = SPACING * np.arange(len(position)) if stamps is None else stamps
    for piece in np.array_split(np.arange(len(position)), pieces):
        faults.add({ALL: JointStream(stamps[piece], position[piece], np.full((len(piece), JOINTS), np.nan))})
    return faults.applied(Estimate('trajectory', 'estimating', 0.0, stamp))


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
def test_clean_readings_show_nothing(pieces: int) -> None:
    for seed, noise in enumerate((1e-4, 1e-4, 1e-3, 1e-2)):
        estimate = found(motion(seed, noise), pieces)
        assert (estimate.status, estimate.warnings, estimate.causes) == ('estimating', (), ())


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
@pytest.mark.parametrize('every', [1, 2, 5, 20])
def test_a_second_source_is_named_first(every: int, pieces: int) -> None:
    rows = np.arange(COUNT)
    other = rows % (every + 1) == every
    number = rows - (rows + 1) // (every + 1)  # of the readings of the first source
    mixed, stamps = np.where(other[:, None], 0.0, motion(1)[number]), number * SPACING + other * SPACING // 2
    estimate = found(mixed, pieces, stamps=stamps)
    assert estimate.status == 'inconsistent'
    assert estimate.causes[0][0].startswith('joint states come from two sources that contradict each other, joint')
    first = bisect_left(rows, 1, key=lambda row: found(mixed, 1, int(stamps[row]), stamps).status == 'inconsistent')
    assert first < 15 * (every + 1)
    assert found(mixed, pieces, int(stamps[first]), stamps).status == 'inconsistent'
    assert found(mixed, pieces, int(stamps[first]) - 1, stamps).status == 'estimating'


@pytest.mark.parametrize('pieces', [1, COUNT])
def test_wrong_values_in_place_of_readings_are_no_second_source(pieces: int) -> None:
    position = motion(2)
    position[12::25] = 0.0
    estimate = found(position, pieces)
    assert estimate.status == 'estimating'
    assert estimate.warnings[0].startswith('joint states contain wrong values now and then, joint')


def test_a_joint_that_rests_at_the_turn_of_its_wrapped_angle_is_no_second_source() -> None:
    position = motion(2)
    position[:, 3] = np.pi + 1e-3 * np.random.default_rng(0).standard_normal(COUNT)
    wrapped = (position + np.pi) % (2.0 * np.pi) - np.pi
    assert np.ptp(wrapped[:, 3]) > 6.0
    assert found(wrapped, 3).status == 'estimating'


@pytest.mark.parametrize('pieces', [1, COUNT])
def test_a_joint_that_is_read_more_seldom_is_named(pieces: int) -> None:
    position = motion(4)
    position[:, 3] = position[np.arange(COUNT) // 8 * 8, 3]
    text = 'joint4 repeats its readings while other joints have new ones'
    assert found(position, pieces).warnings[0].startswith(text)
    position[:, 3] = np.round(motion(4)[:, 3] / 1e-3) * 1e-3  # a coarse encoder
    assert found(position, pieces).warnings == ()


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
def test_steps_of_a_coarse_encoder_are_named_and_no_held_readings(pieces: int) -> None:
    position, step = motion(4), 2.0 * np.pi / 1024.0
    position[:, 3] = np.round(0.5 * position[:, 3] / step) * step
    (text,) = found(position, pieces).warnings
    assert text.startswith('joint4 is read in steps of 0.0061 rad, as by a coarse encoder')
    faults, velocity = JointFaults(robot('servicer7'), list(ALL), 1e-4), np.full((COUNT, JOINTS), np.nan)
    shown = faults.add(JointStream(SPACING * np.arange(COUNT), position, velocity))
    repairs = {symptom: repair for symptom, _, _, repair in shown}
    assert some(repairs['steps']).parameters == {'known_joints.joint4.tracking_std': 5e-3}


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
@pytest.mark.parametrize('step', [-0.02, -0.01, 0.01, 0.5])
def test_a_jump_is_named_by_joint_size_and_time(step: float, pieces: int) -> None:
    position = motion(5)
    position[200:, 3] += step
    (text,) = found(position, pieces).warnings
    assert text.startswith('the reading of joint4 jumps by ')
    assert float(text.split()[6]) == pytest.approx(abs(step), rel=0.02, abs=1.5e-3)
    assert float(text.split('at ')[1].split()[0]) == pytest.approx(4.0, abs=0.1)
    shown = JointFaults(robot('servicer7'), list(ALL), 1e-4).add(
        JointStream(10**18 + SPACING * np.arange(COUNT), position, np.full((COUNT, JOINTS), np.nan))
    )
    (since,) = {some(repair).since for _, _, _, repair in shown if some(repair).conversion}
    assert since == pytest.approx(4.0, abs=0.1)  # of the run
    coarse = np.round(motion(5) / 1.5e-3) * 1.5e-3
    assert found(coarse, pieces).warnings == ()
    kept = np.r_[0:150, 250:COUNT]  # messages that are lost are no jump
    assert found(motion(5)[kept], pieces, stamps=SPACING * kept).warnings == ()


def test_a_slip_of_a_few_milliradians_is_not_named() -> None:
    position = motion(5)
    position[200:, 3] += 3e-3
    assert found(position, 1).warnings == ()


def test_joints_in_degrees_are_beyond_their_limits_and_no_second_source() -> None:
    time = np.arange(COUNT)[:, None] * SPACING * 1e-9
    position = np.rad2deg(2.0 * np.sin(time + np.arange(JOINTS)))  # fast
    first = found(position, 7).causes[0][0]
    assert 'far beyond its limits in the robot description: degrees, millimetres or encoder ticks, not rad' in first


def test_single_outliers_are_no_second_source() -> None:
    position = motion(2)
    position[50::100] = 0.0
    assert found(position, 3).status == 'estimating'


@pytest.mark.parametrize('pieces', [1, COUNT])
def test_encoder_ticks_are_named(pieces: int) -> None:
    estimate = found(np.round(motion(3) * 4096.0 / (2.0 * np.pi) + 2048.0), pieces)
    assert estimate.status == 'inconsistent'
    assert len(estimate.causes) == 1
    assert 'reads whole numbers, from 2' in estimate.causes[0][0]


def test_an_arm_that_rests_at_zero_reads_no_ticks() -> None:
    assert found(np.zeros((COUNT, JOINTS)), 2).status == 'estimating'


@pytest.mark.parametrize(
    ('inertia', 'text'),
    [
        ('<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>', 'kg and no inertia'),
        ('<inertia ixx="248e6" ixy="0" ixz="0" iyy="248e6" iyz="0" izz="248e6"/>', 'the inertia of a body of'),
    ],
)
def test_an_inertia_that_no_body_has_is_warned_of_and_the_first_cause(inertia: str, text: str) -> None:
    urdf = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    begin = urdf.index('<inertia ixx="248"')
    faults = PlainFaults(load_model(urdf[:begin] + inertia + urdf[urdf.index('/>', begin) + 2 :]), 1e-4)
    fine = faults.applied(Estimate('trajectory', 'estimating', 0.0, 0))
    wrong = faults.applied(Estimate('trajectory', 'inconsistent', 0.0, 0, causes=(('something', 5.0),)))
    assert fine.status == 'estimating'
    assert text in fine.warnings[0]
    assert not fine.causes
    assert text in wrong.causes[0][0]


def test_a_description_in_millimetres_is_the_first_cause_and_converted() -> None:
    urdf = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    wrong = Estimate('trajectory', 'inconsistent', 0.0, 0, causes=(('something', 5.0),))
    found = PlainFaults(load_model(in_millimetres(urdf)), 1e-4).applied(wrong)
    text = found.causes[0][0]
    assert re.match(r'joint\d is \d{3} m from its parent, .* of more than 0\.75 m: lengths in millimetres', text)
    read, meant = (load_model(each) for each in (urdf, described(in_millimetres(urdf), [found.remedies[text]])))
    np.testing.assert_allclose(meant.positions, read.positions, rtol=1e-12)
    for one, other in zip(meant.links, read.links, strict=True):
        np.testing.assert_allclose(one.parameters, other.parameters, rtol=1e-9, atol=1e-12)
    assert str(found.remedies[text]).endswith('is in millimetres (the robot description is converted)')


def test_a_slender_robot_is_not_one_in_millimetres() -> None:
    urdf = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    fine = Estimate('trajectory', 'estimating', 0.0, 0)
    assert not PlainFaults(load_model(scale_lengths(urdf, 100.0)), 1e-4).applied(fine).warnings


def spinning(step: float, *, rates: bool, pieces: int, wrapped: bool = True, factor: float = 1.0) -> Estimate:
    """Return what is found where the sixth joint turns by a step (rad) from each reading to the next.

    Its velocity is a factor of what it should be.
    """
    position = motion(3)
    angle = step * np.arange(COUNT)
    position[:, 5] = np.angle(np.exp(1j * angle)) if wrapped else angle
    velocity = np.zeros((COUNT, JOINTS))
    velocity[:, 5] = factor * step / (SPACING * 1e-9) if rates else np.nan
    faults = PlainFaults(load_model(WITHOUT_LIMITS), 1e-4)
    for piece in np.array_split(np.arange(COUNT), pieces):
        faults.add({ALL: JointStream(piece * SPACING, position[piece], velocity[piece])})
    return faults.applied(Estimate('trajectory', 'estimating', 0.0, 10**18))


@pytest.mark.parametrize('pieces', [1, 7, COUNT])
def test_a_joint_that_turns_too_fast_for_its_positions_alone_is_refused(pieces: int) -> None:
    for step in (2.0, 3.0, 8.1):
        estimate = spinning(step, rates=False, pieces=pieces, wrapped=step < 8.0)
        assert estimate.status == 'inconsistent'
        assert estimate.causes[0][0].startswith('joint6 turns by more than a quarter from one reading to the next')
    slow = spinning(1.0, rates=False, pieces=pieces)
    assert slow.status == 'estimating'
    assert slow.warnings[0].startswith('joint6 turns on and on without a velocity, and may turn faster than its pos')
    for step in (3.1416, 6.6, 8.0, -60.0):
        known = spinning(step, rates=True, pieces=pieces)
        assert (known.status, known.warnings) == ('estimating', ())
    wrong = spinning(8.0, rates=True, pieces=pieces, factor=0.6)
    assert wrong.status == 'inconsistent'
    assert wrong.causes[0][0].endswith('if the velocity is right, name it in wheels.names, not as a joint')


@pytest.mark.parametrize('pieces', [1, 7, 100])
def test_poses_before_tracking_begins_are_named(pieces: int) -> None:
    stamp, generator = SPACING * np.arange(100), np.random.default_rng(0)
    for noise, warned in ((1e-3, True), (1e-7, False)):  # the latter leaves a base at rest
        position = noise * generator.standard_normal((100, 3))
        position[:30] = 0.0
        faults, none = PlainFaults(robot('servicer7'), 1e-4), np.zeros((100, 3))
        base = BaseStream(stamp, position, np.tile(np.eye(3), (100, 1, 1)), none, none, *np.zeros((2, 100, 6, 6)))
        for piece in np.array_split(np.arange(100), pieces):
            faults.add({}, base[piece])
        warnings = faults.applied(Estimate('trajectory', 'estimating', 0.0, 10**18)).warnings
        assert [each.startswith('the first 30 poses of the base are zero') for each in warnings] == [True] * warned


RANDOM = np.random.default_rng(4)


@cache
def measured(name: str, noise: str = 'mid') -> Samples:
    truth = configured_motion(name, 15.0, 50.0)
    return observe(truth, {'mid': MID, 'high': HIGH}[noise], 1)


def reasons(samples: Samples, name: str) -> tuple[list[str], list[Samples]]:
    """Return what the checks find in all windows of a robot, and the windows that they pass on."""
    checks = WindowChecks([twist_check(), HeldBase(kernel(name))], JointRates(robot(name).joint_names))
    passed = checks.with_valid_rates(windows(samples))
    return [each.text for each in checks.reasons(passed[-1].time[-1])], passed


@pytest.mark.parametrize('name', ['servicer7', 'table1'])
@pytest.mark.parametrize('noise', ['mid', 'high'])
def test_clean_windows_show_nothing_and_keep_their_velocities(name: str, noise: str) -> None:
    found, passed = reasons(measured(name, noise), name)
    assert found == []
    assert all(np.isfinite(window.joint_velocity).all() for window in passed)


@pytest.mark.parametrize('name', ['servicer7', 'table1'])
@pytest.mark.parametrize('noise', [0.0, 1e-4, 1e-3])
def test_a_base_that_is_held_is_reported(name: str, noise: float) -> None:
    samples = measured(name)
    held = replace(
        samples, base_position=np.array([1.0, -2.0, 0.5]) + noise * RANDOM.standard_normal((len(samples), 3))
    )
    assert reasons(held, name)[0] == [HELD]


def test_a_held_base_is_reported_after_thrust_too() -> None:
    samples = measured('servicer7')
    pushed = np.where(samples.time[:, None] > 3.0, np.arange(6.0), 0.0)
    place = np.full((len(samples), 3), 0.3)
    held = replace(samples, base_position=place + 1e-3 * RANDOM.standard_normal(place.shape), impulse=pushed)
    assert reasons(held, 'servicer7')[0] == [HELD]
    assert reasons(replace(samples, impulse=pushed), 'servicer7')[0] == []


def test_a_heavy_arm_in_the_robot_description_is_no_held_base() -> None:
    # The base reacts by a thousandth of what such links would make it.
    described = kernel('servicer7')
    change = 999.0 * described.known
    change[0] = 0.0
    held = HeldBase(described.with_body_changes(change))
    assert [held.update(each) for each in windows(measured('servicer7'))] == [None] * 30


@pytest.mark.parametrize(
    ('change', 'how'),
    [
        ((0.0, 0.0, 0.0), 'zero while the positions change'),
        ((0.3, 0.0, 0.0), 'no rates of the positions'),
        ((0.0, 2.0, 0.0), 'no rates of the positions'),
        ((0.0, 0.0, 57.3), 'no rates of the positions'),
        ((0.0, 0.0, -1.0), 'no rates of the positions'),
    ],
    ids=['zero', 'constant', 'proportional', 'degrees', 'turned round'],
)
@pytest.mark.parametrize('joint', [0, 4])
def test_velocities_that_are_no_rates_are_left_out(change: tuple[float, float, float], how: str, joint: int) -> None:
    samples = measured('servicer7')
    velocity = samples.joint_velocity.copy()
    constant, of_position, of_velocity = change
    velocity[:, joint] = constant + of_position * samples.joint_position[:, joint] + of_velocity * velocity[:, joint]
    found, passed = reasons(replace(samples, joint_velocity=velocity), 'servicer7')
    assert found == [
        f'the velocities of joint{joint + 1} are {how}: velocities are taken from the positions; correct the driver'
    ]
    # At once where the joint moves, and all along from the third window on.
    assert all(np.isnan(window.joint_velocity).all() for window in passed[6:])


def _poses(position: Array, stamps: Stamps) -> BaseStream:
    count = len(position)
    unknown, covariance = np.full((count, 3), np.nan), np.tile(np.eye(6), (count, 1, 1))
    rotation = np.tile(np.eye(3), (count, 1, 1))
    return BaseStream(stamps, position, rotation, unknown, unknown, covariance, covariance)


@pytest.mark.parametrize('pieces', [1, 7])
@pytest.mark.parametrize(('rise', 'named'), [(0.0, True), (1e-9, True), (1e-3, False)])
def test_odometry_in_two_dimensions_of_a_robot_that_leaves_the_plane_is_named(
    pieces: int, rise: float, named: bool
) -> None:
    faults, joints = PlainFaults(robot('servicer7'), 1e-4), motion(0)
    stamps: Stamps = SPACING * np.arange(COUNT)
    position = np.column_stack((1e-3 * np.arange(COUNT), np.zeros(COUNT), rise * np.sin(np.arange(COUNT))))
    for piece in np.array_split(np.arange(COUNT), pieces):
        read = JointStream(stamps[piece], joints[piece], np.full((len(piece), JOINTS), np.nan))
        faults.add({ALL: read}, _poses(position[piece], stamps[piece]))
    estimate = faults.applied(Estimate('trajectory', 'estimating', 0.0, 10**18))
    assert (estimate.status == 'inconsistent') is named
    assert ('the odometry is in two dimensions' in ''.join(text for text, _ in estimate.causes)) is named


@pytest.mark.parametrize('pieces', [1, 7])
@pytest.mark.parametrize(
    ('same', 'listed'),
    [
        ('z', 'moves: z;'),
        ('xyz', 'moves: x, y, z;'),
        ('t', 'moves: roll and pitch;'),
        ('tr', 'orientation;'),
        ('r', 'moves: yaw;'),
        ('', ''),
    ],
)
def test_coordinates_that_never_change_are_named(pieces: int, same: str, listed: str) -> None:
    joints, count = motion(0), 3 * COUNT
    stamps, turn = SPACING * np.arange(count), 1e-4 * np.arange(count)[:, None]
    position = turn * [axis not in same for axis in 'xyz']
    rolls, yaws = exp(turn * [True, False, False] * ('t' not in same)), exp(turn * [False, False, 'r' not in same])
    rotation = yaws @ rolls
    faults = PlainFaults(robot('servicer7'), 1e-4)
    for piece in np.array_split(np.arange(count), pieces):
        poses = replace(_poses(position[piece], stamps[piece]), rotation=rotation[piece])
        moved = joints[np.minimum(piece, COUNT - 1)]
        faults.add({ALL: JointStream(stamps[piece], moved, np.full((len(piece), JOINTS), np.nan))}, poses)
    found = faults.applied(Estimate('trajectory', 'estimating', 0.0, 10**18))
    assert found.status == 'estimating'
    assert [listed in text for text in found.warnings] == [True] * bool(same)


@pytest.mark.parametrize('pieces', [1, 7])
@pytest.mark.parametrize(
    ('kind', 'named'),
    [
        ('float32', 'steps of 31 mm along x, as in float32'),
        ('rounded', ', as if rounded'),
        ('doubles', ''),
        ('slow', ''),
    ],
)
def test_positions_in_steps_are_named(pieces: int, kind: str, named: str) -> None:
    """In float32 far from the origin, rounded, as they are, and of a tracker that is read more seldom."""
    number, noise = np.arange(3 * COUNT), 1e-3 * np.random.default_rng(2).normal(size=(3 * COUNT, 3))
    moved = np.column_stack((5e5 + 1e-3 * number, 0.2 * np.sin(0.01 * number), np.zeros(len(number))))
    position = moved + noise * [1.0, 1.0, 0.0]
    if kind == 'float32':
        position = position.astype(np.float32).astype(float)
    elif kind == 'rounded':
        position = np.round(position, 2)
    elif kind == 'slow':
        position = moved[number // 10 * 10]
    faults, rotation = PlainFaults(robot('servicer7'), 1e-4), exp(1e-4 * number[:, None] * np.ones(3))
    rotation = rotation[number // 10 * 10] if kind == 'slow' else rotation
    for piece in np.array_split(number, pieces):
        poses = _poses(position[piece], SPACING * piece)
        faults.add({}, replace(poses, rotation=rotation[piece]))
    assert [named in text for text in faults.texts] == [True] * bool(named)


@pytest.mark.parametrize(('axis', 'named'), [('1 0 0', False), ('0 1 0', False), ('0 0 1', True)])
def test_a_joint_that_slides_within_the_plane_does_not_leave_it(axis: str, named: bool) -> None:
    model = load_model(two_links('type="prismatic"', 'type="revolute"').replace('xyz="0 0 1"', f'xyz="{axis}"', 1))
    planar, stamps = PlanarPoses(model), SPACING * np.arange(COUNT)
    moving = np.column_stack((1e-2 * np.arange(COUNT), np.zeros(COUNT)))
    planar.add_joints(model.joint_names, stamps, moving)
    planar.add_poses(_poses(np.column_stack((moving, np.zeros(COUNT))), stamps))
    assert bool(list(planar.found())) is named


@pytest.mark.parametrize(('step', 'how'), [(10**9, 'they are whole seconds'), (10**8, 'they are rounded')])
@pytest.mark.parametrize('pieces', [1, 7])
def test_rounded_stamps_are_named(step: int, how: str, pieces: int) -> None:
    estimate = found(motion(0), pieces, stamps=SPACING * np.arange(COUNT) // step * step)
    assert how in estimate.warnings[0]
    assert not found(motion(0), pieces).warnings


@pytest.mark.parametrize(('unit', 'named'), [(10**6, 'milliseconds'), (1000, 'microseconds'), (1, '')])
@pytest.mark.parametrize('pieces', [1, 7])
def test_nanoseconds_that_are_others_are_named_and_not_their_consequences(unit: int, named: str, pieces: int) -> None:
    begin, part = np.divmod(SPACING * np.arange(COUNT), 10**9)
    estimate = found(motion(0), pieces, stamps=begin * 10**9 + part // unit)
    texts = [text for text in estimate.warnings if 'nanosec of the stamps' in text or 'batches' in text]
    assert [named in text for text in texts] == ([True] if named else [])
    # One reading a second, at its begin, is no fault.
    seldom = found(motion(0), pieces, stamps=10**9 * np.arange(COUNT) + 200)
    assert not any('nanosec' in text for text in seldom.warnings)


@pytest.mark.parametrize('pieces', [1, 7])
@pytest.mark.parametrize(
    ('back', 'jitter', 'named'), [(1.0, 0.0, True), (0.6, 0.005, True), (0.3, 0.0, False), (1.0, 0.3, False)]
)
def test_a_clock_that_creeps_and_is_set_back_by_a_part_of_an_interval_is_named(
    pieces: int, back: float, jitter: float, named: bool
) -> None:
    """As one that is synchronised now and then; what comes early after it came late is jitter."""
    errors = 0.5 * jitter * np.random.default_rng(1).uniform(-1.0, 1.0, COUNT)
    late = back * (np.arange(COUNT) % 200) / 200.0
    stamps = np.round(SPACING * (np.arange(COUNT) + late + errors)).astype(np.int64)
    estimate = found(motion(0), pieces, stamps=stamps)
    assert any('the joint states went back by' in text for text in estimate.warnings) == named
    copies = np.repeat(SPACING * np.arange(COUNT), 1 + (np.arange(COUNT) % 100 == 50))[:COUNT]
    assert not any('went back' in text for text in found(motion(0), pieces, stamps=copies).warnings)


@pytest.mark.parametrize(('zeros', 'away', 'named'), [(10, 2e-4, True), (9, 2e-4, False), (10, 5e-5, False)])
def test_ten_poses_of_zeros_before_one_that_is_none_are_no_tracking(zeros: int, away: float, named: bool) -> None:
    """A position or an orientation further away than its noise ends them; later ones count for nothing."""
    stamp, none = SPACING * np.arange(40), np.zeros((40, 3))
    for turned in (False, True):
        rotation, position = np.tile(np.eye(3), (40, 1, 1)), np.zeros((40, 3))
        if turned:
            rotation[zeros:, 0, 1] = -away
        else:
            position[zeros:, 2] = -away
        faults = PlainFaults(robot('servicer7'), 1e-4)
        position[30:] = 0.0
        base = BaseStream(stamp, position, rotation, none, none, *np.zeros((2, 40, 6, 6)))
        for part in (base[:5], base[5:25], base[25:]):
            faults.add({}, part)
            assert named or not faults.texts
        said = [each for each in faults.texts if 'poses of the base are zero' in each]
        assert bool(said) is named
        assert all(each.startswith(f'the first {zeros} poses') for each in said)


def beside(base: float, reaction: float = 0.0, moved: float = 0.1, walk: bool = False) -> Array:
    """Return means (40, 7) of time, base and centre of mass: an arm that moves so far, m, and a base that reacts."""
    rng, time = np.random.default_rng(3), 0.5 * np.arange(40.0)
    swing = np.sin(0.9 * time[:, None] + np.arange(3.0)) * np.array([1.0, 0.6, -0.8])
    centre = moved * swing + 0.02 * time[:, None] ** 2  # a steady motion counts for nothing
    noise = base * rng.normal(size=(40, 3))
    noise = np.cumsum(noise, axis=0) if walk else noise
    place = noise - reaction * moved * swing + 0.3 * time[:, None] - 0.05 * time[:, None] ** 2
    return np.column_stack((time, place, centre))


@pytest.mark.parametrize(
    ('given', 'held'),
    [
        ({'base': 1e-3}, True),
        ({'base': 0.0}, True),
        ({'base': 1e-3, 'reaction': 0.5}, False),
        ({'base': 1e-3, 'reaction': -0.5}, False),
        ({'base': 1e-4, 'reaction': 0.02}, False),  # little, and together with the arm
        ({'base': 1e-3, 'moved': 1e-6}, False),  # nothing moves
        ({'base': 0.05}, False),  # it moves about as far as the arm
        ({'base': 1e-3, 'walk': True}, False),  # no white noise
    ],
)
def test_a_base_is_held_that_moves_by_noise_alone_beside_an_arm(given: dict[str, Any], held: bool) -> None:
    assert _is_held(beside(**given)) is held


def test_an_arm_that_seems_to_leap_shows_no_held_base() -> None:
    seen = beside(1e-3)
    seen[:, 4:] = np.random.default_rng(1).choice([-1.0, 1.0], (40, 3))
    assert not _is_held(seen)


def test_a_base_that_may_be_held_is_looked_at_ever_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """After ten windows, and with half as many more each time; thrust begins anew."""
    compared = list[int]()
    monkeypatch.setattr(faults, '_is_held', lambda seen: compared.append(len(seen)))
    held = HeldBase(kernel('servicer7'))
    count, nothing = 6, np.zeros((6, 3))
    unit, covariance = np.tile(np.eye(3), (count, 1, 1)), np.tile(np.eye(6), (count, 1, 1))
    joints = np.zeros((count, 7))
    window = Samples(np.arange(6.0), joints, joints, nothing, unit, nothing, nothing, covariance, covariance)
    for _ in range(70):
        assert held.update(window) is None
    assert compared == [10, 20, 30, 45, 68]
    held.update(replace(window, impulse=np.linspace(0.0, 1.0, count)[:, None] * np.ones(6)))
    for _ in range(10):
        held.update(replace(window, impulse=np.ones((count, 6))))
    assert compared[5:] == [10]


def test_faults_of_joints_are_named_after_others_and_notes_last() -> None:
    """In the order of the table."""
    grave, note = (
        [name for name, each in CHECKS.items() if (each.severity == 'note') is kind] for kind in (False, True)
    )
    faults = PlainFaults(robot('servicer7'), 1e-4)
    order = ['planar', *grave, 'zeros', *note]
    for symptom in sorted(order):
        faults.name(symptom, 0, symptom)
    assert faults.texts == order
