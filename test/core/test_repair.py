"""Repairs: the declaration that a size leads to, conversions of readings, and several causes that are as likely."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.forces import DisturbanceModel, disturbance_repair
from mbaid_ros.core.geometry import Array, exp, mirror, rotation_from_quaternion
from mbaid_ros.core.links import densities, known_bodies
from mbaid_ros.core.repair import Conversion, Repair, joined, leading_repair, shown, widened, wider_prior
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import BaseStream, JointStream

NAMES = ('shoulder', 'elbow', 'wrist')
ZERO = Repair('the zero of elbow is off', {'known_joints.elbow.zero_std': 0.05})
AXIS = Repair('the axis of wrist is off', {'known_joints.wrist.axis_std': 0.05})
GRAMS = Repair('link arm is in grams', conversion=Conversion(masses={'arm': 1e-3}))
SIGN = Repair('the sign of elbow is wrong', conversion=Conversion(factors={'elbow': -1.0}))


def joints() -> JointStream:
    """Return three readings of three joints, a second apart."""
    position = np.arange(9.0).reshape(3, 3)
    return JointStream(np.arange(3) * 10**9, position, 10.0 * position)


def converted(conversion: Conversion) -> JointStream:
    """Return them as they are meant."""
    (found,) = conversion.joints({(0, 1, 2): joints()}, NAMES, 3).values()
    return found


@pytest.mark.parametrize(('size', 'declared'), [(0.0302, 0.05), (0.001, 0.002), (0.7, 2.0), (0.0, 0.0), (0.66, 1.0)])
def test_a_declared_deviation_is_larger_than_what_was_found(size: float, declared: float) -> None:
    assert widened(size) == pytest.approx(declared)


def test_a_declared_deviation_stays_below_the_largest_accepted() -> None:
    assert widened(0.9, 1.0) == 1.0


@pytest.mark.parametrize(
    ('torque', 'force', 'value', 'unit'), [(0.3, 0.0, 0.3, 'N m'), (0.0, 2.0, 2.0, 'N'), (0.3, 2.0, 0.3, 'N m')]
)
def test_a_drift_is_declared_by_level_and_time(torque: float, force: float, value: float, unit: str) -> None:
    pushes = (DisturbanceModel(size, 10.0, 'inertial') for size in (torque, force))
    repair = disturbance_repair('something drifts', *pushes)
    assert (repair.cause, repair.value, repair.unit) == ('something drifts', value, unit)
    parts = {'torque': torque, 'force': force}
    assert repair.parameters == {
        f'disturbance.{kind}_{name}': number
        for kind, size in parts.items()
        if size
        for name, number in (('std', size), ('time', 10.0))
    }


def test_a_link_is_declared_as_uncertain_as_its_mass_centre_and_inertia_are_off(servicer7: MomentumKernel) -> None:
    place = servicer7.model.link('link3').body
    before = physical(servicer7.known[place])
    after = before * np.repeat([1.3, 1.0, 1.3], [1, 3, 6])
    after[1:4] += [0.004, -0.03, 0.01]
    moment = np.mean(before[[4, 7, 9]])
    after[5] += 0.2 * moment
    unknown = known_bodies(servicer7.model, servicer7.errors)
    change = standard(after) - servicer7.known[place]
    repair = unknown.repair('link:link3', change, np.full(10, 0.1), servicer7)
    assert repair is not None
    assert repair.value == pytest.approx(0.3 * before[0])
    name = 'known_links.link3'
    declared = {'mass_relative_std': widened(0.3), 'com_std': widened(0.03), 'inertia_relative_std': widened(0.2)}
    assert repair.parameters == pytest.approx({f'{name}.{part}': size for part, size in declared.items()})
    assert unknown.repair('link:link3', -1.1 * servicer7.known[place], np.full(10, 0.1), servicer7) is None


def test_a_link_that_is_described_without_inertia_has_a_repair_all_the_same(servicer7: MomentumKernel) -> None:
    place = servicer7.model.link('link3').body
    point = servicer7.known[place] * (np.arange(10) == 0)  # the mass alone
    change, places = servicer7.known[place] - point, np.arange(len(servicer7.known))[:, None] == place
    wrong = servicer7.with_body_changes(np.where(places, point - servicer7.known, 0.0))
    unknown = known_bodies(servicer7.model, replace(servicer7.errors, factor=np.zeros_like(servicer7.errors.factor)))
    repair = some(unknown.repair('link:link3', 100.0 * change, np.full(10, 0.1), wrong))
    assert some(repair.parameters)['known_links.link3.inertia_relative_std'] == 1.0


def test_a_link_that_is_heavier_throughout_has_a_wider_mass(servicer7: MomentumKernel) -> None:
    unknown, base = densities(servicer7.model, servicer7.known, 2e-4), servicer7.known[0]
    np.testing.assert_allclose(unknown.factor[:10, 0], 2e-4 * base)
    assert not unknown.factor[10:, 0].any()
    repair = some(unknown.repair('density:base_link', 0.15 * base, 0.01 * base, servicer7))
    assert repair.parameters == {'known_links.base_link.mass_relative_std': widened(0.15)}
    assert repair.value == pytest.approx(0.15 * base[0])
    assert unknown.repair('density:base_link', -1.1 * base, 0.01 * base, servicer7) is None


def test_a_sign_and_exchanged_joints_are_converted() -> None:
    read = joints()
    turned = converted(Conversion(factors={'elbow': -1.0}))
    np.testing.assert_array_equal(turned.position, read.position * [1.0, -1.0, 1.0])
    np.testing.assert_array_equal(turned.velocity, read.velocity * [1.0, -1.0, 1.0])
    exchanged = converted(Conversion(columns={'shoulder': 'wrist', 'wrist': 'shoulder'}))
    np.testing.assert_array_equal(exchanged.position, read.position[:, ::-1])


def test_joints_of_several_publishers_are_exchanged_between_them() -> None:
    read = joints()
    shoulder = JointStream(read.stamp, read.position[:, :1], read.velocity[:, :1])
    parts: dict[tuple[int, ...], JointStream] = {(0,): shoulder}
    found = Conversion(columns={'shoulder': 'wrist', 'wrist': 'shoulder'}).joints(parts, NAMES, 3)
    assert list(found) == [(2,)]


def test_late_stamps_are_corrected_and_spoilt_readings_left_out() -> None:
    assert converted(Conversion(delay=0.2)).stamp.tolist() == [-200_000_000, 800_000_000, 1_800_000_000]
    assert converted(Conversion(clock=0.5)).stamp.tolist() == [0, 2_000_000_000, 4_000_000_000]
    assert np.isnan(converted(Conversion(clock=0.5)).velocity).all()
    stepped = converted(Conversion(steps=(('wrist', 10**9, 0.5),)))
    np.testing.assert_array_equal(stepped.position[:, 2], joints().position[:, 2] - [0.0, 0.5, 0.5])
    assert converted(Conversion(left_out=((0.5, 1.5),))).stamp.tolist() == [0, 2_000_000_000]


def test_poses_are_converted_and_their_twist_left_out() -> None:
    quaternion = np.array([[0.1, 0.2, 0.3, 0.9]]) / np.linalg.norm([0.1, 0.2, 0.3, 0.9])
    numbers = np.ones((1, 3))
    read = BaseStream(
        np.zeros(1, dtype=np.int64), numbers, rotation_from_quaternion(np.roll(quaternion, 1)), numbers, numbers,
        np.eye(6)[None], np.eye(6)[None], np.zeros((1, 4), dtype=bool),
    )  # fmt: skip
    found = Conversion(pose='w first').base(read)
    assert found is not None
    np.testing.assert_allclose(found.rotation, rotation_from_quaternion(quaternion), atol=1e-12)
    assert np.isnan(found.linear_velocity).all()
    shorter = Conversion(scale=1e-3).base(read)
    assert shorter is not None
    np.testing.assert_allclose(shorter.position, 1e-3)
    assert Conversion().base(read) is read


def test_poses_of_another_frame_turned_round_or_mirrored_are_those_of_the_base() -> None:
    rng = np.random.default_rng(0)
    rotation, position = exp(rng.normal(size=(5, 3))), rng.normal(size=(5, 3))
    mount = np.array([0.3, -0.4, 0.2, 0.1, 0.2, -0.3])
    turn = exp(mount[:3]).T
    placed, where = rotation @ turn, position - rotation @ turn @ mount[3:]
    read = {
        'as read': (placed, where),
        'turned round': (np.swapaxes(placed, 1, 2), -np.einsum('nji,nj->ni', placed, where)),
        'mirrored y': (mirror(placed, 1), where * [1.0, -1.0, 1.0]),
    }
    for pose, (turned, place) in read.items():
        conversion = Conversion(pose=pose, mount=tuple(mount))  # type: ignore[arg-type]
        found = conversion.base(poses(turned, place))
        assert found is not None
        np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
        np.testing.assert_allclose(found.position, position, atol=1e-12)


def poses(rotation: Array, position: Array) -> BaseStream:
    """Return readings of poses, whose twist is zero."""
    count = len(rotation)
    return BaseStream(
        np.arange(count), position, rotation, np.zeros((count, 3)), np.zeros((count, 3)),
        np.tile(np.eye(6), (count, 1, 1)), np.tile(np.eye(6), (count, 1, 1)), np.zeros((count, 4), dtype=bool),
    )  # fmt: skip


def test_columns_signs_gears_and_zeros_are_converted_together() -> None:
    columns = {'shoulder': 'elbow', 'elbow': 'wrist', 'wrist': 'shoulder'}
    conversion = Conversion(columns=columns, factors={'elbow': -2.0}, zeros={'wrist': 0.5})
    found, read = converted(conversion), joints()
    np.testing.assert_array_equal(found.position, read.position[:, [1, 2, 0]] * [1.0, -2.0, 1.0] + [0.0, 0.0, 0.5])
    np.testing.assert_array_equal(found.velocity, read.velocity[:, [1, 2, 0]] * [1.0, -2.0, 1.0])
    both = Repair('zero', {'known_joints.wrist.zero_std': 0.01}, conversion)
    assert both.how == 'readings are converted, as if known_joints.wrist.zero_std were 0.01'
    assert both.beyond({'known_joints.wrist.zero_std': 1.0}) is not None  # the readings are converted all the same


def test_the_leading_cause_is_repaired_if_no_other_is_as_likely() -> None:
    causes = [('zero', 1000.0), ('axis', 900.0)]
    assert leading_repair(causes, {'zero': ZERO, 'axis': AXIS}) is ZERO
    assert leading_repair(causes, {'axis': AXIS}) is None
    assert leading_repair([], {}) is None


@pytest.mark.parametrize(('unit', 'value', 'repaired'), [('rad', 0.4, True), ('rad', 1.4, False), ('m', 1.4, True)])
def test_no_prior_is_widened_beyond_small_angles(unit: str, value: float, repaired: bool) -> None:
    """An axis that seems to be 80 degrees off stands for another fault."""
    found = Repair('off', {'known_joints.wrist.axis_std': 2.0}, value=(0.0, -value), std=(0.01, 0.01), unit=unit)
    assert (leading_repair([('off', 1000.0)], {'off': found}) is found) is repaired


def test_causes_that_are_as_likely_are_repaired_together_or_not_at_all() -> None:
    causes = [('zero', 1000.0), ('axis', 995.0)]
    remedies = {'zero': ZERO, 'axis': AXIS, 'sign': SIGN}
    together = leading_repair(causes, remedies)
    assert together is not None
    assert together.parameters == {'known_joints.elbow.zero_std': 0.05, 'known_joints.wrist.axis_std': 0.05}
    assert 'elbow is off, or the axis' in together.cause
    assert leading_repair(causes, remedies, several=False) is None
    assert leading_repair([('zero', 1000.0), ('sign', 995.0)], remedies) is None
    assert leading_repair([('zero', 1000.0), ('unknown', 995.0)], remedies) is None


def test_the_likelier_of_two_units_is_the_repair() -> None:
    inches, feet = (Repair(f'{each}', conversion=Conversion(scale=each)) for each in (0.0254, 0.3048))
    remedies = {'inches': inches, 'feet': feet, 'sign': SIGN}
    assert leading_repair([('inches', 1e5), ('feet', 1e5 - 11.0)], remedies) is inches
    assert leading_repair([('inches', 1e5), ('feet', 1e5 - 9.0)], remedies) is None
    assert leading_repair([('inches', 1e5), ('sign', 1e5 - 11.0)], remedies) is None
    assert leading_repair([('sign', 1e5), ('inches', 1e5 - 11.0)], remedies) is None
    assert leading_repair([('inches', 1e5), ('unknown', 1e5 - 11.0)], remedies) is None


def test_a_unit_of_the_description_goes_with_wider_priors_of_as_likely_causes() -> None:
    causes = [('grams', 1000.0), ('zero', 995.0)]
    both = leading_repair(causes, {'grams': GRAMS, 'zero': ZERO})
    assert both is not None
    assert (both.conversion, both.parameters) == (GRAMS.conversion, ZERO.parameters)
    assert not both.by_parameters
    declared = both.beyond({'known_joints.elbow.zero_std': 0.1})
    assert declared is not None
    assert declared.conversion == GRAMS.conversion
    assert both.how == 'the robot description is converted, as if known_joints.elbow.zero_std were 0.05'
    assert leading_repair([*causes, ('sign', 999.0)], {'grams': GRAMS, 'zero': ZERO, 'sign': SIGN}) is None


def test_a_repair_counts_only_as_far_as_it_is_wider_than_what_is_declared() -> None:
    assert ZERO.beyond({'known_joints.elbow.zero_std': 0.1}) is None
    assert ZERO.beyond({'known_joints.elbow.zero_std': 0.01}) == ZERO
    assert ZERO.beyond({'known_joints.zero_std': 0.1}) is None  # of all joints
    assert ZERO.beyond({'known_joints.zero_std': 0.1, 'known_joints.elbow.zero_std': 0.01}) == ZERO
    assert SIGN.beyond({}) == SIGN
    assert str(ZERO) == 'repaired: the zero of elbow is off (as if known_joints.elbow.zero_std were 0.05)'
    assert str(SIGN).endswith('(readings are converted)')


def test_another_clock_leaves_the_speeds_of_wheels() -> None:
    (found,) = Conversion(clock=1.02, origin=10**9).joints({(0, 1, 2): joints()}, NAMES, 2).values()
    assert np.isfinite(found.velocity).all(axis=0).tolist() == [False, False, True]


def test_a_twist_left_out_for_poses_that_were_wrong_is_no_repair_any_more() -> None:
    twist, joint = (
        Repair('twist', conversion=Conversion(with_twist=False)),
        Repair('joint', {'known_joints.zero_std': 1.0}),
    )
    poses, sign = (
        Repair('pose', conversion=each) for each in (Conversion(pose='w first'), Conversion({'elbow': -1.0}))
    )
    assert joined([twist, joint], poses) == (joint, poses)
    assert joined([twist, joint], sign) == (twist, joint, sign)
    assert joined([poses], twist) == (poses, twist)


@pytest.mark.parametrize('of', ['torque', 'force'])
def test_a_force_that_varies_is_no_repair_beside_readings_that_were_wrong(of: str) -> None:
    varying = Repair('drift', {f'disturbance.{of}_std': 5.0})
    constant = Repair('leak', {'disturbance.constant': 'body'})
    sign = Repair('sign', conversion=Conversion({'elbow': -1.0}))
    zero = Repair('zero', {'known_joints.zero_std': 0.1})
    assert joined([varying, constant], sign) == (constant, sign)
    assert joined([varying], zero) == (varying, zero)
    assert joined([sign], varying) == (sign, varying)


def test_times_of_a_repair_count_from_the_first_sample() -> None:
    jump = Repair('jump', conversion=Conversion(steps=(('elbow', 35 * 10**9, 0.1),)), since=35.0)
    counted = jump.since_sample(30 * 10**9)
    assert (counted.since, some(counted.conversion).origin) == (5.0, 30 * 10**9)
    assert counted.conversion == jump.conversion  # the same one, whenever it is found
    assert ZERO.since_sample(7) == ZERO


def test_times_of_a_conversion_count_from_the_first_sample_of_a_run() -> None:
    """Stamps of a clock that starts long before: rates and stretches are about the first sample, steps are stamps."""
    start = 1_700_000_000_000_000_000
    read = replace(joints(), stamp=joints().stamp + start)

    def changed(conversion: Conversion) -> list[float]:
        repair = Repair('', conversion=conversion).since_sample(start)
        found = some(repair.conversion).joints({(0, 1, 2): read}, NAMES, 3)
        return [1e-9 * (stamp - start) for stamp in found[0, 1, 2].stamp.tolist()]

    assert changed(Conversion(clock=0.5)) == [0.0, 2.0, 4.0]
    assert changed(Conversion(left_out=((0.5, 1.5),))) == [0.0, 2.0]
    assert changed(Conversion(left_out=((1.0, 1.0),))) == [0.0, 2.0]  # ends are left out
    stepped = Repair('', conversion=Conversion(steps=(('wrist', start + 10**9, 0.5),)), since=7.0).since_sample(start)
    assert stepped.since == pytest.approx(1.0)
    assert Repair('', conversion=Conversion(delay=0.2), since=7.0).since_sample(start).since == 7.0
    assert Repair('', {'a': 1.0}, since=7.0).since_sample(start).since == 7.0


@pytest.mark.parametrize(
    ('parameters', 'conversion', 'by_parameters', 'leaves_out'),
    [
        ({'imu.use': False}, None, True, True),
        ({'imu.use': False, 'imu.rate': 0.1}, None, True, False),
        ({'imu.use': False}, Conversion(delay=0.1), False, False),
        (None, Conversion(delay=0.1), False, False),
        ({}, None, True, False),
        (None, None, False, False),
    ],
)
def test_a_repair_declares_converts_or_leaves_out(
    parameters: dict[str, Any] | None, conversion: Conversion | None, *, by_parameters: bool, leaves_out: bool
) -> None:
    repair = Repair('a thing', parameters, conversion)
    assert (repair.by_parameters, repair.leaves_out) == (by_parameters, leaves_out)


@pytest.mark.parametrize(
    ('value', 'said'),
    [
        (True, 'true'),
        (False, 'false'),
        (1.0, '1'),
        (0.1234567, '0.123457'),
        ('base', 'base'),
        ((1.5, 2.0, 0.25), '[1.5, 2, 0.25]'),
    ],
)
def test_values_are_shown_as_a_parameter_file_has_them(value: Any, said: str) -> None:
    assert shown(value) == said


@pytest.mark.parametrize(
    ('unit', 'value', 'plausible'),
    [
        ('rad', (0.1, 0.2, 1.4), False),  # the third number is an angle as well
        ('rad, m', (0.1, 0.2, 0.3, 1.4), True),  # and the fourth is not
        ('rad', 1.4, False),
        ('rad', (1.4, 0.1), False),
        ('rad/s', 1.4, True),
        ('', 1.4, True),
    ],
)
def test_angles_alone_are_too_large_for_a_prior(unit: str, value: Any, *, plausible: bool) -> None:
    assert Repair('off', {'a_std': 2.0}, value=value, unit=unit).plausible is plausible
    assert Repair('off', {'a_std': 2.0}, Conversion(delay=0.1), value=value, unit=unit).plausible


def test_a_prior_is_as_wide_as_the_largest_of_its_numbers_of_either_sign() -> None:
    repair = wider_prior('off', 'a_std', np.array([0.01, -0.04, 0.02]), np.array([0.1, 0.2, 0.3]), 'm')
    assert repair.parameters == {'a_std': widened(0.04)}
    assert (repair.value, repair.std, repair.unit) == ((0.01, -0.04, 0.02), (0.1, 0.2, 0.3), 'm')


@pytest.mark.parametrize(('least', 'most'), [(1.01, 1.49), (2.02, 2.98), (0.101, 0.149)])
def test_half_as_much_again_is_rounded_up_to_one_two_or_five(least: float, most: float) -> None:
    for size in (least, most):
        digit = float(f'{widened(size):e}'.partition('e')[0])
        assert digit in {1.0, 2.0, 5.0}
        assert 1.5 * size <= widened(size) < 1.5 * 2.5 * size
    assert widened(2.0 / 1.5) == 2.0  # which is as large as half more


@pytest.mark.parametrize(
    ('given', 'left'),
    [
        ({}, {'known_joints.elbow.zero_std', 'known_joints.elbow.gear'}),
        ({'known_joints.zero_std': 0.05}, {'known_joints.elbow.gear'}),  # of all joints
        ({'known_joints.zero_std': 0.04}, {'known_joints.elbow.zero_std', 'known_joints.elbow.gear'}),
        ({'known_joints.zero_std': 0.05, 'known_joints.elbow.zero_std': 0.0},
         {'known_joints.elbow.zero_std', 'known_joints.elbow.gear'}),
        ({'known_joints.elbow.gear': 3.0}, {'known_joints.elbow.zero_std', 'known_joints.elbow.gear'}),
        ({'known_joints.elbow.gear': 2.0, 'known_joints.elbow.zero_std': 1.0}, None),
    ],
)  # fmt: skip
def test_what_a_user_has_declared_as_wide_is_not_declared_again(given: dict[str, Any], left: set[str] | None) -> None:
    found = Repair('off', {'known_joints.elbow.zero_std': 0.05, 'known_joints.elbow.gear': 2.0}).beyond(given)
    assert (None if found is None else {*some(found.parameters)}) == left
    only = Repair('off', conversion=Conversion(delay=0.1))
    assert only.beyond(given) is only


@pytest.mark.parametrize(
    ('gains', 'kept'),
    [
        ((1000.0, 981.0), 'both'),  # within two hundredths
        ((1000.0, 979.0), 'first'),
        ((100.0, 91.0), 'both'),  # or within ten
        ((100.0, 89.0), 'first'),
    ],
)
def test_causes_are_as_likely_within_a_part_of_their_gain(gains: tuple[float, float], kept: str) -> None:
    zero, axis = replace(ZERO, value=0.02, unit='m'), replace(AXIS, value=0.03, unit='rad')
    found = some(leading_repair([*zip(('zero', 'axis'), gains, strict=True)], {'zero': zero, 'axis': axis}))
    assert (found is zero) == (kept == 'first')
    assert (found.value, found.unit) == (0.02, 'm')
