"""A run: the unknowns that its motion can tell, the likelihood of its windows, and whether momentum is conserved."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.difference.conservation import Conservation, noise_covariance
from mbaid_ros.core.difference.consider_parameters import ConsiderParameters
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation
from mbaid_ros.core.difference.sliding_window import SlidingWindow
from mbaid_ros.core.difference.window_rows import LINEAR, Subspace
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Event

# Standard deviation of the start in typical sizes: far too much to be a prior, and enough to keep every step finite.
NO_PRIOR = 100.0
_CAUSE = 'thrust, contact, a slip of the grasp, or a force that lasts'


class Run:
    """The unknowns x = (m, h, I_o, P_0, L_0) of a run, as far as its motion can tell them.

    Parameters
    ----------
    space : which equations hold, in which unknowns
    origin : (3,) m, about which L_0 is taken
    scale : (16,) typical sizes of x
    linear_momentum_std : N s, of the total linear momentum about zero; 0 is no prior
    considered : the consider parameters
    length : of the SlidingWindow
    restarted : whether earlier windows had to be given up

    Attributes
    ----------
    open_variance : (16,) of x where nothing is known
    momentum : places of the momentum among the unknowns
    window : SlidingWindow
    surplus : what these add to the sum of squared residuals in expectation
    """

    def __init__(
        self,
        space: Subspace,
        origin: Array,
        scale: Array,
        linear_momentum_std: float,
        considered: ConsiderParameters,
        *,
        length: int,
        restarted: bool,
    ) -> None:
        self.space = space
        self.origin = origin
        self.considered = considered
        self.restarted = restarted
        deviation = NO_PRIOR * scale
        self.open_variance = deviation**2
        if linear_momentum_std > 0.0:
            deviation[LINEAR] = linear_momentum_std
        basis = space.basis
        prior = np.asarray((basis.T * (1.0 / deviation**2)) @ basis)
        self.momentum = slice(len(prior) - len(space.rows), len(prior))
        self.window = SlidingWindow(prior, length, np.abs(basis.T) @ scale, considered.count)
        self.surplus = 0.0
        self._conservation = Conservation(self.momentum)

    def add(self, block: Blocks, columns: Array, start: float) -> Linearisation:
        """Take a window, solve again and return the likelihood's quadratic form at the solution.

        Parameters
        ----------
        block, columns : of one window in the unknowns of the subspace, (1, r, e)
        start : s since the first sample
        """
        linear = self.window.add(block, columns)
        covariance = noise_covariance(self.window.linear.information)
        if self.considered.count:
            self.surplus = self.window.cross_information.surplus(covariance)
        self._conservation.update(self.window, start, covariance, self.surplus)
        return linear

    @property
    def event(self) -> Event | None:
        """The first jump of the momentum, about the odometry's origin; None where there was none."""
        jump = self._conservation.jump
        if jump is None:
            return None
        change = self.space.rows.T @ jump.value
        return Event(jump.time, 'step', change[:3], change[3:] + cross(self.origin, change[:3]), _CAUSE)

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Why the momentum of this run, or its noise, cannot be what it is taken for."""
        event, test = self.event, self._conservation
        found = [f'the momentum is not constant: {event}'] if event else []
        if test.excessive:
            found.append(
                f'windows are {test.mean:.1f} times as far from their predictions as the noise parameters explain '
                '(mean normalised innovation squared)'
            )
        return tuple(found)
