"""A target that has changed: from some window on it is another body, or sits elsewhere; all else carries over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbaid_ros.core.filter.bank import HypothesisFilter, as_usual
from mbaid_ros.core.filter.square_root import SquareRootInformation, inflated, pose_reset
from mbaid_ros.core.filter.state import BODY, MOMENTUM
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import WhitenedWindow


def target_changed(
    track: HypothesisFilter, during: Sequence[WhitenedWindow], variables: Variables, *, exchanged: bool
) -> HypothesisFilter:
    """Return a hypothesis after windows in which the target has changed: nothing is predicted of these.

    The known side is as before, and so are mass and momentum of a body that has only moved in the grasp.
    """
    belief = track.belief
    likelihood = belief.log_likelihood + sum(as_usual(belief, white) - belief.log_likelihood for white in during)
    after = another_body(belief, variables, exchanged=exchanged)
    return replace(track, belief=replace(after, log_likelihood=likelihood))


def another_body(belief: SquareRootInformation, variables: Variables, *, exchanged: bool) -> SquareRootInformation:
    """Return the belief with a target of which nothing is known, or with the same mass elsewhere, and a new pose error.

    Parameters
    ----------
    belief : before
    variables : of the filter
    exchanged : whether it is another body, which brings or takes along a momentum of its own
    """
    own, opened = variables.own, variables.open.copy()
    if not exchanged:
        opened[MOMENTUM] = opened[BODY.start] = 0.0
    places = np.flatnonzero(opened)
    return pose_reset(inflated(belief, variables.gather[:own, places] * opened[places]), variables)
