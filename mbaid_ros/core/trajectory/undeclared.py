"""An orbit that nobody has declared, as a run has found it beside the body."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.orbit import orbit_fixed_frame
from mbaid_ros.core.trajectory.belief import Moments
from mbaid_ros.core.trajectory.state import Layout
from mbaid_ros.core.unknowns.gravity import Gravity, rate_of
from mbaid_ros.core.verdict.judgement import Cause

_FALSE_ALARM = 1e-9


def undeclared_orbit(moments: Moments, layout: Layout) -> Cause | None:
    """Return that there is a gravity gradient, if the data say so; None where they do not, or the orbit is declared."""
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, Gravity) and unknown.count:
            begin = np.arange(place.start, place.start + 5)  # the others say how it changes
            found = moments.mean[begin]
            square = float(found @ np.linalg.solve(moments.covariance(begin), found))
            if square > chi_square.limit(_FALSE_ALARM, len(found)):
                return Cause(orbit_fixed_frame(rate_of(unknown.factor @ moments.mean[place])), 0.5 * square)
    return None
