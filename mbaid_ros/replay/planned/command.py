"""What the executable `plan` does with its arguments."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from tqdm import tqdm

from mbaid_ros.bags import BagWriter
from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED, one_line
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.config.trajectory import as_yaml
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.files import require_writable, write_text
from mbaid_ros.outgoing import trajectory_message
from mbaid_ros.planning.plan import Plan
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.replay.planned.begin import Begin, read_begin
from mbaid_ros.replay.planned.words import as_json, summary
from mbaid_ros.replay.provenance import in_words, made_by
from mbaid_ros.session.planning import make_planner

STDOUT = '-'
TOPIC, TYPE = '/joint_trajectory', 'trajectory_msgs/msg/JointTrajectory'


def plan(arguments: argparse.Namespace, argv: Sequence[str]) -> int:
    """Plan a motion, write what was asked for, and return the exit code.

    Parameters
    ----------
    arguments : parsed
    argv : as they were given, for the record

    Raises
    ------
    DataError, ModelError, ParameterError
        The run, the robot or a parameter cannot be used.
    """
    _check_outputs(arguments)
    begin = read_begin(arguments, read_robot_description(arguments.model))
    if begin.status == 'inconsistent':
        print(
            f'mbaid_ros plan: {one_line(arguments.start)} contradicts its model, so that its numbers cannot be '
            'planned from; accepted: a run that does not',
            file=sys.stderr,
        )
        return EXIT_INCONSISTENT
    planner = make_planner(begin.config, begin.knowledge)
    with _progress(begin.config.plan.effort) as progress:
        found = planner.plan(progress)
    _write(found, begin, arguments, argv)
    return 0 if found.reached else EXIT_NOT_DETERMINED


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse before the long work what could not be written after it."""
    for option in ('json', 'report', 'yaml'):
        path = getattr(arguments, option)
        if option != 'json' or path != STDOUT:
            require_writable(f'--{option}', path)
    if arguments.output and Path(arguments.output).exists():
        raise ParameterError(f"--output '{arguments.output}' exists already; accepted: a folder that does not")


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


def _write(found: Plan, begin: Begin, arguments: argparse.Namespace, argv: Sequence[str]) -> None:
    made = made_by('plan', argv, arguments.model, begin.urdf)
    text = json.dumps({**as_json(found), 'made_by': vars(made) | {'robot': vars(made.robot)}}, allow_nan=False) + '\n'
    if arguments.yaml:
        write_text(arguments.yaml, as_yaml(found.trajectory))
    if arguments.output:
        with BagWriter(arguments.output) as bag:
            bag.add_topic(TOPIC, TYPE, latched=True)
            bag.write(TOPIC, trajectory_message(found.trajectory, BAG_TYPES), 0)
    if arguments.json and arguments.json != STDOUT:
        write_text(arguments.json, text)
    if arguments.report:
        from mbaid_ros.replay.report.planned import html  # noqa: PLC0415 - matplotlib takes a while

        knowledge = begin.knowledge
        model = knowledge.layout.kernel.model
        write_text(arguments.report, html(found, model, knowledge.end.joint_position, in_words(made)))
    if arguments.json == STDOUT:
        sys.stdout.write(text)
    else:
        print(summary(found))
