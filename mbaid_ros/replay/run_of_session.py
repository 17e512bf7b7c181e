"""The estimates of a session and its result, wherever its messages come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.capture import Capture
from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.target import Debris
from mbaid_ros.estimate_messages import Frames
from mbaid_ros.parameters import values_of
from mbaid_ros.replay.whole_run import History, Run, TopicStatistics
from mbaid_ros.session.explanation import missing_joints, sensor_rows
from mbaid_ros.session.model_summary import ModelSummary
from mbaid_ros.session.session import Session


class Writer(Protocol):
    """Takes every estimate of a run as it comes."""

    def write(
        self, estimate: Estimate, frames: Frames, alone: Debris | None = None, capture: Capture | None = None
    ) -> None:
        """Write an estimate."""


class Kept:
    """The estimates of a run; a repair starts the run again, and a writer gets those of new windows as a node would.

    Parameters
    ----------
    config : parameters as the user gave them
    """

    def __init__(self, session: Session, config: EstimatorConfig, writer: Writer | None = None) -> None:
        self._session, self._config, self._writer = session, config, writer
        self._repairs, self._restarted, self._written = 0, 0, -1
        self._history = History()  # since the run was started last

    def add(self, estimates: Sequence[Estimate]) -> None:
        """Add the next estimates."""
        session = self._session
        if session.restarted != self._restarted:  # stamps may have jumped back
            self._restarted, self._repairs, self._written = session.restarted, len(session.repairs), -1
        elif len(session.repairs) != self._repairs:
            self._history, self._repairs = History(), len(session.repairs)
        for estimate in estimates:
            self._history.add(estimate)
            if self._writer and (not session.repairs or estimate.stamp > self._written):
                self._written = estimate.stamp
                robot = session.robot_of(estimate)
                self._writer.write(
                    estimate, session.frames_of(estimate), robot.debris(estimate), robot.captured(estimate)
                )

    def run(
        self,
        name: str,
        topics: tuple[TopicStatistics, ...],
        model_summary: ModelSummary,
        warnings: tuple[str, ...],
    ) -> Run:
        """Return the result of a session that has finished; `name` is that of its data."""
        session, history = self._session, self._history
        last = history.last
        final = last or Estimate(method=session.config.method, status='waiting')
        posterior, robot = session.posterior(), session.robot_of(final)
        return Run(
            bag=name,
            target_link=robot.target_link,
            final=final,
            history=history.entries(),
            topics=topics,
            used=session.used,
            dropped=dict(session.dropped),
            missing_joints=missing_joints(session),
            model_summary=model_summary,
            warnings=warnings,
            urdf=robot.urdf,
            settings=values_of(self._config),
            debris=robot.debris(last) if last else None,
            phase=robot.phase,
            capture=robot.captured(last) if last else None,
            posterior=posterior,
            sensors=sensor_rows(session, last),
            advice='' if posterior is None or final.contradicted else _advice(session.config, posterior),
        )


def _advice(config: EstimatorConfig, posterior: Posterior) -> str:
    """Return the motion that would help most."""
    from mbaid_ros.session.planning import advice  # noqa: PLC0415 - takes a while, and many a run ends without it

    return advice(config, posterior)
