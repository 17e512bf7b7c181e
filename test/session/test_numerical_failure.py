"""Equations that cannot be solved, whatever the reason: the run starts again and says so."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.session import Session, make_estimator
from mbaid_ros.session.posterior import KnownRobot
from streams import run, urdf

FAILS_AT, SECONDS = 4.0, 12.0  # s


class Failing:
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
        return self._method.update(windows, origin)

    def work_off(self) -> bool:
        """Fail if it has not done so."""
        if self._failures and self._time > FAILS_AT - 0.5:
            raise self._failures.pop()
        return False


@pytest.mark.parametrize('kind', [Failing, FailingLater])
@pytest.mark.parametrize('failure', [np.linalg.LinAlgError('Singular matrix'), FloatingPointError('not positive')])
def test_a_run_that_cannot_be_solved_starts_again(failure: Exception, kind: type[Failing]) -> None:
    failures = [failure]

    def make(config: EstimatorConfig, kernel: MomentumKernel, known: KnownRobot | None) -> Estimator:
        return kind(make_estimator(config, kernel, known), failures)

    session = Session(build(EstimatorConfig, {'noise.joint_position': 1e-4}), urdf('servicer7'), make)
    estimates: list[Estimate] = []
    for timed in run('servicer7', SECONDS):
        add = session.add_joint_state if timed.topic == 'joint_states' else session.add_odometry
        if add(timed.message):
            estimates += session.process()
            session.work_off()
    reason = f'the equations could not be solved ({failure}); started again'
    assert session.restarts == [reason]
    times = np.array([estimate.time for estimate in estimates])
    again = int(np.argmin(np.diff(times))) + 1
    assert times[again - 1] == pytest.approx(FAILS_AT, abs=0.6)
    assert times[-1] == pytest.approx(SECONDS - FAILS_AT, abs=1.1)
    assert not any(reason in estimate.warnings for estimate in estimates[:again])
    assert all(reason in estimate.warnings for estimate in estimates[again:])
    assert np.all(estimates[-1].identifiable)
