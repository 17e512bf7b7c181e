"""How the momentum depends on the unknowns, against central differences and against orbits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from checked import central_difference, some
from mbaid_ros.core.contracts import Motion, Unknown
from mbaid_ros.core.geometry import Array, exp, log, rotate
from mbaid_ros.core.joints.model import JointPlacements, joint_placements
from mbaid_ros.core.links import independent_errors, known_bodies
from mbaid_ros.core.orbit import (
    FallingFrame,
    NominalOrbit,
    Orbit,
    OrbitShape,
    gravity,
    momentum_rates,
    orbit_rate,
    orbit_shape,
)
from mbaid_ros.core.robot.model import PlaneDetector, RobotModel, displaced, express
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel, summed_over_bodies
from mbaid_ros.core.samples import BaseStream
from mbaid_ros.core.wheels import spin_inertias
from observed import kernel
from random_robots import NORMAL, planar, random_state, random_storage, spatial
from sessions import orbit

SEEDS = range(6)
STEP = 1e-5
COUNT = 3  # states of a robot
Robots = Callable[[int], RobotModel]
IN_PLANE = [0, 1, 5]  # of (P, L)


class Case:
    """A robot in random states, in which all of its bodies count as known."""

    def __init__(self, model: RobotModel, seed: int, *, in_plane: bool = False) -> None:
        rng = np.random.default_rng([seed, 2])
        bodies = model.body_parameters()
        kernel = MomentumKernel(model, model.last_link)
        target = np.zeros_like(bodies)
        placed = kernel.target
        target[placed.body] = express(placed.parameters, placed.rotation, placed.position)
        self.kernel = kernel.with_body_changes(target).with_errors(independent_errors(bodies, 0.01))
        if seed % 2 and not in_plane:
            self.kernel = self.kernel.with_storage(random_storage(rng, model))
        self.readings = rng.normal(size=(COUNT, self.kernel.storage.count))
        # What an orbit has brought to any body, on top of its own momentum.
        self.gravity_columns = 0.1 * rng.normal(size=(COUNT, len(bodies) if seed >= 3 and not in_plane else 0, 6, 10))
        self.joints, self.rates, self.rotation, self.twist = random_state(rng, model.joints, COUNT)
        if in_plane:
            self.rotation = exp(self.rotation[:, 0, :1] * NORMAL)
            self.twist[:, 2:5] = 0.0

    def states(self, kernel: MomentumKernel, zeros: Array | float = 0.0) -> BodyStates:
        """Return the states of a robot whose joints are elsewhere by these zeros."""
        states = kernel.states_of(self.rotation, self.joints + zeros, self.rates, self.twist, self.readings)
        return replace(states, gravity_columns=self.gravity_columns)

    def momentum(self, kernel: MomentumKernel, zeros: Array | float = 0.0) -> Array:
        """Return the momentum of all bodies, (N, 6)."""
        total = self.states(kernel, zeros).known_momentum
        return total - summed_over_bodies(self.gravity_columns, kernel.known) if self.gravity_columns.size else total

    def placements(self) -> JointPlacements:
        """Return the joints' placements as an unknown, all equally uncertain."""
        each = [1e-3] * self.kernel.model.joints
        return joint_placements(self.kernel, each, each, each)


def close(found: Array, expected: Array) -> None:
    assert found == pytest.approx(expected, abs=1e-7 * float(np.abs(expected).max()))


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
        elsewhere = elsewhere.with_storage(case.kernel.storage)
        return case.momentum(elsewhere.with_body_changes(case.kernel.known - elsewhere.known), each[:, 0])

    found = unknown.momentum_columns(case.kernel, case.states(case.kernel))
    close(found, central_difference(displaced_momentum, np.zeros(6 * model.joints), STEP))


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('make', [spatial, planar])
def test_directions_of_known_bodies_are_bodies_that_are_heavier_throughout(make: Robots, seed: int) -> None:
    kernel = Case(make(seed), seed).kernel
    unknown = known_bodies(kernel.model, kernel.errors, kernel.known)
    assert len(unknown.directions) == len(unknown.bodies)
    for place, along in enumerate(unknown.directions.values()):
        change = (unknown.factor @ along).reshape(-1, 10)
        known = kernel.known[unknown.bodies[place]]
        assert np.linalg.norm(along) == pytest.approx(1.0)
        assert np.allclose(change[place] * np.linalg.norm(known), np.linalg.norm(change[place]) * known)
        assert not np.delete(change, place, axis=0).any()


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('make', [spatial, planar])
def test_known_bodies(make: Robots, seed: int) -> None:
    case = Case(make(seed), seed)
    unknown = known_bodies(case.kernel.model, case.kernel.errors)

    def other_momentum(value: Array) -> Array:
        change = np.zeros_like(case.kernel.known)
        change[list(unknown.bodies)] = value.reshape(-1, 10)
        return case.momentum(case.kernel.with_body_changes(change))

    found = unknown.momentum_columns(case.kernel, case.states(case.kernel))
    close(found, central_difference(other_momentum, np.zeros(10 * len(unknown.bodies)), 1e-2))


@pytest.mark.parametrize('seed', [1, 3, 5])
def test_spin_inertias(seed: int) -> None:
    case = Case(spatial(seed), seed)
    storage = case.kernel.storage
    unknown = spin_inertias(case.kernel, [0.1, 0.2, 0.0, *(0.0,) * 3])
    found = unknown.momentum_columns(case.kernel, case.states(case.kernel))

    def stored(value: Array) -> Array:
        return case.momentum(case.kernel.with_storage(storage.with_inertia_changes(value)))

    close(found, central_difference(stored, np.zeros(storage.count), STEP))
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
    columns = some(unknown.momentum_columns(kernel, states))
    rows = (columns[:, IN_PLANE] @ unknown.factor).reshape(-1, unknown.count)
    return np.asarray(rows @ rows.T)


RATE = 1.1e-3
ORIGIN = np.array([8.0, -11.0, 5.0])
LAST = np.array([70.0, 7.0, -3.0, 20.0, 30.0, 1.0, -2.0, 32.0, 1.0, 12.0])


def random_orbit(rng: np.random.Generator) -> Orbit:
    normal = rng.normal(size=3)
    return Orbit.inertial(RATE, np.cross(normal, rng.normal(size=3)), normal)


def numbers(around: Orbit) -> Array:
    """Return the ten numbers of an orbit's gradient at the begin, and of how it changes."""
    before, now, after = around.gradient(np.array([-1.0, 0.0, 1.0]))
    both = np.array([now, (after - before) / 2.0])
    mixed = np.sqrt(2.0) * np.column_stack((both[:, 0, 1], both[:, 0, 2], both[:, 1, 2]))
    across = (both[:, 0, 0] - both[:, 1, 1]) / np.sqrt(2.0)
    along = -3.0 * both[:, 2, 2] / np.sqrt(6.0)
    return np.column_stack((mixed, across, along)).ravel()


@pytest.mark.parametrize('seed', range(3))
def test_it_changes_the_momentum_as_an_orbit_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    servicer, around = kernel('servicer7'), random_orbit(rng)
    rotation = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    rotation *= np.linalg.det(rotation)[:, None, None]
    place = rng.normal(size=(4, 3))
    placed = servicer.kinematics.configure(rotation, rng.normal(size=(4, servicer.model.joints)))
    bodies = servicer.body_parameters(LAST)
    whole = np.sum(express(bodies, placed.rotation, place[:, None] + placed.position), axis=1)
    time = np.array([0.0, 10.0, 20.0, 30.0])  # s, in which it turns by 0.07 rad
    found = gravity(RATE).momentum_rates(whole, ORIGIN, time, rotation) @ numbers(around)
    expected = summed_over_bodies(momentum_rates(around, time, placed, ORIGIN + place), bodies)
    expected[:, 3:] -= np.cross(ORIGIN, expected[:, :3])
    size = np.abs(expected).max()
    assert np.all(np.abs(found - expected)[0] < 1e-9 * size)  # at the begin it is that of the random_orbit
    assert np.all(np.abs(found - expected) < 0.01 * size)  # then up to what turning is of second order
    assert orbit_rate(numbers(around)) == pytest.approx(RATE, rel=1e-9)


def test_its_prior_is_that_of_orbits_in_all_planes() -> None:
    rng = np.random.default_rng(0)
    unknown = gravity(RATE)
    size = np.sqrt(np.diag(unknown.factor @ unknown.factor.T))
    drawn = np.array([numbers(random_orbit(rng)) / size for _ in range(1500)])
    assert drawn.T @ drawn / len(drawn) == pytest.approx(np.eye(10), abs=0.15)
    assert gravity(0.0).count == 0


SMALL = 1e-4
TIME = np.array([0.0, 60.0, 200.0, 400.0])  # s, in which it turns by 0.44 rad


def circle(frame: str) -> Orbit:
    if frame == 'inertial':
        return orbit(RATE)
    return Orbit.rotating(RATE, 'lvlh' if frame == 'lvlh' else 'hill')


def eccentric(around: Orbit, number: int) -> tuple[Orbit, Array]:
    """Return an orbit that is a little none, and its numbers."""
    numbers = SMALL * np.eye(3)[number]
    if number == 2:
        return replace(around, mean_motion=(1.0 + SMALL) * RATE), numbers
    return around.with_eccentricity(SMALL, 0.0 if number == 0 else np.pi / 2.0), numbers


def shape(around: Orbit, *, relative: bool = True) -> OrbitShape:
    return orbit_shape(NominalOrbit(around, 0.002, relative))


def poses(seed: int) -> tuple[Array, Array]:
    """Return orientations and places, the latter from the run's origin, in the frame that falls along."""
    rng = np.random.default_rng(seed)
    return exp(rng.normal(size=(len(TIME), 3))), rng.normal(size=(len(TIME), 3))


def taken(true: Orbit, declared: Orbit, twist: Array, *, relative: bool) -> BaseStream:
    """Return poses and twists (N, 6) of the falling frame as they are read, taken for those of the declared orbit."""
    rotation, place = poses(0)
    back = np.swapaxes(true.to_inertial(TIME), 1, 2)
    linear, angular = twist[:, :3], twist[:, 3:]
    if relative:
        rate = true.rate(TIME)
        linear, angular = linear - np.cross(rate, ORIGIN + place), angular - rate
    seen = BaseStream(
        np.round(TIME * 1e9).astype(np.int64),
        rotate(back, ORIGIN + place),
        back @ rotation,
        rotate(back, linear),
        rotate(back, angular),
        *np.zeros((2, len(TIME), 6, 6)),
    )
    return FallingFrame(declared, kernel('ets7').model, relative_twist=relative, epoch=0).to_falling_frame(seen)


@pytest.mark.parametrize('relative', [True, False])
@pytest.mark.parametrize('number', range(3))
@pytest.mark.parametrize('frame', ['lvlh', 'hill'])
def test_what_is_read_turns_back(frame: str, number: int, *, relative: bool) -> None:
    around = circle(frame)
    true, numbers = eccentric(around, number)
    rotation, place = poses(0)
    still = np.zeros((len(TIME), 6))
    read = taken(true, around, still, relative=relative)
    motion = Motion(TIME, ORIGIN, place, rotation, still, still, still)
    unknown = shape(around, relative=relative)
    pose = some(unknown.measured('pose', motion)) @ numbers
    faster = unknown.measured('twist', motion)
    twist = np.zeros_like(pose) if faster is None else faster @ numbers
    assert log(read.rotation @ np.swapaxes(rotation, 1, 2)) == pytest.approx(pose[:, :3], rel=1e-2, abs=1e-9)
    assert read.position - ORIGIN - place == pytest.approx(pose[:, 3:], rel=1e-2, abs=1e-7)
    assert read.angular_velocity == pytest.approx(twist[:, :3], rel=1e-2, abs=1e-10)
    # Velocities relative to the run's origin, which does not turn, are what the positions change by.
    assert read.linear_velocity == pytest.approx(twist[:, 3:], rel=1e-2, abs=2e-9)
    assert np.abs(pose).max() > 1e-6


@pytest.mark.parametrize('number', range(3))
@pytest.mark.parametrize('frame', ['inertial', 'lvlh', 'hill'])
def test_gravity_brings_what_the_true_orbit_does(frame: str, number: int) -> None:
    """About where the run is read to begin, of a robot where it is read to be, against the truth of both."""
    around, servicer = circle(frame), kernel('servicer7')
    true, numbers = eccentric(around, number)
    rotation, place = poses(1)
    angles = np.random.default_rng(2).normal(size=(len(TIME), servicer.model.joints))
    bodies = servicer.body_parameters(LAST)

    def brought(by: Orbit, turn: Array) -> Array:
        placed = servicer.kinematics.configure(turn @ rotation, angles)
        there = rotate(turn, ORIGIN + place)
        rates = summed_over_bodies(momentum_rates(by, TIME, placed, there), bodies)
        rates[:, 3:] -= np.cross(ORIGIN, rates[:, :3])
        return np.asarray(rates)

    whole_turn = np.broadcast_to(np.eye(3), (len(TIME), 3, 3))
    back = around.to_inertial(TIME) @ np.swapaxes(true.to_inertial(TIME), 1, 2) if around.is_rotating else whole_turn
    expected = brought(true, whole_turn) - brought(around, back)
    placed = servicer.kinematics.configure(rotation, angles)
    whole = np.sum(express(bodies, placed.rotation, place[:, None] + placed.position), axis=1)
    found = shape(around).momentum_rates(whole, ORIGIN, TIME, rotation) @ numbers
    assert found == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_its_prior_is_of_any_direction() -> None:
    unknown = shape(circle('hill'))
    assert unknown.factor @ unknown.factor.T == pytest.approx(0.5 * 0.002**2 * np.eye(3))
    assert set(unknown.labels) == {'orbit shape'}
