"""A body that has moved in the grasp: from some window on it is another one; all else carries over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbaid_ros.core.trajectory.bank import Track, as_usual
from mbaid_ros.core.trajectory.belief import Belief
from mbaid_ros.core.trajectory.filter import inflated, pose_reset
from mbaid_ros.core.trajectory.state import BODY
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.trajectory.whitened import WhitenedWindow


def moved_in_grasp(track: Track, during: Sequence[WhitenedWindow], variables: Variables) -> Track:
    """Return a hypothesis after windows in which the body has moved: nothing is predicted of these.

    Momentum and known side are as before, of pose error and body nothing is known.
    """
    belief = track.belief
    likelihood = belief.log_likelihood + sum(as_usual(belief, white) - belief.log_likelihood for white in during)
    return replace(track, belief=replace(another_body(belief, variables), log_likelihood=likelihood))


def another_body(belief: Belief, variables: Variables) -> Belief:
    """Return the belief with a target body and a pose error of which nothing is known."""
    own, head = variables.own, variables.head
    noise = np.zeros((own, BODY.stop - BODY.start))
    noise[head:] = variables.gather[head:own, BODY] @ variables.factor[BODY, BODY]
    return pose_reset(inflated(belief, noise), variables)
