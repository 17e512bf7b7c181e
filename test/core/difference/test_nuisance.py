"""Consider parameters: their columns are derivatives of the equations, and which of them matters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mbaid_ros.core.clocks import time_offset
from mbaid_ros.core.contracts import NominalModel, Unknown
from mbaid_ros.core.difference import ConsiderParameters, window_rows
from mbaid_ros.core.difference_solver import Blocks
from mbaid_ros.core.geometry import Array, cross, exp
from mbaid_ros.core.joints.model import joint_placements
from mbaid_ros.core.links import known_bodies
from mbaid_ros.core.odometry.model import odometry_mount
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.momentum import BodyStates, KnownErrors, MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import UnknownsPrior
from mbaid_ros.simulation.simulation import Truth
from observed import MID, kernel, observe, windows


@dataclass(frozen=True, eq=False)
class Stated(Unknown):
    """An unknown with given columns, the same at all samples."""

    given: Array

    def momentum_columns(self, _kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return those that were given."""
        return np.tile(self.given, (len(states.body_twist), 1, 1))


def bodies_of(servicer: MomentumKernel) -> Unknown:
    return known_bodies(servicer.model, servicer.errors)


def left(equations: Blocks, x: Array) -> Array:
    """Return what the equations of a robot leave of a solution x (16,), (K, 6)."""
    return np.asarray(equations.rows @ x + equations.offset)


def test_the_columns_of_known_bodies_are_what_their_errors_do(spatial: Truth) -> None:
    servicer, parts = kernel('servicer7'), windows(observe(spatial, MID))[:4]
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(20, 3))
    doubtful = servicer.with_errors(KnownErrors((0, 3), factor))
    considered = ConsiderParameters(doubtful, [bodies_of(doubtful)])
    error = rng.normal(size=3)
    change = np.zeros_like(servicer.known)
    change[[0, 3]] = (factor @ error).reshape(2, 10)
    origin = np.zeros(3)
    plain, moved = (window_rows(robot, parts, MID, origin) for robot in (servicer, servicer.with_body_changes(change)))
    assert considered.columns(parts, np.zeros(10)) @ error == pytest.approx(moved.offset - plain.offset, abs=1e-9)


def test_the_columns_of_placements_are_what_they_do_with_the_target(spatial: Truth) -> None:
    servicer, parts = kernel('servicer7'), windows(observe(spatial, MID))[:3]
    joints = servicer.model.joints
    unknown = joint_placements(servicer, *([1.0] * joints for _ in range(3)))
    body = standard(physical(servicer.target.parameters))
    x = np.concatenate((body, np.random.default_rng(1).normal(size=6)))
    columns = ConsiderParameters(servicer, [unknown]).columns(parts, body)
    error = 1e-6 * np.random.default_rng(2).normal(size=unknown.count)

    def equations(size: float) -> Array:
        nominal = unknown.applied_to(NominalModel.nominal(servicer), unknown.factor @ (size * error))
        there = [replace(part, joint_position=part.joint_position + nominal.zeros) for part in parts]
        return left(window_rows(nominal.kernel, there, MID, np.zeros(3)), x)

    assert columns @ error == pytest.approx(0.5 * (equations(1.0) - equations(-1.0)), abs=1e-9)


def test_the_columns_of_the_mount_are_what_it_does(spatial: Truth) -> None:
    servicer, parts = kernel('servicer7'), windows(observe(spatial, MID))[:3]
    unknown = odometry_mount(1.0, 1.0)
    body = standard(physical(servicer.target.parameters))
    columns = ConsiderParameters(servicer, [unknown]).columns(parts, body)
    states = [servicer.states(part) for part in parts]
    # At the momentum that there is.
    total = np.mean([np.mean(s.known_momentum + s.regressor @ body, axis=0) for s in states], axis=0)
    total[3:] += np.cross(np.mean([part.base_position.mean(axis=0) for part in parts], axis=0), total[:3])
    mount = 1e-6 * np.random.default_rng(3).normal(size=6)

    def at_the_base(part: Samples, size: float) -> Samples:
        away = part.base_rotation @ (size * mount[3:])
        return replace(
            part,
            base_rotation=part.base_rotation @ exp(size * mount[:3]),
            base_position=part.base_position + away,
            base_linear_velocity=part.base_linear_velocity + cross(part.base_angular_velocity, away),
        )

    def equations(size: float) -> Array:
        there = [at_the_base(part, size) for part in parts]
        return left(window_rows(servicer, there, MID, np.zeros(3)), np.concatenate((body, total)))

    found = 0.5 * (equations(1.0) - equations(-1.0))
    assert columns @ mount == pytest.approx(found, abs=1e-3 * np.abs(found).max())


def test_what_is_known_of_unknowns_together_has_their_correlations(spatial: Truth) -> None:
    servicer, parts = kernel('servicer7'), windows(observe(spatial, MID))[:3]
    rng = np.random.default_rng(6)
    first, last = rng.normal(size=(6, 2)), rng.normal(size=(6, 3))
    unknowns = [
        Stated(np.diag([0.5, 2.0]), ('first',) * 2, first),
        time_offset(0.02),  # not in the equations
        Stated(np.diag([1.0, 3.0, 0.1]), ('last',) * 3, last),
    ]
    factor = rng.normal(size=(6, 8))  # wider than high, as a planar calibration leaves it
    known = UnknownsPrior(rng.normal(size=6), factor)
    both = ConsiderParameters(servicer, unknowns, known)
    assert both.count == 5
    columns = both.columns(parts, np.zeros(10))[1]
    spread = np.concatenate((first * [0.5, 2.0], last * [1.0, 3.0, 0.1]), axis=1) @ factor[[0, 1, 3, 4, 5]]
    assert columns @ columns.T == pytest.approx(spread @ spread.T)


def test_the_robot_is_taken_at_the_mean_of_what_is_known(spatial: Truth) -> None:
    """Joint zeros, placements and mount that are off by the mean lead to what the true robot leads to."""
    servicer = kernel('servicer7')
    joints = servicer.model.joints
    unknowns = [
        joint_placements(servicer, *([size] * joints for size in (2e-3, 1e-3, 1e-3))),
        odometry_mount(2e-3, 2e-3),
    ]
    count = sum(unknown.count for unknown in unknowns)
    known = UnknownsPrior(np.random.default_rng(7).normal(size=count), np.eye(count))
    nominal = known.nominal_model(servicer, unknowns)
    placements, mount = (
        unknown.factor @ mean for unknown, mean in zip(unknowns, np.split(known.mean, [-6]), strict=True)
    )
    assert nominal.zeros == pytest.approx(placements[::6])
    assert nominal.mount == pytest.approx(mount)
    samples = observe(spatial, MID)
    found = nominal.corrected(samples)
    assert found.joint_position == pytest.approx(samples.joint_position + placements[::6])
    assert found.base_rotation == pytest.approx(samples.base_rotation @ exp(mount[:3]))
    assert found.base_position == pytest.approx(samples.base_position + samples.base_rotation @ mount[3:])
    # The velocity goes with the position: no other motion than that of a fixed point of the base.
    step = np.diff(found.time)[:, None]
    means = 0.5 * (found.base_linear_velocity[1:] + found.base_linear_velocity[:-1])
    before = 0.5 * (samples.base_linear_velocity[1:] + samples.base_linear_velocity[:-1])
    moved = np.diff(found.base_position - samples.base_position, axis=0) / step
    assert means - before == pytest.approx(moved, abs=1e-3 * np.abs(moved).max())
