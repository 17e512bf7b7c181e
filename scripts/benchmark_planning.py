"""Write measured/planning.md: planned motions against random sinusoids within the same limits, and their outcome."""

import time
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.data import NOISE, RATE, kernel, last_state, sampled, target
from benchmarks.frame import Frame, Runs, declared, number
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array, rotation_from_quaternion
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import BAND, Estimate
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.windows import Windows
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.parameters import build
from mbaid_ros.planning.information import Grid
from mbaid_ros.planning.motions import Motions
from mbaid_ros.planning.planner import Planner, PlanSettings
from mbaid_ros.planning.requirements import BaseLimits, Goal, JointLimits, joint_limits
from mbaid_ros.planning.splines import Splines
from mbaid_ros.session.methods import make_estimator, make_reporting
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation, Truth
from mbaid_ros.simulation.steered import motion_along

ROBOTS, SPEEDS = ('servicer7', 'ets7', 'table1'), (1.0, 5.0)  # deg/s
WANTED = 0.01
TURN = np.radians(2.0)  # rad, limit of the base's turn
WINDOW, KNOTS = 0.5, 10  # s, of the estimator
FIRST, FIRST_SPEED, REST = 6.0, 0.035, 0.5  # s, rad/s, s: the motion before the plan
SPIN = 0.002  # rad/s, standard deviation of the base's rates
CLOSE = 0.2  # relative difference of reached and predicted deviations that counts as close
SINUSOIDS = 50
LENGTHS = (10.0, 20.0, 40.0, 80.0, 160.0)  # s, in which sinusoids keep the limits
_BATCH, _WINDOWS = 25, 40  # sinusoids at once; windows of each length
_TINY = 1e-12  # rad or m


@dataclass(frozen=True)
class Case:
    """A row of the table."""

    robot: str
    speed: float  # deg/s, of the fastest joint
    limited: bool  # whether the base's turn is

    @property
    def name(self) -> str:
        """For the table."""
        return f'{self.robot}, {self.speed:g} deg/s, {"2 deg" if self.limited else "free"}'


@dataclass(frozen=True)
class Outcome(Runs):
    """Outcomes of plans."""

    planned: Array  # s, of the motion; NaN if the wanted accuracy was out of reach
    sinusoids: Array  # s, of the best of the sinusoids; infinite if none reached it in the longest of LENGTHS
    searched: Array  # s, processor time of the search
    turned: Array  # rad, of the base
    reached: Array  # (..., 10) relative standard deviations after the motion over the predicted ones; NaN for none
    normalised: Array  # (..., 10) errors in the estimator's standard deviations; NaN for none


def run(case: Case, seed: int) -> Outcome:
    """Identify for some seconds, plan, compare with sinusoids, and make the motion."""
    generator = np.random.default_rng([seed, 11])
    own = kernel(case.robot)
    model = own.model
    state = _begin(own, generator)
    truth = _follow(model, state, _first(own, state, generator), FIRST + REST)
    method = make_estimator(build(EstimatorConfig, {**EXACT, **declared(NOISE)}), own)
    samples = sampled(truth, Sensors(NOISE, seed), NOISE)[:-1]
    _updated(method, samples)
    posterior = method.posterior()
    assert posterior is not None, f'{case}: a solution after {FIRST:g} s'
    reporting = make_reporting(EstimatorConfig(), own)
    base = BaseLimits(rotation=TURN) if case.limited else BaseLimits()
    settings = PlanSettings(np.full(10, WANTED), joint_velocity=float(np.radians(case.speed)), base=base, seed=seed)
    planner = Planner(posterior, reporting, settings)
    begin = time.process_time()
    plan = planner.plan()
    searched = time.process_time() - begin
    goal = Goal(settings.relative, planner.information.determinable)
    best = best_of_sinusoids(planner.motions, goal, base, generator)
    moved = _follow(model, last_state(truth), plan.trajectory, plan.trajectory.duration + REST)
    seen = sampled(moved, Sensors(NOISE, seed + 1000), NOISE)
    final = _updated(method, replace(seen, time=seen.time + samples.time[-1] + 1.0 / RATE))
    determined = plan.determinable & final.identifiable
    ratio = final.std / reporting.sizes(final.parameters) / plan.std_after
    error = final.parameters - target(case.robot)
    return Outcome(
        planned=np.asarray(plan.trajectory.duration if plan.reached else np.nan),
        sinusoids=np.asarray(best),
        searched=np.asarray(searched),
        turned=np.asarray(_turned(model, last_state(truth), moved, plan.trajectory.duration)),
        reached=np.where(determined, ratio, np.nan),
        normalised=np.where(determined, error / final.std, np.nan),
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
    drawn = splines.scaled_to_limits(generator.standard_normal((4, kernel.model.joints)), state.joint_position, limits)
    return splines.trajectory(drawn, state.joint_position, kernel.model.joint_names)


def _follow(model: RobotModel, state: State, trajectory: JointTrajectory, seconds: float) -> Truth:
    motion = motion_along(trajectory, model, state.joint_position, 0.0)
    return Simulation(model, motion, state).advance(np.arange(round(seconds * RATE) + 1) / RATE)


def _updated(method: Estimator, samples: Samples) -> Estimate:
    cutter = Windows(WINDOW)
    return method.update([*cutter.push(samples), *cutter.flush()], 0)[-1]


def _turned(model: RobotModel, begin: State, moved: Truth, seconds: float) -> float:
    """Return the largest turn of the base, rad, from its orientation with the joints at rest."""
    nothing = np.zeros((0, 0))
    stay = JointTrajectory(model.joint_names, np.zeros(1), begin.joint_position[None], nothing, nothing)
    rest = _follow(model, begin, stay, seconds)
    rotation, coasting = (rotation_from_quaternion(each.base_orientation[: len(rest)]) for each in (moved, rest))
    cosine = (np.trace(rotation @ np.swapaxes(coasting, 1, 2), axis1=1, axis2=2) - 1.0) / 2.0
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())


def best_of_sinusoids(motions: Motions, wanted: Goal, base: BaseLimits, generator: np.random.Generator) -> float:
    """Return the shortest time in which one of the sinusoids reaches the wanted accuracy, s; infinite for none."""
    drawn = _sinusoids(motions, generator)
    shortest = (min(_time_to_reach(motions, each, length, wanted, base) for each in drawn) for length in LENGTHS)
    return next(filter(np.isfinite, shortest), np.inf)  # in a longer time they are no larger, and reach it no sooner


def _sinusoids(motions: Motions, generator: np.random.Generator) -> list[list[Sinusoids]]:
    """Return sinusoids of all joints, two terms each, as large as the joints' limits allow, in batches."""
    limits: JointLimits = motions.limits
    every = []
    for _ in range(SINUSOIDS):
        shape = (len(motions.start), 2)
        amplitude = generator.uniform(0.5, 1.0, shape)
        frequency = 1.0 / generator.uniform(8.0, 40.0, shape)
        phase = 0.5 * np.pi * generator.choice([-1.0, 1.0], shape)  # from rest: no joint jumps to a speed
        rate = 2.0 * np.pi * frequency
        centre = -(amplitude * np.sin(phase)).sum(axis=1)
        reach = amplitude.sum(axis=1)
        room = np.minimum(
            (limits.upper - motions.start) / np.maximum(reach + centre, _TINY),
            (motions.start - limits.lower) / np.maximum(reach - centre, _TINY),
        )
        fastest = limits.velocity / (amplitude * rate).sum(axis=1)
        steepest = limits.acceleration / (amplitude * rate**2).sum(axis=1)
        scale = np.minimum(np.minimum(fastest, steepest), room)
        every.append(Sinusoids(motions.start, amplitude * scale[:, None], frequency, phase))
    return [every[place : place + _BATCH] for place in range(0, SINUSOIDS, _BATCH)]


def _time_to_reach(motions: Motions, drawn: list[Sinusoids], length: float, wanted: Goal, base: BaseLimits) -> float:
    """Return when the first of some sinusoids, reduced to the limits of the base, reaches the wanted accuracy."""
    grid = Grid(_WINDOWS, 5, length / _WINDOWS / 5)
    times = grid.half_steps
    part = np.ones(len(drawn))
    for _ in range(3):
        position, rate = _moved(drawn, times, part)
        floating = motions.floating.base_motion(position, rate, grid.spacing)
        resting = motions.floating.base_motion(*motions.joints_at_rest(times), grid.spacing)
        use = (floating.deviation_from(resting).max(axis=0) / base.array).max(axis=1)
        if np.all(use <= 1.0):
            break
        part *= np.where(use > 1.0, 0.98 / use, 1.0)
    relative = motions.information.std_after(grid, (position[::2], rate[::2]), floating, every=1)
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


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/planning.md', seeds=20)
    cases = frame.chosen((Case(*each) for each in product(ROBOTS, SPEEDS, (True, False))), lambda case: case.name)
    frame.tabulate(_HEADER, frame.outcomes(Outcome, run, {case: case.name for case in cases}), _row)


def _row(case: Case, found: Outcome) -> list[str]:
    ratio = found.planned / found.sinusoids
    reached = found.reached[np.isfinite(found.reached)]
    missing = int(np.isnan(found.planned).sum())
    errors = found.normalised[np.isfinite(found.normalised)]
    beyond = f', {np.sum(found.turned > TURN)} beyond' if case.limited else ''
    return [
        case.name,
        str(len(found)),
        f'{number(float(np.nanmedian(found.planned)), 1)} s' + (f' ({missing} out of reach)' if missing else ''),
        f'{number(float(np.median(found.sinusoids)), 1)} s',
        _spread(ratio[np.isfinite(ratio)]),
        f'{_spread(reached)}, {100.0 * np.mean(np.abs(reached - 1.0) <= CLOSE):.0f} %',
        f'{np.sum(np.abs(errors) < BAND)} of {errors.size}',
        f'{np.degrees(found.turned.max()):.2f} deg{beyond}',
        f'{np.median(found.searched):.1f} s',
    ]


def _spread(ratio: Array) -> str:
    return f'{np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})' if len(ratio) else '-'


_HEADER = (
    *('robot, joints, base', 'states', 'planned', f'best of {SINUSOIDS}', 'planned / best'),
    *('reached / predicted', 'in 95 %', 'turned, most', 'search'),
)

if __name__ == '__main__':
    main()
