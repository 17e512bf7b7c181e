"""Methods on runs, each in a process of its own; finished ones stay in the run's folder."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import multiprocessing
import os
import resource
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.frame import resident
from benchmarks.peers.dataset import BAG, KNOWN, URDF
from benchmarks.peers.recording import Known
from benchmarks.peers.registry import load
from mbaid_ros.core.geometry import Array

LIMIT = 300  # s of processor time, of a run
_PRELOADED = 'benchmarks.peers.ours'


@dataclass(frozen=True)
class Outcome:
    """The outcome of a method on a run.

    Attributes
    ----------
    parameters, std : (10,) NaN where there is none
    doubt : why the method does not trust its numbers
    failure : why there are none
    wall, processor : s, without the start of Python
    memory : MB beyond what the loaded package takes
    """

    parameters: list[float]
    std: list[float]
    doubt: str
    failure: str
    wall: float
    processor: float
    memory: float


def outcomes(
    work: Sequence[tuple[str, Path]], manifest: dict[str, dict[str, str]], processes: int
) -> Iterator[tuple[str, str, Outcome]]:
    """Yield (method, name of the run, outcome) of all work: methods and folders of runs.

    Without processes, only of runs finished before.
    """
    if processes == 0:
        for name, folder in work:
            found = _finished(*_kept_in(name, folder, manifest[folder.name]))
            if found is not None:
                yield name, folder.name, found
        return
    os.environ['PYTHONPATH'] = os.pathsep.join(filter(None, sys.path))  # for the server, which gets it in no other way
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload([_PRELOADED])

    def one(task: tuple[str, Path]) -> tuple[str, str, Outcome]:
        name, folder = task
        return name, folder.name, _outcome(name, folder, manifest[folder.name], context)

    with ThreadPoolExecutor(processes) as pool, tqdm(total=len(work), unit=' runs', disable=None, leave=False) as bar:
        for result in pool.map(one, work):
            bar.update()
            yield result


def _kept_in(name: str, folder: Path, files: dict[str, str]) -> tuple[Path, str]:
    """Return the file of an outcome, and the digests it must have: of this bag and this method."""
    module = load(name).identify.__code__.co_filename
    made_of = hashlib.sha256(json.dumps(files, sort_keys=True).encode() + Path(module).read_bytes()).hexdigest()
    return folder.parent / 'results' / folder.name / f'{name}.json', made_of


def _finished(file: Path, made_of: str) -> Outcome | None:
    """Return the outcome in a file; None where there is none, or one of something else."""
    values = json.loads(file.read_text(encoding='utf-8')) if file.is_file() else {}
    return Outcome(**values) if values.pop('made_of', '') == made_of else None


def _outcome(name: str, folder: Path, files: dict[str, str], context: Any) -> Outcome:
    """Return the finished outcome, or make it."""
    file, made_of = _kept_in(name, folder, files)
    found = _finished(file, made_of)
    if found is not None:
        return found
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(name, str(folder), theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        outcome = Outcome(**ours.recv())
    except EOFError:
        outcome = Outcome([np.nan] * 10, [np.nan] * 10, '', 'the process ended', np.nan, np.nan, np.nan)
    process.join()
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({'made_of': made_of, **asdict(outcome)}, indent=1) + '\n', encoding='utf-8')
    return outcome


def _work(name: str, folder: str, pipe: Any) -> None:
    """Run a method in this process, and send its outcome."""
    signal.signal(signal.SIGPROF, _late)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    pipe.send(asdict(outcome_of(name, Path(folder))))


def outcome_of(name: str, folder: Path) -> Outcome:
    """Return the outcome of a method on a run, in this process."""
    method, before = load(name), resident()
    urdf, known = (folder / URDF).read_text(encoding='utf-8'), Known.read(folder / KNOWN)
    parameters: Array = np.full(10, np.nan)
    std: Array = np.full(10, np.nan)
    doubt, failure = '', ''
    wall, processor = time.perf_counter(), time.process_time()
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            answer = method.identify(folder / BAG, urdf, known)
        parameters, doubt = np.asarray(answer.parameters, dtype=float), answer.doubt
        if answer.covariance is not None:
            std = np.sqrt(np.diag(answer.covariance))
    except Exception as error:  # noqa: BLE001 - one method must not stop the others
        failure = ' '.join(f'{type(error).__name__}: {error}'.split())[:200]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    times = (time.perf_counter() - wall, time.process_time() - processor)
    return Outcome(parameters.tolist(), std.tolist(), doubt, failure, *times, max(peak - before, 0.0))


def _late(*_: object) -> None:
    raise TimeoutError(f'no answer within {LIMIT} s')
