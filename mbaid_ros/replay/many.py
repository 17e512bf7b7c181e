"""Many bags through the estimator's core, on all cores."""

from __future__ import annotations

from collections.abc import Iterator, MutableSequence, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager
from ctypes import c_double
from dataclasses import dataclass
from multiprocessing.sharedctypes import RawArray
from typing import Any

from tqdm import tqdm

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import DataError
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.run import replay_bag
from mbaid_ros.replay.workers import ProcessDiedError, Workers

_LOOK = 0.2  # s between two looks at how far the processes are


@dataclass(frozen=True)
class _Task:
    """What all processes are told when they start.

    Attributes
    ----------
    config, urdf, inputs : as for `replay_bags`
    done : memory shared by all: the part that is done of each bag, 0 to 1
    """

    config: EstimatorConfig
    urdf: str
    inputs: Inputs
    done: MutableSequence[float]

    def replay(self, place: int, bag: str) -> Run:
        """Replay the bag at a place in the list."""

        def advance(done: int, total: int) -> None:
            self.done[place] = done / total if total else 1.0

        return replay_bag(bag, self.config, self.urdf, self.inputs, progress=advance)


def replay_bags(bags: Sequence[str], config: EstimatorConfig, urdf: str, inputs: Inputs, processes: int) -> list[Run]:
    """Replay bags, several at the same time, with the results of one after the other.

    Parameters
    ----------
    bags : the bags
    config : the estimator's parameters
    urdf : text of the robot description
    inputs : the topics to read
    processes : that work at the same time

    Raises
    ------
    DataError, ModelError, ParameterError
        What `replay_bag` raises of the first bag, in the order given, that it cannot replay.
    """
    done: Any = RawArray(c_double, len(bags))
    task = _Task(config, urdf, inputs, done)
    with _bar(len(bags)) as bar, Workers(min(processes, len(bags)), task) as workers:
        futures = [workers.submit(_Task.replay, *each) for each in enumerate(bags)]
        return [_result(future, done, bar) for future in futures]


def _result(future: Future[Run], done: MutableSequence[float], bar: tqdm[None]) -> Run:
    """Return a result as soon as it is there; show until then how far all are."""
    while not future.done():
        wait([future], _LOOK)
        bar.update(sum(done) - bar.n)
    try:
        return future.result()
    except ProcessDiedError as error:
        raise DataError(
            'a process died over a bag: it was killed, or memory ran out; fewer --processes take less of it'
        ) from error


@contextmanager
def _bar(bags: int) -> Iterator[tqdm[None]]:
    """Show a bar on a terminal, nothing when piped."""
    shape = '{l_bar}{bar}| {n:.1f}/{total} bags [{elapsed}<{remaining}]'
    with tqdm(total=bags, bar_format=shape, disable=None, leave=False) as bar:
        yield bar
