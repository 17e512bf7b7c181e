"""The executable `plan`: the next motion, planned from the end of a recorded run."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from tqdm import tqdm

from mbaid_ros.bags import BAG_TYPES, BagWriter
from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED, one_line, warn
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.motion_files import as_yaml
from mbaid_ros.config.parameter_files import given_parameters, read_robot_description
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.estimate_messages import trajectory_message
from mbaid_ros.files import write_text
from mbaid_ros.parameters import build
from mbaid_ros.planning.planned_motion import Plan
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.json_output import plain
from mbaid_ros.replay.one_bag import progress_bar, replay_bag
from mbaid_ros.replay.provenance import made_by
from mbaid_ros.replay.whole_run import Run
from mbaid_ros.replay.writers import check_outputs, write_results
from mbaid_ros.session.planning import make_planner

TOPIC, TYPE = '/joint_trajectory', 'trajectory_msgs/msg/JointTrajectory'


def plan(arguments: argparse.Namespace) -> int:
    """Plan a motion, write the results, and return the exit code.

    Raises DataError, ModelError, ParameterError: The run, the robot or a parameter cannot be used.
    """
    check_outputs(arguments, 'yaml')
    if arguments.output and Path(arguments.output).exists():
        raise ParameterError(f"--output '{arguments.output}' exists already; accepted: a folder that does not")
    config = build(EstimatorConfig, given_parameters(arguments, 'estimator'))
    run = _begin(arguments, config)
    if run.final.status == 'inconsistent':
        print(
            f'mbaid_ros plan: {one_line(arguments.bag)} contradicts its model, so that its numbers cannot be '
            'planned from; accepted: a run that does not',
            file=sys.stderr,
        )
        return EXIT_INCONSISTENT
    if run.posterior is None:
        raise DataError(
            f"bag '{run.bag}' leads to no state to plan from: it needs a solution of method trajectory (status "
            f'{run.final.status})'
        )
    planner = make_planner(config, run.posterior)
    with _progress(config.plan.effort) as progress:
        found = planner.plan(progress)
    _write(found, made_by('plan', arguments.argv, arguments.model, run.urdf), arguments)
    return 0 if found.reached else EXIT_NOT_DETERMINED


@contextmanager
def _progress(effort: int) -> Iterator[Callable[[int], bool]]:
    """Show a bar on a terminal; Ctrl-C ends the search, not the program."""
    stopped = False

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    before = signal.signal(signal.SIGINT, stop)
    try:
        with tqdm(total=effort, unit=' motions', disable=None, leave=False) as bar:

            def advance(compared: int) -> bool:
                bar.update(compared - bar.n)
                return not stopped

            yield advance
    finally:
        signal.signal(signal.SIGINT, before)


def _write(found: Plan, made: dict[str, Any], arguments: argparse.Namespace) -> None:
    if arguments.yaml:
        write_text(arguments.yaml, as_yaml(found.trajectory))
    if arguments.output:
        with BagWriter(arguments.output) as bag:
            bag.add_topic(TOPIC, TYPE, latched=True)
            bag.write(TOPIC, trajectory_message(found.trajectory, BAG_TYPES), 0)

    write_results(arguments, {**_as_json(found), 'made_by': made}, lambda: _summary(found))


def _begin(arguments: argparse.Namespace, config: EstimatorConfig) -> Run:
    """Replay the bag whose end is the begin of a plan; warnings about it go to stderr."""
    urdf, inputs = read_robot_description(arguments.model), Inputs.from_arguments(arguments, config)
    with progress_bar(arguments.bag) as progress:
        run = replay_bag(arguments.bag, config, urdf, inputs, progress=progress)
    warn('plan', run.warnings)
    return run


def _summary(plan: Plan) -> str:
    """Return a plan as a table for a terminal."""
    rows = [plan.verdict, '', '             now        after      wanted     over the posterior']
    stds = plan.std_before, plan.std_after, plan.wanted, *plan.std_range
    for name, now, then, wanted, least, most, asked in zip(PARAMETERS, *stds, plan.determinable, strict=True):
        if asked:
            shares = '  '.join(f'{100.0 * value:8.3g} %' for value in (now, then, wanted, least))
            rows.append(f'  {name:6} {shares} to {100.0 * most:.3g} %')
        else:
            rows.append(f'  {name:6} determined by no motion of this robot')
    rows += [
        '  one standard deviation, as convergence.relative_std has it',
        f'  over the posterior: after the motion, for {len(plan.sampled_stds)} bodies drawn from the present estimate',
        *(f'  {line}' for line in plan.excursions),
        f'  {len(plan.trajectory.joints)} joints: {", ".join(plan.trajectory.joints)}',
    ]
    if plan.stuck:
        rows.append(f'  not moved: {", ".join(plan.stuck)}')
    if plan.binding:
        rows.append(f'  at its limit: {", ".join(plan.binding)}')
    rows += [f'  best of {plan.compared} motions', *(f'  note: {note}' for note in plan.notes)]
    return '\n'.join(row if row.isprintable() else one_line(row) for row in rows)


def _as_json(plan: Plan) -> dict[str, Any]:
    """Return a plan as scripts read it; standard deviations are relative."""
    trajectory = plan.trajectory
    stds = np.stack((plan.std_before, plan.std_after, plan.wanted, *plan.std_range), axis=1).tolist()
    return {
        'target_link': plan.target,
        'reached': plan.reached,
        'verdict': plan.verdict,
        'duration': trajectory.duration,
        'relative_std': {
            name: dict(zip(('now', 'after', 'wanted', 'least', 'most'), values, strict=True)) if asked else None
            for name, values, asked in zip(PARAMETERS, stds, plan.determinable, strict=True)
        },
        'course': {'t': plan.times.tolist(), 'relative_std': plan.course.tolist()},
        'base': {
            name: {'unit': unit, **plain(dict(zip(('most', 'certain', 'limit'), values, strict=True)))}
            for (name, unit, _), values in plan.effects
        },
        'binding': list(plan.binding),
        'stuck': list(plan.stuck),
        'notes': list(plan.notes),
        'compared': plan.compared,
        'trajectory': {
            'joint_names': list(trajectory.joints),
            'time_from_start': trajectory.time.tolist(),
            'positions': trajectory.position.tolist(),
            'velocities': trajectory.velocity.tolist(),
            'accelerations': trajectory.acceleration.tolist(),
        },
    }
