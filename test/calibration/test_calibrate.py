"""All bodies from motions of a free arm: recovered within the reported covariance, whatever is unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.precapture import GENERAL, WEIGHED, factors, free_model, free_urdf, perturbed
from mbaid_ros.calibration.calibration import CalibrationSettings, calibrate
from mbaid_ros.calibration.iteration import Motion, converge
from mbaid_ros.calibration.misfit import Misfit, bias_corrected
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.config.estimator_parameters import EXACT
from mbaid_ros.core.forces import DisturbanceModel, disturbances
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import BodyDeviations
from mbaid_ros.core.robot.body import is_physical
from mbaid_ros.core.robot.model import PlaneDetector, RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.state import BODY, Declared
from mbaid_ros.core.target import KnownTarget
from mbaid_ros.session import methods
from mbaid_ros.simulation.motion import Sinusoids, random_sinusoids
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from observed import HIGH, MID, drifting, identify, kernel, observe, windows
from servicers import LINKS, PRIORS, all_unknown, free_motion, standard_parameters
from simulated import robot, state


def calibrated(model: RobotModel, truth: Truth, seed: int, priors: tuple[BodyDeviations, ...] = PRIORS) -> Calibration:
    unknown = all_unknown(model)
    return calibrate(unknown, [windows(observe(truth, MID, seed))], CalibrationSettings(MID, factors(unknown, priors)))


def momentum_rows(model: RobotModel, truth: Truth) -> Array:
    """Return Y of all links, (N, 6, 10 k), at exact states."""
    robot_kernel = all_unknown(model)
    states = robot_kernel.states(observe(truth, MID))
    return np.concatenate([states.regressor_of(link) for link in robot_kernel.unknown], axis=2)


def sizes(momenta: Array) -> Array:
    """Return the root mean square size of linear and angular momentum, (2,)."""
    return np.sqrt(np.mean(np.sum(momenta.reshape(-1, 2, 3) ** 2, axis=2), axis=0))


def normalised(error: Array, covariance: Array) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def test_all_bodies_are_recovered_and_predict_the_momentum_of_another_motion() -> None:
    truth, fresh = free_motion(1, 60.0), free_motion(2, 30.0)
    servicer = free_model()
    rows, theta = momentum_rows(servicer, fresh), standard_parameters(servicer)
    squares, before, after, deviations = [], [], [], []
    for seed in range(5):
        cad = perturbed(servicer, PRIORS, seed)
        found = calibrated(cad, truth, seed)
        error = found.theta - theta
        squares.append(normalised(error, found.covariance))
        before.append(sizes(rows @ (standard_parameters(cad) - theta)))
        after.append(sizes(rows @ error))
        std = np.sqrt(np.einsum('nij,jk,nik->ni', rows, found.covariance, rows))
        deviations.append(np.sqrt(np.mean((rows @ error / std) ** 2)))
        assert found.residual == pytest.approx(1.0, abs=0.1)
    # 400 chi-squares: standard deviation sqrt(800).
    assert sum(squares) == pytest.approx(400.0, abs=4.0 * np.sqrt(800.0))
    # A tenth of the samples of two minutes at 100 Hz: errors some three times those of docs/how-to/calibrate.md.
    assert np.all(np.sqrt(np.mean(np.square(before), axis=0)) > 4.0 * np.sqrt(np.mean(np.square(after), axis=0)))
    # One direction makes most of the error of a run: five chi-squares, above 20 once in 1000.
    assert np.sum(np.square(deviations)) < 20.0


def test_without_a_weighed_body_the_common_factor_stays_open() -> None:
    servicer = free_model()
    priors = (GENERAL,) * 8
    cad = perturbed(servicer, priors, 3)
    found = calibrated(cad, free_motion(1, 60.0), 3, priors)
    theta = standard_parameters(servicer)
    # Eight bodies, each to 5 %, determine the common factor together; one of them alone, far less.
    assert 0.01 < found.scale_std < 0.03
    rows = momentum_rows(servicer, free_motion(2, 30.0))
    factor = np.sum(found.theta[::10]) / np.sum(theta[::10])
    assert abs(factor - 1.0) < 4.0 * found.scale_std
    # Up to that factor the momentum is as right as ever.
    left, wrong = rows @ (found.theta / factor - theta), rows @ (standard_parameters(cad) - theta)
    assert np.all(sizes(wrong) > 5.0 * sizes(left))


WHEEL = """
  <link name="wheel">
    <inertial><mass value="9"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.18"/></inertial>
  </link>
  <joint name="wheel_joint" type="continuous">
    <parent link="base_link"/><child link="wheel"/><origin xyz="-0.3 0.1 0.2" rpy="0.4 0.7 0"/><axis xyz="0 0 1"/>
  </joint>
</robot>"""


def test_the_known_momentum_of_a_wheel_fixes_the_scale() -> None:
    """A wheel that speeds up to 200 rad/s, 36 N m s, while the arm moves; no link was weighed."""
    model = load_model(free_urdf().replace('</robot>', WHEEL))
    arm = random_sinusoids(np.linspace(0.5, -0.4, 7), 1, 2, 1.0, 12.0, 30.0)
    motion = Sinusoids(
        start=np.append(arm.start, 0.0),
        amplitude=np.vstack((arm.amplitude, [7600.0, 0.0])),
        frequency=np.vstack((arm.frequency, [1.0 / 240.0, 0.1])),
        phase=np.vstack((arm.phase, [-0.5 * np.pi, 0.0])),
    )
    start = state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02))
    truth = Simulation(model, motion, start).advance(np.arange(1200) / 20.0)
    priors = (GENERAL,) * 8
    squares = []
    for seed in range(3):
        unknown = MomentumKernel(
            perturbed(model, (*priors, replace(GENERAL, mass=0.0, com=0.0, inertia=0.0)), seed), *LINKS
        )
        settings = CalibrationSettings(MID, factors(unknown, priors))
        found = calibrate(unknown, [windows(observe(truth, MID, seed))], settings)
        # A fifth of what masses and inertias known to 5 % determine together.
        assert found.scale_std < 0.003
        factor = np.sum(found.theta[::10]) / np.sum(standard_parameters(free_model())[::10])
        squares.append(((factor - 1.0) / found.scale_std) ** 2)
    assert sum(squares) < 16.0  # three chi-squares: 1 in 1000


def test_one_unknown_link_is_the_single_link_method(spatial: Truth, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(methods, '_ADAPT', False)
    unknown = kernel('servicer7')
    exact = {name.replace('.', '__'): value for name, value in EXACT.items()}
    given = {**exact, 'time_offset__estimate': False}
    alone = identify(unknown, spatial, MID, 4, method='trajectory', **given)[-1]
    found = calibrate(unknown, [windows(observe(spatial, MID, 4))], CalibrationSettings(MID, (None,)))
    link = found.links[0]
    # Either stops when a pass moves it by less than a tenth of a standard deviation; the estimator takes off what the
    # rows' noise does, and widens its intervals by the residual.
    assert np.all(np.abs(link.parameters - alone.parameters) < 0.3 * alone.std)
    assert link.std == pytest.approx(alone.std, rel=0.1)
    assert np.all(np.abs(found.momentum[0] - alone.momentum) < 0.3 * np.sqrt(np.diag(alone.momentum_covariance)))


def test_in_a_plane_what_lies_out_of_it_stays_at_cad(planar: Truth) -> None:
    model = robot('table1')
    # All weighed: where the data determine a mass, the moments change with it.
    priors = (BodyDeviations(0.001, 0.05, 0.05),) * 5
    cad = perturbed(model, priors, 8)
    found = calibrated(cad, planar, 8, priors)
    assert found.planar
    assert 0 < found.determined <= 16
    for link in found.links:
        # A thin link whose moment about the normal grows has to grow across it as well, to be a body.
        assert link.parameters[3] == pytest.approx(
            link.cad[3], abs=1e-9 if link.consistency_correction == 0.0 else 1e-3
        )
        assert link.is_prior[[4, 5, 6, 7, 8]].all()
    squares = normalised(found.theta - standard_parameters(model), found.covariance)
    assert chi2.ppf(1e-5, 50) < squares < chi2.isf(1e-5, 50)


def test_several_motions_keep_their_own_momenta(drift: Array) -> None:
    servicer = free_model()
    truths = [free_motion(1, 60.0), drifting(free_motion(2, 30.0), 0.05 * drift, np.array([30.0, -20.0, 10.0]))]
    runs = [windows(observe(truth, MID, seed)) for seed, truth in enumerate(truths)]
    unknown = all_unknown(perturbed(servicer, PRIORS, 5))
    settings = CalibrationSettings(MID, factors(unknown, PRIORS))
    both = calibrate(unknown, runs, settings)
    for index, truth in enumerate(truths):
        error = both.momentum[index] - total_momentum(servicer, truth[:1])[0]
        assert normalised(error, both.momentum_covariance[index]) < 35.0  # six chi-squares: 1 in 200 000
    one = calibrate(unknown, runs[:1], settings)
    assert np.all(np.diag(both.covariance) < 1.001 * np.diag(one.covariance))
    assert both.determined >= one.determined


def at_rest() -> Truth:
    still = free_motion(1, 60.0)[np.zeros(100, dtype=int)]
    return replace(
        still,
        time=np.arange(100) / 20.0,
        joint_velocity=np.zeros((100, 7)),
        base_linear_velocity=np.zeros((100, 3)),
        base_angular_velocity=np.zeros((100, 3)),
    )


def test_encoders_that_are_found_to_be_noisy_do_not_move_the_joints() -> None:
    servicer = perturbed(free_model(), PRIORS, 1)
    noise = replace(MID, joint_position=15.0 * MID.joint_position)
    found_in = np.tile([noise.joint_position, noise.joint_velocity, 0.0], (100, 1))
    run = windows(replace(observe(at_rest(), noise, 0), noise=found_in))
    unknown = all_unknown(servicer)
    found = calibrate(unknown, [run], CalibrationSettings(MID, factors(unknown, PRIORS)))
    assert found.at_rest == servicer.joint_names
    assert found.determined == 0


def test_a_robot_at_rest_says_nothing() -> None:
    servicer = perturbed(free_model(), PRIORS, 1)
    found = calibrated(servicer, at_rest(), 0)
    assert found.determined == 0
    assert found.at_rest == servicer.joint_names
    for link in found.links:
        assert link.is_prior.all()
        assert np.abs(link.shift_in_prior_stds).max() < 0.3


def test_every_body_can_exist_even_where_data_and_prior_say_little() -> None:
    loose = BodyDeviations(mass=0.5, com=0.2, inertia=1.0)
    priors = (WEIGHED, *(loose,) * 7)
    truth = free_motion(1, 60.0)[:200]
    bent = 0.0
    for seed in range(3):
        unknown = all_unknown(free_model())
        found = calibrate(
            unknown, [windows(observe(truth, HIGH, seed))], CalibrationSettings(HIGH, factors(unknown, priors))
        )
        assert all(is_physical(part) for part in found.theta.reshape(-1, 10))
        bent = max(bent, float(found.corrections.max()))
    assert bent > 0.0


# -- Motions with a torque that varies.


def test_where_a_torque_varies_the_misfit_is_least_at_the_solution() -> None:
    robot_kernel = MomentumKernel(free_model(), 'link7')
    prior, detector = robot_kernel.target.parameters, PlaneDetector(robot_kernel.model)
    scale = 0.05 * np.maximum(np.abs(prior), 0.01)
    varying, _ = disturbances(DisturbanceModel(0.3, 30.0), DisturbanceModel())
    declared = Declared((varying,), target=KnownTarget(prior, np.diag(scale)))
    run = windows(observe(free_motion(1, 10.0), HIGH, 0))
    # The momentum of a varying torque, which the readings of the motion do not have: as if it had been taken up.
    torque = 0.3 * np.sin(np.outer(np.concatenate([each.time for each in run]), [0.2, 0.3, 0.4]))
    impulses = np.cumsum(torque, axis=0) * np.median(np.diff(run[0].time))
    parts = np.split(impulses, np.cumsum([len(each) for each in run])[:-1])
    run = [
        replace(each, impulse=each.impulse + np.column_stack((np.zeros((len(part), 3)), part)))
        for each, part in zip(run, parts, strict=True)
    ]
    motion = Motion.from_windows(run, robot_kernel, detector, declared, (HIGH, 0.5, True))
    solution = converge([motion], prior)
    assert motion.has_disturbance
    assert solution.converged
    body = motion.variables.to_state[BODY.start :, motion.variables.moving :]
    deviation = np.linalg.norm(body @ solution.iteration.factor, axis=1)
    misfit = Misfit([motion], solution.common, deviation, solution.momenta)

    def lost(mean: Array) -> float:
        common = body @ mean
        distance = (common[:10] - prior) / scale
        return misfit.value_at(common) + float(distance @ distance)

    before, after = solution.iteration.mean, bias_corrected([motion], solution).iteration.mean
    step = (after - before) @ np.linalg.pinv(solution.iteration.factor @ solution.iteration.factor.T) @ (after - before)
    assert 0.01 < step < 9.0  # it matters
    assert lost(after) < min(lost(before) - 0.5 * float(step), lost(2.0 * after - before))
