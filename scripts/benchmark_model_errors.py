"""Write docs/model-errors.md: robots that are not their URDF, coverage and errors over the attainable ones.

--seeds is for rows with all errors; other rows have 0.4 times as many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.data import MAXIMUM_GAP, NOISE, RATE, readings, simulation
from benchmarks.frame import Frame, declared, number, percent, provenance, statuses, table
from benchmarks.model_errors.runs import Outcome, estimates, run
from benchmarks.model_errors.variant import DEFAULT, STEPS, Variant, ladder, monte_carlo
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.results.budget import ErrorBudget
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.true_robot import true_robot
from mbaid_ros.core.simulation.drawn import draw, generator
from mbaid_ros.session import make_estimator
from mbaid_ros.session.segment import UNSOLVABLE

ROBOTS, EXAMPLE = ('servicer7', 'ets7', 'table1'), 'servicer7'
_OTHERS = 0.4  # of the seeds, for rows without all errors
_LEAST = 0.01  # share of a variance that is worth a column
_WHEELS, _MASS_STD = 4, 0.01  # runs with one flywheel, and relative standard deviation of a given mass
BASE, MASS = 'base_link', 180.0  # kg
# The wheel turns about its own centre: it moves no mass.
URDF = f"""\
<robot name="flywheel">
  <link name="{BASE}"><inertial><origin xyz="0.03 -0.02 0.05"/><mass value="{MASS}"/>
    <inertia ixx="42" ixy="1.5" ixz="-2" iyy="35" iyz="0.8" izz="30"/></inertial></link>
  <joint name="spin" type="continuous"><parent link="{BASE}"/><child link="wheel"/>
    <origin xyz="0.2 0.1 0.3" rpy="0.4 0.5 0"/><axis xyz="0 0 1"/></joint>
  <link name="wheel"><inertial><mass value="12"/>
    <inertia ixx="0.3" ixy="0" ixz="0" iyy="0.3" iyz="0" izz="0.5"/></inertial></link>
</robot>
"""
_MOTION: dict[str, object] = {
    'initial': {'base_angular_velocity': [0.03, -0.04, 0.05], 'zero_linear_momentum': True},
    'motion': {'kind': 'sinusoids', 'amplitudes': [40.0, 15.0], 'frequencies': [0.05, 0.12]},
}
Found = Mapping[Variant, Outcome]


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'model-errors.md', seeds=50)
    variants = [variant for robot in ROBOTS for variant in monte_carlo(robot)]
    variants = [*sorted(variants, key=lambda one: one.name != 'all'), *(variant for _, _, variant in ladder(EXAMPLE))]
    work = {}
    for variant in frame.chosen(variants, lambda variant: f'{variant.robot}, {variant.name}'):
        seeds = frame.seeds if variant.name == 'all' else range(round(_OTHERS * len(frame.seeds)) or 1)
        # On the ladder the robots are not drawn from the priors: there is no bound.
        bounded = not variant.name.startswith('ladder')
        work[variant] = (f'{variant.robot}-{variant.name}', [(variant, seed, bounded) for seed in seeds])
    found: dict[Variant, Outcome] = {}
    for variant, outcome in frame.outcomes(Outcome, run, work):
        found[variant] = outcome
        print(' | '.join(_row(variant, outcome)), flush=True)
    if frame.path:
        frame.write(_page(found))


def _page(found: Found) -> str:
    drawn = [_row(variant, outcome) for variant, outcome in found.items() if not variant.name.startswith('ladder')]
    budget = estimates(next(monte_carlo(EXAMPLE)), 0)[-1].budget
    assert budget is not None, 'a run with all errors has a budget'
    steps: dict[str, list[str]] = {}
    for name, _, variant in ladder(EXAMPLE):
        steps.setdefault(name, [name]).append(_step(found[variant]) if variant in found else '-')
    seeds = min((len(outcome) for variant, outcome in found.items() if variant.name.startswith('ladder')), default=0)
    wheels = [_wheel(range(_WHEELS), std) for std in (0.0, _MASS_STD * MASS)]
    return _PAGE.format(
        example=EXAMPLE,
        seeds=seeds,
        mass=MASS,
        drawn=table(_HEADER, drawn),
        ladder=table(['drawn with', *(f'{step:g}' for step in STEPS)], steps.values()),
        wheels=table(['mass given', 'runs', 'status', 'largest error', 'CoM std, mm', 'Ixx std, %'], wheels),
        budget=_budget(budget),
        provenance=provenance(),
    )


def _row(variant: Variant, outcome: Outcome) -> list[str]:
    coverage, (size, name, seed), (nees, low, high) = outcome.coverage, outcome.largest, outcome.nees
    numbers, nis = bool(np.any(np.isfinite(coverage))), outcome.nis[np.isfinite(outcome.nis)]
    return [
        f'{variant.robot}, {variant.name}',
        str(len(outcome)),
        percent(float(np.nanmean(coverage))) if numbers else '-',
        f'{percent(float(np.nanmin(coverage)))} to {percent(float(np.nanmax(coverage)))}' if numbers else '-',
        f'{number(size, 1)} ({name}, seed {seed})' if numbers else '-',
        number(nees),
        f'{number(low)} to {number(high)}',
        number(float(np.mean(nis))) if len(nis) else '-',
        _ratio(outcome.over_bound(outcome.error)),
        _ratio(outcome.over_bound(outcome.robots_own)),
        statuses(outcome.status),
    ]


def _ratio(values: Array) -> str:
    if not np.any(np.isfinite(values)):
        return '-'
    return f'{number(float(np.nanmedian(values)))} ({number(float(np.nanmax(values)))})'


def _step(outcome: Outcome) -> str:
    covered = percent(float(np.nanmean(outcome.coverage))) if np.any(np.isfinite(outcome.coverage)) else '-'
    size, name, seed = outcome.largest
    return f'{number(size, 1)} ({name}, seed {seed}), {covered}, {statuses(outcome.status)}'


def _budget(budget: ErrorBudget) -> str:
    worth = [cause for cause, shares in zip(budget.causes, budget.shares.T, strict=True) if np.nanmax(shares) > _LEAST]
    rows = [[name, *(percent(budget.of(name, 0.0).get(cause, np.nan)) for cause in worth)] for name in PARAMETERS]
    return table(['', *worth], rows)


def _wheel(seeds: Sequence[int], mass_std: float) -> list[str]:
    """Return a row of runs with one flywheel."""
    truth = physical(load_model(URDF).link(BASE).parameters)
    found = [_with_flywheel(seed, mass_std) for seed in seeds]
    errors = np.abs([(one.parameters - truth) / one.std for one in found])
    com = 1e3 * np.array([np.max(one.std[1:4]) for one in found])
    inertia = 100.0 * np.array([one.std[4] / one.parameters[4] for one in found])
    largest = (float(np.nanmax(x)) if np.any(np.isfinite(x)) else np.nan for x in (errors, com, inertia))
    status = statuses(one.status for one in found)
    return [f'within {mass_std:g} kg' if mass_std else 'no', str(len(found)), status, *map(number, largest)]


def _with_flywheel(seed: int, mass_std: float) -> Estimate:
    """Return the last estimate of a base with one flywheel in a minute; only the base itself is exact.

    Parameters
    ----------
    seed : of the robot, the sensors' noise and the given mass
    mass_std : kg, of the given mass about the true one; 0: no mass is given
    """
    nominal = load_model(URDF)
    errors = draw(nominal, BASE, DEFAULT, generator(seed))
    moving = simulation(build(SimulatorConfig, _MOTION), true_robot(nominal, errors, (BASE,)), 0.02)
    truth = moving.advance(np.arange(round(60.0 * RATE) + 1) / RATE)
    given: dict[str, object] = {'target_link': BASE, **declared(NOISE)}
    if mass_std > 0.0:
        off = float(np.random.default_rng([seed, 1]).normal(scale=mass_std))
        given |= {'target_prior.mass': MASS + off, 'target_prior.mass_std': mass_std}
    config = build(EstimatorConfig, given)
    identifier = Identifier(make_estimator(config, MomentumKernel(nominal, BASE)), config.window, MAXIMUM_GAP)
    try:
        return identifier.push(*readings(truth, NOISE, seed, errors))[-1]
    except UNSOLVABLE:  # a session would report it, and start anew
        return Estimate(method=config.method, status='waiting')


_HEADER = (
    *('robot, errors', 'robots', 'coverage', 'by parameter', 'largest error', 'NEES', 'its 95 % band', 'NIS'),
    *('RMSE / bound', 'draw / bound', 'status'),
)
_PAGE = """\
# Robots that are not their URDF

Robots are drawn as by the simulator (`model_errors.*`), one standard deviation each: links 1 % as a whole and each of
their parameters 1 % beside that ([trajectory.md](trajectory.md#a-known-body)), joint zeros 1 mrad, joint origins 1 mm,
joint axes 1 mrad, odometry mount 2 mm and 2 mrad; the target is exact. They move as the `*_simulator.yaml` of `config/`
command, with *mid* noise at 100 Hz. Method `trajectory` identifies a minute of it with default parameters and declared
noise; a robot and its noise have one seed.

## Coverage and errors

- *all*: all errors; then one block alone, the others exact and declared so; then all with wrong priors: by a factor of
  two, or about the links, which are off by one factor each, *as a whole*, or *each number by itself*.
- *coverage*: of the 95 % intervals, the mean over the parameters, and the smallest and largest of a parameter. The
  parameters of one run are hardly independent: the mean over twenty robots is good to some 5 %.
- *largest error*: in reported standard deviations. *NEES*, *NIS*: 1 is right; the band takes parameters as independent
  in the metric of their covariance.
- *RMSE / bound*: over the root mean square of the attainable deviations, median over the parameters (worst). The bound
  is the filter's posterior for exact data of the same robot, linearised at the truth, with right priors
  (`scripts/benchmarks/model_errors/runs.py`).
- *draw / bound*: the same of the errors that these robots make to first order, without noise: the luck of few draws in
  the ratio before. 1 or a little less is expected.

`table1` is drawn in its plane; in one row it is not.

{drawn}

## One undeclared error at a time

`{example}` with one error, drawn with the standard deviation at the head of the column in the unit of the row;
everything else is exact. Default parameters. Largest error of {seeds} runs in standard deviations, coverage, status at
the end. If the windows reveal larger errors of a kind (the zeros of all joints, say) than declared, the intervals of
unobservable ones widen as much, and a warning names the parameter
([trajectory.md](trajectory.md#verdict-coreverdict), eq. 7).

{ladder}

## A mass that has to be given

A base of {mass:g} kg with one flywheel, which turns about its own centre and moves no mass: no motion determines the
mass of the base. The robot is drawn as above; its wheel is a little out of balance, which determines the mass to some
per cent. A given mass deviates by its declared standard deviation. The mount of the odometry (2 mm) limits the CoM, the
wheel's inertia (1 %) the inertia.

{wheels}

## An error budget

Sources of the variance of each parameter in one run of `{example}` with all errors (seed 0; sources of more than 1 % of
any):

{budget}

{provenance}
"""


if __name__ == '__main__':
    main()
