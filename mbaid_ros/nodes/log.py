"""What the estimator says in its terminal: the robot, what it waits for, and how the estimate comes along."""

from __future__ import annotations

import re
from collections.abc import Sequence
from time import monotonic
from typing import Any

from mbaid_ros.cli import one_line
from mbaid_ros.core.errors import listing
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS, UNITS, rounded
from mbaid_ros.nodes.watch import NEXT
from mbaid_ros.session import Survey

PATIENCE = 5.0  # s without what is needed, or of a motion that says too little, after which that is told
_NUMBER = re.compile(r'\b\d+(\.\d+)?\b')
_ALARMING = {'inconsistent', 'not_identifiable'}


class RunLog:
    """Tells each thing once.

    Parameters
    ----------
    log : the node's logger
    """

    def __init__(self, log: Any) -> None:
        self._log = log
        self._warned: set[str] = set()
        self.begin()

    def begin(self, *, warned: bool = False) -> None:
        """Begin anew: what depends on data may be told again, warnings only if these are to be forgotten."""
        if not warned:
            self._warned.clear()
        self._since = monotonic()
        self._told_of_waiting = False
        self._status = ''
        self._told_of_joints = False
        self._advised: set[str] = {''}

    def robot(self, survey: Survey, method: str) -> None:
        """Tell what the robot description was taken for."""
        for line in (*survey.lines, f'method {method}'):
            self._log.info(one_line(line))
        for warning in survey.warnings:
            self._log.warning(one_line(warning))

    def joints(self, survey: Survey) -> None:
        """Tell, once messages have come, which joints only they or only the robot description have."""
        if self._told_of_joints:
            return
        self._told_of_joints = True
        if survey.foreign:
            foreign = listing(survey.foreign)
            self._log.info(one_line(f'joints of the messages that the robot description lacks: {foreign}'))

    def waiting(self, awaited: Sequence[str]) -> None:
        """Tell what is waited for, once, when that has taken a while; call it regularly."""
        if awaited and not self._told_of_waiting and monotonic() - self._since > PATIENCE:
            self._told_of_waiting = True
            for each in awaited:
                self._log.warning(one_line(f'waiting for {each}'))

    def estimate(self, estimate: Estimate) -> None:
        """Tell of an estimate where it is the first one, or its status is another than the last one's."""
        self._log.debug(
            f'window to {estimate.time:.3f} s: {estimate.status}, {estimate.samples} samples, residual '
            f'{estimate.residual:.3g}, {_method(estimate)}'
        )
        if estimate.status in {'waiting', self._status} or _too_early(estimate):
            return
        first, self._status = not self._status, estimate.status
        lead = 'first estimate, ' if first else ''
        text = one_line(f'{lead}{estimate.status.replace("_", " ")} after {estimate.time:.1f} s: {headline(estimate)}')
        # One call a level: rclpy holds a place in the code to the level that it had there first.
        if estimate.status in _ALARMING:
            self._log.warning(text)
        else:
            self._log.info(text)

    def warn_once(self, text: str) -> None:
        """Log a warning, unless it differs from an earlier one in its numbers alone."""
        key = _NUMBER.sub('#', text)
        if key not in self._warned:
            self._warned.add(key)
            self._log.warning(one_line(text))

    def advice(self, text: str) -> None:
        """Tell what motion would help most, once for each joint and parameter."""
        key = _NUMBER.sub('#', text)
        if key not in self._advised:
            self._advised.add(key)
            self._log.info(one_line(f'{NEXT}: {text}'))

    def event(self, text: str) -> None:
        """Tell what somebody has asked for: a reset, a pause, a capture."""
        self._log.info(one_line(text))


def _too_early(estimate: Estimate) -> bool:
    """Whether it is of the first seconds of a motion, which hardly ever determine anything: no reason for alarm yet."""
    return estimate.status == 'not_identifiable' and estimate.time < PATIENCE and not estimate.contradicted


def headline(estimate: Estimate) -> str:
    """Return mass and centre of mass with their 95 % bands, the residual, and why not, in a line."""
    parts = []
    for index in range(4):
        value, band = rounded(float(estimate.parameters[index]), float(estimate.std[index]))
        if value:
            parts.append(f'{PARAMETERS[index]} {value}{f" ± {band}" if band else ""} {UNITS[index]}')
    if any('±' in part for part in parts):
        parts.append('± 95 %')
    parts.append(f'residual {estimate.residual:.2g}')
    parts.append(_method(estimate))
    if estimate.likely_causes:
        parts.append(f'likely cause: {estimate.likely_causes[0][0]}')
    elif estimate.status in _ALARMING and estimate.warnings:
        parts.append(estimate.warnings[0])
    return ', '.join(parts)


def _method(estimate: Estimate) -> str:
    return estimate.method if estimate.stage in {'', estimate.method} else f'stage {estimate.stage}'
