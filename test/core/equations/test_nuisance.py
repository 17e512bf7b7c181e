"""Nuisances: their columns are derivatives of the momentum, and which of them matters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from mbaid_ros.core.equations.nuisance import ConsiderParameters, KnownBodies
from mbaid_ros.core.equations.window_rows import window_rows
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.known_errors import KnownErrors, declared
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.simulation.run import Truth
from observed import MID, kernel, observe, windows


@dataclass(frozen=True)
class Stated:
    """A nuisance with given columns, the same at all samples."""

    factor: Array
    labels: Mapping[str, slice]
    given: Array

    def columns(self, _kernel: MomentumKernel, _states: BodyStates, samples: Samples) -> Array:
        """Return those that were given."""
        return np.tile(self.given, (len(samples), 1, 1))


def test_the_columns_of_known_bodies_are_what_their_errors_do(spatial: Truth) -> None:
    servicer, parts = kernel('servicer7'), windows(observe(spatial, MID))[:4]
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(20, 3))
    doubtful = servicer.doubted(KnownErrors((0, 3), factor))
    considered = ConsiderParameters(doubtful, [KnownBodies(doubtful)])
    assert considered.labels == ['link:base_link', 'link:link3']
    error = rng.normal(size=3)
    change = np.zeros_like(servicer.known)
    change[[0, 3]] = (factor @ error).reshape(2, 10)
    origin = np.zeros(3)
    plain, moved = (window_rows(robot, parts, MID, origin) for robot in (servicer, servicer.corrected(change)))
    assert considered.columns(parts) @ error == pytest.approx(moved.offset - plain.offset, abs=1e-9)


def test_the_share_of_a_part_is_what_knowing_it_would_take_away() -> None:
    rng = np.random.default_rng(5)
    factor = rng.normal(size=(20, 20)) * 10.0 ** rng.uniform(-2.0, 1.0, 20)[:, None]
    parts = {'one': slice(0, 10), 'other': slice(10, 20)}
    considered = ConsiderParameters(kernel('servicer7'), [Stated(factor, parts, np.zeros((6, 20)))])
    gain = rng.normal(size=(4, 20))
    shares = considered.shares(gain @ factor)
    full = factor @ factor.T
    for place, (own, other) in enumerate(((slice(0, 10), slice(10, 20)), (slice(10, 20), slice(0, 10)))):
        left = full[other, other] - full[other, own] @ np.linalg.solve(full[own, own], full[own, other])
        taken = np.diag(gain @ full @ gain.T) - np.diag(gain[:, other] @ left @ gain[:, other].T)
        assert shares[:, place] == pytest.approx(taken, rel=1e-5)


def test_several_nuisances_stand_beside_each_other(spatial: Truth) -> None:
    servicer, parts = kernel('servicer7'), windows(observe(spatial, MID))[:3]
    servicer = servicer.doubted(declared(servicer.known, [0.01, *[0.0] * (len(servicer.known) - 1)]))
    bodies, given = KnownBodies(servicer), np.arange(12.0).reshape(6, 2)
    exact = Stated(np.zeros((2, 0)), {'exact': slice(0, 2)}, given)
    stated = Stated(np.diag([0.5, 2.0]), {'first': slice(0, 1), 'second': slice(1, 2)}, given)
    both = ConsiderParameters(servicer, [bodies, exact, stated])
    assert both.count == 12
    assert both.labels == ['link:base_link', 'first', 'second']
    columns = both.columns(parts)
    assert columns[..., :10] == pytest.approx(ConsiderParameters(servicer, [bodies]).columns(parts))
    assert columns[1, :, 10:] == pytest.approx(given * [0.5, 2.0])
    spread = np.arange(24.0).reshape(2, 12)
    assert both.shares(spread)[:, 1:] == pytest.approx(spread[:, 10:] ** 2)
    # Independent parts add up to all of it.
    assert both.shares(spread).sum(axis=1) == pytest.approx(np.sum(spread**2, axis=1))


def test_nothing_uncertain_costs_nothing(spatial: Truth) -> None:
    none = ConsiderParameters(kernel('servicer7'), [KnownBodies(kernel('servicer7'))])
    assert none.count == 0
    assert none.columns(windows(observe(spatial, MID))[:3]).shape == (3, 6, 0)
    assert none.shares(np.zeros((5, 0))).shape == (5, 0)
