"""A run that begins before the capture calibrates the robot with what it has seen of it, and goes on with that."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import recorded
from benchmarks.precapture import free_model, free_urdf, perturbed
from captured import Joined, alone, capture, sensed
from mbaid_ros.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.capture.estimator import BEFORE
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.model_errors import displaced
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.core.samples import Samples
from mbaid_ros.session.session import Session
from mbaid_ros.session.settings import declared_uncertainty
from mbaid_ros.simulation.true_robot import ErrorSizes, draw, generator
from observed import MID
from servicing import LINKS, PRIORS

BEGIN, END = 20.0, 10.0  # s: the capture, and how long the run goes on after it
PARAMETERS: dict[str, object] = {
    'capture.time': BEGIN,
    'debris.report': True,
    'calibration.enabled': True,
    'calibration.inertia_relative_std': 0.05,
    'calibration.weighed_links': ['base_link'],
    'calibration.weighed_stds': [0.001],
}
LIMIT = float(chi2.isf(1e-4, 10))


@cache
def joined() -> Joined:
    return capture(BEGIN, END, np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015]))


@cache
def cad() -> str:
    """Return what CAD says of the servicer."""
    text = free_urdf()
    for link in perturbed(free_model(), PRIORS, 1).links:
        text = replace_inertial(text, link.name, physical(link.parameters))
    return text


@cache
def messages(*, misread: bool = False) -> list[tuple[str, Any, int]]:
    errors = draw(free_model(), 'link7', ErrorSizes(0.0, 1e-3, 0.0, 0.0, 2e-3, 2e-3), generator(3))
    return list(recorded.messages(free_model(), sensed(joined().truth, 1, errors if misread else None)))


def feed(session: Session, until: float = np.inf, *, misread: bool = False) -> list[Estimate]:
    for topic, message, time in messages(misread=misread):
        if time <= until * 1e9:
            (session.add_joint_state if topic == '/joint_states' else session.add_odometry)(message)
    return session.process()


def make(**parameters: object) -> Session:
    return Session(build(EstimatorConfig, {**PARAMETERS, **parameters}), cad())


def body(session: Session, last: Estimate) -> tuple[Array, Array]:
    """Return the error (10,) of the captured body, and the covariance that it is published with."""
    found = session.robot.debris(last)
    assert found is not None
    return found.parameters - physical(alone()), found.covariance


def error(session: Session, last: Estimate) -> float:
    """Return the squared error of the captured body in its covariance."""
    off, covariance = body(session, last)
    return float(off @ np.linalg.solve(covariance, off))


@cache
def calibrated(method: str) -> tuple[Session, list[Estimate]]:
    """Return a session that has calibrated the robot, and its estimates."""
    session = make(method=method)
    assert session.robot.calibrated == ''
    return session, feed(session)


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_the_captured_body_is_right_within_its_intervals(method: str) -> None:
    session, (*_, last) = calibrated(method)
    assert error(session, last) < LIMIT
    found = session.robot.captured(last)
    assert found is not None
    assert found.calibrated == session.robot.calibrated
    assert session.robot.calibrated.startswith('8 bodies calibrated from the 19.5 s before the capture')
    off = found.momentum - joined().momentum
    assert float(off @ np.linalg.solve(found.covariance, off)) < chi2.isf(1e-4, 6)
    assert found.chaser is not None
    assert found.chaser.residual == pytest.approx(1.0, abs=0.15)
    # CAD values do not conserve momentum; those that came after do.
    assert not any('the known model changes' in warning for warning in last.warnings)


@pytest.mark.parametrize('method', [pytest.param('difference', marks=pytest.mark.long), 'trajectory'])
def test_zeros_and_mount_are_learnt_before_the_capture_and_go_on(method: str) -> None:
    """Encoders whose zeros are off and odometry that is mounted elsewhere, before the capture and after it."""
    session = make(method=method)
    last = feed(session, misread=True)[-1]
    assert error(session, last) < LIMIT
    assert last.status != 'inconsistent'
    exact = make(method=method, **{name: value for name, value in EXACT.items() if 'links' not in name})
    off, _ = body(exact, feed(exact, misread=True)[-1])
    assert off @ np.linalg.solve(body(session, last)[1], off) > 2.0 * error(session, last)


def test_without_it_the_body_is_wrong() -> None:
    session = make(**{'calibration.enabled': False, **EXACT})
    last = feed(session)[-1]
    assert error(session, last) > 3.0 * LIMIT
    assert last.status == 'inconsistent'
    assert session.robot.urdf == cad()


class Collector:
    """A method that keeps the windows."""

    method, needs_rates = 'none', False

    def __init__(self) -> None:
        self.windows: list[Samples] = []

    def update(self, windows: list[Samples], _origin: int) -> list[Estimate]:
        """Take windows."""
        self.windows += windows
        return []


def test_the_numbers_are_those_of_calibrate() -> None:
    session, collector = calibrated('trajectory')[0], Collector()

    def collect(*_given: object) -> Estimator:
        return collector

    feed(Session(EstimatorConfig(), cad(), collect), BEGIN - 0.5)
    model = load_model(cad())
    settings = CalibrationSettings(
        MID, (PRIORS[-1], *PRIORS[:-1]), replace(declared_uncertainty(session.config, model), time_offset=0.02)
    )
    names = (LINKS[-1], *LINKS[:-1])
    found = calibrate(MomentumKernel(model, *names), [collector.windows], settings)
    robot = session.robot.kernel
    used = np.concatenate([robot.model.link(name).parameters for name in names])
    assert used == pytest.approx(found.theta, rel=1e-9)
    size = np.sqrt(np.diag(found.covariance))[10:]
    wanted = found.covariance[10:, 10:] / np.outer(size, size)
    assert robot.errors.covariance / np.outer(size, size) == pytest.approx(wanted, abs=1e-9)
    # The robot description that is given on has them, too, and the joints where they have been found.
    written = load_model(session.robot.urdf)
    assert written.link('link3').parameters == pytest.approx(found.theta[40:50], rel=1e-9)
    moved = displaced(model, *found.displacements)
    assert np.abs(moved.positions - model.positions).max() > 1e-4
    assert written.positions == pytest.approx(moved.positions, abs=1e-10)
    assert written.rotations == pytest.approx(moved.rotations, abs=1e-10)


def test_a_robot_that_did_nothing_before_is_said_to_be_uncalibrated() -> None:
    session = make(**{'capture.time': 0.4})
    last = feed(session, 5.0)[-1]
    assert last.warnings[0] != BEFORE
    assert any(warning.startswith('not calibrated before the capture: the data hold no') for warning in last.warnings)
    assert session.robot.calibrated == ''


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'capture.time': 0.0}, "'calibration.enabled' is true in a run that begins after the capture"),
        ({'calibration.weighed_stds': []}, "'calibration.weighed_stds' has 0 numbers; accepted: 1"),
        ({'calibration.weighed_links': ['moon']}, "'calibration.weighed_links' has 'moon'; accepted: links with an"),
        (
            {'known_links.link1.mass_relative_std': 0.01},
            "with 'calibration.enabled', which estimates all links",
        ),
        (
            {
                'calibration.mass_relative_std': 0.0,
                'calibration.inertia_relative_std': 0.0,
                'calibration.weighed_stds': [0.0],
            },
            'nothing fixes the scale',
        ),
    ],
)
def test_what_cannot_be_is_said_at_the_start(parameters: dict[str, object], reason: str) -> None:
    with pytest.raises(MbaidError, match=reason.replace('.', r'\.')) as caught:
        make(**parameters)
    assert '\n' not in str(caught.value)
