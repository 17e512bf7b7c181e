"""Methods on runs, each in a process of its own, and their score; finished runs stay in the run's folder."""

import contextlib
import hashlib
import io
import json
import multiprocessing
import os
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

from benchmarks.peers.dataset import BAG, KNOWN, TRUTH, URDF
from benchmarks.peers.recording import Known
from benchmarks.peers.registry import load
from fuzzing.trial import memory_of
from mbaid_ros.core.geometry import Array
from mbaid_ros.replay.campaigns.statistics import QUANTILE

LIMIT = 300  # s of processor time, of a run
FAR = 5.0  # standard deviations: an error beyond is wrong
FAR_ALONE = 0.1  # the same without standard deviations: of mass, radius of gyration or mean moment
COVERED = (0.9, 0.98)  # share of 95 % intervals that hold the truth, where they are right
_MANY = 100  # intervals: of fewer, all may hold the truth by chance


@dataclass(frozen=True)
class Outcome:
    """The outcome of a method on a run."""

    parameters: list[float]  # (10,) NaN where there is none
    std: list[float]  # (10,) NaN where there is none
    doubt: str  # why the method does not trust its numbers
    failure: str  # why there are none
    processor: float  # s, without the start of Python
    memory: float  # MB beyond what the loaded package takes


def outcomes(
    work: Sequence[tuple[str, Path]], manifest: dict[str, dict[str, str]], processes: int
) -> Iterator[tuple[str, str, Outcome]]:
    """Yield (method, name of the run, outcome) of all work: methods and folders of runs.

    Without processes, only of runs finished before.
    """
    if processes == 0:
        for name, folder in work:
            *_, found = _finished(name, folder, manifest[folder.name])
            if found is not None:
                yield name, folder.name, found
        return
    os.environ['PYTHONPATH'] = os.pathsep.join(filter(None, sys.path))  # for the server, which gets it in no other way
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload(['benchmarks.peers.registry'])

    def one(task: tuple[str, Path]) -> tuple[str, str, Outcome]:
        name, folder = task
        return name, folder.name, _outcome(name, folder, manifest[folder.name], context)

    with ThreadPoolExecutor(processes) as pool, tqdm(total=len(work), unit=' runs', disable=None, leave=False) as bar:
        for result in pool.map(one, work):
            bar.update()
            yield result


def _finished(name: str, folder: Path, files: dict[str, str]) -> tuple[Path, str, Outcome | None]:
    """Return the file of an outcome, the digest of this bag and this method, and the outcome if it is of these."""
    made_of = hashlib.sha256(json.dumps(files, sort_keys=True).encode() + load(name).file.read_bytes()).hexdigest()
    file = folder.parent / 'results' / folder.name / f'{name}.json'
    values = json.loads(file.read_text(encoding='utf-8')) if file.is_file() else {}
    values.pop('wall', None)  # of an older version
    return file, made_of, Outcome(**values) if values.pop('made_of', '') == made_of else None


def _outcome(name: str, folder: Path, files: dict[str, str], context: Any) -> Outcome:
    """Return the finished outcome, or make it."""
    file, made_of, found = _finished(name, folder, files)
    if found is not None:
        return found
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(name, str(folder), theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        outcome = Outcome(**ours.recv())
    except EOFError:
        outcome = Outcome([np.nan] * 10, [np.nan] * 10, '', 'the process ended', np.nan, np.nan)
    process.join()
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({'made_of': made_of, **asdict(outcome)}, indent=1) + '\n', encoding='utf-8')
    return outcome


def _work(name: str, folder: str, pipe: Any) -> None:
    signal.signal(signal.SIGPROF, _late)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    pipe.send(asdict(outcome_of(name, Path(folder))))


def outcome_of(name: str, folder: Path) -> Outcome:
    """Return the outcome of a method on a run, in this process."""
    method, before = load(name), memory_of('VmRSS')
    urdf, known = (folder / URDF).read_text(encoding='utf-8'), Known.read(folder / KNOWN)
    parameters: Array = np.full(10, np.nan)
    std: Array = np.full(10, np.nan)
    doubt, failure = '', ''
    processor = time.process_time()
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            answer = method.identify(folder / BAG, urdf, known)
        parameters, doubt = np.asarray(answer.parameters, dtype=float), answer.doubt
        if answer.covariance is not None:
            std = np.sqrt(np.diag(answer.covariance))
    except Exception as error:  # noqa: BLE001 - one method must not stop the others
        failure = ' '.join(f'{type(error).__name__}: {error}'.split())[:200]
    taken, memory = time.process_time() - processor, 1e-6 * max(memory_of('VmHWM') - before, 0)
    return Outcome(parameters.tolist(), std.tolist(), doubt, failure, taken, memory)


def _late(*_: object) -> None:
    raise TimeoutError(f'no answer within {LIMIT} s')


@dataclass(frozen=True)
class Truth:
    """The (10,) true parameters of a run, and the standard deviations that no unbiased method surpasses."""

    parameters: Array
    bound: Array  # NaN for what the motion leaves open

    @staticmethod
    def read(run: Path) -> 'Truth':
        """Return that in the folder of a run."""
        values = json.loads((run / TRUTH).read_text(encoding='utf-8'))
        return Truth(np.array(values['parameters']), np.array(values['bound'], dtype=float))

    @property
    def sizes(self) -> Array:
        """Sizes that errors are compared with, (10,)."""
        mass, moment = self.parameters[0], np.mean(self.parameters[[4, 7, 9]])
        return np.concatenate(([mass], np.full(3, np.sqrt(1.5 * moment / mass)), np.full(6, moment)))


@dataclass(frozen=True)
class Score:
    """The runs of a method together; NaN where there is none."""

    runs: int
    answers: int  # with a number that the method trusts
    ratio: Array  # of each run: root mean square over the parameters of error over bound; NaN without an answer
    covered: float  # share of the 95 % intervals that hold the truth
    intervals: int
    wrong: int  # answers that are wrong with a small interval
    failures: tuple[str, ...]  # why there was no answer
    processor: float  # s, median
    memory: float  # MB, largest

    @property
    def median(self) -> float:
        """Median error over the bound."""
        return median(self.ratio)

    @property
    def holds(self) -> bool:
        """Whether the intervals hold the truth as often as claimed."""
        return bool(self.covered >= COVERED[0] and (self.covered <= COVERED[1] or self.intervals < _MANY))


def median(values: Sequence[float] | Array) -> float:
    """Return the median of the numbers that are there; NaN if none is."""
    return float(np.nanmedian(values)) if np.any(np.isfinite(values)) else np.nan


def score(outcomes: Sequence[Outcome], truths: Sequence[Truth]) -> Score:
    """Return the score of some runs."""
    ratios, inside, wrong, failures = [], [], 0, []
    for outcome, truth in zip(outcomes, truths, strict=True):
        open_ones = ~np.isfinite(truth.bound)
        error, std = np.array(outcome.parameters) - truth.parameters, np.array(outcome.std)
        error[open_ones] = std[open_ones] = np.nan
        given = np.isfinite(error)
        if outcome.failure or outcome.doubt or not given.any():
            failures.append(outcome.failure or outcome.doubt or 'nothing is determined')
            ratios.append(np.nan)
            continue
        ratios.append(np.sqrt(np.mean((error[given] / truth.bound[given]) ** 2)))
        sure = given & np.isfinite(std)
        inside += (np.abs(error[sure]) < QUANTILE * std[sure]).tolist()
        limit = np.where(sure, FAR * std, FAR_ALONE * truth.sizes)
        wrong += bool(np.any(np.abs(error[given]) > limit[given]))
    return Score(
        runs=len(outcomes),
        answers=len(outcomes) - len(failures),
        ratio=np.array(ratios),
        covered=float(np.mean(inside)) if inside else np.nan,
        intervals=len(inside),
        wrong=wrong,
        failures=tuple(failures),
        processor=float(np.median([each.processor for each in outcomes])),
        memory=float(np.max([each.memory for each in outcomes])),
    )
