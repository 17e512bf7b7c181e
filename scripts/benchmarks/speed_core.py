"""How fast the core is without messages: the rows of the momentum equations, and the whole identification."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio

from benchmarks.data import DURATION, LEVELS, endless_motion, exact_samples, kernel, sensed
from benchmarks.methods import Identification
from benchmarks.speed_bag import LEVEL, ROBOT
from mbaid_ros.core.geometry import Array, quaternion_from_rotation, unvec
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.robot.kernel import MomentumKernel, momentum_rows
from mbaid_ros.core.robot.model import RobotModel, load_model, parse
from mbaid_ros.core.samples import BaseStream, JointStream, Samples
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import random_sinusoids
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation, Truth

JOINTS = (4, 7, 12, 20)
WINDOWS = (0.1, 0.25, 0.5, 1.0, 2.0)  # s
_PART = 3_000  # samples handed over at a time, as `replay` does in thousands
_STEP = 0.02  # s, of the integrator
_RATE = 100.0  # Hz
# Columns of pinocchio's regressor, whose inertia is (xx, xy, yy, xz, yz, zz), in our order.
_ORDER = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]


@dataclass(frozen=True)
class Rates:
    """Samples a second, of one core.

    Attributes
    ----------
    rows, peer : the rows of the equations: ours, and a loop over pinocchio; one a repetition
    """

    rows: tuple[float, ...]
    peer: tuple[float, ...]


def rows(count: int, repeats: int) -> Rates:
    """Return how fast rows are made, checked to be the same.

    Parameters
    ----------
    count : number of samples
    repeats : number of pairs
    """
    samples = exact_samples(endless_motion(ROBOT)[:count], LEVELS[LEVEL])
    ours, peer = kernel(ROBOT), _Peer(kernel(ROBOT), samples)
    for found, expected in zip(_rows(ours, samples), peer.rows(), strict=True):
        if not np.allclose(found, expected, rtol=1e-9, atol=1e-9):
            raise RuntimeError('the rows are not those of pinocchio')
    pairs = [(_taken(_rows, ours, samples), _taken(peer.rows)) for _ in range(repeats)]
    return Rates(*(tuple(len(samples) / taken for taken in column) for column in zip(*pairs, strict=True)))


def rows_by_joints(count: int, repeats: int) -> dict[int, float]:
    """Return the median of samples a second by number of joints, of chains in random states."""
    rates = {}
    for joints in JOINTS:
        ours, samples = chain(joints), _anywhere(joints, count)
        _rows(ours, samples)
        rates[joints] = float(np.median([count / _taken(_rows, ours, samples) for _ in range(repeats)]))
    return rates


def identification_by_joints(method: str, seconds: float, repeats: int) -> dict[int, float]:
    """Return the median of samples a second through a method, by number of joints, of simulated chains."""
    rates = {}
    for joints in JOINTS:
        ours = chain(joints)
        truth = _simulated(ours.model, seconds)
        rates[joints] = float(np.median([_identified(ours, method, truth, 0.5) for _ in range(repeats)]))
    return rates


def identification_by_window(method: str, seconds: float, repeats: int) -> dict[float, float]:
    """Return the median of samples a second through a method, by length of the windows."""
    truth = endless_motion(ROBOT)[: round(seconds * _RATE)]
    return {
        window: float(np.median([_identified(kernel(ROBOT), method, truth, window) for _ in range(repeats)]))
        for window in WINDOWS
    }


def identification_by_length(method: str, minutes: Sequence[int]) -> dict[int, float]:
    """Return samples a second through a method in the last minutes (at most five) of runs of some lengths.

    The first minute, in which a method looks for where to start, counts only in a run of one minute.

    Parameters
    ----------
    method : name
    minutes : lengths of the runs, increasing; they are the beginnings of one run
    """
    truth, noise = endless_motion(ROBOT), LEVELS[LEVEL]
    identifier = Identification(kernel(ROBOT), noise, np.zeros(6)).identifier(method)
    sensors = Sensors(noise, seed=0)
    taken: list[float] = []
    rates = {}
    for minute in range(max(minutes)):
        later = replace(truth, time=truth.time + minute * DURATION)
        streams = [sensed(later[k : k + _PART], sensors, noise) for k in range(0, len(later), _PART)]
        taken.append(_taken(_pushed, identifier, streams))
        if minute + 1 in minutes:
            rates[minute + 1] = len(truth) / float(np.mean(taken[max(min(minute, 1), minute - 4) :]))
    return rates


def chain(joints: int) -> MomentumKernel:
    """Return the kernel of a chain of bodies with random placements, whose last link is unknown."""
    rng = np.random.default_rng(joints)
    masses = (300.0, *rng.uniform(3.0, 10.0, joints - 1), 100.0)
    links = [_link(k, mass, rng) for k, mass in enumerate(masses)]
    urdf = '\n'.join(
        [f'<robot name="chain{joints}">', *links, *(_joint(k, rng) for k in range(1, joints + 1)), '</robot>']
    )
    model = load_model(urdf)
    return MomentumKernel(model, model.last_link)


def _link(index: int, mass: float, rng: np.random.Generator) -> str:
    ixx, iyy, izz = mass * rng.uniform(0.1, 0.15, 3)
    return (
        f'<link name="link{index}"><inertial><origin xyz="{_text(rng.uniform(-0.2, 0.2, 3))}"/><mass value="{mass}"/>'
        f'<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/></inertial></link>'
    )


def _joint(index: int, rng: np.random.Generator) -> str:
    axis = rng.normal(size=3)
    return (
        f'<joint name="joint{index}" type="revolute"><parent link="link{index - 1}"/><child link="link{index}"/>'
        f'<origin xyz="{_text(rng.uniform(-0.4, 0.4, 3))}" rpy="{_text(rng.uniform(-2.0, 2.0, 3))}"/>'
        f'<axis xyz="{_text(axis / np.linalg.norm(axis))}"/>'
        '<limit lower="-3" upper="3" effort="100" velocity="10"/></joint>'
    )


def _text(values: Array) -> str:
    return ' '.join(repr(float(value)) for value in values)


def _simulated(model: RobotModel, seconds: float) -> Truth:
    """Return the motion of a robot at rest at first, all of whose joints move."""
    motion = random_sinusoids(np.zeros(model.joints), model.joints, 2, 0.3, 10.0, 40.0)
    velocity = np.concatenate((np.zeros(6), motion.reference(0.0)[1]))
    state = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), motion.reference(0.0)[0], velocity)
    return Simulation(model, motion, state, _STEP).advance(np.arange(round(seconds * _RATE)) / _RATE)


def _anywhere(joints: int, count: int) -> Samples:
    rng = np.random.default_rng(joints)
    angle, rate, effort = rng.normal(size=(3, count, joints))
    place, velocity, spin = rng.normal(size=(3, count, 3))
    turn = endless_motion(ROBOT).base_orientation[:count]
    truth = Truth(np.arange(count) / _RATE, angle, rate, effort, place, turn, velocity, spin)
    return exact_samples(truth, LEVELS[LEVEL])


def _identified(ours: MomentumKernel, method: str, truth: Truth, window: float) -> float:
    """Return samples a second through a method."""
    noise = LEVELS[LEVEL]
    identifier = Identification(ours, noise, np.zeros(6)).identifier(method, {'window': window})
    sensors = Sensors(noise, seed=0)
    streams = [sensed(truth[k : k + _PART], sensors, noise) for k in range(0, len(truth), _PART)]
    return len(truth) / _taken(_pushed, identifier, streams)


def _pushed(identifier: Identifier, streams: Sequence[tuple[JointStream, BaseStream]]) -> None:
    for joints, base in streams:
        identifier.push(joints, base)


def _taken(work: Callable[..., object], *arguments: object) -> float:
    """Return the processor time of a piece of work, s."""
    begin = time.process_time()
    work(*arguments)
    return time.process_time() - begin


def _rows(ours: MomentumKernel, samples: Samples) -> tuple[Array, Array]:
    """Return the (N, 6, 10) regressor of the target link and the (N, 6) momentum of the known bodies."""
    found = momentum_rows(ours, samples)
    return np.moveaxis(found.regressors[0], -1, 0), found.known.T


class _Peer:
    """The same rows by a loop over pinocchio: what it takes as arguments is made beforehand, at no charge."""

    def __init__(self, ours: MomentumKernel, samples: Samples) -> None:
        self._model = parse(ours.model.urdf)
        for body, (mass, *rest) in enumerate(ours.known):
            com, about = np.array(rest[:3]) / max(mass, 1e-300), unvec(np.array(rest[3:]))
            lever = pinocchio.skew(com)
            known = pinocchio.Inertia(mass, com, about + mass * lever @ lever) if mass else pinocchio.Inertia.Zero()
            self._model.inertias[body + 1] = known
        self._data = self._model.createData()
        self._frame = self._model.getFrameId(ours.target.name)
        base = np.concatenate((np.zeros((len(samples), 3)), quaternion_from_rotation(samples.base_rotation)), axis=1)
        angle = samples.joint_position
        joints = [
            column
            for joint, turns in enumerate(ours.model.continuous)
            for column in ((np.cos(angle[:, joint]), np.sin(angle[:, joint])) if turns else (angle[:, joint],))
        ]
        back = np.swapaxes(samples.base_rotation, 1, 2)
        twist = [(back @ v[..., None])[..., 0] for v in (samples.base_linear_velocity, samples.base_angular_velocity)]
        self._positions = np.column_stack((base, *joints))
        self._velocities = np.column_stack((*twist, samples.joint_velocity))

    def rows(self) -> tuple[Array, Array]:
        """Return regressor and known momentum, about the base's origin in odometry axes."""
        model, data, frame, still = self._model, self._data, self._frame, pinocchio.Motion.Zero()
        regressors = np.empty((len(self._positions), 6, 10))
        momenta = np.empty((len(self._positions), 6))
        for index, (position, velocity) in enumerate(zip(self._positions, self._velocities, strict=True)):
            pinocchio.forwardKinematics(model, data, position, velocity)
            pinocchio.centerOfMass(model, data)
            pinocchio.computeCentroidalMomentum(model, data)
            linear = data.hg.linear
            momenta[index, :3] = linear
            momenta[index, 3:] = data.hg.angular + np.cross(data.com[0], linear)
            place = pinocchio.updateFramePlacement(model, data, frame)
            moving = pinocchio.getFrameVelocity(model, data, frame)
            # The force that accelerates a body from rest is its inertia times the acceleration: here, times the twist.
            regressors[index] = (place.toDualActionMatrix() @ pinocchio.bodyRegressor(still, moving))[:, _ORDER]
        return regressors, momenta
