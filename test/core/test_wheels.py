"""Reaction wheels are joints like others: with their speeds the estimate holds, without them the methods object."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from floating import RATE, float_freely, normalised
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.simulation.motion import Sinusoids
from mbaid_ros.core.simulation.run import Truth
from observed import MID, identify
from simulated import CONFIG

SECONDS = 20.0
AXES = ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, 1.0))
# Speeding up to 100 rad/s in 20 s, at a quarter of a slow sine.
TOP, FREQUENCY = 200.0, 1.0 / 240.0
WHEEL = """
  <link name="wheel{0}">
    <inertial>
      <mass value="5.0"/>
      <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.05"/>
    </inertial>
  </link>
  <joint name="wheel{0}_joint" type="continuous">
    <parent link="base_link"/>
    <child link="wheel{0}"/>
    <origin xyz="{1}" rpy="{2}"/>
    <axis xyz="0 0 1"/>
  </joint>
"""
# Ten parameters, one run in a thousand.
LIMIT = float(chi2.isf(1e-3, 10))


def urdf() -> str:
    """Return the servicer with a pyramid of four wheels."""
    wheels = []
    for index, axis in enumerate(AXES):
        tilt, turn = np.arccos(axis[2] / np.sqrt(3.0)), np.arctan2(axis[1], axis[0])
        place = f'{-0.2 * axis[0]} {-0.2 * axis[1]} 0.1'
        wheels.append(WHEEL.format(index, place, f'0 {tilt} {turn}'))
    text: str = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    return text.replace('</robot>', f'{"".join(wheels)}</robot>')


@cache
def wheeled() -> MomentumKernel:
    return MomentumKernel(load_model(urdf()), 'link7')


def spinning(joints: Sinusoids) -> Sinusoids:
    """Return the arm's motion with the wheels' beside it, in the order of the model's joints."""
    arm = [index for index, name in enumerate(wheeled().model.joint_names) if not name.startswith('wheel')]
    count, terms = wheeled().model.joints, joints.amplitude.shape[1]

    def spread(values: Array, wheel: float) -> Array:
        whole = np.zeros((count, terms))
        whole[:, 0] = wheel
        whole[arm] = values
        return whole

    start = np.zeros(count)
    start[arm] = joints.start
    return Sinusoids(
        start=start,
        amplitude=spread(joints.amplitude, TOP / (2.0 * np.pi * FREQUENCY)),
        frequency=spread(joints.frequency, FREQUENCY),
        phase=spread(joints.phase, -0.5 * np.pi),
    )


@pytest.fixture(scope='module')
def run(joints: Sinusoids) -> Truth:
    momentum = np.array([16.0, -8.0, 24.0, 30.0, -35.0, 60.0])
    return float_freely(wheeled(), spinning(joints), momentum, SECONDS)


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_wheels_that_are_read_make_no_difference(run: Truth, method: str) -> None:
    assert run.joint_velocity.max() == pytest.approx(TOP * np.sin(2.0 * np.pi * FREQUENCY * (SECONDS - 1.0 / RATE)))
    last = identify(wheeled(), run, MID, 3, method=method)[-1]
    assert normalised(last, wheeled()) < LIMIT
    assert not last.events
    assert last.status in {'estimating', 'converged'}


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_wheels_that_nobody_tells_of_are_noticed(run: Truth, method: str) -> None:
    arm = [index for index, name in enumerate(wheeled().model.joint_names) if not name.startswith('wheel')]
    unaware = MomentumKernel(load_model(urdf().replace('type="continuous"', 'type="fixed"')), 'link7')
    assert unaware.model.joint_names == tuple(wheeled().model.joint_names[index] for index in arm)
    told = replace(
        run,
        joint_position=run.joint_position[:, arm],
        joint_velocity=run.joint_velocity[:, arm],
        joint_effort=run.joint_effort[:, arm],
    )
    last = identify(unaware, told, MID, 3, method=method)[-1]
    assert last.status == 'inconsistent' or last.events
    assert any('in base axes' in warning for warning in last.warnings)
