"""A simulated pulse of thrust: the momentum changes by what the force and torque bring, and by nothing else."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from captured import servicer_motion
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.sensors.external_momentum import Thrust
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Motion, Passive
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from mbaid_ros.simulation.thrust import Pulse, ThrustSimulation
from observed import LOW, observe
from simulated import robot, state

WRENCH = np.array([6.0, -6.0, 5.0, 3.0, 2.7, -3.0])
ODOM = 'odom'
BEGIN, END = 1.013, 1.527  # s, between steps
INSTANTS = np.arange(0.0, 3.0, 0.01)


def start() -> State:
    motion = servicer_motion()
    turning = state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02))
    return replace(turning, base_position=np.array([2.0, -1.0, 3.0]))


def make(frame: str = 'base_link', motion: Motion | None = None, wrench: Array = WRENCH) -> ThrustSimulation:
    pulse = Pulse(BEGIN, END, None if frame == ODOM else robot('servicer7').link(frame), wrench)
    return ThrustSimulation(robot('servicer7'), motion or servicer_motion(), start(), 0.05, pulse)


@pytest.mark.parametrize('frame', ['base_link', 'link4', ODOM])
@pytest.mark.parametrize('passive', [False, True])
def test_the_momentum_changes_by_the_impulse(frame: str, passive: bool) -> None:
    truth = make(frame, Passive() if passive else None).advance(INSTANTS)
    momentum = total_momentum(robot('servicer7'), truth)
    # The estimator's own account of the same thrust, at a hundred samples a second.
    known = Thrust(robot('servicer7'), 10**9)
    known.odometry_frame = ODOM
    known.command(frame, round(BEGIN * 1e9), WRENCH, None)
    known.command(frame, round(END * 1e9), np.zeros(6), None)
    expected = known.applied(observe(truth, LOW), 0).impulse
    assert np.linalg.norm(expected[-1, :3]) == pytest.approx((END - BEGIN) * np.linalg.norm(WRENCH[:3]), rel=1e-3)
    # Between two samples it takes the mean of both poses.
    assert momentum - momentum[0] == pytest.approx(expected, abs=3e-4)


def test_batches_make_no_difference() -> None:
    whole, simulation = make().advance(INSTANTS), make()
    parts = [simulation.advance(part) for part in np.array_split(INSTANTS, 9)]
    assert len(simulation.advance(np.zeros(0))) == 0
    for item in fields(Truth):
        together = np.concatenate([getattr(part, item.name) for part in parts])
        assert np.array_equal(together, getattr(whole, item.name))


def test_no_force_is_no_thrust() -> None:
    free = Simulation(robot('servicer7'), servicer_motion(), start(), 0.05).advance(INSTANTS)
    assert make(wrench=np.zeros(6)).advance(INSTANTS).base_position == pytest.approx(free.base_position, abs=1e-9)
