"""How well the known side is known: a calibration's file and parameters, and errors about either."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

from benchmarks.precapture import free_model
from checked import some
from declarations import exact_but
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.clocks import ClockDrift, TimeOffset
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import KnownLinksConfig
from mbaid_ros.core.odometry.model import OdometryScale, TwistBias
from mbaid_ros.core.orbit import Gravity
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import layout_of, variables
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build, values_of
from mbaid_ros.session.catalogue import EXACT_ROBOT, inexact_robot
from mbaid_ros.session.robot import Robot, contradicted_mass, nominal_model, with_known_errors
from mbaid_ros.session.session import Session
from mbaid_ros.tasks import Method
from servicers import LINKS, standard_parameters
from simulated import robot
from streams import run, urdf
from unchanged import Unchanged

ROBOT = MomentumKernel(free_model(), 'link7')


SIZE = 80 + 6 * 7 + 6


def matrix() -> Array:
    factor = np.random.default_rng(1).normal(size=(SIZE, SIZE)) * 10.0 ** np.linspace(-3.0, 0.0, SIZE)[:, None]
    return factor @ factor.T


def values() -> Array:
    found = np.zeros(SIZE)
    found[:80] = standard_parameters(free_model())
    found[80:-6:6] = 1e-3 * np.arange(7)
    found[-6:] = 1e-3 * np.arange(6)
    return found


def joints() -> dict[str, Any]:
    model = free_model()
    frames = zip(model.joint_names, model.positions.tolist(), model.rotations.tolist(), strict=True)
    return {name: {'position': position, 'rotation': rotation} for name, position, rotation in frames}


def content(**changed: Any) -> dict[str, Any]:
    covariance = {'values': values().tolist(), 'matrix': matrix().tolist()}
    return {'links': {name: {} for name in LINKS}, 'joints': joints(), 'covariance': {**covariance, **changed}}


def read(path: Path, found: object) -> tuple[MomentumKernel, Array | None]:
    path.write_text(found if isinstance(found, str) else json.dumps(found), encoding='utf-8')
    return with_known_errors(ROBOT, config_of(path).known_links)


def config_of(path: Path) -> EstimatorConfig:
    return build(EstimatorConfig, {'known_links.calibration': str(path)})


def test_the_covariance_is_that_of_the_file(tmp_path: Path) -> None:
    robot, own = read(tmp_path / 'calibration.json', content())
    assert robot.errors.bodies == tuple(range(7))
    size = np.sqrt(np.diag(matrix()))
    wanted = matrix() / np.outer(size, size)
    assert robot.errors.covariance / np.outer(size[:70], size[:70]) == pytest.approx(wanted[:70, :70], abs=1e-11)
    assert own == pytest.approx(matrix()[70:80, 70:80])


def test_a_run_that_starts_again_goes_on_with_the_calibration_it_began_with(tmp_path: Path) -> None:
    path = tmp_path / 'calibration.json'
    path.write_text(json.dumps(content()), encoding='utf-8')
    session = Session(config_of(path), free_model().urdf)
    known = session.robot.known
    assert known is not None
    assert known.declared.joint_prior is not None
    path.write_text('moved on', encoding='utf-8')
    session.reset()
    assert session.robot.known is known


def test_the_filter_starts_from_all_of_it_with_every_correlation(tmp_path: Path) -> None:
    """Links but the target, joints, mount: what the filter's independent numbers make of it is what the file says."""
    path = tmp_path / 'calibration.json'
    path.write_text(json.dumps(content()), encoding='utf-8')
    known = nominal_model(config_of(path), ROBOT)
    unknowns, carried = known.declared.unknowns, known.declared.joint_prior
    assert carried is not None
    parts, sensing = unknowns[:-5], unknowns[-5:]
    assert [type(each) for each in sensing] == [TimeOffset, ClockDrift, OdometryScale, TwistBias, Gravity]
    spread = block_diag(*(part.factor for part in parts))
    own = np.delete(np.arange(SIZE), np.arange(70, 80))
    size = np.sqrt(np.diag(matrix()))[own]
    count = sum(part.count for part in parts)
    found = spread @ carried.factor[:count] @ carried.factor[:count].T @ spread.T
    assert found / np.outer(size, size) == pytest.approx(matrix()[np.ix_(own, own)] / np.outer(size, size), abs=1e-9)
    wanted = values()[own]
    wanted[:70] = 0.0  # the robot description has these
    assert spread @ carried.mean[:count] == pytest.approx(wanted, abs=1e-12)
    # Delay, drift, bias and gradient are those of the recording, of which a calibration says nothing.
    assert carried.factor[count:] == pytest.approx(np.eye(len(carried.factor))[count:])
    # Whitened they are independent.
    whole = carried.whitening @ carried.factor
    assert whole @ whole.T == pytest.approx(np.eye(len(whole)), abs=1e-6)
    assert carried.triangle.T @ carried.triangle == pytest.approx(carried.whitening.T @ carried.whitening, rel=1e-6)


def test_a_part_of_the_links(tmp_path: Path) -> None:
    kept = np.delete(np.arange(SIZE), np.arange(20, 80))
    part = content(values=values()[kept].tolist(), matrix=matrix()[np.ix_(kept, kept)].tolist())
    part['links'] = {'base_link': {}, 'link1': {}}
    robot, own = read(tmp_path / 'calibration.json', part)
    assert robot.errors.bodies == (0, 1)
    assert own is None


def changed_values() -> list[float]:
    found = values()
    found[30] *= 1.01
    return found.tolist()


def without_variance() -> list[list[float]]:
    found = matrix()
    found[3, 3] = 0.0
    return found.tolist()


def moved_joint(distance: float = 1e-4) -> dict[str, Any]:
    found = joints()
    found['joint4']['position'][1] += distance
    return found


@pytest.mark.parametrize(
    ('found', 'reason'),
    [
        ('[1, 2', 'is no calibration: Expecting'),
        ('[]', 'is no calibration: it is no object of JSON; accepted: a file of calibrate --json'),
        ({'mass': 1.0}, "is no calibration: it lacks 'links'"),
        ({'links': {}, 'joints': {}, 'covariance': None}, 'is no calibration: '),
        ({**content(), 'joints': moved_joint()}, "joint 'joint4' is elsewhere in the robot description than in"),
        ({**content(), 'joints': {f'{x}_': y for x, y in joints().items()}}, 'has the joints joint1_, '),
        ({**content(), 'status': 'inconsistent'}, 'must not be trusted, for its data contradict the model; accepted'),
        (
            content(matrix=[[1.0]]),
            'is no calibration: values and covariance of 8 links and 7 joints have the shapes (128,), (1, 1)',
        ),
        (content(matrix=(-matrix()).tolist()), 'its matrix is no covariance'),
        (content(matrix=without_variance()), 'its matrix is no covariance'),
        (content(matrix=(1e31 * np.eye(SIZE)).tolist()), 'its matrix is no covariance'),
        ({**content(), 'joints': moved_joint(1e200)}, 'position or rotation of a joint is none'),
        (content(values=changed_values()), "link 'link3' has other values in the robot description than in"),
        (
            {**content(), 'links': {name: {} for name in (*LINKS[:7], 'claw')}},
            'is of claw; accepted: links of the robot',
        ),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path: Path, found: object, reason: str) -> None:
    with pytest.raises(ParameterError) as caught:
        read(tmp_path / 'calibration.json', found)
    assert reason in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('parameters', 'exact'),
    [
        (EXACT, True),
        ({}, False),
        (EXACT | {'known_joints.joint2.zero_std': 1e-3}, False),
        (EXACT | {'odometry_mount.position_std': 1e-3}, False),
    ],
)
def test_a_robot_is_declared_exact_if_no_parameter_leaves_it_uncertain(
    parameters: dict[str, object], exact: bool
) -> None:
    config = build(EstimatorConfig, parameters)
    assert Robot(config, urdf('table1')).exact is exact
    found = [*inexact_robot(ROBOT, config)]
    assert len(found) == exact
    for convention in found:
        usual = {name: value for name, value in values_of(EstimatorConfig()).items() if name in EXACT}
        given = some(convention.repair).parameters
        assert given == {name: usual[name] for name in usual if name.startswith(('known_', 'odometry_mount'))}
        labels = {label.partition(':')[0] for unknown in convention.rest for label in unknown.labels}
        assert {'link', 'zero', 'origin', 'axis'} < labels


def test_the_mass_of_the_whole_robot_is_known_as_well_as_it_was_weighed() -> None:
    """Without the target, whose own part is as uncertain as declared: 1 % twice, of a common factor and of the mass."""
    own, nominal = float(ROBOT.target.parameters[0]), float(np.sum(ROBOT.known[:, 0]))
    given = {'known_links.total_mass': nominal + own + 2.0, 'known_links.total_mass_std': 0.3}
    config = build(EstimatorConfig, given)
    kernel, _ = with_known_errors(ROBOT, config.known_links)
    known, detector = nominal_model(config, kernel), PlaneDetector(kernel.model)
    layout = layout_of(known.kernel, known.declared, detector)
    filtered = variables(layout, detector, known.declared)
    mean, root, _ = filtered.prior()
    total = np.zeros(layout.size)
    total[layout.places[0]] = layout.unknowns[0].factor[::10].sum(axis=0)
    before, weighed = float(np.sum(total**2)), 0.3**2 + 2.0 * (0.01 * own) ** 2
    after = total @ filtered.to_state @ np.linalg.inv(root)
    assert after @ after == pytest.approx(before * weighed / (before + weighed))
    assert total @ filtered.to_state @ mean == pytest.approx(2.0 * before / (before + weighed))
    with pytest.raises(ParameterError, match='accepted: both above 0, or none'):
        nominal_model(build(EstimatorConfig, {'known_links.total_mass': 3.0}), kernel)


def test_what_is_known_of_the_target_link_is_its_own_before_a_capture() -> None:
    parts = ('mass_relative_std', 'com_std', 'inertia_relative_std')
    given: dict[str, object] = {f'known_links.link7.{part}': 0.05 for part in parts}
    assert some(nominal_model(build(EstimatorConfig, given), ROBOT).declared.target).declared
    captures: tuple[dict[str, object], ...] = ({'capture.time': 60.0}, {'capture.phase': 'pre_capture'})
    for capture in captures:
        config = build(EstimatorConfig, {**given, **capture})
        assert not some(nominal_model(config, ROBOT).declared.target).declared


@pytest.mark.parametrize(('excess', 'warned'), [(0.0, False), (0.2, True), (-0.2, True)])
def test_a_weighed_mass_that_contradicts_the_robot_description_is_a_warning(excess: float, warned: bool) -> None:
    """It counts the target link's own inertial, which seldom holds the body as well."""
    total = float(np.sum(ROBOT.known[:, 0]) + ROBOT.target.parameters[0])
    given = {'known_links.total_mass': (1.0 + excess) * total, 'known_links.total_mass_std': 0.01}
    config = build(EstimatorConfig, given).known_links
    kernel, _ = with_known_errors(ROBOT, config)
    text = contradicted_mass(config, kernel)
    assert bool(text) is warned
    if warned:
        assert f'is {(1.0 + excess) * total:.6g} kg' in text
        assert f"{total:.6g} kg, {ROBOT.target.parameters[0]:.4g} kg of it in target link '{ROBOT.target.name}'" in text
    assert contradicted_mass(KnownLinksConfig(), kernel) == ''


class Contradicted(Method):
    """A method whose data contradict the model in every window."""

    method, needs_rates = 'trajectory', False

    def update(self, windows: list[Samples], _origin: int) -> list[Estimate]:
        """Return an estimate of the last window."""
        return [Estimate('trajectory', 'inconsistent', time=float(windows[-1].time[-1]), causes=(('first', 9.0),))]


@pytest.mark.parametrize(('parameters', 'exact'), [(EXACT, True), ({}, False)])
def test_a_contradicted_run_doubts_an_exact_robot_and_suspects_unknown_names(
    parameters: dict[str, object], exact: bool, unchanged: Unchanged
) -> None:
    session = Session(build(EstimatorConfig, parameters), urdf('table1'), lambda *_: Contradicted())
    for timed in run('table1', 1.1):
        message = timed.message
        if timed.topic == 'joint_states':
            message = deepcopy(message)
            message.name, message.position = [*message.name, 'wheel'], [*message.position, 0.0]
            message.velocity = [*message.velocity, 9.0]
            session.add_joint_state(message)
        else:
            session.add_odometry(message)
    last = session.process()[-1]
    unchanged(last)
    assert (EXACT_ROBOT in last.warnings) is exact
    (first, _), (second, gain) = last.causes
    assert first == 'first'
    assert second.startswith('joint states contain wheel, fixed or missing in the robot description')
    assert gain == 9.0


# -- How uncertain the known side is, as the parameters declare it.


def test_a_joint_may_have_standard_deviations_of_its_own() -> None:
    first, *_ = names = robot('table1').joint_names
    found = exact_but(
        MomentumKernel(robot('table1'), 'link4'),
        known_joints__zero_std=1e-3,
        known_joints__axis_std=2e-3,
        **{f'known_joints.{first}.zero_std': 5e-3},
    )
    each = np.linalg.norm(found.unknowns[0].factor, axis=1).reshape(len(names), 6)
    assert each[:, 0] == pytest.approx([5e-3, 1e-3, 1e-3, 1e-3])
    assert np.all(each[:, 1:4] == 0.0)
    assert each[:, 4:] == pytest.approx(np.full((len(names), 2), 2e-3))


@pytest.mark.parametrize(
    ('parameters', 'named'),
    [
        ({'known_joints.elbow.zero_std': 1e-3}, "'known_joints.elbow' is of no joint"),
        ({'target_prior__mass_std': 2.0}, "without 'target_prior.mass'"),
        ({'target_prior__mass': 150.0}, "'target_prior.mass' is 150 kg without 'target_prior.mass_std'"),
        ({'target_prior__com': [0.0, 0.0, 0.1]}, "is [0.0, 0.0, 0.1] m without 'target_prior.com_std'"),
        ({'target_prior__com_std': 0.01, 'target_prior__com': [0.0, 0.0, 0.1]}, "without 'target_prior.mass_std'"),
        (
            {'target_prior__com_std': 0.01, 'target_prior__mass_std': 1.0, 'target_prior__mass': 9.0},
            "without 'target_prior.com'",
        ),
    ],
)
def test_half_of_what_is_declared_is_an_error(parameters: dict[str, object], named: str) -> None:
    with pytest.raises(ParameterError, match='accepted') as caught:
        exact_but(MomentumKernel(robot('table1'), 'link4'), **parameters)
    assert named in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_captured_body_alone_has_the_uncertainty_that_known_links_declares_of_its_link() -> None:
    # One declaration for calibrate and replay: without debris.report it is a prior of link and body together.
    given = {'known_links.link7.mass_relative_std': 0.05}
    _, own = with_known_errors(ROBOT, build(EstimatorConfig, given).known_links)
    assert own is not None
    assert np.sqrt(own[0, 0]) == pytest.approx(0.05 * ROBOT.target.parameters[0])
    config = build(EstimatorConfig, {**given, 'debris.report': True})
    target = nominal_model(config, ROBOT).declared.target
    assert target is not None
    assert not target.declared
