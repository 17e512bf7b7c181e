"""Motions planned from drawn states of simulated robots, against random sinusoids of the same limits; then made."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.random_sinusoids import best_of_sinusoids
from benchmarks.sampled import sampled
from benchmarks.store import Runs
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.filter.state import BODY
from mbaid_ros.core.geometry import Array, Flags, rotation_from_quaternion
from mbaid_ros.core.identifier import Estimator, knowledge_of
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import BAND
from mbaid_ros.core.results.reporting import Reporting
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.sensors.streams import Windows
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.planning.information import Grid
from mbaid_ros.planning.limits import BaseLimits, joint_limits
from mbaid_ros.planning.motions import Motions
from mbaid_ros.planning.plan import Plan
from mbaid_ros.planning.planner import Planner, PlanSettings
from mbaid_ros.planning.search import Wanted
from mbaid_ros.planning.splines import Splines
from mbaid_ros.session import make_estimator
from mbaid_ros.session.methods import make_reporting
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation, Truth
from mbaid_ros.simulation.steered import made_to_follow

CONFIG = Path(__file__).resolve().parents[2] / 'config'
NOISE = SensorNoise(1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4)
RATE, SEEN, STEP = 100.0, 10.0, 0.05  # Hz, of the sensors, and of what is looked at alone; s, of the integrator
WANTED = 0.01
TURN = np.radians(2.0)  # rad, that the base may be turned by the motion
WINDOW, KNOTS = 0.5, 10  # s, of the estimator
FIRST, FIRST_SPEED, REST = 6.0, 0.035, 0.5  # s, rad/s, s: the motion before the plan
SPIN = 0.002  # rad/s, standard deviation of the base's rates
LONGER, LONGER_SEEDS = 5000, 4  # motions that a longer search compares, and the first of the states that it is made for
DRAWS = 5  # robots as they may be as well, that make each planned motion


@dataclass(frozen=True)
class Case:
    """A robot, the fastest that its joints go (rad/s), whether the base is kept from turning, and a seed."""

    robot: str
    speed: float
    limited: bool
    seed: int

    @property
    def longer(self) -> bool:
        """Whether a longer search is made, too: where the others show that the usual one is not at its end."""
        return self.robot != 'servicer7' and self.seed < LONGER_SEEDS


@dataclass(frozen=True)
class Outcome:
    """What a plan led to.

    Attributes
    ----------
    planned : s, of the motion; NaN where what is wanted was out of reach
    sinusoids : s, of the best of the sinusoids; infinite where none reached it in the longest of LENGTHS
    longer : s, of the motion that a search of LONGER finds; NaN where none is made, or finds none
    searched : s of this process's time that the search took
    before : the worst relative standard deviation in the beginning
    bound, turned : rad, by which the base was to be turned at most, and was
    strayed : (DRAWS,) rad, by which robots drawn from what the run knows are turned; NaN where one cannot be simulated
    reached : (10,) relative standard deviations of the estimator after the motion over those promised; NaN without any
    true_body : (10,) over those that would have been promised if the body had been known; likewise
    normalised : (10,) errors in the estimator's standard deviations; NaN without any
    """

    planned: float
    sinusoids: float
    longer: float
    searched: float
    before: float
    bound: float
    turned: float
    strayed: Array
    reached: Array
    true_body: Array
    normalised: Array


@dataclass(frozen=True)
class Outcomes(Runs):
    """Outcomes side by side."""

    planned: Array
    sinusoids: Array
    longer: Array
    searched: Array
    before: Array
    bound: Array
    turned: Array
    strayed: Array
    reached: Array
    true_body: Array
    normalised: Array

    @property
    def inside(self) -> Flags:
        """Which errors are within their 95 % interval; of those there are."""
        known = self.normalised[np.isfinite(self.normalised)]
        return np.asarray(np.abs(known) < BAND)


def run(case: Case) -> Outcome:
    """Identify for some seconds, plan, compare with sinusoids, and make the motion."""
    generator = np.random.default_rng([case.seed, 11])
    model = load_model((CONFIG / f'{case.robot}.urdf').read_text(encoding='utf-8'))
    kernel = MomentumKernel(model, model.last_link)
    state = _begin(kernel, generator)
    first = _first(kernel, state, generator)
    truth = _follow(model, state, first, FIRST + REST)
    method = _method(kernel)
    samples = _seen(truth, case.seed)[:-1]
    _updated(method, samples)
    knowledge = knowledge_of(method)
    if knowledge is None:
        raise RuntimeError(f'{case}: no solution after {FIRST:g} s')
    reporting = make_reporting(EstimatorConfig(), kernel)
    base = BaseLimits(rotation=TURN) if case.limited else BaseLimits()
    settings = PlanSettings(np.full(10, WANTED), joint_velocity=case.speed, base=base, seed=case.seed)
    planner = Planner(knowledge, reporting, settings)
    begin = time.process_time()
    plan = planner.plan()
    searched = time.process_time() - begin
    wanted = Wanted(settings.relative, planner.information.asked)
    best = best_of_sinusoids(planner.motions, wanted, base, generator)
    longer = _longer(knowledge, reporting, settings) if case.longer else np.nan
    moved = _follow(model, _last(truth), plan.trajectory, plan.trajectory.duration + REST)
    seen = _seen(moved, case.seed + 1000)
    final = _updated(method, replace(seen, time=seen.time + samples.time[-1] + 1.0 / RATE))
    turned = _turned(kernel.model, _last(truth), moved, plan.trajectory.duration)
    reached, normalised = _compared(final, plan, reporting.sizes(final.parameters[None])[0], kernel)
    return Outcome(
        plan.trajectory.duration if plan.reached else np.nan,
        best,
        longer,
        searched,
        planner.ratio * WANTED,
        float(plan.bounds.sure[0]),
        turned,
        _strayed(planner.motions, _last(truth), plan, case.seed),
        reached,
        reached * plan.after / _of_the_true_body(planner.motions, plan, kernel),
        normalised,
    )


def _begin(kernel: MomentumKernel, generator: np.random.Generator) -> State:
    model = kernel.model
    lower, upper = (np.array([getattr(limit, end) for limit in model.limits]) for end in ('lower', 'upper'))
    place = generator.uniform(np.maximum(0.5 * lower, -1.0), np.minimum(0.5 * upper, 1.0))
    spin = SPIN * generator.standard_normal(3) * ([0.0, 0.0, 1.0] if model.name == 'table1' else [1.0, 1.0, 1.0])
    velocity = np.concatenate((np.zeros(3), spin, np.zeros(model.joints)))
    return State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), place, velocity)


def _first(kernel: MomentumKernel, state: State, generator: np.random.Generator) -> JointTrajectory:
    limits = joint_limits(kernel.model, state.joint_position, FIRST_SPEED, 0.1, ())
    splines = Splines(4, FIRST)
    drawn = splines.filling(generator.standard_normal((4, kernel.model.joints)), state.joint_position, limits)
    return splines.trajectory(drawn, state.joint_position, kernel.model.joint_names)


def _follow(model: RobotModel, state: State, trajectory: JointTrajectory, seconds: float, rate: float = RATE) -> Truth:
    motion = made_to_follow(trajectory, model, state.joint_position, 0.0)
    return Simulation(model, motion, state, STEP).advance(np.arange(round(seconds * rate) + 1) / rate)


def _last(truth: Truth) -> State:
    last = truth[-1:]
    velocity = (last.base_linear_velocity[0], last.base_angular_velocity[0], last.joint_velocity[0])
    return State(last.base_position[0], last.base_orientation[0], last.joint_position[0], np.concatenate(velocity))


def _method(kernel: MomentumKernel) -> Estimator:
    noise = {f'noise.{name}': value for name, value in vars(NOISE).items()}
    return make_estimator(build(EstimatorConfig, {**EXACT, **noise}), kernel)


def _updated(method: Estimator, samples: Samples) -> Estimate:
    cutter = Windows(WINDOW)
    return method.update([*cutter.push(samples), *cutter.flush()], 0)[-1]


def _seen(truth: Truth, seed: int) -> Samples:
    return sampled(truth, Sensors(NOISE, seed), NOISE)


def _turned(model: RobotModel, begin: State, moved: Truth, seconds: float, rate: float = RATE) -> float:
    """Return by how much the motion has turned the base from where it would be with the joints at rest, rad."""
    nothing = np.zeros((0, 0))
    stay = JointTrajectory(model.joint_names, np.zeros(1), begin.joint_position[None], nothing, nothing)
    rest = _follow(model, begin, stay, seconds, rate)
    rotation, coasting = (rotation_from_quaternion(each.base_orientation[: len(rest)]) for each in (moved, rest))
    cosine = (np.trace(rotation @ np.swapaxes(coasting, 1, 2), axis1=1, axis2=2) - 1.0) / 2.0
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())


def _strayed(motions: Motions, begin: State, plan: Plan, seed: int) -> Array:
    """Return by how much robots as they may be as well are turned by a planned motion, (DRAWS,) rad."""
    kernel, asked = motions.knowledge.layout.kernel, motions.information.asked
    model, target = kernel.model, kernel.target
    turned = np.full(DRAWS, np.nan)
    for place, point in enumerate(motions.knowledge.drawn(DRAWS, seed + 500)):
        floating = motions.as_if(point)
        twist = floating.coasting(begin.joint_position, 2, STEP).twist[0, 0].reshape(2, 3)
        velocity = np.concatenate((*(twist @ floating.rotation), np.zeros(model.joints)))
        try:
            # What no motion tells of a planar robot is not drawn.
            body = np.where(asked, physical(point.body[None])[0], physical(target.parameters))
            robot = load_model(replace_inertial(model.urdf, target.name, body), model.base_link)
            state = replace(begin, velocity=velocity)
            seconds = plan.trajectory.duration
            moved = _follow(robot, state, plan.trajectory, seconds, SEEN)
            turned[place] = _turned(robot, state, moved, seconds, SEEN)
        except ModelError:
            continue  # no body is like that
    return turned


def _longer(knowledge: Posterior, reporting: Reporting, settings: PlanSettings) -> float:
    """Return the length of the motion that a longer search finds, s; NaN where it finds none."""
    plan = Planner(knowledge, reporting, replace(settings, effort=LONGER)).plan()
    return plan.trajectory.duration if plan.reached else np.nan


def _of_the_true_body(motions: Motions, plan: Plan, kernel: MomentumKernel) -> Array:
    """Return the relative standard deviations (10,) that a plan would have promised if the body had been known."""
    known = motions.knowledge
    mean = known.mean.copy()
    mean[BODY] = kernel.target.parameters
    grid = Grid.over(plan.trajectory.duration, WINDOW, KNOTS)
    return motions.relative_along(plan.trajectory, grid, replace(known, mean=mean).point)


def _compared(final: Estimate, plan: Plan, sizes: Array, kernel: MomentumKernel) -> tuple[Array, Array]:
    """Return reached over promised standard deviations, and normalised errors, (10,) each; NaN where there are none."""
    told = plan.asked & final.identifiable
    error = final.parameters - physical(kernel.target.parameters)
    return np.where(told, final.std / sizes / plan.after, np.nan), np.where(told, error / final.std, np.nan)
