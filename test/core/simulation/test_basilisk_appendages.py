"""Hinged panels of Basilisk (pip install bsk): the servicer's target is identified through their swing."""

from __future__ import annotations

from functools import cache
from importlib import import_module

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.appendages import servicer
from in_basilisk import column, craft_of, seen_falling
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Springs
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.simulation.simulation import Truth
from observed import MID, estimator, nees, observe, true_body, windows

pytest.importorskip('Basilisk', reason='Basilisk is not installed (pip install bsk)')
pytestmark = pytest.mark.long
STEP, SECONDS = 0.02, 30.0
SPRINGS = [0.12, 0.12, 0.08, 0.06, 0.03, 0.024, 0.012]  # N m / rad, of the arm's joints
# Of each panel: mass (kg), frequency (Hz), place of its hinge along y (m), deflection at the start (rad).
PANELS = {'left': (20.0, 0.3, (0.1, 0.65, 0.0), 0.02), 'right': (18.0, 0.34, (0.1, -0.65, 0.0), -0.01)}
ARM, MOMENTS, DAMPING = 1.1, (1.35, 8.1, 9.4), 0.01


def described() -> RobotModel:
    """Return the servicer with the panels as passive joints."""
    form = (
        '<link name="{0}"><inertial><origin xyz="{1} 0 0"/><mass value="{2}"/><inertia ixx="{3[0]}" ixy="0" ixz="0" '
        'iyy="{3[1]}" iyz="0" izz="{3[2]}"/></inertial></link><joint name="{0}" type="revolute">'
        '<parent link="base_link"/><child link="{0}"/><origin xyz="{4[0]} {4[1]} {4[2]}"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )
    parts = [form.format(name, -ARM, mass, MOMENTS, place) for name, (mass, _, place, _) in PANELS.items()]
    return load_model(servicer(*parts, lighter=sum(each[0] for each in PANELS.values())))


@cache
def in_basilisk() -> Truth:
    """Return how the craft moves, its passive joints at zero as nothing reports them."""
    total = sum(each[0] for each in PANELS.values())
    craft, arm = craft_of(load_model(servicer(lighter=total)), SPRINGS)
    effectors = []
    for mass, frequency, place, start in PANELS.values():
        panel = import_module('Basilisk.simulation.hingedRigidBodyStateEffector').HingedRigidBodyStateEffector()
        panel.mass, panel.d, panel.IPntS_S = mass, ARM, np.diag(MOMENTS).tolist()
        inertia, rate = MOMENTS[1] + mass * ARM**2, 2.0 * np.pi * frequency
        panel.k, panel.c = inertia * rate**2, 2.0 * DAMPING * inertia * rate
        panel.r_HB_B, panel.dcm_HB, panel.thetaInit = column(np.array(place)), np.eye(3).tolist(), start
        effectors.append(panel)
    for effector in effectors:
        craft.addStateEffector(effector)
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = column(np.zeros(3)), column(np.zeros(3))
    craft.hub.sigma_BNInit, craft.hub.omega_BN_BInit = column(np.zeros(3)), column(np.array([0.01, -0.015, 0.02]))
    seconds = import_module('Basilisk.utilities.macros').sec2nano
    simulation = import_module('Basilisk.utilities.SimulationBaseClass').SimBaseClass()
    simulation.CreateNewProcess('process').addTask(simulation.CreateNewTask('task', seconds(STEP)))
    base, joints = craft.scStateOutMsg.recorder(), [message.recorder() for message in arm.spinningBodyOutMsgs]
    for part in (arm, *effectors, craft, base, *joints):
        simulation.AddModelToTask('task', part)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(seconds(SECONDS))
    simulation.ExecuteSimulation()
    truth = seen_falling(base, joints, 0.0, 0.0).truth
    unread = np.zeros((len(truth.time), len(effectors)))
    for name in ('joint_position', 'joint_velocity', 'joint_effort'):
        object.__setattr__(truth, name, np.concatenate((getattr(truth, name), unread), axis=1))
    return truth


@pytest.mark.parametrize('seed', [1, 2])
def test_the_target_is_identified_through_panels_of_basilisk(seed: int) -> None:
    model, names = described(), list(PANELS)
    true = np.array([each[1] for each in PANELS.values()])
    declared = true * (1.0 + 0.03 * (-1.0) ** (seed + np.arange(len(true))))
    joints = tuple(model.joint_names.index(name) for name in names)
    rates = 2.0 * np.pi * declared
    kernel = MomentumKernel(model, 'link7').swinging(
        Springs(joints, rates, np.full(len(rates), DAMPING), np.zeros((2, len(rates))))
    )
    given = {f'flexible.{name}.frequency': each for name, each in zip(names, declared, strict=True)}
    samples = observe(in_basilisk(), MID, seed)
    for part in (samples.joint_position, samples.joint_velocity):
        part[:, list(joints)] = 0.0
    found = estimator(kernel, MID, method='trajectory', **{'flexible.joints': names}, **given)
    last = found.update(windows(samples), 0)[-1]
    assert last.status in {'estimating', 'converged'}, last.warnings
    assert nees(last, true_body(kernel)) < chi2.isf(1e-3, 10)
    assert last.std[0] < 2.0
    for joint, frequency in zip(last.flexible, true, strict=True):
        assert abs(joint.frequency - frequency) < 4.0 * joint.frequency_std < 0.05 * frequency
