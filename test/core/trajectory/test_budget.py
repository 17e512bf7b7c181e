"""The error budget of the filter: the shares of what is independent, computed one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.budget import SENSOR_NOISE
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import physical_jacobian
from mbaid_ros.core.trajectory.solution import error_budget
from mbaid_ros.core.unknowns.bodies import TargetPrior
from mbaid_ros.core.unknowns.catalogue import Uncertainty, catalogue
from observed import MID, configured_motion, kernel, observe


def uncertainty(joints: int, *, given: bool) -> Uncertainty:
    each = [1e-3] * joints
    known = TargetPrior(160.0, 2.0, (0.1, 0.2, 0.3), 0.01) if given else TargetPrior()
    return Uncertainty(each, each, each, 2e-3, 2e-3, 0.02, known, 0.5 if given else 0.0)


def measured(belief: SquareRootInformation, seed: int, truth: Array) -> tuple[SquareRootInformation, Array]:
    """Return a belief after measurements of unit variance, and their rows."""
    rows = np.random.default_rng(seed).normal(size=(60, belief.size))
    known = np.column_stack((rows, np.zeros(60), rows @ truth))
    root = np.asarray(np.linalg.qr(np.vstack((belief.root, known)), mode='r'))
    return belief.with_root(root[: belief.size]), rows


def blocks(layout: Layout, filter_variables: Variables, *, given: bool) -> dict[str, Flags]:
    """Return of each cause which variables have its prior."""
    place, head, own = np.arange(len(filter_variables.scale)), filter_variables.head, filter_variables.own
    labels = [cause for unknown in layout.unknowns for cause in unknown.causes]
    found = {cause: np.isin(place - own, np.flatnonzero(np.array(labels) == cause)) for cause in layout.causes}
    if given:
        found['target prior'] = (place >= head) & (place < own)
        found['momentum prior'] = (place >= filter_variables.poses) & (place < head)
    return found


@pytest.mark.parametrize('given', [False, True])
@pytest.mark.parametrize('name', ['servicer7', 'table1'])
def test_each_prior_has_its_share_and_noise_the_rest(name: str, given: bool) -> None:
    robot = kernel(name)
    detector, known = PlaneDetector(robot.model), uncertainty(robot.model.joints, given=given)
    unknowns = catalogue(robot, known)
    detector.update(observe(configured_motion(name, 0.5, 20.0, 0.05), MID))
    if detector.planar:
        unknowns = tuple(unknown.in_plane(detector) for unknown in unknowns)
    layout = Layout.of(robot, unknowns)
    of_filter = variables(layout, detector, known)
    state = np.zeros(layout.size)
    state[BODY] = robot.target.parameters
    prior = SquareRootInformation.prior(of_filter)
    belief, rows = measured(prior, 1, of_filter.gather @ state)
    moments = MeanAndCovariance.of(belief, of_filter)
    declared = replace(moments.sizes(layout), each=np.ones(layout.size - BODY.stop))
    found = error_budget(moments, layout, known, declared)
    zeros = np.array([cause.startswith('zero') for unknown in layout.unknowns for cause in unknown.causes])
    wider = error_budget(moments, layout, known, replace(declared, each=np.where(zeros, 3.0, 1.0)))

    information = prior.root[:, :-2].T @ prior.root[:, :-2]
    covariance = np.linalg.inv(information + rows.T @ rows)
    gains = physical_jacobian(moments.mean[BODY]) @ of_filter.spread[BODY] @ covariance
    parts = {
        cause: np.sum((gains[:, which] @ np.linalg.cholesky(information[np.ix_(which, which)])) ** 2, axis=1)
        for cause, which in blocks(layout, of_filter, given=given).items()
    }
    seen = [0, 1, 2, 9] if detector.planar else list(range(10))
    assert found.causes == (SENSOR_NOISE, *parts)
    variance = np.sum((gains @ np.linalg.cholesky(information + rows.T @ rows)) ** 2, axis=1)
    expected = np.column_stack(list(parts.values()))[seen] / variance[seen, None]
    np.testing.assert_allclose(found.shares[seen, 1:], expected, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.shares[seen].sum(axis=1), 1.0)
    # What is no prior that is given is noise: the measurements, and next to nothing of pose and momentum at the start.
    np.testing.assert_allclose(
        found.shares[seen, 0], np.sum((gains @ rows.T) ** 2, axis=1)[seen] / variance[seen], atol=0.05
    )
    assert found.shares[seen, 0].max() > 0.1
    # Where zeros are three times as far off, their part of the variance is nine times as large, the others stay.
    factor = np.array([9.0 if cause.startswith('zero') else 1.0 for cause in found.causes])
    of_zeros = found.shares[seen] * factor
    np.testing.assert_allclose(wider.shares[seen], of_zeros / of_zeros.sum(axis=1, keepdims=True), rtol=1e-9)
