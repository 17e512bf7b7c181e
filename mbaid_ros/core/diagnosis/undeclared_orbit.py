"""An orbit that nobody has declared, as a run has found it beside the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.filter.gaussian import MeanAndCovariance
from mbaid_ros.core.filter.state import Layout
from mbaid_ros.core.results.verdict import Cause, Verdict
from mbaid_ros.core.robot.orbit import orbit_fixed_frame
from mbaid_ros.core.unknowns.environment import Gravity, rate_of

_FALSE_ALARM = 1e-9  # chance that noise looks like a gravity gradient as large: each window asks once, for days


def with_undeclared_orbit(judgement: Verdict, moments: MeanAndCovariance, layout: Layout) -> Verdict:
    """Return the judgement with the gravity gradient among its causes, if the data say that there is one.

    The model is not adequate then: the gradient is estimated to first order, beside a body that it acts on and that is
    not known either. That suffices to tell of it, not for what the intervals claim.

    Parameters
    ----------
    judgement : Judgement
    moments, layout : of the run
    """
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, Gravity) and unknown.count:
            begin = np.arange(place.start, place.start + 5)  # the others say how it changes
            found = moments.mean[begin]
            square = float(found @ np.linalg.solve(moments.covariance(begin), found))
            if square > chi_square.limit(_FALSE_ALARM, len(found)):
                rate = rate_of(unknown.factor @ moments.mean[place])
                return replace(judgement.with_cause(Cause(orbit_fixed_frame(rate), 0.5 * square)), adequate=False)
    return judgement
