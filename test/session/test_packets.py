"""When and how a session works: bytes in lists, in parts, and again after a numerical failure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import defects
from defects import JOINTS, ODOMETRY, Arrival, arrivals, estimates, in_order
from mbaid_ros.bags import Batch
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import JOINT_STATE_TYPE, ODOMETRY_TYPE, Samples
from mbaid_ros.packets import packer
from mbaid_ros.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.robot import KnownRobot
from mbaid_ros.session.session import PART, Session
from mbaid_ros.tasks import AT_ONCE, Kind, Method, Work
from recorded import as_bytes
from simulated import CONFIG
from streams import run, urdf

ROBOT, SECONDS = 'servicer7', 2.6
INPUTS = Inputs(JOINTS, ODOMETRY)


def restamped(places: Sequence[int], seconds: Callable[[Arrival], float]) -> Callable[[list[Arrival]], list[Arrival]]:
    """Return a defect that shifts the stamps of some messages."""

    def defect(messages: list[Arrival]) -> list[Arrival]:
        messages = list(messages)
        for place in places:
            change = defects.shifted(seconds(messages[place]))
            (messages[place],) = defects.changed(messages[place].topic, change)([messages[place]])
        return messages

    return defect


STREAMS: dict[str, Callable[[list[Arrival]], list[Arrival]]] = {
    'as they come': lambda messages: messages,
    'jump back': lambda messages: [*messages, *messages],
    'stray stamps': restamped((40, 141, 142, 260), lambda _: 100.0),
    'stamps not set': restamped((0, 77, 200), lambda message: -1e-9 * defects.stamp_of(message)),
    'halves': defects.in_halves,
    'without rates': defects.changed(JOINTS, defects.no_rates),
    'in another order': lambda messages: [messages[k ^ 1] for k in range(len(messages))],
}


def packed(messages: Sequence[Arrival]) -> list[tuple[str, bytes, int]]:
    """Return messages as bytes, with their topics and times."""
    return [(each.topic, as_bytes(each.message), each.time) for each in messages]


class Packing:
    """Makes of bytes what a bag's reader makes of them: packets together, or one by one."""

    def __init__(self) -> None:
        self._packers = {JOINTS: packer(JOINT_STATE_TYPE), ODOMETRY: packer(ODOMETRY_TYPE)}

    def recorded(self, messages: Sequence[tuple[str, bytes, int]]) -> Batch:
        """Return messages by their topics."""
        by_topic: dict[str, Sequence[Any]] = {}
        for topic, pack in self._packers.items():
            assert pack is not None
            given = [data for name, data, _ in messages if name == topic]
            if given:
                together = pack.many(given)
                by_topic[topic] = [pack(data) for data in given] if together is None else together
        times = {name: np.array([time for topic, _, time in messages if topic == name]) for name in by_topic}
        return Batch([topic for topic, _, _ in messages], by_topic, times)


def said(found: Sequence[Estimate]) -> list[tuple[Any, ...]]:
    return [(e.stamp, e.status, e.parameters.tobytes(), e.covariance.tobytes(), e.warnings) for e in found]


@pytest.mark.parametrize('at_once', [37, 300, 100_000])
@pytest.mark.parametrize('stream', STREAMS)
def test_the_estimates_are_the_same_to_the_last_bit(stream: str, at_once: int) -> None:
    messages = STREAMS[stream](arrivals(ROBOT, SECONDS, 1))
    expected, singly = estimates(ROBOT, messages)
    session = Session(build(EstimatorConfig, dict(EXACT)), (CONFIG / f'{ROBOT}.urdf').read_text(encoding='utf-8'))
    given, packing, found = packed(messages), Packing(), []
    for begin in range(0, len(given), at_once):
        INPUTS.add_to(session, packing.recorded(given[begin : begin + at_once]))
        found += session.process()
    assert len(expected) >= 2
    assert said(found) == said(expected)
    assert (session.used, session.dropped, session.restarts) == (singly.used, singly.dropped, singly.restarts)
    assert session.received == singly.received


# -- When a session asks to work: in small parts while a window is open, and with the very message that completes it.

TABLE1, FEW_SECONDS, WINDOW = 'table1', 2.1, 0.5


def times(rate: float, offset: float = 0.0) -> Array:
    return np.arange(0.1 + offset, FEW_SECONDS - 1e-9, 1.0 / rate)


def delayed(messages: Sequence[Arrival], topic: str, by: float) -> list[Arrival]:
    """Return messages of which those of one topic take longer on their way, s."""
    later = (replace(m, time=m.time + round(by * 1e9)) if m.topic == topic else m for m in messages)
    return in_order(list(later))


ARRIVING: dict[str, Callable[[], list[Arrival]]] = {
    'equal stamps': lambda: arrivals(TABLE1, FEW_SECONDS, 1),
    'joints later': lambda: arrivals(TABLE1, FEW_SECONDS, 1, times(100.0, 0.004), times(100.0, 0.002)),
    'joints earlier': lambda: arrivals(TABLE1, FEW_SECONDS, 1, times(100.0, 0.002), times(100.0, 0.004)),
    'joints often': lambda: arrivals(TABLE1, FEW_SECONDS, 1, times(250.0), times(20.0, 0.002)),
    'joints seldom': lambda: arrivals(TABLE1, FEW_SECONDS, 1, times(20.0, 0.004), times(250.0)),
    'joints on their way for 45 ms': lambda: delayed(arrivals(TABLE1, FEW_SECONDS, 1), JOINTS, 0.045),
    'odometry on its way for 45 ms': lambda: delayed(arrivals(TABLE1, FEW_SECONDS, 1), ODOMETRY, 0.045),
    'joints in halves': lambda: defects.in_halves(arrivals(TABLE1, FEW_SECONDS, 1)),
}


def worked(messages: Sequence[Arrival], *, always: bool) -> tuple[list[int], list[int]]:
    """Return after which messages estimates came, and how many messages were worked through in each call.

    Parameters
    ----------
    messages : in the order of arrival
    always : whether to work after every message, not only when the session asks for it
    """
    session = Session(EstimatorConfig(window=WINDOW), (CONFIG / f'{TABLE1}.urdf').read_text(encoding='utf-8'))
    came, parts = [], []
    for index, arrival in enumerate(messages):
        take = session.add_joint_state if arrival.topic == JOINTS else session.add_odometry
        if take(arrival.message) or always:
            before = sum(session.received.values())
            came += [index] * len(session.process())
            parts.append(sum(session.received.values()) - before)
    return came, parts


@pytest.mark.parametrize('stream', ARRIVING)
def test_an_estimate_comes_with_the_message_that_completes_its_window(stream: str) -> None:
    messages = ARRIVING[stream]()
    came, parts = worked(messages, always=False)
    assert len(came) >= 3
    # Halves of the joints are distinguished only when they are read.
    late = 2 if stream == 'joints in halves' else 0
    assert np.all(np.subtract(came, worked(messages, always=True)[0]) <= late)
    # Hardly any work in vain.
    assert len(parts) <= 5 * (len(came) + 1) + len(messages) / PART


# -- Equations that cannot be solved, whatever the reason: the run starts again and says so.

FAILS_AT, MANY_SECONDS = 4.0, 12.0  # s


CAUSE = 'the positions are in millimetres'


class Failing(Method):
    """A method that fails once."""

    def __init__(self, method: Estimator, failures: list[Exception]) -> None:
        self.method, self.needs_rates = method.method, method.needs_rates
        self._method, self._failures = method, failures

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Fail if it has not done so, or do what the method does."""
        if self._failures and windows[-1].time[-1] > FAILS_AT:
            raise self._failures.pop()
        return self._method.update(windows, origin)


class FailingLater(Failing):
    """A method that fails once in what it has put off."""

    _time = 0.0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Do what the method does."""
        self._time = float(windows[-1].time[-1])
        self.tasks.begin(Kind.CAUSES, self._fail(), lambda _: None, steps=AT_ONCE)
        return self._method.update(windows, origin)

    def _fail(self) -> Work[None]:
        """Fail if it has not done so."""
        yield 1
        if self._failures and self._time > FAILS_AT - 0.5:
            raise self._failures.pop()


class Contradicted(Failing):
    """A method that contradicts its model, with a cause, before it fails."""

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Contradict the model until it fails."""
        found = super().update(windows, origin)
        return [replace(each, status='inconsistent', causes=((CAUSE, 30.0),)) for each in found]


@pytest.mark.parametrize('kind', [Failing, FailingLater, Contradicted])
@pytest.mark.parametrize('failure', [np.linalg.LinAlgError('Singular matrix'), FloatingPointError('not positive')])
def test_a_run_that_cannot_be_solved_starts_again(failure: Exception, kind: type[Failing]) -> None:
    failures = [failure]

    def make(config: EstimatorConfig, kernel: MomentumKernel, known: KnownRobot | None) -> Estimator:
        return kind(make_estimator(config, kernel, known), failures)

    session = Session(build(EstimatorConfig, {'noise.joint_position': 1e-4}), urdf('servicer7'), make)
    estimates: list[Estimate] = []
    for timed in run('servicer7', MANY_SECONDS):
        add = session.add_joint_state if timed.topic == 'joint_states' else session.add_odometry
        if add(timed.message):
            estimates += session.process()
            session.run_slice()
    before = f'; likeliest before: {CAUSE}' if kind is Contradicted else ''
    reason = f'the equations could not be solved ({failure}){before}; started again'
    assert session.restarts == [reason]
    times = np.array([estimate.time for estimate in estimates])
    again = int(np.argmin(np.diff(times))) + 1
    assert times[again - 1] == pytest.approx(FAILS_AT, abs=0.6)
    assert times[-1] == pytest.approx(MANY_SECONDS - FAILS_AT, abs=1.1)
    assert not any(reason in estimate.warnings for estimate in estimates[:again])
    assert all(reason in estimate.warnings for estimate in estimates[again:])
    assert (estimates[-1].warnings[0] == reason) == (kind is Contradicted)  # a cause comes before what follows from it
    assert np.all(estimates[-1].identifiable)
