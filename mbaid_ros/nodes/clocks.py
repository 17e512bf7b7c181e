"""Whether the stamps of messages fit the clock of this node: what is told when they do not."""

from __future__ import annotations

from collections.abc import Mapping
from time import monotonic
from typing import Any

from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.time_source import TimeSource

_SECOND = 1_000_000_000  # ns
_STAMP_AHEAD = 1 * _SECOND  # more than transport and clocks kept in step by NTP explain
_CALENDAR = 10 * 365 * 86_400 * _SECOND  # a clock that shows less has been started, not set


def clock_problems(now: int, readings: Mapping[str, tuple[int, int]], *, use_sim_time: bool) -> list[str]:
    """Return what is wrong with the clocks, one sentence each.

    Parameters
    ----------
    now : ns, of the node's clock
    readings : by topic, the stamp of a message and the node's clock when it arrived, ns
    use_sim_time : the node's parameter
    """
    if use_sim_time and now == 0:
        return ['use_sim_time is true, but nothing has come on /clock: publish it, or set use_sim_time to false']
    problems = []
    for topic, (stamp, arrival) in readings.items():
        ahead = stamp - arrival
        if stamp < _CALENDAR <= arrival and not use_sim_time:
            problems.append(
                f'stamps on {topic} are simulated time ({stamp / _SECOND:.0f} s), but use_sim_time is false: set it'
            )
        elif use_sim_time and arrival < _CALENDAR <= stamp:
            problems.append(
                f'use_sim_time is true, but stamps on {topic} are not simulated time: set it for their publisher, too'
            )
        elif ahead > _STAMP_AHEAD:
            problems.append(
                f'stamps on {topic} are {ahead / _SECOND:.1f} s in the future: the clocks of the publisher and of this '
                'machine differ'
            )
    return problems


STILL_AFTER = 2.0  # s without a later time
_CLOCK_AHEAD = 10.0  # s: a fast clock is ahead by less where a node that is busy misses some of it


class SimulatedClock:
    """Watches the clock of a node.

    Parameters
    ----------
    node : whose clock it is
    threshold : s, what it has to jump back by to be told
    """

    def __init__(self, node: Node, threshold: float) -> None:
        self._node = node
        self._clock: Any = node.get_clock()
        self._jumps: list[float] = []  # s, since the last look
        self._last = 0, monotonic()  # ns, and when it came
        ahead, back = Duration(seconds=max(threshold, _CLOCK_AHEAD)), Duration(seconds=-threshold)
        limits = JumpThreshold(min_forward=ahead, min_backward=back, on_clock_change=False)
        self._handle: Any = self._clock.create_jump_callback(limits, post_callback=self._on_jump)

    def problems(self) -> list[str]:
        """Return what it has done since the last call that a clock does not do, one sentence each."""
        told = []
        if self._jumps:
            jumps, self._jumps = self._jumps, []
            told.append(f'/clock jumped {len(jumps)} times since the last report, the last time by {jumps[-1]:.6g} s')
        now, seen = self._clock.now().nanoseconds, monotonic()
        if now != self._last[0]:
            self._last = now, seen
        elif now and seen - self._last[1] > STILL_AFTER and self._node.get_parameter('use_sim_time').value:
            told.append(f'/clock stands still: for {seen - self._last[1]:.0f} s it has been {now * 1e-9:.6g} s')
        return told

    def close(self) -> None:
        """Watch no more."""
        self._handle.unregister()

    def _on_jump(self, jump: TimeJump) -> None:
        amount = jump.delta.nanoseconds
        if self._clock.now().nanoseconds != amount:  # the first time is no jump from 0
            self._jumps.append(amount * 1e-9)


def refuse_negative_times() -> None:
    """Let the nodes of this process go on where a time on /clock is negative: rclpy ends them."""
    take = TimeSource.clock_callback
    log: Any = get_logger('clock')

    def take_unless_negative(source: TimeSource, message: Any) -> None:
        if message.clock.sec < 0:
            text = f'a time on /clock is negative, {message.clock.sec} s: it is not taken'
            log.warning(text, once=True)
        else:
            take(source, message)

    TimeSource.clock_callback = take_unless_negative  # type: ignore[method-assign, assignment]
