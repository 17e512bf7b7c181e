"""Many bags through the estimator's core, on all cores."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, MutableSequence, Sequence
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from ctypes import c_double
from dataclasses import dataclass
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tqdm import tqdm

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import DataError
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.run import replay_bag
from mbaid_ros.replay.workers import Workers

_LOOK = 0.2  # s between two looks at how far the processes are


@dataclass(frozen=True)
class _Task:
    """What all processes are told when they start.

    Attributes
    ----------
    config, urdf, inputs : as for `replay_bags`
    done : memory shared by all: the part that is done of each bag, 0 to 1
    folder : where the results go; `Workers` carry small ones only
    """

    config: EstimatorConfig
    urdf: str
    inputs: Inputs
    done: MutableSequence[float]
    folder: Path

    def replay(self, place: int, bag: str) -> None:
        """Replay the bag at a place in the list."""

        def advance(done: int, total: int) -> None:
            self.done[place] = done / total if total else 1.0

        run = replay_bag(bag, self.config, self.urdf, self.inputs, progress=advance)
        (self.folder / str(place)).write_bytes(pickle.dumps(run))

    def result(self, place: int) -> Run:
        """Return what `replay` led to."""
        file = self.folder / str(place)
        run: Run = pickle.loads(file.read_bytes())
        file.unlink()
        return run


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
    with TemporaryDirectory(prefix='mbaid_ros_') as folder, _bar(len(bags)) as bar:
        task = _Task(config, urdf, inputs, done, Path(folder))
        with Workers(min(processes, len(bags)), task) as workers:
            runs = []
            for place, future in enumerate([workers.submit(_Task.replay, *each) for each in enumerate(bags)]):
                _wait(future, done, bar)
                runs.append(task.result(place))
    return runs


def _wait(future: Future[None], done: MutableSequence[float], bar: tqdm[None]) -> None:
    while not future.done():
        wait([future], _LOOK)
        bar.update(sum(done) - bar.n)
    try:
        future.result()
    except BrokenProcessPool as error:
        raise DataError(
            'a process died over a bag: it was killed, or memory ran out; fewer --processes take less of it'
        ) from error


@contextmanager
def _bar(bags: int) -> Iterator[tqdm[None]]:
    """Show a bar on a terminal, nothing when piped."""
    shape = '{l_bar}{bar}| {n:.1f}/{total} bags [{elapsed}<{remaining}]'
    with tqdm(total=bags, bar_format=shape, disable=None, leave=False) as bar:
        yield bar
