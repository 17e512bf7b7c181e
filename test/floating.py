"""Bases that float as conservation says, with a momentum that may change, and the estimator that follows them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.honesty.paths import following
from benchmarks.honesty.worlds import Flow, World, integrated, truth_of
from mbaid_ros.core.clocks import time_offset
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.links import independent_errors, known_bodies
from mbaid_ros.core.method import TrajectoryEstimator, TrajectorySettings
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.verdict import Reporting
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import MomentumKernel, inertia_matrix, momentum, unknown_scale
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.state import Declared
from mbaid_ros.session.catalogue import conventions, hypotheses, suspects
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
from observed import nees, true_body, windows

WINDOW = 0.5  # s
RATE = 100.0  # Hz
DEFAULT = Declared((time_offset(0.02),))  # of a robot that is known exactly, as the parameters have it

# (time, base rotation, base position) -> rate of change of (P, L) about the odometry origin.
Push = Callable[[float, Array, Array], Array]


def still(_time: float, _rotation: Array, _position: Array) -> Array:
    """No force."""
    return np.zeros(6)


def pushing(wrench: Array, axes: str) -> Push:
    """Return a constant force and torque: on the base's origin in its axes or inertial ones, or where it was at first.

    The last are inertial ones, which act at the common centre of mass if that does not move.
    """

    def push(_time: float, rotation: Array, position: Array) -> Array:
        if axes == 'inertial':
            return wrench
        turn = rotation if axes == 'body' else np.eye(3)
        force, torque = turn @ wrench[:3], turn @ wrench[3:]
        return np.concatenate((force, np.cross(position, force) + torque))

    return push


def float_freely(
    kernel: MomentumKernel,
    motion: Sinusoids,
    start: Array,
    seconds: float,
    push: Push = still,
    pulse: tuple[float, Array] = (np.inf, np.zeros(6)),
) -> Truth:
    """Integrate the base of a robot whose joints move as given, as the benchmarks do (errors below 1e-9).

    Parameters
    ----------
    kernel : with the target's true parameters
    motion : of the joints
    start : (6,) momentum (P, L) at time 0 about the odometry origin, where the base begins
    seconds : s
    push : what changes the momentum
    pulse : s, (6,): a jump of the momentum
    """
    steps, path = round(seconds * RATE), following(motion)
    joints, rates = path(np.arange(2 * steps - 1) / (2.0 * RATE))
    rest = np.zeros((len(joints), 6))
    states = kernel.states_of(np.broadcast_to(np.eye(3), (len(joints), 3, 3)), joints, rates, rest)
    target = express(kernel.target.parameters, states.rotation, states.position)
    whole = np.sum(states.known, axis=1) + target
    moving = states.known_momentum + momentum(target, states.twist)
    world = World('', path, seconds, RATE, wrench=lambda time, rotation, place, _: push(time, rotation, place))
    flow = Flow(np.linalg.inv(inertia_matrix(whole)), moving, whole, world)
    begin = np.concatenate(([0.0, 0.0, 0.0, 1.0], np.zeros(3), start))
    jump = min(int(np.ceil(min(pulse[0], seconds) * RATE)), steps - 1)
    course = integrated(flow.rate, begin, jump + 1, RATE)
    course[jump, 7:] += pulse[1]
    after = integrated(lambda node, state: flow.rate(2 * jump + node, state), course[jump], steps - jump, RATE)
    course = np.concatenate((course[:jump], after))
    twists = np.array([flow.twist(2 * number, state)[1] for number, state in enumerate(course)])
    return truth_of(world, course, twists, joints[::2], rates[::2])


def true_momentum(kernel: MomentumKernel, samples: Samples) -> Array:
    """Return (P, L) of noise-free samples, (N, 6), about the odometry origin."""
    states = kernel.states(samples)
    total = states.known_momentum + states.regressor @ kernel.target.parameters
    total[:, 3:] += cross(samples.base_position, total[:, :3])
    return total


def make(
    kernel: MomentumKernel,
    noise: SensorNoise,
    *,
    adapt: bool = False,
    known_std: float = 0.0,
    declared: Declared = DEFAULT,
    kept: int = 40,
) -> TrajectoryEstimator:
    """Return an estimator with the defaults of the parameters, and so many windows kept."""
    reporting = Reporting(unknown_scale(kernel)[:10], 0.5, 0.01, 2.0)
    robot = kernel.with_errors(independent_errors(kernel.known, known_std))
    declared = declared.with_links(known_bodies(robot.model, robot.errors))
    followed = hypotheses(float(np.sum(robot.known[:, 0])), noise.base_position, 'none', adapt=adapt)
    settings = TrajectorySettings(
        noise, WINDOW, kept, declared, followed, suspects(robot), conventions(declared.marker)
    )
    return TrajectoryEstimator(robot, settings, reporting)


def follow(
    kernel: MomentumKernel, samples: Samples, noise: SensorNoise, *, adapt: bool = False, known_std: float = 0.0
) -> list[Estimate]:
    """Return the estimates of all windows of a run."""
    return make(kernel, noise, adapt=adapt, known_std=known_std).update(windows(samples, WINDOW), 0)


def errors(estimate: Estimate, kernel: MomentumKernel) -> Array:
    """Return the errors of the parameters that are identifiable."""
    return (estimate.parameters - true_body(kernel))[estimate.identifiable]


def normalised(estimate: Estimate, kernel: MomentumKernel) -> float:
    """Return the squared error of all identifiable parameters in units of their covariance (NEES)."""
    return nees(estimate, true_body(kernel))
