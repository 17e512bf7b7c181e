"""When a run that contradicts its model is started again with a repair of the leading cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.repair import Conversion, Repair, Setting, leading_repair
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.urdf import scale_inertials, scale_lengths, with_inertias
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build, values_of

# Windows in a row that contradict the model before a repair: an impulse or a search for a start contradicts for less.
_PERSISTENT = 16
# The same, where several causes explain the data as well: more windows may distinguish them.
_AMBIGUOUS = 32
MOST = 3  # repairs of a run, one after the other
LEFT_OUT = 'left out by a repair'  # a named sensor
LONGEST = 300.0  # s of a run, whose messages are kept so that it can be started again
_CALIBRATED = ('known_links.', 'known_joints.', 'odometry_mount.')  # which a calibration file replaces


def refuse_repair(config: EstimatorConfig) -> None:
    """Raise a ParameterError if the parameters ask for repairs in a run that has none."""
    for obstacle in obstacles(values_of(config)) if config.repair else ():
        raise ParameterError(f"parameter 'repair' is true, and {obstacle}")


def obstacles(settings: Mapping[str, Setting]) -> list[str]:
    """Return why a run of these parameters has no repairs; empty where it may have them."""
    before = settings['capture.phase'] != 'post_capture' or settings['capture.time'] != 0.0
    found = {
        f'method is {settings["method"]}; accepted: trajectory': settings['method'] != 'trajectory',
        'the run begins before the capture; accepted: capture.phase post_capture': before,
    }
    return [text for text, present in found.items() if present]


def admitted(repair: Repair, settings: Mapping[str, Setting]) -> Repair | None:
    """Return the part of a repair that a run of these parameters lacks, and can take; None where there is none."""
    found = repair.beyond(settings)
    names = () if found is None else found.parameters or ()
    if settings['known_links.calibration'] and any(name.startswith(_CALIBRATED) for name in names):
        return None
    return found


def repaired(config: EstimatorConfig, repairs: Sequence[Repair]) -> EstimatorConfig:
    """Return the parameters with those of repairs."""
    values: dict[str, object] = dict(values_of(config))
    for each in repairs:
        values |= each.parameters or {}
    return build(EstimatorConfig, values)


def conversions(repairs: Sequence[Repair]) -> tuple[Conversion, ...]:
    """Return the conversions of readings by repairs, in order."""
    return tuple(each.conversion for each in repairs if each.conversion is not None)


def described(urdf: str, repairs: Sequence[Repair]) -> str:
    """Return a robot description as repairs convert it."""
    for each in conversions(repairs):
        urdf = scale_inertials(urdf, each.masses) if each.masses else urdf
        urdf = scale_lengths(urdf, each.lengths) if each.lengths != 1.0 else urdf
        urdf = with_inertias(urdf, each.inertias) if each.inertias != 'as read' else urdf
    return urdf


class RepairPolicy:
    """Follows the estimates of a run window by window, and decides when it is started again, and how.

    The decision depends on the windows alone, not on how their messages were handed over: live equals replay.
    """

    def __init__(self) -> None:
        self._contradicted = 0  # windows in a row
        self.over = False  # whether the run is too long to be started again

    def repair(self, estimate: Estimate, config: EstimatorConfig, taken: Sequence[Repair]) -> Repair | None:
        """Return how to start the run again after the next estimate; None where it goes on.

        Parameters
        ----------
        config : of the run, with the repairs `taken`
        """
        self._contradicted = self._contradicted + 1 if estimate.contradicted else 0
        self.over = self.over or estimate.time > LONGEST
        if self.over or len(taken) == MOST or self._contradicted < _PERSISTENT:
            return None
        found = leading_repair(estimate.causes, estimate.remedies, several=self._contradicted >= _AMBIGUOUS)
        found = None if found is None else admitted(found, values_of(config))
        if found is None or any(found.conversion == each.conversion is not None for each in taken):
            return None
        return found
