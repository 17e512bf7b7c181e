"""The executable `watch`: the estimate in a terminal, as it converges."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Sequence
from time import monotonic
from typing import TextIO

from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.subscription import Subscription

from mbaid_ros.cli import one_line, run
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.nodes.arguments import watch_arguments
from mbaid_ros.nodes.qos import qos
from mbaid_ros.nodes.runner import own_arguments, ros, spin
from mbaid_ros.nodes.terminal import ESTIMATE, NEXT, drawn, line, screen

NAME = 'watch'
TYPE = 'mbaid_msgs/msg/InertiaEstimate'
_PERIOD = 0.2  # s, between two looks at the graph for an estimator
_PATIENCE = 5.0  # s without one, after which it is said what may be wrong
_DEBRIS = '/debris'  # the end of a topic that is shown only if it is asked for


class WatchNode(Node):
    """Finds an estimator and shows what it says.

    Parameters
    ----------
    wanted : name of an estimator or of its topic; empty for the first one that is found
    show : called with the message, the topic, and what motion would help most, in words
    hint : called with what a user should know about the graph
    context : rclpy's, its own one where not given
    """

    def __init__(
        self,
        wanted: str,
        show: Callable[[InertiaEstimate, str, str], None],
        hint: Callable[[str], None],
        context: Context | None = None,
    ) -> None:
        super().__init__(f'{NAME}_{os.getpid()}', context=context, start_parameter_services=False)
        self._wanted = wanted
        self._show = show
        self._hint = hint
        self._begin = monotonic()
        self._hinted = False
        self._subscription: Subscription | None = None
        self.seen = 0
        self._advice = ''
        self.create_timer(_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        """Subscribe once there is something to subscribe to."""
        if self._subscription is not None:
            return
        found = sorted(name for name, types in self.get_topic_names_and_types() if TYPE in types)
        estimates = [name for name in found if not name.endswith(_DEBRIS)]
        topic = next((name for name in (found if self._wanted else estimates) if self._fits(name)), None)
        if topic is None:
            self._hint_at(found)
            return
        if not self._wanted and len(estimates) > 1:
            self._hint(f'{len(estimates)} estimators: {listing(estimates)}; shown is {topic}, NAME chooses another')

        def take(message: InertiaEstimate) -> None:
            self.seen += 1
            self._show(message, topic, self._advice)

        status = f'{topic.rpartition("/")[0].lstrip("/")}: {ESTIMATE}'

        def advise(array: DiagnosticArray) -> None:
            for each in array.status:
                if each.name == status:
                    self._advice = next((pair.value for pair in each.values if pair.key == NEXT), '')

        self._subscription = self.create_subscription(InertiaEstimate, topic, take, qos(100, latched=True))
        self.create_subscription(DiagnosticArray, '/diagnostics', advise, qos(10))

    def _fits(self, topic: str) -> bool:
        absolute = '/' + self._wanted.strip('/')
        return not self._wanted or topic in {absolute, f'{absolute}/estimate'}

    def _hint_at(self, found: Sequence[str]) -> None:
        """Say once, after a while, why there may be nothing to show."""
        if self._hinted or monotonic() - self._begin < _PATIENCE:
            return
        self._hinted = True
        if found:
            self._hint(f"no '{self._wanted}' yet; there is {listing(found)}")
        else:
            domain = os.environ.get('ROS_DOMAIN_ID', '0')
            self._hint(
                f'no estimator in ROS_DOMAIN_ID {domain} yet; start one (ros2 run mbaid_ros estimator), or set the '
                'domain and ROS_AUTOMATIC_DISCOVERY_RANGE that it has'
            )


class Screen:
    """Shows each estimate in place of the last one.

    Parameters
    ----------
    stream : a terminal
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._sign = sign_for(stream)
        self._begun = False

    def __call__(self, message: InertiaEstimate, topic: str, advice: str = '') -> None:
        """Show a message."""
        size = shutil.get_terminal_size((80, 24))
        begin = '' if self._begun else '\x1b[2J'
        self._begun = True
        self._stream.write(begin + drawn(screen(message, topic, size.columns, self._sign, advice), size.lines))
        self._stream.flush()


class Lines:
    """Writes each estimate as a line.

    Parameters
    ----------
    stream : a file or pipe
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._sign = sign_for(stream)

    def __call__(self, message: InertiaEstimate, _topic: str, advice: str = '') -> None:
        """Write a message."""
        encoding = self._stream.encoding or 'ascii'
        text = line(message, self._sign, advice).encode(encoding, 'backslashreplace').decode(encoding)
        self._stream.write(text + '\n')
        self._stream.flush()


def sign_for(stream: TextIO) -> str:
    """Return plus-minus as a stream can take it."""
    sign = '\N{PLUS-MINUS SIGN}'
    try:
        sign.encode(stream.encoding or 'ascii')
    except (UnicodeEncodeError, LookupError):
        return '+-'
    return sign


def _hint(text: str) -> None:
    print(f'mbaid_ros {NAME}: {one_line(text)}', file=sys.stderr, flush=True)


def _main(argv: list[str]) -> int:
    arguments = watch_arguments().parse(own_arguments(argv))
    wanted = arguments.estimator
    if wanted and not all(part.isidentifier() and part.isascii() for part in wanted.strip('/').split('/')):
        raise ParameterError(f"estimator '{wanted}' is not accepted; accepted: a node or topic, as /servicer/estimator")
    on_terminal = sys.stdout.isatty() and os.environ.get('TERM', 'dumb') != 'dumb' and not arguments.once
    with ros(argv) as interrupt:
        node = WatchNode(wanted, Screen(sys.stdout) if on_terminal else Lines(sys.stdout), _hint)
        if sys.stdout.isatty():
            print(f'waiting for {wanted or "an estimator"} ...', flush=True)
        spin(node, lambda: interrupt.requested or (arguments.once and node.seen))
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run `watch` and return its exit code."""
    return run(_main, argv, name=NAME)


if __name__ == '__main__':
    sys.exit(main())
