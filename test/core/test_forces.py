"""Commanded thrust: its impulse, whatever the frame; and reaction wheels, as joints or inside the base."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.honesty.disturbed import AXES
from checked import generic, same
from floating import float_freely, follow, make, normalised, true_momentum
from mbaid_ros.core import forces
from mbaid_ros.core.clocks import time_offset
from mbaid_ros.core.forces import (
    FAR_THRUST,
    NOT_FINITE_THRUST,
    UNKNOWN_FRAME,
    DisturbanceConfig,
    DisturbanceModel,
    Thrust,
    declared_disturbances,
    disturbances,
    thrusters,
)
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.orbit import OrbitConfig
from mbaid_ros.core.repair import widened
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel, Storage
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import Declared
from mbaid_ros.core.wheels import make_storage, spin_inertias
from mbaid_ros.errors import ParameterError
from mbaid_ros.simulation.environment import Environment, Wheels
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from observed import LIMIT, MID, estimator, kernel, observe, windows
from servicers import FORCE_TORQUE, OFF, ON, pushed, spinning, unaware, wheeled
from simulated import robot, state
from unchanged import Unchanged

EPOCH = 1_700_000_000_000_000_000  # ns
ZERO = np.zeros(6)


def ns(time: float) -> int:
    return EPOCH + round(time * 1e9)


def thrust_of() -> Thrust:
    thrust = Thrust(robot('servicer7'))
    thrust.odometry_frame = 'odom'
    return thrust


def samples() -> Samples:
    return observe(pushed(), MID)


def impulses(thrust: Thrust, parts: list[Samples]) -> Array:
    return np.concatenate([thrust.with_momentum(part, EPOCH).impulse for part in parts])


def test_the_impulse_is_what_the_momentum_changes_by() -> None:
    momentum = true_momentum(kernel('servicer7'), samples())
    change = momentum - momentum[0]
    found = impulses(make_pulsed(), windows(samples()))
    # The integrator's steps smear the ends of the pulse by a hundredth of a second.
    assert found == pytest.approx(change, abs=0.04)
    after = samples().time > OFF + 0.02
    assert found[after] == pytest.approx(change[after], abs=2e-3)


def make_pulsed(frame: str = 'base_link') -> Thrust:
    thrust = thrust_of()
    thrust.add_command(frame, ns(ON), FORCE_TORQUE, None)
    thrust.add_command(frame, ns(OFF), ZERO, None)
    return thrust


def test_the_odometry_frame_is_fixed() -> None:
    found = impulses(make_pulsed('odom'), [samples()])
    assert found[-1] == pytest.approx((OFF - ON) * FORCE_TORQUE)


def test_a_link_s_force_acts_where_the_link_is() -> None:
    thrust = thrust_of()
    thrust.add_command('link7', ns(ON), np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]), None)
    thrust.add_command('link7', ns(ON + 0.04), ZERO, None)
    found = impulses(thrust, [samples()])[-1]
    middle = samples()[round(ON * 25.0) : round(ON * 25.0) + 1]
    state = kernel('servicer7').states(middle)
    force = 0.08 * state.rotation[0] @ [0.0, 0.0, 1.0]
    place = middle.base_position[0] + state.position[0]
    assert found == pytest.approx(np.concatenate((force, np.cross(place, force))), abs=2e-3)


def test_a_command_ends_after_the_hold_or_by_the_next() -> None:
    thrust = thrust_of()
    thrust.add_command('odom', ns(1.0), FORCE_TORQUE, None)
    thrust.add_command('odom', ns(1.75), FORCE_TORQUE, None)
    thrust.add_command('link1', ns(1.2), ZERO, None)  # another thruster
    assert impulses(thrust, [samples()])[-1] == pytest.approx(1.75 * FORCE_TORQUE)


def test_what_acted_before_the_first_sample_does_not_count() -> None:
    thrust = thrust_of()
    thrust.add_command('odom', ns(-0.3), FORCE_TORQUE, None)
    found = impulses(thrust, [samples()])
    assert found[0] == pytest.approx(ZERO)
    assert found[-1] == pytest.approx(0.7 * FORCE_TORQUE)


def test_late_commands_count_from_then_on() -> None:
    in_time, late = make_pulsed(), thrust_of()
    expected = impulses(in_time, windows(samples()))
    parts = windows(samples())
    first = impulses(late, parts[:22])  # until 11 s
    late.add_command('base_link', ns(OFF), ZERO, None)
    late.add_command('base_link', ns(ON), FORCE_TORQUE, None)
    assert late.late
    rest = impulses(late, parts[22:])
    assert np.all(first == 0.0)
    assert rest == pytest.approx(expected[len(first) :], abs=1e-12)
    assert not in_time.late


def test_commands_that_are_forgotten_have_acted(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a second each; the last one is kept."""
    monkeypatch.setattr(forces, '_REMEMBERED', 2 * 10**9)
    thrust, wrenches = thrust_of(), generic(3, 12, 6)
    for second, wrench in enumerate(wrenches):
        thrust.add_command('odom', ns(0.7 + second), wrench, None)
    assert impulses(thrust, windows(samples()))[-1] == pytest.approx(np.sum(wrenches, axis=0))
    assert [each.stamp for each in thrust._commands['odom']] == [ns(11.7)]


def commands(thrust: Thrust, *wrenches: Array, count: int = 90) -> str:
    for index in range(count):
        thrust.add_command('base_link', ns(1.0 + 0.02 * index), wrenches[index % len(wrenches)], None)
    return thrust.shared


def test_two_publishers_of_one_frame_are_reported() -> None:
    force, torque = FORCE_TORQUE * [1, 1, 1, 0, 0, 0], FORCE_TORQUE * [0, 0, 0, 1, 1, 1]
    assert commands(thrust_of(), force, torque) == 'base_link'
    assert commands(thrust_of(), *[force] * 5, torque) == 'base_link'  # at another rate
    assert commands(thrust_of(), force, torque, count=11) == ''  # nine of each between two of the other
    assert commands(thrust_of(), force, torque, count=12) == 'base_link'
    assert commands(thrust_of(), force, ZERO) == ''  # pulses
    assert commands(thrust_of(), force, FORCE_TORQUE) == ''
    assert commands(thrust_of(), *[force] * 10, *[torque] * 10, count=400) == ''  # one that does this, and then that


def test_commands_that_cannot_be_used_are_counted() -> None:
    thrust = thrust_of()
    thrust.add_command('base_link', ns(1.0), np.full(6, np.nan), ns(1.0))
    thrust.add_command('moon', ns(1.0), FORCE_TORQUE, ns(1.0))
    thrust.add_command('base_link', 5_000_000_000, FORCE_TORQUE, ns(1.0))
    assert thrust.dropped == {NOT_FINITE_THRUST: 1, UNKNOWN_FRAME: 1, FAR_THRUST: 1}
    assert thrust.commands == 0
    unknown = Thrust(robot('servicer7'))
    unknown.add_command('moon', ns(1.0), FORCE_TORQUE, ns(1.0))
    unknown.odometry_frame = 'odom'
    assert np.all(impulses(unknown, [samples()]) == 0.0)
    assert unknown.dropped == {UNKNOWN_FRAME: 1}


SECONDS = 20.0


@pytest.fixture(scope='module')
def run(joints: Sinusoids) -> Truth:
    momentum = np.array([16.0, -8.0, 24.0, 30.0, -35.0, 60.0])
    return float_freely(wheeled(), spinning(joints), momentum, SECONDS)


SPIN = 0.05  # kg m^2, as the description of the wheels has it
UNIT = np.array(AXES) / np.sqrt(3.0)
NAMES = ('wheel0', 'wheel1', 'wheel2', 'wheel3')


@cache
def bare() -> MomentumKernel:
    return MomentumKernel(load_model(unaware()), 'link7')


def reading(noise: float = 0.0, factor: float = 1.0) -> MomentumKernel:
    """Return it with the wheels' speeds read; their spin inertias taken for `factor` times what they are."""
    base = bare().model.link('base_link')
    return bare().with_storage(Storage.from_wheels(base, NAMES, UNIT, [factor * SPIN] * 4, noise))


def inside(run: Truth, seed: int | None = None, noise: float = 0.0) -> Samples:
    """Return what sensors tell of a robot whose wheels are inside, their speeds with a noise (rad/s)."""
    names = wheeled().model.joint_names
    wheel = np.array([name.startswith('wheel') for name in names])
    speeds = run.joint_velocity[:, wheel]
    alone = replace(
        run,
        joint_position=run.joint_position[:, ~wheel],
        joint_velocity=run.joint_velocity[:, ~wheel],
        joint_effort=run.joint_effort[:, ~wheel],
    )
    rng = np.random.default_rng([7, seed or 0])
    return replace(observe(alone, MID, seed), stored=speeds + noise * rng.normal(size=speeds.shape))


def test_the_momentum_is_that_of_wheels_that_are_joints(run: Truth) -> None:
    with_wheels = true_momentum(reading(), inside(run))
    assert with_wheels == pytest.approx(true_momentum(wheeled(), observe(run, MID)), abs=1e-9)
    # Each stores up to 5 N m s: without them the momentum is nowhere near constant.
    without = true_momentum(bare(), replace(inside(run), stored=np.zeros((len(run), 0))))
    assert np.ptp(without[:, 3:], axis=0).max() > 5.0


@pytest.mark.parametrize('method', ['difference', pytest.param('trajectory', marks=pytest.mark.long)])
def test_noisy_speeds_widen_the_intervals_as_they_should(run: Truth, method: str) -> None:
    """With tachometers this bad, intervals that took them for exact would be far too narrow."""
    noise, squares = 3.0, []
    for seed in range(4):
        parts = windows(inside(run, seed, noise))
        reported = estimator(reading(noise), MID, method=method).update(parts, 0)[-1]
        assert reported.status in {'estimating', 'converged'}
        squares.append(normalised(reported, reading()))
        taken_for_exact = estimator(reading(), MID, method=method).update(parts, 0)[-1]
        assert taken_for_exact.status == 'inconsistent' or normalised(taken_for_exact, reading()) > LIMIT
    assert chi2.ppf(1e-3, 40) < sum(squares) < chi2.isf(1e-3, 40)


@pytest.mark.parametrize('seeds', [1, pytest.param(3, marks=pytest.mark.long)])
def test_a_wrong_spin_inertia_with_its_prior(run: Truth, seeds: int, unchanged: Unchanged) -> None:
    """5 % off: with the prior the intervals hold, and the spin inertias are found; without it they do not hold."""
    wrong = reading(factor=1.05)
    declared = Declared((spin_inertias(wrong, (0.05 * SPIN,) * 4), time_offset(0.02)))
    squares = []
    for seed in range(seeds):
        method = make(wrong, MID, declared=declared)
        last = unchanged.course(method.update(windows(inside(run, seed)), 0))
        squares.append(normalised(last, wrong))
        assert last.status in {'estimating', 'converged'}
        assert last.budget is not None
        assert {f'wheel:{name}' for name in NAMES} <= set(last.budget.causes)
    assert sum(squares) < chi2.isf(1e-3, 10 * seeds)
    assert normalised(follow(wrong, inside(run, 0), MID)[-1], wrong) > 10.0 * LIMIT


def ramped() -> Wheels:
    start, slope = np.array([10.0, -20.0, 5.0, 0.0]), np.array([2.0, 1.0, -1.5, 0.0])
    return Wheels(NAMES, UNIT, np.full(4, SPIN), start, slope)


def test_simulated_wheels_exchange_momentum(joints: Sinusoids) -> None:
    wheels, model = ramped(), bare().model
    start = state(joints.start, joints.reference(0.0)[1], (0.02, -0.03, 0.04), 0.1)
    truth = Simulation(model, joints, start, environment=Environment(wheels)).advance(np.arange(200) * 0.1)
    total = total_momentum(model, truth, wheels)
    assert total == pytest.approx(np.broadcast_to(total[0], total.shape), abs=1e-8)
    assert np.ptp(total_momentum(model, truth)[:, 3:], axis=0).max() > 1.0
    assert truth.wheel_speed == pytest.approx(wheels.speeds(truth.time), abs=1e-9)
    # A later begin makes no difference.
    later = wheels.from_time(7.0)
    assert later.speeds(np.array([0.0, 4.0])) == pytest.approx(wheels.speeds(np.array([7.0, 11.0])), rel=1e-12)


@pytest.mark.parametrize(
    ('names', 'axes', 'inertias', 'said'),
    [
        (['a'], [0.0, 0.0, 0.0], [0.1], "'wheels.axes' is [0.0, 0.0, 0.0]"),
        (['a', 'b'], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.1, 0.1], 'not all of them 0'),
        (['a'], [1.0, 0.0], [0.1], "'wheels.axes' has 2 numbers; accepted: 3"),
        (['a'], [1.0, 0.0, 0.0], [], "'wheels.spin_inertias' has 0 numbers; accepted: 1"),
        (['a', 'a'], [1.0, 0.0, 0.0] * 2, [0.1, 0.1], "'wheels.names' is a, a"),
        (['a', 'joint1'], [1.0, 0.0, 0.0] * 2, [0.1, 0.1], "'wheels.names' is a, joint1"),
    ],
)
def test_wheels_that_cannot_be_are_refused(
    names: list[str], axes: list[float], inertias: list[float], said: str
) -> None:
    with pytest.raises(ParameterError) as error:
        make_storage(names, axes, inertias, robot('servicer7'))
    assert said in str(error.value)


def test_wheels_spin_about_their_axes_of_any_length() -> None:
    model = robot('servicer7')
    made = make_storage(['a', 'b'], [2.0, 0.0, 0.0, 0.0, -3.0, 4.0], [0.5, 0.25], model, 0.1)
    unit = np.array([[1.0, 0.0, 0.0], [0.0, -0.6, 0.8]])
    expected = Storage.from_wheels(model.link(model.base_link), ['a', 'b'], unit, [0.5, 0.25], 0.1)
    assert same(made, expected)


def test_a_torque_and_a_force_change_the_momentum_as_they_do_at_the_centre_of_mass() -> None:
    """In inertial axes and in those of the base; a force acts through the common centre of mass."""
    whole, rotation = generic(1, 2, 10), exp(generic(2, 2, 3))
    whole[:, 0] = 3.0, 7.0
    for axes, turned in (('inertial', np.tile(np.eye(3), (2, 1, 1))), ('body', rotation)):
        torque, force = disturbances(*(DisturbanceModel(1.0, 0.0, axes) for _ in range(2)))  # type: ignore[arg-type]
        given = whole, np.zeros(3), np.zeros(2), rotation
        push = generic(3, 3)
        pushed, twisted = force.momentum_rates(*given) @ push, torque.momentum_rates(*given) @ push
        for place in range(2):
            acting = turned[place] @ push
            centre = whole[place, 1:4] / whole[place, 0]
            assert pushed[place] == pytest.approx(np.concatenate((acting, np.cross(centre, acting))))
            assert twisted[place] == pytest.approx(np.concatenate((np.zeros(3), acting)))


@pytest.mark.parametrize(
    ('off', 'parameters'),
    [
        ((0.35, 0.0, 0.0, 0.0, 0.0), ['scale_std']),
        ((0.25, 0.0, 0.0, 0.0, 0.0), ['scale_std']),  # none is far off: the furthest
        ((0.25, 0.0, 0.14, 0.0, 0.0), ['direction_std']),
        ((-0.35, 0.0, -0.16, 0.01, 0.0), ['scale_std', 'direction_std']),
        ((0.0, 0.0, 0.0, 0.0, -0.07), ['delay_std']),
        ((0.1, 0.16, 0.0, 0.0, 0.07), ['direction_std', 'delay_std']),
    ],
)
def test_numbers_of_a_thruster_that_are_three_deviations_off_are_declared_wider(
    off: tuple[float, ...], parameters: list[str]
) -> None:
    """Of the second thruster of two, with a tenth of scale, .05 rad and .02 s."""
    unknown = thrusters(['link1', 'link3'], [(0.5, 0.5, 0.5), (0.1, 0.05, 0.02)])
    value = np.array(off)
    repair = unknown.repair('thrust:link3', value, 0.01 * np.arange(1.0, 6.0), kernel('servicer7'))
    sizes = {'scale_std': value[:1], 'direction_std': value[1:4], 'delay_std': value[4:]}
    assert repair.parameters == {
        f'thrust.link3.{name}': widened(float(np.abs(sizes[name]).max())) for name in parameters
    }
    assert (repair.value, repair.std) == (off[0], 0.01)


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ({'torque_time': 0.4}, "'disturbance.torque_time' is 0.4 s; accepted: 0, or at least window, 0.5 s"),
        ({'force_time': 0.4}, "'disturbance.force_time' is 0.4 s"),
        ({'torque_time': 0.5, 'force_time': 0.0}, ''),
        ({'axes': 'orbit'}, "'disturbance.axes' is 'orbit'"),
        ({'axes': 'orbit', 'mean_motion': 1e-3}, ''),
        ({'axes': 'orbit', 'mean_motion': 1e-3, 'epoch': 5.0}, "'disturbance.axes' is 'orbit'"),
        ({'axes': 'inertial', 'epoch': 5.0}, ''),
    ],
)
def test_forces_from_outside_vary_slowly_and_have_the_axes_of_an_orbit_that_is_known(
    given: dict[str, Any], said: str
) -> None:
    orbit = OrbitConfig(
        mean_motion=given.pop('mean_motion', 0.0), epoch=given.pop('epoch', 0.0), nadir=(1.0, 0.0, 0.0),
        normal=(0.0, 0.0, 1.0),
    )  # fmt: skip
    config = DisturbanceConfig(torque_std=0.1, force_std=0.2, **given)
    if said:
        with pytest.raises(ParameterError) as error:
            declared_disturbances(config, orbit, 0.5, located=True)
        assert said in str(error.value)
        return
    torque, force = declared_disturbances(config, orbit, 0.5, located=True)
    assert (torque.model.deviation, force.model.deviation) == (0.1, 0.2)
    assert (torque.model.orbit is not None) is (config.axes == 'orbit')
    assert declared_disturbances(config, orbit, 0.5, located=False)[1].count == 0
