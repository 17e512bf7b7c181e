"""Passive joints in MuJoCo: our simulator moves them alike, and the estimator finds the body through their swing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.appendages import PANELS, SLOSH, with_fuel, with_panels
from benchmarks.in_mujoco import InMuJoCo
from mbaid_ros.core.results.estimate import PassiveJoint
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel, Springs
from mbaid_ros.simulation import environment as simulated
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Environment
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, Truth
from observed import MID, estimator, nees, observe, true_body, windows

DAMPING = 0.01


class Swinging:
    """A robot with joints on springs, its arm free, in MuJoCo."""

    def __init__(self, urdf: str, joints: tuple[str, ...], frequencies: tuple[float, ...], seconds: float) -> None:
        self.model: RobotModel = load_model(urdf)
        self.joints = [self.model.joint_names.index(name) for name in joints]
        self.springs = simulated.Springs.from_frequencies(self.model, joints, frequencies, [DAMPING] * len(joints))
        position, rate = np.full(self.model.joints, 0.4), 0.03 * np.cos(1.3 * np.arange(self.model.joints))
        position[self.joints], rate[self.joints] = 0.01 * np.cos(np.arange(len(joints))), 0.0
        velocity = np.concatenate(([0.001, -0.002, 0.0, 0.01, -0.015, 0.02], rate))
        self.start = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), position, velocity)
        self.instants = np.arange(round(50.0 * seconds)) / 50.0

    def ours(self) -> Truth:
        """Return the motion by our simulator."""
        around = Environment(springs=self.springs)
        return Simulation(self.model, Passive(), self.start, environment=around).advance(self.instants)

    def theirs(self) -> Truth:
        """Return the motion by MuJoCo."""
        constants = zip(self.springs.stiffness, self.springs.damping, strict=True)
        springs = {self.model.joint_names[joint]: each for joint, each in zip(self.joints, constants, strict=True)}
        return InMuJoCo(self.model, 0.002, springs=springs).measured(self.start, self.instants)


@pytest.fixture(scope='module')
def panels() -> Swinging:
    return Swinging(with_panels(), PANELS, (0.3, 0.31), 25.0)


def test_mujoco_swings_alike(panels: Swinging) -> None:
    ours, theirs = panels.ours(), panels.theirs()
    assert np.abs(ours.joint_position[:, panels.joints]).max() > 5e-3
    assert ours.joint_position == pytest.approx(theirs.joint_position, abs=1e-7)
    assert ours.base_position == pytest.approx(theirs.base_position, abs=1e-7)


def found(case: Swinging, frequencies: tuple[float, ...], seed: int) -> tuple[float, float, tuple[PassiveJoint, ...]]:
    """Return the body's squared error, the std of its mass, and the passive joints, of MuJoCo's motion."""
    truth = case.theirs()
    samples = observe(truth, MID, seed)
    for part in (samples.joint_position, samples.joint_velocity):
        part[:, case.joints] = 0.0  # which nothing reports
    rates = 2.0 * np.pi * np.array(frequencies)
    declared = Springs(tuple(case.joints), rates, np.full(len(rates), DAMPING), np.zeros((2, len(rates))))
    kernel = MomentumKernel(case.model, 'link7').with_springs(declared)
    names = [case.model.joint_names[joint] for joint in case.joints]
    given = {f'flexible.{name}.frequency': each for name, each in zip(names, frequencies, strict=True)}
    parameters = {'method': 'trajectory', 'flexible.joints': names, **given}
    last = estimator(kernel, MID, **parameters).update(windows(samples), 0)[-1]
    assert last.status in {'estimating', 'converged'}, last.warnings
    assert last.identifiable.all()
    return nees(last, true_body(kernel)), last.std[0], last.flexible


def test_the_body_is_found_through_the_swing_of_mujoco(panels: Swinging) -> None:
    distance, std, joints = found(panels, (0.315, 0.3), 1)
    assert distance < chi2.isf(1e-3, 10)
    assert std < 2.0
    assert [each.frequency for each in joints] == pytest.approx([0.3, 0.31], rel=5e-3)


@pytest.mark.long
@pytest.mark.parametrize('seed', [2, 3])
def test_propellant_in_mujoco(seed: int) -> None:
    case = Swinging(with_fuel(20.0), SLOSH, (0.1, 0.1, 0.1), 40.0)
    distance, std, joints = found(case, (0.104, 0.098, 0.1), seed)
    assert distance < chi2.isf(1e-3, 10)
    assert std < 2.0
    # Four periods of a spring that the motion hardly excites: what is reported says how well it is known.
    assert all(abs(each.frequency - 0.1) < 4.0 * each.frequency_std < 0.02 for each in joints)
