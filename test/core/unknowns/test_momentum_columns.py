"""How the momentum depends on the unknowns, against central differences of the momentum of robots that are so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from derivatives import central_difference
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.model import RobotModel, express, load_model
from mbaid_ros.core.robot.model_errors import KnownErrors, declared, displaced
from mbaid_ros.core.robot.orbit import of_bodies
from mbaid_ros.core.unknowns.bodies import known_bodies, spin_inertias
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.joints import JointPlacements, joint_placements
from random_robots import random_state, random_storage, random_urdf

SEEDS = range(6)
STEP = 1e-5
COUNT = 3  # states of a robot
Robots = Callable[[int], RobotModel]
NORMAL = np.array([0.0, 0.0, 1.0])
IN_PLANE = [0, 1, 5]  # of (P, L)


def spatial(seed: int) -> RobotModel:
    return load_model(random_urdf(np.random.default_rng(seed), joints=7))


def planar(seed: int) -> RobotModel:
    """Return a flat tree: joints turn about z, or slide across it, and every body is its own image in the plane."""
    model, rng = spatial(seed), np.random.default_rng([seed, 1])
    across = np.column_stack((rng.normal(size=(model.joints, 2)), np.zeros(model.joints)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    flat = np.array([1.0, 1.0, 0.0])
    symmetric = np.array([1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0])
    return replace(
        model,
        axes=np.where(np.array(model.prismatic)[:, None], across, NORMAL),
        rotations=exp(rng.uniform(-2.0, 2.0, (model.joints, 1)) * NORMAL),
        positions=flat * model.positions,
        links=tuple(
            replace(link, rotation=np.eye(3), position=flat * link.position, parameters=symmetric * link.parameters)
            for link in model.links
        ),
    )


class Case:
    """A robot in random states, in which all of its bodies count as known."""

    def __init__(self, model: RobotModel, seed: int, *, in_plane: bool = False) -> None:
        rng = np.random.default_rng([seed, 2])
        bodies = model.body_parameters()
        kernel = MomentumKernel(model, model.last_link)
        target = np.zeros_like(bodies)
        placed = kernel.target
        target[placed.body] = express(placed.parameters, placed.rotation, placed.position)
        self.kernel = kernel.corrected(target).with_uncertainty(declared(bodies, 0.01))
        if seed % 2 and not in_plane:
            self.kernel = self.kernel.storing(random_storage(rng, model))
        self.readings = rng.normal(size=(COUNT, self.kernel.storage.count))
        # What an orbit has brought to any body, on top of its own momentum.
        self.tide = 0.1 * rng.normal(size=(COUNT, len(bodies) if seed >= 3 and not in_plane else 0, 6, 10))
        self.joints, self.rates, self.rotation, self.twist = random_state(rng, model.joints, COUNT)
        if in_plane:
            self.rotation = exp(self.rotation[:, 0, :1] * NORMAL)
            self.twist[:, 2:5] = 0.0

    def states(self, kernel: MomentumKernel, zeros: Array | float = 0.0) -> BodyStates:
        """Return the states of a robot whose joints are elsewhere by these zeros."""
        states = kernel.states_of(self.rotation, self.joints + zeros, self.rates, self.twist, self.readings)
        return replace(states, tide=self.tide)

    def momentum(self, kernel: MomentumKernel, zeros: Array | float = 0.0) -> Array:
        """Return the momentum of all bodies, (N, 6)."""
        total = self.states(kernel, zeros).known_momentum
        return total - of_bodies(self.tide, kernel.known) if self.tide.size else total

    def placements(self) -> JointPlacements:
        """Return the joints' placements as an unknown, all equally uncertain."""
        each = [1e-3] * self.kernel.model.joints
        return joint_placements(self.kernel, each, each, each)


def close(found: Array, expected: Array) -> None:
    assert found == pytest.approx(expected, abs=1e-7 * float(np.abs(expected).max()))


def test_the_random_robots_are_trees_with_joints_of_both_kinds() -> None:
    models = [make(seed) for seed in SEEDS for make in (spatial, planar)]
    assert {slides for model in models for slides in model.prismatic} == {False, True}
    assert any(len(set(model.parents)) < model.joints for model in models)
    assert all(PlaneDetector(planar(seed)).planar for seed in SEEDS)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('make', [spatial, planar])
def test_joint_placements(make: Robots, seed: int) -> None:
    case = Case(make(seed), seed)
    unknown, model = case.placements(), case.kernel.model

    def displaced_momentum(value: Array) -> Array:
        each = value.reshape(-1, 6)
        tilts = (unknown.across @ each[:, 4:, None])[..., 0]
        # The tilts are normal to the joints' axes: what turns about these is the zeros'.
        assert np.sum(tilts * model.axes, axis=1) == pytest.approx(np.zeros(model.joints), abs=1e-12)
        elsewhere = MomentumKernel(displaced(model, each[:, 1:4], tilts), case.kernel.target.name)
        elsewhere = elsewhere.storing(case.kernel.storage)
        return case.momentum(elsewhere.corrected(case.kernel.known - elsewhere.known), each[:, 0])

    found = unknown.momentum_columns(case.kernel, case.states(case.kernel))
    close(found, central_difference(displaced_momentum, np.zeros(6 * model.joints), STEP))


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('make', [spatial, planar])
def test_known_bodies(make: Robots, seed: int) -> None:
    case = Case(make(seed), seed)
    unknown = known_bodies(case.kernel.model, case.kernel.errors)

    def other_momentum(value: Array) -> Array:
        change = np.zeros_like(case.kernel.known)
        change[list(unknown.bodies)] = value.reshape(-1, 10)
        return case.momentum(case.kernel.corrected(change))

    found = unknown.momentum_columns(case.kernel, case.states(case.kernel))
    close(found, central_difference(other_momentum, np.zeros(10 * len(unknown.bodies)), 1e-2))


@pytest.mark.parametrize('seed', SEEDS)
def test_the_first_number_of_a_known_body_is_its_mass(seed: int) -> None:
    for kernel, in_plane in ((Case(spatial(seed), seed).kernel, False), (Case(planar(seed), seed).kernel, True)):
        unknown: Unknown = known_bodies(kernel.model, kernel.errors)
        unknown = unknown.in_plane(PlaneDetector(kernel.model)) if in_plane else unknown
        assert [part for part in unknown.parts if part] == [
            f'mass:{label.partition(":")[2]}' for label in dict.fromkeys(unknown.labels)
        ]
        first = [place for place, part in enumerate(unknown.parts) if part]
        mass = unknown.factor[::10]
        assert np.all(np.delete(mass, first, axis=1) == 0.0)
        dense = KnownErrors(kernel.errors.bodies, kernel.errors.factor @ np.full((kernel.errors.count,) * 2, 0.1))
        assert not any(known_bodies(kernel.model, dense).parts)


@pytest.mark.parametrize('seed', [1, 3, 5])
def test_spin_inertias(seed: int) -> None:
    case = Case(spatial(seed), seed)
    storage = case.kernel.storage
    unknown = spin_inertias(case.kernel, [0.1, 0.2, 0.0, *(0.0,) * 3])
    found = unknown.momentum_columns(case.kernel, case.states(case.kernel))
    close(
        found,
        central_difference(
            lambda value: case.momentum(case.kernel.storing(storage.changed(value))), np.zeros(storage.count), STEP
        ),
    )
    assert unknown.count == 2
    assert unknown.causes == ('wheel:wheel0', 'wheel:wheel1')


@pytest.mark.parametrize('seed', SEEDS)
def test_in_a_plane_nothing_that_the_motion_depends_on_is_left_out(seed: int) -> None:
    case = Case(planar(seed), seed, in_plane=True)
    detector = PlaneDetector(case.kernel.model)
    states = case.states(case.kernel)
    for unknown in (case.placements(), known_bodies(case.kernel.model, case.kernel.errors)):
        part = unknown.in_plane(detector)
        assert part.count < len(unknown.factor)
        whole, seen = (_in_plane(each, case.kernel, states) for each in (unknown, part))
        close(seen, whole)


def _in_plane(unknown: Unknown, kernel: MomentumKernel, states: BodyStates) -> Array:
    """Return the covariance of the momentum of all states in the plane, by the unknown's prior."""
    columns = unknown.momentum_columns(kernel, states)
    assert columns is not None
    rows = (columns[:, IN_PLANE] @ unknown.factor).reshape(-1, unknown.count)
    return np.asarray(rows @ rows.T)
