"""The moments of a belief: where their variance comes from, and what no window has seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.square_root import advance, update
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.filter.whitened import WhitenedWindow
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.unknowns.catalogue import Uncertainty, catalogue
from mbaid_ros.core.unknowns.hypotheses import UNDISTURBED
from observed import kernel

MEASURED = 12


class Case:
    """The seven-joint servicer, some of whose unknowns windows full of random rows tell of."""

    def __init__(self, windows: int = 5, unseen: slice = slice(0)) -> None:
        robot = kernel('servicer7')
        uncertainty = Uncertainty(zeros=(1e-3,) * 7, axes=(2e-3,) * 7, mount_position=2e-3, time_offset=5e-3)
        self.layout = Layout.of(robot, catalogue(robot, uncertainty))
        self.space: Variables = variables(self.layout, PlaneDetector(robot.model), uncertainty)
        rng = np.random.default_rng(5)
        self.windows = [self._window(rng, unseen) for _ in range(windows)]
        belief = SquareRootInformation.prior(self.space)
        for white in self.windows:
            belief = advance(update(belief, white), white, self.space, UNDISTURBED)
        self.moments = MeanAndCovariance.of(belief, self.space)

    def _window(self, rng: np.random.Generator, unseen: slice) -> WhitenedWindow:
        size = self.layout.size
        rows, way = rng.normal(size=(MEASURED, size)), 0.1 * rng.normal(size=(6, size))
        way[:, :6] += np.eye(6)
        rows[:, unseen] = way[:, unseen] = 0.0
        shared = rng.normal(size=size)
        shared[unseen] = 0.0
        none, head = np.zeros((6, 6)), np.eye(12)
        head[:6] = way[:, :12]
        return WhitenedWindow(
            *(rng.normal(size=MEASURED), rows, 0.0, way, rng.normal(size=6), np.zeros((6, 0)), np.linalg.inv(head)),
            *(shared, np.zeros((10, 11)), none, np.zeros((6, size)), none, none, np.zeros((6, 0))),
            length=0.5,
            places=np.arange(MEASURED),
        )

    def sources(self) -> Array:
        """Return what white noise and prior each contribute to the covariance of the state, (1 + v, s, s).

        The estimate's error as a linear function of the noise of all values, and of the prior's independent numbers.
        """
        size = self.layout.size
        whole: Array = np.eye(size)
        rows = []
        for white in self.windows:
            rows.append(white.rows @ whole)
            step = np.eye(size)
            step[:6] = white.transition
            whole = step @ whole
        matrix, root = np.concatenate(rows), self.space.gather @ self.space.factor
        covariance = np.linalg.inv(matrix.T @ matrix + np.linalg.inv(root @ root.T))
        to_state = self.space.spread @ whole
        noise = to_state @ covariance @ matrix.T
        prior = to_state @ (covariance @ matrix.T @ matrix - np.eye(size)) @ root
        return np.stack([noise @ noise.T, *(np.outer(column, column) for column in prior.T)])


def test_the_shares_are_what_each_prior_contributes() -> None:
    case = Case()
    moments, layout = case.moments, case.layout
    # Of numbers of momentum and body that are no coordinates of the state.
    rows = np.arange(6, BODY.stop)
    jacobian = np.random.default_rng(1).normal(size=(4, len(rows)))
    parts = moments.contributions(jacobian @ moments.factor[rows], layout)
    shares = dict(zip(layout.causes, (parts.T**2 @ layout.belongs).T, strict=True))
    names = layout.kernel.model.joint_names
    assert set(shares) == {*(f'{part}:{name}' for name in names for part in ('zero', 'axis')), 'mount', 'time offset'}

    def of(covariance: Array) -> Array:
        return np.einsum('mi,ij,mj->m', jacobian, covariance[np.ix_(rows, rows)], jacobian)

    noise, *priors = (of(each) for each in case.sources())
    for cause, share in shares.items():
        own = [
            place.start + index
            for unknown, place in zip(layout.unknowns, layout.places, strict=True)
            for index, each in enumerate(unknown.causes)
            if each == cause
        ]
        assert share == pytest.approx(sum(priors[index] for index in own), rel=1e-6)
    # What is left of the whole is sensor noise, and the priors of pose, momentum and body.
    whole = of(moments.factor @ moments.factor.T)
    rest = noise + sum(priors[: BODY.stop])
    assert sum(shares.values()) + rest == pytest.approx(whole, rel=1e-8)


def test_what_no_window_has_seen_keeps_its_prior_exactly() -> None:
    unseen = slice(BODY.stop + 4, BODY.stop + 9)
    moments = Case(windows=200, unseen=unseen).moments
    assert np.array_equal(moments.variance[unseen], np.ones(5))
    assert np.array_equal(moments.mean[unseen], np.zeros(5))
    others = np.delete(moments.factor, np.arange(unseen.start, unseen.stop), axis=0)
    assert np.array_equal(moments.factor[unseen] @ others.T, np.zeros((5, len(others))))


def test_numbers_of_the_state_have_the_covariance_of_their_factor() -> None:
    case = Case()
    rows = np.array([3, 14, 30])
    factor = case.moments.factor
    outside = replace(case.space, basis=case.space.basis[:, :-1], scale=case.space.scale[:-1])
    found = case.moments.covariance(rows)
    assert found == pytest.approx((factor @ factor.T)[np.ix_(rows, rows)])
    # What the variables leave out is as uncertain as ever.
    last = np.array([case.layout.size - 1])
    assert outside.outside[np.ix_(last, last)] == pytest.approx(np.ones((1, 1)))
