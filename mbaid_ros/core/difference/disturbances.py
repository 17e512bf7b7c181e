"""What may disturb a run, and what the tests for it see."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mbaid_ros.core.difference.coupling import Places
from mbaid_ros.core.difference.effects import Kind
from mbaid_ros.core.difference.monitor import Nuisance
from mbaid_ros.core.geometry import Array


@dataclass
class Jump:
    """A change of the momentum.

    Attributes
    ----------
    start, end : s since the first sample, of the windows in which it happened
    value : (k,) as far as known
    covariance : (k, k) of it
    """

    start: float
    end: float
    value: Array
    covariance: Array


@dataclass
class Found:
    """A watched effect that is there: a constant force and torque, or a delay of the joints' stamps.

    Attributes
    ----------
    kind : axes of the force, or 'delay'
    effects : its places among the effects, while it was only watched
    place : (k,) indices among the unknowns
    """

    kind: Kind
    effects: slice
    place: Places


@dataclass(frozen=True)
class View:
    """What the tests see: the latest solution.

    Attributes
    ----------
    rows : (K, r, u + 1 + e) the bordered rows of the windows that are solved again
    step : (u,) from where they are linearised to the solution
    uncertain : (u, e) what ties the uncertain effects, each in its standard deviation, to the unknowns
    nuisance : what is unknown anyhow
    cost, expected : sum of the squared normalised residuals, and what it should be
    """

    rows: Array
    step: Array
    uncertain: Array
    nuisance: Nuisance
    cost: float
    expected: float

    def squared(self, window: int) -> float:
        """Return the squared normalised residual of a window at the solution."""
        count = len(self.step)
        residual = self.rows[window, :, count] + self.rows[window, :, :count] @ self.step
        return float(residual @ residual)

    @property
    def scale(self) -> float:
        """Mean squared normalised residual, over what is expected of it, not below 1."""
        return self.left(0.0)

    def left(self, fall: float) -> float:
        """Return the scale once the cost has fallen."""
        return max(1.0, (self.cost - fall) / self.expected)

    def relative(self, fall: float) -> float:
        """Return a fall of the cost over the scale that is left: no more than chance makes of it."""
        return fall / self.left(fall)


@dataclass(frozen=True)
class Uncertain:
    """Effects that are not solved for, but known to be small.

    Attributes
    ----------
    places : (e,) indices among the effects
    size : (e,) standard deviations
    """

    places: Places
    size: Array


@dataclass(frozen=True)
class Watched:
    """Constant forces and torques that may act, and a delay that there may be.

    Attributes
    ----------
    effects : their places among the effects; a delay is as many as the body has unknowns, and one: the rate of the
        known momentum, and those of the body's
    prior : (k,) information of each about zero where nothing is known of it
    """

    effects: Mapping[Kind, slice]
    prior: Mapping[Kind, Array]
