"""Whether the stamps of messages fit the clock of this node: what is told when they do not."""

from __future__ import annotations

from collections.abc import Mapping

_SECOND = 1_000_000_000  # ns
_AHEAD = 1 * _SECOND  # more than transport and clocks kept in step by NTP explain
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
        elif ahead > _AHEAD:
            problems.append(
                f'stamps on {topic} are {ahead / _SECOND:.1f} s in the future: the clocks of the publisher and of this '
                'machine differ'
            )
    return problems
