"""Windows of drawn numbers, of no robot, for tests of what the filter makes of them."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.filter.chain import WindowModel
from mbaid_ros.core.filter.measured_window import IntegratedTwist
from mbaid_ros.core.filter.state import BODY
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import WhitenedWindow, prepared
from mbaid_ros.core.geometry import Array

UNKNOWNS = 3  # of the known side
NUMBERS = 10 + 2  # of the body and those unknowns that the prediction depends on
STATE = BODY.stop + UNKNOWNS


def prepare(window: WindowModel, variables: Variables) -> WhitenedWindow:
    """Return one window in the filter's variables."""
    return prepared(window[None], variables)[0]  # type: ignore[index]


def variables(rng: np.random.Generator) -> Variables:
    """Return variables of drawn sizes and priors."""
    scale, deviation = rng.uniform(0.5, 2.0, STATE), rng.uniform(1.0, 1.4, STATE)
    scale[BODY.stop :] = deviation[BODY.stop :] = 1.0
    mean = rng.normal(size=STATE)
    mean[BODY.stop :] = 0.0
    force = np.diag(rng.uniform(0.5, 2.0, 6))
    return Variables(np.eye(STATE), scale, np.eye(6), force, mean, np.diag(deviation), np.eye(UNKNOWNS), np.ones(6))


def positive(rng: np.random.Generator, size: float = 1.0) -> Array:
    """Return a drawn covariance (6, 6)."""
    root = rng.normal(size=(6, 8))
    return size * root @ root.T


def window(rng: np.random.Generator, process: float = 0.0) -> WindowModel:
    """Return a drawn window whose joints' noise adds as much on the way as `process` says, (6, 8)."""
    turn = 0.1 * rng.normal(size=(6, STATE))
    turn[:, :6] += np.eye(6)
    return WindowModel(
        *(rng.normal(size=6), rng.normal(size=(6, STATE)), positive(rng)),
        *(rng.normal(size=6), rng.normal(size=(6, STATE)), positive(rng)),
        transition=turn,
        drift=rng.normal(size=6),
        process=np.sqrt(process) * rng.normal(size=(6, 8)),
        joints=rng.normal(size=(6, 3)),
        joints_by_unknowns=rng.normal(size=(6, NUMBERS, 3)),
        joints_of_gyro=np.zeros((3, 3)),
        joints_in_twist=np.array(rng.uniform(0.5, 2.0)),
        length=np.array(0.5),
        rotation=np.eye(3),
        position=rng.normal(size=3),
        centre=rng.normal(size=3),
        brought=np.zeros((6, STATE)),
        stepped=np.zeros((6, 0)),
        gained=np.zeros(0),
        body=rng.normal(size=10),
        integrated=IntegratedTwist.none(1, STATE)[0],
    )
