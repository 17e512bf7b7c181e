"""A run that ends at rest, as a motion is planned from, and what simulated robots make of planned motions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.data import last_state
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.planning.planner import Planner, PlanSettings
from mbaid_ros.planning.requirements import joint_limits
from mbaid_ros.planning.splines import Splines
from mbaid_ros.session.methods import make_reporting
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.simulation import Simulation, Truth
from mbaid_ros.simulation.steered import TrajectoryMotion
from observed import MID, estimator, kernel, observe, windows
from simulated import robot, state

RATE = 20.0  # Hz
START = np.array([0.4, 0.7, -0.3, 0.9, 0.5, -0.6, 0.2])
SPIN = (0.002, -0.001, 0.003)  # rad/s
FASTEST = 0.08  # rad/s


@dataclass(frozen=True)
class Begun:
    """A robot that has been identified for a while and rests.

    Attributes
    ----------
    kernel : of the robot, its last link unknown
    method : that has identified it
    state : it is in now
    samples : the last ones
    """

    kernel: MomentumKernel
    method: Estimator
    state: State
    samples: Samples

    @property
    def posterior(self) -> Posterior:
        """What the method has come to know."""
        known = self.method.posterior()
        assert known is not None
        return known

    def moved(self, trajectory: JointTrajectory, rest: float = 0.5) -> tuple[Truth, Estimate]:
        """Return how the robot truly follows a trajectory, and what the same run knows in the end."""
        truth = follow(self.kernel, self.state, trajectory, trajectory.duration + rest)
        seen = observe(truth, MID, 7)
        seen = replace(seen, time=seen.time + self.samples.time[-1] + 1.0 / RATE)
        return truth, self.method.update(windows(seen), 0)[-1]


def follow(unknown: MomentumKernel, begin: State, trajectory: JointTrajectory, seconds: float) -> Truth:
    """Return the motion of a robot that follows a trajectory."""
    model = unknown.model
    places = np.array([model.joint_names.index(name) for name in trajectory.joints])
    motion = TrajectoryMotion(trajectory, begin.joint_position, places)
    return Simulation(model, motion, begin).advance(np.arange(round(seconds * RATE) + 1) / RATE)


def begun(
    name: str = 'servicer7',
    seconds: float = 8.0,
    unknown: MomentumKernel | None = None,
    spin: tuple[float, ...] = SPIN,
    **parameters: object,
) -> Begun:
    """Return a robot that has moved all its joints for some seconds, then rested for half a second.

    Of another one than config/ has, `unknown`, the joints after those of `name` rest.
    """
    trajectory = first_motion(name, seconds)
    unknown = unknown or kernel(name)
    model = unknown.model
    start = np.append(START, np.zeros(model.joints))[: model.joints]
    truth = follow(unknown, state(start, np.zeros(model.joints), spin), trajectory, seconds + 0.5)
    method = estimator(unknown, MID, method='trajectory', **parameters)
    samples = observe(truth, MID, 1)[:-1]
    method.update(windows(samples), 0)
    return Begun(unknown, method, last_state(truth), samples[-1:])


def planner(robot: Begun, posterior: Posterior | None = None, **settings: object) -> Planner:
    """Return what plans motions of a robot to 1 %, quickly; from what it has come to know where nothing is given."""
    given = {'relative': np.full(10, 0.01), 'joint_velocity': FASTEST, 'effort': 24, **settings}
    reporting = make_reporting(EstimatorConfig(), robot.kernel)
    return Planner(posterior or robot.posterior, reporting, PlanSettings(**given))  # type: ignore[arg-type]


def first_motion(name: str, seconds: float) -> JointTrajectory:
    """Return a motion of all joints of a robot of config/."""
    model = robot(name)
    start = START[: model.joints]
    limits = joint_limits(model, start, FASTEST, 0.1, ())
    splines = Splines(5, seconds)
    drawn = np.random.default_rng(3).standard_normal((5, model.joints))
    return splines.trajectory(splines.scaled_to_limits(drawn, start, limits), start, model.joint_names)


def angle(rotation: Array) -> Array:
    """Return by how much (..., 3, 3) rotations turn, rad."""
    return np.arccos(np.clip((np.trace(rotation, axis1=-2, axis2=-1) - 1.0) / 2.0, -1.0, 1.0))
