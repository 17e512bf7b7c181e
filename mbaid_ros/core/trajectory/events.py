"""What has happened in a run, as events: forces, jumps of the momentum, a target that has changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.causes import PULSE, SYMPTOM, changed_by, constant_force
from mbaid_ros.core.results.estimate import Event
from mbaid_ros.core.trajectory.filter.bank import Track
from mbaid_ros.core.trajectory.filter.belief import Moments
from mbaid_ros.core.trajectory.state import BODY, MOMENTUM
from mbaid_ros.core.verdict.judgement import MOST_JUMPS

_NOTHING = 1e-6  # chance that noise looks like a constant force as large: of one that is less sure nothing is told
_KNOWN = 0.1  # relative standard deviation of a mass, up to which its centre is a quotient that can be compared


@dataclass(frozen=True, eq=False)
class ChangedTarget:
    """A target that has changed in a run.

    Attributes
    ----------
    time : s since the first sample
    text : what has happened, in words
    exchanged : whether it is another body, not the same elsewhere
    before : state until then; None where it was not known
    """

    time: float
    text: str
    exchanged: bool
    before: Moments | None

    def event(self, after: Moments | None) -> Event:
        """Return it as an event, with how much mass and centre of mass have changed, where that is known now."""
        text = self.text
        if self.before is not None and after is not None and _known(self.before) and _known(after):
            then, now = self.before.mean[BODY], after.mean[BODY]
            heavier = float(now[0] - then[0]) if self.exchanged else None
            text = changed_by(text, heavier, now[1:4] / now[0] - then[1:4] / then[0])
        return Event(self.time, 'target_changed', np.zeros(3), np.zeros(3), text)


def _known(moments: Moments) -> bool:
    """Tell whether the target's mass is known well enough to say where its centre is."""
    return bool(moments.deviation[BODY.start] < _KNOWN * moments.mean[BODY.start])


def forces(track: Track, moments: Moments) -> tuple[Event, ...]:
    """Return the constant force and torque (6,), if there is one and it is not nothing."""
    axes = track.hypothesis.force
    if axes == 'none':
        return ()
    value, factor = moments.force, moments.force_factor
    significance = float(value @ np.linalg.pinv(factor @ factor.T, hermitian=True) @ value)
    if significance < chi_square.limit(_NOTHING, len(value)):
        return ()
    return (Event(0.0, 'ramp', value[:3], value[3:], constant_force(axes)),)


def jumps(track: Track, moments: Moments, origin: Array) -> tuple[Event, ...]:
    """Return the jumps of the momentum: what is known of it later less what was before, without a constant force.

    Parameters
    ----------
    track, moments : the best hypothesis and its moments at present
    origin : (3,) m, of the run, in the odometry frame
    """
    levels = [*((jump.before, jump.pushed) for jump in track.jumps), (moments.mean[MOMENTUM], track.pushed)]
    found, cause = [], PULSE if len(track.jumps) <= MOST_JUMPS else SYMPTOM
    for jump, (after, pushed) in zip(track.jumps, levels[1:], strict=True):
        change = after - jump.before - moments.by_force(pushed - jump.pushed)
        angular = change[3:] + cross(origin, change[:3])
        found.append(Event(jump.time, 'step', change[:3], angular, cause))
    return tuple(found)
