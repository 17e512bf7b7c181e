"""An orbit that nobody has declared, as a run has found it beside the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.orbit import orbit_fixed_frame
from mbaid_ros.core.trajectory.belief import Moments
from mbaid_ros.core.trajectory.state import Layout
from mbaid_ros.core.unknowns.gravity import Gravity, rate_of
from mbaid_ros.core.verdict.judgement import Cause, Judgement

_FALSE_ALARM = 1e-9
# Root mean square of what a straight line leaves of t^2 on [0, 1]: sqrt(1 / 180).
_BENT = 0.0745


def with_undeclared_orbit(judgement: Judgement, moments: Moments, layout: Layout, time: float) -> Judgement:
    """Return the judgement with the gravity gradient among its causes, if the data say that there is one.

    Where that has turned so far that value and change of its elements, which are estimated, leave more of it than they
    are known to, the model is no longer adequate.

    Parameters
    ----------
    judgement : Judgement
    moments, layout : of the run
    time : s since its begin
    """
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, Gravity) and unknown.count:
            begin = np.arange(place.start, place.start + 5)  # the others say how it changes
            found = moments.mean[begin]
            square = float(found @ np.linalg.solve(moments.covariance(begin), found))
            if square > chi_square.limit(_FALSE_ALARM, len(found)):
                rate = rate_of(unknown.factor @ moments.mean[place])
                left = _BENT * 2.0 * (rate * time) ** 2  # the gradient turns by twice the rate
                told = judgement.with_cause(Cause(orbit_fixed_frame(rate), 0.5 * square))
                return replace(told, adequate=told.adequate and left * np.sqrt(square) < 1.0)
    return judgement
