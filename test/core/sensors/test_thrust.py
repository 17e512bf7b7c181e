"""Commanded thrust: the impulse it brings, whatever the frame, the hold, the order or the cut."""

from __future__ import annotations

import numpy as np
import pytest

from floating import true_momentum
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.external_momentum import FAR_THRUST, NOT_FINITE_THRUST, UNKNOWN_FRAME, Thrust
from observed import MID, kernel, observe, windows
from simulated import robot
from thrusting import FORCE_TORQUE, OFF, ON, pushed

EPOCH = 1_700_000_000_000_000_000  # ns
ZERO = np.zeros(6)


def ns(time: float) -> int:
    return EPOCH + round(time * 1e9)


def make() -> Thrust:
    thrust = Thrust(robot('servicer7'))
    thrust.odometry_frame = 'odom'
    return thrust


def samples() -> Samples:
    return observe(pushed(), MID)


def impulses(thrust: Thrust, parts: list[Samples]) -> Array:
    return np.concatenate([thrust.applied(part, EPOCH).impulse for part in parts])


def test_the_impulse_is_what_the_momentum_changes_by() -> None:
    momentum = true_momentum(kernel('servicer7'), samples())
    change = momentum - momentum[0]
    found = impulses(make_pulsed(), windows(samples()))
    # The integrator's steps smear the ends of the pulse by a hundredth of a second.
    assert found == pytest.approx(change, abs=0.04)
    after = samples().time > OFF + 0.02
    assert found[after] == pytest.approx(change[after], abs=2e-3)


def make_pulsed(frame: str = 'base_link') -> Thrust:
    thrust = make()
    thrust.command(frame, ns(ON), FORCE_TORQUE, None)
    thrust.command(frame, ns(OFF), ZERO, None)
    return thrust


def test_the_odometry_frame_is_fixed() -> None:
    found = impulses(make_pulsed('odom'), [samples()])
    assert found[-1] == pytest.approx((OFF - ON) * FORCE_TORQUE)


def test_a_link_s_force_acts_where_the_link_is() -> None:
    thrust = make()
    thrust.command('link7', ns(ON), np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]), None)
    thrust.command('link7', ns(ON + 0.04), ZERO, None)
    found = impulses(thrust, [samples()])[-1]
    middle = samples()[round(ON * 25.0) : round(ON * 25.0) + 1]
    state = kernel('servicer7').states(middle)
    force = 0.08 * state.rotation[0] @ [0.0, 0.0, 1.0]
    place = middle.base_position[0] + state.position[0]
    assert found == pytest.approx(np.concatenate((force, np.cross(place, force))), abs=2e-3)


def test_a_command_ends_after_the_hold_or_by_the_next() -> None:
    thrust = make()
    thrust.command('odom', ns(1.0), FORCE_TORQUE, None)
    thrust.command('odom', ns(1.75), FORCE_TORQUE, None)
    thrust.command('link1', ns(1.2), ZERO, None)  # another thruster
    assert impulses(thrust, [samples()])[-1] == pytest.approx(1.75 * FORCE_TORQUE)


def test_what_acted_before_the_first_sample_does_not_count() -> None:
    thrust = make()
    thrust.command('odom', ns(-0.3), FORCE_TORQUE, None)
    found = impulses(thrust, [samples()])
    assert found[0] == pytest.approx(ZERO)
    assert found[-1] == pytest.approx(0.7 * FORCE_TORQUE)


def test_late_commands_count_from_then_on() -> None:
    in_time, late = make_pulsed(), make()
    expected = impulses(in_time, windows(samples()))
    parts = windows(samples())
    first = impulses(late, parts[:22])  # until 11 s
    late.command('base_link', ns(OFF), ZERO, None)
    late.command('base_link', ns(ON), FORCE_TORQUE, None)
    assert late.late
    rest = impulses(late, parts[22:])
    assert np.all(first == 0.0)
    assert rest == pytest.approx(expected[len(first) :], abs=1e-12)
    assert not in_time.late


def commands(thrust: Thrust, *wrenches: Array) -> str:
    for index in range(90):
        thrust.command('base_link', ns(1.0 + 0.02 * index), wrenches[index % len(wrenches)], None)
    return thrust.shared


def test_two_publishers_of_one_frame_are_told() -> None:
    force, torque = FORCE_TORQUE * [1, 1, 1, 0, 0, 0], FORCE_TORQUE * [0, 0, 0, 1, 1, 1]
    assert commands(make(), force, torque) == 'base_link'
    assert commands(make(), *[force] * 5, torque) == 'base_link'  # at another rate
    assert commands(make(), force, ZERO) == ''  # pulses
    assert commands(make(), force, FORCE_TORQUE) == ''
    assert commands(make(), *[force] * 10, *[torque] * 10) == ''  # one that does the one and then the other


def test_commands_that_cannot_be_used_are_counted() -> None:
    thrust = make()
    thrust.command('base_link', ns(1.0), np.full(6, np.nan), ns(1.0))
    thrust.command('moon', ns(1.0), FORCE_TORQUE, ns(1.0))
    thrust.command('base_link', 5_000_000_000, FORCE_TORQUE, ns(1.0))
    assert thrust.dropped == {NOT_FINITE_THRUST: 1, UNKNOWN_FRAME: 1, FAR_THRUST: 1}
    assert thrust.commands == 0
    unknown = Thrust(robot('servicer7'))
    unknown.command('moon', ns(1.0), FORCE_TORQUE, ns(1.0))
    unknown.odometry_frame = 'odom'
    assert np.all(impulses(unknown, [samples()]) == 0.0)
    assert unknown.dropped == {UNKNOWN_FRAME: 1}
