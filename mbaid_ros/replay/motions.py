"""The motions in a bag, as the windows that a calibration takes."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.bags import BagReader, Recorded
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import Samples
from mbaid_ros.replay.feed import Progress, feed
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.session import Session, intake_warnings


@dataclass(frozen=True)
class BagMotions:
    """What a bag holds.

    Attributes
    ----------
    bag : path as the user gave it
    runs : motions, each as windows; stamps that jump back begin another one
    warnings : of bag, intake and data, one line each
    heard : joints that the messages name
    """

    bag: str
    runs: tuple[list[Samples], ...]
    warnings: tuple[str, ...]
    heard: tuple[str, ...] = ()


class _Collector:
    """A method that keeps the windows, and says nothing of any body."""

    method = 'calibration'
    needs_rates = False

    def __init__(self) -> None:
        self.windows: list[Samples] = []

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows; the estimates without numbers are there to carry the notes on the data."""
        self.windows += windows
        last = float(windows[-1].time[-1])
        return [Estimate(self.method, 'estimating', time=last, stamp=origin + round(last * 1e9))]


def read_motions(
    path: str,
    config: EstimatorConfig,
    urdf: str,
    inputs: Inputs,
    progress: Progress,
) -> BagMotions:
    """Return the motions in a bag, through the same intake as an estimator's.

    Parameters
    ----------
    path : the bag
    config : the estimator's parameters
    urdf : text of the robot description
    inputs : the topics to read
    progress : Progress

    Raises
    ------
    DataError
        The bag cannot be read, or lacks a topic.
    ModelError, ParameterError
        The robot or the parameters cannot be used.
    """
    collectors: list[_Collector] = []

    def collect(*_given: object) -> Estimator:
        collectors.append(_Collector())
        return collectors[-1]

    session = Session(config, urdf, collect)

    notes: tuple[str, ...] = ()
    with BagReader(path) as bag:
        own = inputs.found(bag)

        def add(messages: Recorded) -> None:
            own.add_to(session, messages)

        for _ in feed(bag, own, add, progress):
            notes = _noted(session.process(), notes)
        warnings = (*bag.warnings, *notes, *intake_warnings(session))
    runs = tuple(collector.windows for collector in collectors if collector.windows)
    return BagMotions(path, runs, tuple(dict.fromkeys(warnings)), tuple(session.intake.joint_reader.heard))


def _noted(estimates: list[Estimate], notes: tuple[str, ...]) -> tuple[str, ...]:
    return estimates[-1].warnings if estimates else notes
