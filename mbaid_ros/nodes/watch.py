"""An estimate as text: a screen that is as wide as the terminal, or one line. Only printable characters get through."""

from __future__ import annotations

import argparse
import math
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Sequence
from io import TextIOWrapper
from time import monotonic
from typing import Any, cast

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.subscription import Subscription

from mbaid_ros.cli import one_line
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import MAIN_CAUSES, PARAMETERS, UNITS, ErrorBudget, rounded
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.estimate_messages import parameters_of
from mbaid_ros.nodes.runner import Interrupt, NoParameters, declare_parameters, spin
from mbaid_ros.nodes.subscriptions import qos

NARROWEST = 20  # columns
ESTIMATE, NEXT = 'estimate', 'next'  # a status of /diagnostics, and its key of the most informative motion
_DECADES = 3.0  # an empty bar is a relative standard deviation of 100 %, a full one 0.1 %
_COLUMNS_WITHOUT_BAR = 36
_SIGN = '\N{PLUS-MINUS SIGN}'


def screen(message: Any, topic: str, width: int, advice: str = '') -> list[str]:
    """Return an estimate as lines of at most `width` columns.

    Parameters
    ----------
    message : mbaid_msgs/InertiaEstimate
    topic, width : its topic; columns of the terminal
    advice : the most informative motion, in words
    """
    values, stds = numbers(message)
    lines = [
        one_line(topic),
        f'{_status(message)}: {one_line(message.header.frame_id)}',
        f'{_span(message):.1f} s, {message.samples} samples, {_method(message)}',
        f'{"":16} {_SIGN}95 %',
    ]
    progress = certainty(values, stds)
    for name, unit, value, std, share in zip(PARAMETERS, UNITS, values, stds, progress, strict=True):
        lines.append(_row(name, unit, (value, std), share, width))
    lines += ['', _momentum('P', 'N s', message.linear_momentum), _momentum('L', 'N m s', message.angular_momentum)]
    if math.isfinite(message.residual):
        lines.append(f'residual {message.residual:.2f} (1 is as expected)')
    if mostly := budget(message):
        lines += textwrap.wrap(f'{MAIN_CAUSES}: {mostly}', max(width, NARROWEST), subsequent_indent='  ')
    for repair in message.repairs:
        lines += textwrap.wrap(f'* {one_line(repair)}', max(width, NARROWEST), subsequent_indent='  ')
    if advice:
        lines += textwrap.wrap(f'{NEXT}: {one_line(advice)}', max(width, NARROWEST), subsequent_indent='  ')
    for warning in (each for each in message.warnings if each not in message.repairs):
        lines += textwrap.wrap(f'! {one_line(warning)}', max(width, NARROWEST), subsequent_indent='  ')
    return [line[:width].rstrip() for line in lines]


def line(message: Any, advice: str = '') -> str:
    """Return an estimate as one line."""
    values, stds = numbers(message)
    parts = [f'{_span(message):.1f} s', _status(message)]
    for name, unit, value, std in zip(PARAMETERS, UNITS, values, stds, strict=True):
        shown, band = rounded(value, std)
        if shown:
            parts.append(f'{name} {shown}{f" {_SIGN}{band}" if band else ""} {unit}')
    if mostly := budget(message):
        parts.append(f'{MAIN_CAUSES}: {mostly}')
    parts += message.repairs
    if advice:
        parts.append(f'{NEXT}: {advice}')
    if warnings := [each for each in message.warnings if each not in message.repairs]:
        parts.append('! ' + '; '.join(warnings))
    return one_line(', '.join(parts))


def numbers(message: Any) -> tuple[Array, Array]:
    """Return the ten parameters of a message and their standard deviations; NaN where not known."""
    values, stds = parameters_of(message), np.asarray(message.standard_deviation, dtype=float)
    return values, np.where(np.isnan(values), np.nan, stds)


def budget(message: Any) -> str:
    """Return the main causes of the variances, in a few words; empty if the message has none."""
    causes, shares = tuple(message.budget_causes), np.asarray(message.budget_shares, dtype=float)
    if not causes or len(shares) != len(PARAMETERS) * len(causes):
        return ''
    return one_line(ErrorBudget(causes, shares.reshape(len(PARAMETERS), -1)).main_causes(numbers(message)[1]))


def certainty(values: Array, stds: Array) -> Array:
    """Return the progress of each parameter, 0 to 1, by its standard deviation on a logarithmic scale.

    The mass counts relative to itself, the CoM to a metre, the inertia to its largest moment.
    """
    moments = np.abs(values[[4, 7, 9]])
    largest = float(np.nanmax(moments)) if np.any(np.isfinite(moments)) else 1.0
    sizes = np.array([abs(values[0]), *[1.0] * 3, *[largest] * 6])
    with np.errstate(divide='ignore', invalid='ignore'):
        share = -np.log10(stds / sizes) / _DECADES
    return np.nan_to_num(np.clip(share, 0.0, 1.0), nan=0.0)


def _row(name: str, unit: str, number: tuple[float, float], share: float, width: int) -> str:
    value, band = rounded(*number)
    if not value:
        return f'{name:<5} {"-":>10}'
    spread = f'{_SIGN}{band}' if band else ''
    text = f'{name:<5} {value:>10} {spread:<9} {unit:<6}'
    room = min(width - _COLUMNS_WITHOUT_BAR, 30)
    if room < 3 or not spread:
        return text
    filled = round(share * room)
    return f'{text} [{"#" * filled}{"." * (room - filled)}]'


def _momentum(symbol: str, unit: str, vector: Any) -> str:
    shown = ' '.join(f'{value:.4g}' if math.isfinite(value) else '-' for value in (vector.x, vector.y, vector.z))
    return f'{symbol} {shown} {unit}'


def _status(message: Any) -> str:
    stale = ' (stale)' if message.stale else ''
    return one_line(message.status).replace('_', ' ') + stale


def _method(message: Any) -> str:
    stage = '' if message.stage in {'', message.method} else f' (stage {message.stage})'
    return one_line(f'{message.method}{stage}')


def _span(message: Any) -> float:
    return float(message.span.sec) + 1e-9 * float(message.span.nanosec)


def drawn(lines: Sequence[str], height: int) -> str:
    """Return lines with the control sequences that replace the last ones, without colour and without flicker."""
    shown = list(lines[: max(height - 1, 1)])
    return '\x1b[H' + ''.join(f'{text}\x1b[K\n' for text in shown) + '\x1b[J'


NAME = 'watch'
TYPE = 'mbaid_msgs/msg/InertiaEstimate'
_PERIOD = 0.2  # s, between two looks at the graph for an estimator
_PATIENCE = 5.0  # s without one, after which a hint follows
_DEBRIS = '/debris'  # the end of a topic that is shown only if it is asked for


class WatchNode(Node):
    """Finds an estimator and shows its estimates.

    Parameters
    ----------
    wanted : name of an estimator or of its topic; empty for the first one that is found
    show : called with the message, the topic, and the most informative motion in words
    hint : called with hints about the graph
    context : rclpy's default one where not given
    """

    def __init__(
        self,
        wanted: str,
        show: Callable[[InertiaEstimate, str, str], None],
        hint: Callable[[str], None],
        context: Context | None = None,
    ) -> None:
        super().__init__(f'{NAME}_{os.getpid()}', context=context, start_parameter_services=False)
        declare_parameters(self, NoParameters)
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
            self._hint(f'{len(estimates)} estimators: {listing(estimates)}; showing {topic}, NAME selects another')

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
        """Hint once, after a while, at why there may be nothing to show."""
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


def show_screen(message: InertiaEstimate, topic: str, advice: str) -> None:
    """Show an estimate on a terminal in place of the last one."""
    size = shutil.get_terminal_size((80, 24))
    print(drawn(screen(message, topic, size.columns, advice), size.lines), end='', flush=True)


def show_line(message: InertiaEstimate, _topic: str, advice: str) -> None:
    """Write an estimate as a line to a file or pipe."""
    print(line(message, advice), flush=True)


def _hint(text: str) -> None:
    print(f'mbaid_ros {NAME}: {one_line(text)}', file=sys.stderr, flush=True)


def main(arguments: argparse.Namespace, interrupt: Interrupt) -> int:
    """Run the node until it is interrupted, and return the exit code; `mbaid_ros.nodes.start` calls it within ROS."""
    wanted = arguments.estimator
    if wanted and not all(part.isidentifier() and part.isascii() for part in wanted.strip('/').split('/')):
        raise ParameterError(f"estimator '{wanted}' is not accepted; accepted: a node or topic, as /servicer/estimator")
    # A stream that cannot take the sign shows its code.
    cast('TextIOWrapper', sys.stdout).reconfigure(errors='backslashreplace')
    on_terminal = sys.stdout.isatty() and os.environ.get('TERM', 'dumb') != 'dumb' and not arguments.once
    node = WatchNode(wanted, show_screen if on_terminal else show_line, _hint)
    if sys.stdout.isatty():
        print(f'waiting for {wanted or "an estimator"} ...', flush=True)
    spin(node, lambda: interrupt.requested or (arguments.once and node.seen))
    return 0
