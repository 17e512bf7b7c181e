"""Motions planned from drawn states of simulated robots, against random sinusoids of the same limits; then made."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.sampled import sampled
from benchmarks.store import Runs
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.known_side import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array, Flags, rotation_from_quaternion
from mbaid_ros.core.identifier import Estimator, knowledge_of
from mbaid_ros.core.intake.windows import Windows
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.planning.information import Grid
from mbaid_ros.core.planning.limits import BaseLimits, JointLimits, joint_limits
from mbaid_ros.core.planning.motions import Motions
from mbaid_ros.core.planning.plan import Plan
from mbaid_ros.core.planning.planner import Planner, PlanSettings
from mbaid_ros.core.planning.search import Wanted
from mbaid_ros.core.planning.splines import Splines
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import BAND
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.simulation.dynamics import State
from mbaid_ros.core.simulation.motion import Sinusoids
from mbaid_ros.core.simulation.run import Simulation, Truth
from mbaid_ros.core.simulation.sensors import Sensors
from mbaid_ros.core.simulation.steered import made_to_follow
from mbaid_ros.session import make_estimator
from mbaid_ros.session.methods import make_reporting

CONFIG = Path(__file__).resolve().parents[2] / 'config'
NOISE = SensorNoise(1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4)
RATE, STEP = 100.0, 0.05  # Hz; s, of the integrator
WANTED = 0.01
TURN = np.radians(2.0)  # rad, that the base may be turned by the motion
SINUSOIDS = 50
LENGTHS = (10.0, 20.0, 40.0, 80.0, 160.0)  # s, in which sinusoids keep the limits
FIRST, FIRST_SPEED, REST = 6.0, 0.035, 0.5  # s, rad/s, s: the motion before the plan
SPIN = 0.002  # rad/s, standard deviation of the base's rates
BATCH, WINDOWS = 25, 40  # sinusoids at once; in which they are looked at, of each length


@dataclass(frozen=True)
class Case:
    """A robot, the fastest that its joints go (rad/s), whether the base is kept from turning, and a seed."""

    robot: str
    speed: float
    limited: bool
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What a plan led to.

    Attributes
    ----------
    planned : s, of the motion; NaN where what is wanted was out of reach
    sinusoids : s, of the best of the sinusoids; infinite where none reached it in the longest of LENGTHS
    searched : s of this process's time that the search took
    before : the worst relative standard deviation in the beginning
    bound, turned : rad, by which the base was to be turned at most, and was
    reached : (10,) relative standard deviations of the estimator after the motion over those promised; NaN without any
    normalised : (10,) errors in the estimator's standard deviations; NaN without any
    """

    planned: float
    sinusoids: float
    searched: float
    before: float
    bound: float
    turned: float
    reached: Array
    normalised: Array


@dataclass(frozen=True)
class Outcomes(Runs):
    """Outcomes side by side."""

    planned: Array
    sinusoids: Array
    searched: Array
    before: Array
    bound: Array
    turned: Array
    reached: Array
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
    truth = _follow(kernel, state, first, FIRST + REST)
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
    best = _best_of_sinusoids(planner.motions, wanted, base, generator)
    moved = _follow(kernel, _last(truth), plan.trajectory, plan.trajectory.duration + REST)
    seen = _seen(moved, case.seed + 1000)
    final = _updated(method, replace(seen, time=seen.time + samples.time[-1] + 1.0 / RATE))
    turned = _turned(kernel, truth, moved, plan)
    reached, normalised = _compared(final, plan, reporting.sizes(final.parameters[None])[0], kernel)
    return Outcome(
        plan.trajectory.duration if plan.reached else np.nan,
        best,
        searched,
        planner.ratio * WANTED,
        float(plan.bounds.sure[0]),
        turned,
        reached,
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
    drawn = splines.within(generator.standard_normal((4, kernel.model.joints)), state.joint_position, limits)
    return splines.trajectory(drawn, state.joint_position, kernel.model.joint_names)


def _follow(kernel: MomentumKernel, state: State, trajectory: JointTrajectory, seconds: float) -> Truth:
    motion = made_to_follow(trajectory, kernel.model, state.joint_position, 0.0)
    return Simulation(kernel.model, motion, state, STEP).advance(np.arange(round(seconds * RATE) + 1) / RATE)


def _last(truth: Truth) -> State:
    last = truth[-1:]
    velocity = (last.base_linear_velocity[0], last.base_angular_velocity[0], last.joint_velocity[0])
    return State(last.base_position[0], last.base_orientation[0], last.joint_position[0], np.concatenate(velocity))


def _method(kernel: MomentumKernel) -> Estimator:
    noise = {f'noise.{name}': value for name, value in vars(NOISE).items()}
    return make_estimator(build(EstimatorConfig, {**EXACT, **noise}), kernel)


def _updated(method: Estimator, samples: Samples) -> Estimate:
    cutter = Windows(0.5)
    return method.update([*cutter.push(samples), *cutter.flush()], 0)[-1]


def _seen(truth: Truth, seed: int) -> Samples:
    return sampled(truth, Sensors(NOISE, seed), NOISE)


def _turned(kernel: MomentumKernel, before: Truth, moved: Truth, plan: Plan) -> float:
    """Return by how much the motion has turned the base from where it would be with the joints at rest, rad."""
    begin, nothing = _last(before), np.zeros((0, 0))
    stay = JointTrajectory(kernel.model.joint_names, np.zeros(1), begin.joint_position[None], nothing, nothing)
    rest = _follow(kernel, begin, stay, plan.trajectory.duration)
    rotation, coasting = (rotation_from_quaternion(each.base_orientation[: len(rest)]) for each in (moved, rest))
    cosine = (np.trace(rotation @ np.swapaxes(coasting, 1, 2), axis1=1, axis2=2) - 1.0) / 2.0
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())


def _compared(final: Estimate, plan: Plan, sizes: Array, kernel: MomentumKernel) -> tuple[Array, Array]:
    """Return reached over promised standard deviations, and normalised errors, (10,) each; NaN where there are none."""
    told = plan.asked & final.identifiable
    error = final.parameters - physical(kernel.target.parameters)
    return np.where(told, final.std / sizes / plan.after, np.nan), np.where(told, error / final.std, np.nan)


def _best_of_sinusoids(motions: Motions, wanted: Wanted, base: BaseLimits, generator: np.random.Generator) -> float:
    """Return the shortest time in which one of the sinusoids reaches what is wanted, s."""
    drawn = _sinusoids(motions, generator)
    for length in LENGTHS:  # in a longer one they are no larger, and reach it no sooner
        shortest = min(_time_to_reach(motions, each, length, wanted, base) for each in drawn)
        if np.isfinite(shortest):
            return shortest
    return np.inf


def _sinusoids(motions: Motions, generator: np.random.Generator) -> list[list[Sinusoids]]:
    """Return sinusoids of all joints, two terms each, as large as the joints' limits allow, in batches."""
    limits: JointLimits = motions.limits
    every = []
    for _ in range(SINUSOIDS):
        shape = (len(motions.start), 2)
        amplitude = generator.uniform(0.5, 1.0, shape)
        frequency = 1.0 / generator.uniform(8.0, 40.0, shape)
        phase = generator.uniform(-np.pi, np.pi, shape)
        rate = 2.0 * np.pi * frequency
        centre = -(amplitude * np.sin(phase)).sum(axis=1)
        reach = amplitude.sum(axis=1)
        room = np.minimum(
            (limits.upper - motions.start) / (reach + centre), (motions.start - limits.lower) / (reach - centre)
        )
        fastest = limits.velocity / (amplitude * rate).sum(axis=1)
        steepest = limits.acceleration / (amplitude * rate**2).sum(axis=1)
        scale = np.minimum(np.minimum(fastest, steepest), room)
        every.append(Sinusoids(motions.start, amplitude * scale[:, None], frequency, phase))
    return [every[place : place + BATCH] for place in range(0, SINUSOIDS, BATCH)]


def _time_to_reach(motions: Motions, drawn: list[Sinusoids], length: float, wanted: Wanted, base: BaseLimits) -> float:
    """Return when the first of some sinusoids reaches what is wanted, each as large as keeps the base in its limit."""
    grid = Grid(WINDOWS, 5, length / WINDOWS / 5)
    times = grid.half_steps
    part = np.ones(len(drawn))
    for _ in range(3):
        position, rate = _moved(drawn, times, part)
        floating = motions.floating.moved(position, rate, grid.spacing)
        resting = motions.floating.coasting(motions.start, len(floating), grid.spacing)
        use = (floating.away_from(resting).max(axis=0) / base.array).max(axis=1)
        if np.all(use <= 1.0):
            break
        part *= np.where(use > 1.0, 0.98 / use, 1.0)
    relative = motions.information.after(grid, (position[::2], rate[::2]), floating, every=1)
    reached = (wanted.ratio(relative) <= 1.0) & (use <= 1.0)
    return float(grid.ends[int(np.argmax(reached.any(axis=1)))]) if reached.any() else np.inf


def _moved(drawn: list[Sinusoids], times: Array, part: Array) -> tuple[Array, Array]:
    """Return positions and rates (T, B, n): before the begin, at rest."""
    amplitude, frequency, phase = (
        np.stack([getattr(each, name) for each in drawn]) for name in ('amplitude', 'frequency', 'phase')
    )
    amplitude, omega = amplitude * part[:, None, None], 2.0 * np.pi * frequency
    angle = omega * np.maximum(times, 0.0)[:, None, None, None] + phase
    position = drawn[0].start + (amplitude * (np.sin(angle) - np.sin(phase))).sum(axis=-1)
    rate = (amplitude * omega * np.cos(angle)).sum(axis=-1)
    return position, np.where(times[:, None, None] < 0.0, 0.0, rate)
