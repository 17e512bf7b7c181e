"""A bag through the estimator's core, or through its intake alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from mbaid_ros.bags import BagReader, Batch
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.gyro import IMU
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import Samples
from mbaid_ros.errors import DataError
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.run_of_session import Kept
from mbaid_ros.replay.whole_run import Arrivals, Run, TopicStatistics, topic_statistics
from mbaid_ros.replay.writers import EstimateWriter
from mbaid_ros.session.explanation import intake_warnings
from mbaid_ros.session.session import JOINTS, ODOMETRY, Session
from mbaid_ros.tasks import Method

# How the calls are spread does not change the numbers; this many messages keep the arrays long and the memory short.
_MESSAGES_AT_ONCE = 4_000
_BROKEN = 3.0  # times longer or shorter than its stamps, from which a recording's times are wrong, not just played fast
_UNITS = ((1e3, 'milliseconds'), (1e6, 'microseconds'))
_LIKE = 0.2  # relative, of such a factor: sec has 31 bits, and its overflow takes some

# Called now and then with the number of messages read and that of all.
Progress = Callable[[int, int], None]


def feed(bag: BagReader, inputs: Inputs, add: Callable[[Batch], None], progress: Progress | None) -> Iterator[None]:
    """Hand over a bag's messages; yield where it is time to work through them, the last time at the end.

    Raises DataError: The bag lacks a topic, or has it with another type.
    """
    topics = inputs.topics(bag)
    total = sum(bag.topics[topic].count for topic in topics)
    count = done = 0
    for part in bag.read_packed(topics, _MESSAGES_AT_ONCE):
        add(part)
        count += len(part)
        if count - done >= _MESSAGES_AT_ONCE:
            done = count
            yield
            if progress:
                progress(count, total)
    if not count and inputs.sliced:
        until = '' if inputs.end == np.inf else f' until {inputs.end:g} s'
        raise DataError(f"bag '{bag.path}' contains no messages from {inputs.start:g} s on{until}")
    yield
    if progress:
        progress(total, total)


@contextmanager
def progress_bar(bag: str) -> Iterator[Progress]:
    """Show a bar on a terminal, nothing when piped."""
    with tqdm(desc=Path(bag).name, unit=' messages', disable=None, leave=False) as bar:

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield advance


def replay_bag(
    path: str,
    config: EstimatorConfig,
    urdf: str,
    inputs: Inputs,
    *,
    writer: EstimateWriter | None = None,
    progress: Progress | None = None,
    before: Run | None = None,
) -> Run:
    """Send a bag's messages through a session and return the result; a writer gets every estimate.

    Of a run before, it goes on from the posterior.

    Raises DataError: The bag cannot be read, or lacks a topic.
    Raises ModelError, ParameterError: The robot or the parameters cannot be used.
    """
    known = None if before is None or before.posterior is None else before.posterior.continuation
    session = Session(config, urdf, before=known)
    kept = Kept(session, config, writer)
    with BagReader(path, inputs.start, inputs.end) as bag:
        inputs = inputs.resolved(bag)
        intake = _Intake(session, inputs, inputs.topics(bag))
        for _ in feed(bag, inputs, intake.add, progress):
            kept.add(session.process())
        kept.add(session.finish())
        topics = intake.statistics(bag)
        model_summary = session.model_summary()
        warnings = (*bag.warnings, *intake.warnings, *model_summary.warnings, *intake_warnings(session))
    run = kept.run(path, topics, model_summary, warnings)
    read = {ODOMETRY: inputs.odometry, IMU: inputs.imu}
    return replace(run, sensors=tuple(replace(each, topic=read.get(each.name) or each.topic) for each in run.sensors))


class _Intake:
    """Hands messages to the session and gathers their statistics."""

    def __init__(self, session: Session, inputs: Inputs, topics: tuple[str, ...]) -> None:
        self._session = session
        self._inputs = inputs
        self._arrivals = {topic: Arrivals() for topic in topics}
        self.warnings: list[str] = []

    def add(self, messages: Batch) -> None:
        """Take messages."""
        self._inputs.add_to(self._session, messages)
        for topic, times in messages.times.items():
            self._arrivals[topic].add(times)

    def statistics(self, bag: BagReader) -> tuple[TopicStatistics, ...]:
        """Return the statistics of each topic, by header stamps where the bag's times of recording cannot be."""
        spans = {topic: arrivals.span for topic, arrivals in self._arrivals.items()}
        names = (self._inputs.joint_states, JOINTS), (self._inputs.odometry, ODOMETRY)
        stamped = {topic: self._session.queue.span(name) for topic, name in names if topic in spans}
        for topic, lasting in stamped.items():
            if lasting > 0.0 and not 1.0 / _BROKEN < self._arrivals[topic].span / lasting < _BROKEN:
                within = self._arrivals[topic].span
                likely = [unit for times, unit in _UNITS if abs(lasting - times * within) < _LIKE * times * within]
                unit = f', as if sec were {likely[0]}' if likely else ''
                self.warnings.append(
                    f'the messages on {topic} were recorded within {within:.3g} s, by their stamps they last '
                    f'{lasting:.3g} s{unit}: rates are by the stamps'
                )
                spans |= stamped
        return tuple(
            topic_statistics(topic, bag.topics[topic].type, self._count(bag, topic), span)
            for topic, span in spans.items()
        )

    def _count(self, bag: BagReader, topic: str) -> int:
        return self._arrivals[topic].count if self._inputs.sliced else bag.topics[topic].count


@dataclass(frozen=True)
class BagMotions:
    """The motions in a bag, as the windows that a calibration takes."""

    bag: str  # path as the user gave it
    runs: tuple[list[Samples], ...]  # motions, each as windows; stamps that jump back begin another one
    warnings: tuple[str, ...]  # of bag, intake and data, one line each
    heard: tuple[str, ...] = ()  # joints that the messages name


class _Collector(Method):
    """A method that keeps the windows; its estimates hold no numbers and carry the notes on the data."""

    needs_rates = False

    def __init__(self, number: int) -> None:
        self.method = f'calibration, motion {number}'
        self.windows: list[Samples] = []

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows."""
        self.windows += windows
        last = float(windows[-1].time[-1])
        return [Estimate(self.method, 'estimating', time=last, stamp=origin + round(last * 1e9))]


def read_motions(path: str, config: EstimatorConfig, urdf: str, inputs: Inputs) -> BagMotions:
    """Return the motions in a bag, through the same intake as an estimator's, with a progress bar.

    Raises DataError: The bag cannot be read, or lacks a topic.
    Raises ModelError, ParameterError: The robot or the parameters cannot be used.
    """
    collectors: list[_Collector] = []

    def collect(*_given: object) -> Estimator:
        collectors.append(_Collector(len(collectors)))
        return collectors[-1]

    session = Session(config, urdf, collect)
    last: dict[str, tuple[str, ...]] = {}  # notes on the data of each motion
    with progress_bar(path) as progress, BagReader(path, inputs.start, inputs.end) as bag:
        resolved = inputs.resolved(bag)
        for _ in feed(bag, resolved, lambda messages: resolved.add_to(session, messages), progress):
            last.update((each.method, each.warnings) for each in session.process())
        last.update((each.method, each.warnings) for each in session.finish())
        notes = [text for each in last.values() for text in each]
        warnings = (*bag.warnings, *notes, *intake_warnings(session))
    runs = tuple(collector.windows for collector in collectors if collector.windows)
    return BagMotions(path, runs, tuple(dict.fromkeys(warnings)), tuple(session.intake.joint_reader.heard))
