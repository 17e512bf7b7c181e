"""Services of the estimator, called in a loop while both topics come at 1 kHz."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from std_srvs.srv import SetBool, Trigger
from tqdm import tqdm

import benchmarks
from attack.victim import Victim
from benchmarks.pages import table
from benchmarks.speed_bag import ROBOT, make_bag
from streams import urdf

RATE = 1000.0  # Hz, of each topic
SECONDS = 120.0  # of the flow
PARAMETERS = ('capture.time:=5.0',)  # of the node, so that a capture can be told: a later one
SPREAD = 0.9  # part of it, over which the calls are spread
_PUBLISHER = Path(benchmarks.__path__[0]) / 'speed_publisher.py'


@dataclass(frozen=True)
class Call:
    """A call of a service.

    Attributes
    ----------
    service : its name, without the node's
    kind : its type
    request : by the number of the call
    share : of the calls that are drawn; reset and capture seldom enough that there is an estimate to plan from
    """

    service: str
    kind: Any
    request: Callable[[int], Any]
    share: float


def _set(number: int) -> Any:
    """Return a request that sets what may change at run time, and back with an odd number."""
    value = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=number % 2 == 0)
    return SetParameters.Request(parameters=[Parameter(name='publish_tf', value=value)])


def _trigger(_number: int) -> Any:
    return Trigger.Request()


_CALLS = {
    'reset': Call('reset', Trigger, _trigger, 0.007),
    'capture': Call('capture', Trigger, _trigger, 0.023),
    'pause (on)': Call('pause', SetBool, lambda _: SetBool.Request(data=True), 0.2),
    'pause (off)': Call('pause', SetBool, lambda _: SetBool.Request(data=False), 0.0),  # the next after each on
    'plan': Call('plan', Trigger, _trigger, 0.27),
    'set_parameters': Call('set_parameters', SetParameters, _set, 0.25),
    'get_parameters': Call('get_parameters', GetParameters, lambda _: GetParameters.Request(names=['method']), 0.25),
}


@dataclass
class Calls:
    """What came of calls.

    Attributes
    ----------
    latencies : s, by service
    granted : of how many the answer was yes
    within : how many were made while messages flowed
    before, after : MB, resident memory
    messages, lost : on both topics
    """

    latencies: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in _CALLS})
    granted: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_CALLS, 0))
    within: int = 0
    before: float = 0.0
    after: float = 0.0
    messages: int = 0
    lost: int = 0

    def __str__(self) -> str:
        """Return the table of the page, and what else there was."""
        every = [latency for latencies in self.latencies.values() for latency in latencies]
        rows = [_row(name, taken, str(self.granted[name])) for name, taken in self.latencies.items() if taken]
        rows.append(['all', *_row('', every, '-')[1:]])
        told = (
            f'{self.within} of {len(every)} calls were made while messages came, of {self.messages} messages '
            f'{self.lost} were lost; resident memory was {self.before:.0f} MB before, {self.after:.0f} MB after.'
        )
        header = ['service', 'calls', 'granted', 'median, ms', 'p99, ms', 'slowest, ms']
        return f'{table(header, rows)}\n\n{told}'


def _row(name: str, taken: list[float], granted: str) -> list[str]:
    times = (np.median(taken), np.quantile(taken, 0.99), np.max(taken))
    service, _, how = name.partition(' ')
    return [f'`~/{service}` {how}'.strip(), str(len(taken)), granted, *(f'{1e3 * time:.1f}' for time in times)]


def calls(victim: Victim, folder: Path, count: int, generator: np.random.Generator) -> Calls:
    """Return what came of so many calls while a robot's messages come at 1 kHz."""
    make_bag(folder / 'flow', SECONDS / 60.0, RATE)
    victim.describe(urdf(ROBOT))
    for name in _CALLS:
        _ask(victim, name, 1)  # finds the service
    victim.drained()
    victim.reset()
    found, received = Calls(before=victim.memory()), victim.received()
    command = [sys.executable, str(_PUBLISHER), str(folder / 'flow'), f'{RATE:g}']
    names = _drawn(count, generator)
    with ExitStack() as stack:
        pipe = subprocess.PIPE
        source = stack.enter_context(
            subprocess.Popen(command, env=victim.graph.environment, stdin=pipe, stdout=pipe, text=True)
        )
        stack.callback(source.kill)  # its graph must not outlive this one
        assert source.stdin, 'it is asked for'
        assert source.stdout, 'it is asked for'
        if source.stdout.readline() != 'ready\n':
            raise AssertionError('the publisher has ended')
        _say(source)
        begin = time.monotonic()
        for number, name in enumerate(tqdm(names, unit=' calls', disable=None, leave=False)):
            time.sleep(max(0.0, begin + number * SPREAD * SECONDS / count - time.monotonic()))
            at = time.monotonic()
            found.within += at < begin + SECONDS
            found.granted[name] += _ask(victim, name, number)
            found.latencies[name].append(time.monotonic() - at)
        found.messages = 2 * int(source.stdout.readline() or 0)
        for name in ('pause (off)', 'set_parameters'):
            _ask(victim, name, 1)  # as it was
        victim.drained()
        _say(source)
    found.lost = found.messages - (victim.received() - received)
    found.after = victim.memory()
    return found


def _ask(victim: Victim, name: str, number: int) -> bool:
    """Make a call, and return whether the answer was yes."""
    call = _CALLS[name]
    answer = victim.graph.call(f'/estimator/{call.service}', call.kind, call.request(number))
    if call.kind is GetParameters:
        return len(answer.values) == 1
    return bool(answer.results[0].successful if call.kind is SetParameters else answer.success)


def _drawn(count: int, generator: np.random.Generator) -> list[str]:
    """Return the names of so many calls."""
    names: list[str] = []
    while len(names) < count:
        names.append(str(generator.choice(list(_CALLS), p=[call.share for call in _CALLS.values()])))
        if names[-1] == 'pause (on)':
            names.append('pause (off)')
    return names[:count]


def _say(process: subprocess.Popen[str]) -> None:
    """Give the publisher the line that it waits for."""
    if process.stdin:
        process.stdin.write('\n')
        process.stdin.flush()
