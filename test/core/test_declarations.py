"""Each unknown's effect on the nominal model, its part in a planar motion, and its words."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic
from mbaid_ros.core.contracts import NominalModel, deviation_text, underestimated_text
from mbaid_ros.core.forces import DisturbanceModel, disturbances, thrusters
from mbaid_ros.core.geometry import Array, crossed, exp, rotate
from mbaid_ros.core.gyro import GyroErrors, gyro
from mbaid_ros.core.passive import implausible_springs, resolved, spring_errors, starting_swing, swing_noise
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import Springs
from mbaid_ros.core.state import UnknownsPrior, in_plane_map
from mbaid_ros.core.target import KnownTarget, TargetPrior, target_changed_text
from observed import MID, configured_motion, kernel, observe

NAMES = ('boom', 'panel')
RATES, RATIOS = np.array([2.0, 3.0]), np.array([0.01, 0.02])


def on_springs() -> NominalModel:
    """Return the planar arm with two passive joints."""
    state = np.array([[0.1, 0.2], [0.3, 0.4]])
    return NominalModel.nominal(kernel('table1').with_springs(Springs((1, 2), RATES, RATIOS, state)))


def test_springs_are_as_much_stiffer_and_more_damped_as_their_errors_say() -> None:
    unknown = spring_errors(NAMES, [0.1, 0.2], [0.01, 0.0])
    assert unknown.factor @ unknown.factor.T == pytest.approx(np.diag([0.01, 1e-4, 0.04, 0.0]))
    assert unknown.causes == ('frequency:boom', 'damping:boom', 'frequency:panel')
    springs = unknown.applied_to(on_springs(), np.array([0.1, 0.005, -0.2, -0.1])).kernel.springs
    assert springs.frequency == pytest.approx(RATES * np.exp([0.1, -0.2]))
    assert springs.damping_ratio == pytest.approx([0.015, 0.0])  # no damper drives
    held = NominalModel.nominal(kernel('table1'))
    assert unknown.applied_to(held, np.ones(4)) is held


def test_a_swing_starts_with_its_own_deflection_and_rate() -> None:
    """As fast as it deflects at its frequency."""
    unknown = starting_swing(NAMES, [0.5, 0.25], RATES)
    assert unknown.factor @ unknown.factor.T == pytest.approx(np.diag([0.5, 1.0, 0.25, 0.75]) ** 2)
    springs = unknown.applied_to(on_springs(), np.array([0.01, 0.02, 0.03, 0.04])).kernel.springs
    assert springs.initial_state == pytest.approx(np.array([[0.11, 0.23], [0.32, 0.44]]))
    assert unknown.linearisation_value(np.ones(4), np.ones(4)).tolist() == [1.0] * 4
    held = NominalModel.nominal(kernel('table1'))
    assert unknown.applied_to(held, np.ones(4)) is held


def test_an_excited_swing_dies_down_by_its_damping() -> None:
    unknown = swing_noise(NAMES, [0.5, 0.0], RATES, RATIOS)
    assert unknown.count == 2
    assert unknown.time_constants == pytest.approx([50.0, 50.0])  # s, of the first: 1 / (ratio rate)
    assert unknown.factor @ unknown.factor.T == pytest.approx(np.diag([0.25, 1.0, 0.0, 0.0]))
    both = swing_noise(NAMES, [0.5, 0.1], RATES, [0.0, 0.02])
    assert both.time_constants == pytest.approx([500.0, 500.0, 1.0 / 0.06, 1.0 / 0.06])  # of a ratio of 1e-3
    # Rates of the size of the stationary ones, 1 and .3 rad/s: half of the variance is in either amplitude.
    found = both.process_variances(np.array([[1.0, 0.3], [2.0, 0.6]]))
    assert found == pytest.approx(np.array([[0.5] * 4, [2.0] * 4]))
    half = swing_noise(NAMES, [0.0, 0.1], RATES, RATIOS)  # the first is exact
    assert half.process_variances(np.array([[1.0, 0.3]])) == pytest.approx(np.array([[0.5] * 2]))
    assert both.linearisation_value(np.ones(4), np.ones(4)).tolist() == [0.0] * 4
    nominal = on_springs()
    assert both.applied_to(nominal, np.ones(4)) is nominal


@pytest.mark.parametrize(
    ('relative', 'seconds', 'known'),
    [
        (0.1, 1.0, [True, True]),  # phases of .2 and .3 rad
        (0.15, 1.0, [True, False]),
        (0.1, 100.0, [False, False]),
        (0.001, 1000.0, [True, True]),  # a swing keeps its phase for 3 / ratio: .3 and .15 rad
        (0.002, 1000.0, [False, True]),
    ],
)
def test_a_frequency_is_resolved_while_its_phase_is_known(relative: float, seconds: float, known: list[bool]) -> None:
    assert resolved(RATES, RATIOS, np.full(2, relative), seconds).tolist() == known


def test_a_corrected_sample_is_of_the_bases_own_frame() -> None:
    nominal = NominalModel.nominal(kernel('servicer7'))
    samples = observe(configured_motion('servicer7', 0.2, 20.0), MID)
    assert nominal.corrected(samples) is samples
    mount, zeros = 0.1 * generic(0, 6), 0.1 * generic(1, 7)
    for moved in (
        NominalModel(nominal.kernel, zeros, mount, 0.0),
        NominalModel(nominal.kernel, zeros * 0.0, mount, 0.0),
        NominalModel(nominal.kernel, zeros, mount * 0.0, 0.0),
    ):
        found, away = moved.corrected(samples), rotate(samples.base_rotation, moved.mount[None, 3:])
        assert found.joint_position == pytest.approx(samples.joint_position + moved.zeros)
        assert found.base_position == pytest.approx(samples.base_position + away)
        assert found.base_rotation == pytest.approx(samples.base_rotation @ exp(moved.mount[:3]))
        faster = np.cross(samples.base_angular_velocity, away)
        assert found.base_linear_velocity == pytest.approx(samples.base_linear_velocity + faster)
        assert found.base_angular_velocity is samples.base_angular_velocity


def test_numbers_drawn_anew_are_independent_of_the_others() -> None:
    before = UnknownsPrior(generic(0, 3), generic(1, 3, 3))
    after = before.drawn_anew(np.array([False, True, False]))
    covariance = before.factor @ before.factor.T
    covariance[1] = covariance[:, 1] = [0.0, 1.0, 0.0]
    assert after.factor @ after.factor.T == pytest.approx(covariance)
    assert after.mean == pytest.approx(before.mean * [1.0, 0.0, 1.0])
    assert before.drawn_anew(np.zeros(3, dtype=bool)) is before
    first, second = generic(2, 1, 2), generic(3, 2, 1)
    mapped = before.of([first, second])
    whole = np.array([[*first[0], 0.0], [0.0, 0.0, second[0, 0]], [0.0, 0.0, second[1, 0]]])
    assert mapped.mean == pytest.approx(whole @ before.mean)
    assert mapped.factor == pytest.approx(whole @ before.factor)


def test_the_nominal_model_is_at_the_mean_of_each_unknown() -> None:
    two = starting_swing(NAMES, [0.5, 0.25], RATES), spring_errors(NAMES, [0.1, 0.2], [0.01, 0.03])
    prior = UnknownsPrior(generic(0, 8), np.eye(8))
    springs = prior.nominal_model(on_springs().kernel, two).kernel.springs
    assert springs.initial_state[1] == pytest.approx(np.array([0.3, 0.4]) + prior.mean[[1, 3]] * [1.0, 0.75])
    assert springs.frequency == pytest.approx(RATES * np.exp(prior.mean[[4, 6]] * [0.1, 0.2]))


PLANE = PlaneDetector(kernel('table1').model)


def test_a_gyro_in_a_plane_reads_about_the_normal() -> None:
    unknown = gyro(GyroErrors(bias=0.1, scale=0.2, orientation=0.3, delay=0.4, walk=0.5, cross=0.6))
    assert np.diag(unknown.factor) == pytest.approx([*[0.1] * 3, *[0.2] * 3, *[0.3] * 3, *[0.6] * 3, 0.4])
    assert unknown.random_walk[:3] == pytest.approx(0.5 * np.eye(3))
    seen = unknown.in_plane(PLANE)
    normal = np.array([0.0, 0.0, 1.0])
    assert seen.factor @ seen.factor.T == pytest.approx(
        np.diag([*0.01 * normal, *0.04 * normal, *[0.0] * 6, 0.16]), abs=1e-15
    )
    assert seen.random_walk @ seen.random_walk.T == pytest.approx(np.diag([*0.25 * normal, *[0.0] * 10]))
    assert gyro(GyroErrors(bias=0.1)).in_plane(PLANE).random_walk.shape == (13, 0)
    to_plane = in_plane_map(unknown, seen)
    assert seen.factor @ to_plane @ to_plane.T @ seen.factor.T == pytest.approx(seen.factor @ seen.factor.T)
    assert in_plane_map(seen, seen).tolist() == np.eye(3).tolist()


def test_scales_of_a_gyro_are_about_its_own_axes() -> None:
    axes, rate, errors = exp(generic(0, 3)), generic(1, 3), generic(2, 6)
    unknown = gyro(GyroErrors(scale=0.2, cross=0.6, axes=axes))
    sensitivity = np.diag(0.2 * errors[:3]) + 0.6 * crossed(errors[3:])
    numbers = unknown.factor @ errors
    read = numbers[3:6] * rate + crossed(rate) @ numbers[9:12]
    assert read == pytest.approx(axes @ sensitivity @ axes.T @ rate)
    seen = unknown.in_plane(PLANE).factor
    normal = np.array([0.0, 0.0, 1.0])
    about_normal = [seen[3:6].T @ normal**2, seen[9:12].T @ crossed(normal) @ normal]
    along = axes.T @ normal
    assert np.sum(np.sum(about_normal, axis=0) ** 2) == pytest.approx(
        0.04 * np.sum(along**4) + 0.36 * np.sum((crossed(along) @ along) ** 2)
    )


def test_a_gyro_is_linear_unless_it_alone_observes_the_orientation() -> None:
    nominal, numbers = NominalModel.nominal(kernel('table1')), generic(0, 13)
    beside, alone = (gyro(GyroErrors(0.1, 0.2, 0.3, 0.4, cross=0.6, alone=each)) for each in (False, True))
    assert not beside.linearisation_value(numbers, np.ones(13)).any()
    assert beside.applied_to(nominal, numbers) is nominal
    assert alone.linearisation_value(numbers, np.ones(13)) == pytest.approx([*numbers[:12], 0.0])
    assert alone.applied_to(nominal, numbers).gyro == pytest.approx(numbers[:12])


@pytest.mark.parametrize('axes', ['body', 'inertial'])
def test_a_push_in_a_plane_has_one_torque_and_two_forces(axes: str) -> None:
    tilt = exp(np.array([0.5, -0.3, 0.2]))
    detector = PlaneDetector(kernel('table1').model)
    still = observe(configured_motion('table1', 0.2, 20.0), MID)
    rate = rotate(tilt, still.base_angular_velocity)
    detector.update(replace(still, base_rotation=tilt @ still.base_rotation, base_angular_velocity=rate))
    push = DisturbanceModel(0.5, 30.0, axes)  # type: ignore[arg-type]
    torque, force = disturbances(push, push)
    normal = tilt[:, 2] if axes == 'inertial' else np.array([0.0, 0.0, 1.0])
    about, within = torque.plane_basis(detector), force.plane_basis(detector)
    assert about @ about.T == pytest.approx(np.outer(normal, normal), abs=1e-12)
    assert within @ within.T == pytest.approx(np.eye(3) - np.outer(normal, normal), abs=1e-12)


def test_thrust_that_was_brought_is_taken_off_and_errors_of_thrusters_add_up() -> None:
    unknown = thrusters(['left', 'right'], [(0.1, 0.2, 0.3)] * 2)
    assert np.diag(unknown.factor) == pytest.approx([0.1, 0.2, 0.2, 0.2, 0.3] * 2)
    states: Any = SimpleNamespace(thrust=generic(0, 2, 2, 6, 5))
    nominal = NominalModel.nominal(kernel('table1'))
    columns = unknown.momentum_columns(nominal.kernel, states)
    assert columns[1][:, 7] == pytest.approx(-states.thrust[1, 1, :, 2])
    once = unknown.applied_to(nominal, generic(1, 10))
    assert once.thrust == pytest.approx(generic(1, 10))
    assert unknown.applied_to(once, generic(2, 10)).thrust == pytest.approx(generic(1, 10) + generic(2, 10))


def prior_of(target: TargetPrior | KnownTarget) -> tuple[Array, Array]:
    """Return the mean and the covariance of a body whose numbers are unknown otherwise."""
    mean, factor = np.zeros(10), np.diag(np.full(10, 30.0))
    target.apply(mean, factor)
    return mean, factor @ factor.T


def test_the_prior_of_a_target() -> None:
    """Var(h) = m^2 Var(c) + c c^T Var(m), Cov(m, h) = c Var(m); the moments are as unknown as before."""
    mean, covariance = prior_of(TargetPrior(50.0, 2.0, (0.1, -0.2, 0.3), 0.01))
    centre = np.array([0.1, -0.2, 0.3])
    assert mean == pytest.approx([50.0, *(50.0 * centre), *[0.0] * 6])
    assert covariance[0, :4] == pytest.approx([4.0, *(4.0 * centre)])
    assert covariance[1:4, 1:4] == pytest.approx(0.25 * np.eye(3) + 4.0 * np.outer(centre, centre))
    assert covariance[4:, 4:] == pytest.approx(900.0 * np.eye(6))
    assert not covariance[:4, 4:].any()
    assert prior_of(TargetPrior(50.0, 2.0))[1][1:, 1:] == pytest.approx(900.0 * np.eye(9))
    nothing = TargetPrior(50.0, 0.0, (0.1, 0.0, 0.0), 0.01)
    assert not nothing.declared
    assert not prior_of(nothing)[0].any()
    known = KnownTarget(generic(0, 10), generic(1, 10, 10))
    mean, covariance = prior_of(known)
    assert mean == pytest.approx(known.parameters)
    assert covariance == pytest.approx(known.factor @ known.factor.T)


def test_a_part_of_an_unknown_has_the_numbers_of_one_cause() -> None:
    unknown = spring_errors(NAMES, [0.1, 0.2], [0.01, 0.03])
    part = unknown.part('frequency:panel')
    assert part.factor @ part.factor.T == pytest.approx(np.diag([0.0, 0.0, 0.04, 0.0]))


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (underestimated_text('zero', 3.04), "the joints' zeros look 3.0 times as far off as specified"),
        (underestimated_text('zero:elbow', 25.2), 'the zero of elbow looks 25 times as far off'),
        (underestimated_text('odometry scale', 96.0), 'scale) look 100 or more times as far off as specified'),
        (underestimated_text('zero', 9.4), 'raise known_joints.zero_std'),
        (deviation_text('link:arm', np.array([-2.0, 0.1, 0.2, 0.3, *[0.0] * 6])), 'it looks 2 kg lighter'),
        (deviation_text('density:arm', np.array([2.0, *[0.0] * 9])), 'link arm is 2 kg heavier than described'),
        (deviation_text('link:arm', np.array([2.0, 0.1, 0.2, 0.3, *[0.0] * 6])), 'it looks 2 kg heavier'),
        (deviation_text('origin:elbow', np.array([3e-3, 4e-3, 0.0])), 'the origin of elbow is off by 5 mm'),
        (deviation_text('zero:elbow', np.array([3e-3])), 'the zero of elbow is off by +3 mrad (mm)'),
        (deviation_text('mount', np.array([3e-3, 4e-3, 0.0, 0.0, 0.0, 0.02])), 'is mounted 20 mm and 5 mrad off'),
        (deviation_text('what', np.array([3.0, 4.0])), 'what is off by 5'),
        (target_changed_text(3.0, exchanged=True), 'another body is in the grasp since 3.0 s'),
        (target_changed_text(3.0, exchanged=False), 'the body moved in the grasp at 3.0 s'),
    ],
)
def test_what_is_off_is_said_with_its_value(text: str, words: str) -> None:
    assert words in text


def layout_of_springs() -> Any:
    """Return a layout whose third to sixth numbers are errors of two springs."""
    springs, limits = on_springs().kernel.springs, [SimpleNamespace(lower=-3.14, upper=3.0)] * 3
    unknown = spring_errors(NAMES, [0.1, 0.2], [0.01, 0.02])
    kernel = SimpleNamespace(model=SimpleNamespace(limits=limits), springs=springs)
    return SimpleNamespace(kernel=kernel, unknowns=(unknown,), places=(slice(2, 6),))


@pytest.mark.parametrize(
    ('frequency', 'deflection', 'seen', 'texts'),
    [
        (2.9, 0.1, True, []),
        (-3.1, 0.1, True, ['boom would swing at 0.233 Hz, 3.1 standard deviations from flexible.boom.frequency']),
        (-3.1, 0.1, False, []),
        (0.0, 2.9, True, []),
        (0.0, 3.1, True, ['boom would swing by 3.1 rad (m), beyond its limits in the URDF, -3.14 to 3']),
    ],
)
def test_a_passive_joint_contradicts_its_declaration_by_its_frequency_or_its_limits(
    frequency: float, deflection: float, texts: list[str], *, seen: bool
) -> None:
    state = np.zeros(6)
    state[2] = frequency
    joints: list[Any] = [SimpleNamespace(joint=name, deflection=deflection * (name == 'boom')) for name in NAMES]
    reasons = implausible_springs(state, layout_of_springs(), joints, np.array([seen, True]))
    assert [each.text.split(', 0.318')[0].split(':')[0] for each in reasons] == texts
    assert [each.gain for each in reasons] == pytest.approx([4.805 if frequency else 4.5][: len(texts)])


def test_a_passive_joint_is_named_with_its_own_frequency() -> None:
    """Of two joints whose damping ratios are off as well, each by exp of its relative error times as fast."""
    joints: list[Any] = [SimpleNamespace(joint=name, deflection=0.0) for name in NAMES]
    state = np.array([0.0, 0.0, 4.0, 1.5, -5.0, 2.5])
    reasons = implausible_springs(state, layout_of_springs(), joints, np.array([True, True]))
    frequencies = RATES / (2.0 * np.pi) * np.exp([0.1 * 4.0, 0.2 * -5.0])
    for rate, reason in zip(frequencies, reasons, strict=True):
        assert f'would swing at {rate:.3g} Hz' in reason.text
