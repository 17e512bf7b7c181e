"""Speed of the core without messages: the rows of the momentum equations, and the whole identification."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pinocchio

from benchmarks.bags import ROBOT
from benchmarks.data import DURATION, NOISE, endless_motion, exact_samples, kernel, sensed
from benchmarks.honesty.paths import drawn
from benchmarks.honesty.robots import chain
from benchmarks.honesty.worlds import World, float_freely
from benchmarks.methods import Identification
from mbaid_ros.core.geometry import Array, quaternion_from_rotation, unvec
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model, parse
from mbaid_ros.core.robot.momentum_rows import momentum_rows
from mbaid_ros.core.samples import BaseStream, JointStream, Samples
from mbaid_ros.core.simulation.run import Truth
from mbaid_ros.core.simulation.sensors import Sensors

JOINTS = (4, 7, 12, 20)
_AXES = ((0, 0, 1), (0, 1, 0), (1, 0, 0))
_PART = 3_000  # samples at a time, as `replay` takes thousands
# Columns of pinocchio's regressor, whose inertia is (xx, xy, yy, xz, yz, zz), in our order.
_ORDER = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]
Streams = list[tuple[JointStream, BaseStream]]


def rows(count: int, repeats: int) -> tuple[list[float], list[float]]:
    """Return samples a second of the rows by the kernel, and by a loop over pinocchio, checked to be the same."""
    samples = exact_samples(endless_motion(ROBOT)[:count], NOISE)
    ours, peer = kernel(ROBOT), _Peer(kernel(ROBOT), samples)
    for found, expected in zip(_rows(ours, samples), peer.rows(), strict=True):
        if not np.allclose(found, expected, rtol=1e-9, atol=1e-9):
            raise RuntimeError('the rows are not those of pinocchio')
    pairs = [(count / _taken(_rows, ours, samples), count / _taken(peer.rows)) for _ in range(repeats)]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def identification_by_joints(method: str, seconds: float, repeats: int) -> dict[int, float]:
    """Return the median of samples a second through a method, by number of joints of a chain."""
    rates = {}
    for joints in JOINTS:
        urdf = chain((_AXES * joints)[:joints])
        truth = float_freely(World(urdf, drawn(np.full(joints, 0.2), joints), seconds))
        model = load_model(urdf)
        streams, own = _streams(truth, Sensors(NOISE, seed=0)), MomentumKernel(model, model.last_link)
        taken = [_taken(_pushed, _identifier(own, method), streams) for _ in range(repeats)]
        rates[joints] = len(truth) / float(np.median(taken))
    return rates


def identification_by_length(method: str, minutes: Sequence[int]) -> dict[int, float]:
    """Return samples a second through a method in the last minutes (at most five) of runs of increasing lengths.

    The first minute, with the search for a start, counts only in a run of one minute.
    """
    truth, sensors = endless_motion(ROBOT), Sensors(NOISE, seed=0)
    identifier = _identifier(kernel(ROBOT), method)
    taken: list[float] = []
    rates = {}
    for minute in range(max(minutes)):
        streams = _streams(replace(truth, time=truth.time + minute * DURATION), sensors)
        taken.append(_taken(_pushed, identifier, streams))
        if minute + 1 in minutes:
            rates[minute + 1] = len(truth) / float(np.mean(taken[max(min(minute, 1), minute - 4) :]))
    return rates


def _identifier(own: MomentumKernel, method: str) -> Identifier:
    return Identification(own, NOISE, np.zeros(6)).identifier(method)


def _streams(truth: Truth, sensors: Sensors) -> Streams:
    return [sensed(truth[k : k + _PART], sensors, NOISE) for k in range(0, len(truth), _PART)]


def _pushed(identifier: Identifier, streams: Streams) -> None:
    for joints, base in streams:
        identifier.push(joints, base)


def _taken(work: Callable[..., object], *arguments: object) -> float:
    """Return the processor time of some work, s."""
    begin = time.process_time()
    work(*arguments)
    return time.process_time() - begin


def _rows(own: MomentumKernel, samples: Samples) -> tuple[Array, Array]:
    """Return the (N, 6, 10) regressor of the target link and the (N, 6) momentum of the known bodies."""
    found = momentum_rows(own, samples)
    return np.moveaxis(found.regressors[0], -1, 0), found.known.T


class _Peer:
    """The same rows by a loop over pinocchio, whose arguments are made beforehand."""

    def __init__(self, own: MomentumKernel, samples: Samples) -> None:
        self._model = parse(own.model.urdf)
        for body, (mass, *rest) in enumerate(own.known):
            com, about = np.array(rest[:3]) / max(mass, 1e-300), unvec(np.array(rest[3:]))
            lever = pinocchio.skew(com)
            known = pinocchio.Inertia(mass, com, about + mass * lever @ lever) if mass else pinocchio.Inertia.Zero()
            self._model.inertias[body + 1] = known
        self._data = self._model.createData()
        self._frame = self._model.getFrameId(own.target.name)
        base = np.concatenate((np.zeros((len(samples), 3)), quaternion_from_rotation(samples.base_rotation)), axis=1)
        joints = []
        for angle, turns in zip(samples.joint_position.T, own.model.continuous, strict=True):
            joints += [np.cos(angle), np.sin(angle)] if turns else [angle]
        back = np.swapaxes(samples.base_rotation, 1, 2)
        twist = [(back @ v[..., None])[..., 0] for v in (samples.base_linear_velocity, samples.base_angular_velocity)]
        self._positions = np.column_stack((base, *joints))
        self._velocities = np.column_stack((*twist, samples.joint_velocity))

    def rows(self) -> tuple[Array, Array]:
        """Return regressor and known momentum, about the base's origin in odometry axes."""
        model, data, frame, still = self._model, self._data, self._frame, pinocchio.Motion.Zero()
        regressors, momenta = np.empty((len(self._positions), 6, 10)), np.empty((len(self._positions), 6))
        for index, (position, velocity) in enumerate(zip(self._positions, self._velocities, strict=True)):
            pinocchio.forwardKinematics(model, data, position, velocity)
            pinocchio.centerOfMass(model, data)
            pinocchio.computeCentroidalMomentum(model, data)
            linear = data.hg.linear
            momenta[index, :3], momenta[index, 3:] = linear, data.hg.angular + np.cross(data.com[0], linear)
            place = pinocchio.updateFramePlacement(model, data, frame)
            moving = pinocchio.getFrameVelocity(model, data, frame)
            # A body at rest needs a force of its inertia times the acceleration: here, times the twist.
            regressors[index] = (place.toDualActionMatrix() @ pinocchio.bodyRegressor(still, moving))[:, _ORDER]
        return regressors, momenta
