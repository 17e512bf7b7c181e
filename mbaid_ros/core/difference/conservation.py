"""Is the momentum constant? A score test of each window, and of a jump before any window of the sliding window.

How much would the sum of squared residuals fall if the momentum had jumped by d before window k? With the gradient s by
d at the solution for the other unknowns, and S its covariance, all windows from k on together, by

    s^T S^-1 s,    d = -S^-1 s                                               (method.md, eq. 9)

which is chi-square distributed if nothing happened (Rao 1948). For a jump before the newest window alone it is that
window's normalised innovation squared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.difference.sliding_window import SlidingWindow
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import chi_square_limit, inverse_root, square_root

# Chance of an undisturbed window to be taken for a jump, and of all together to seem too far from their predictions:
# once in years of windows.
_FALSE_ALARM = 1e-9
_ENOUGH = 50  # redundant equations from which the tests can be trusted
# Normalised innovation squared, of an equation: noise a fifth larger than declared is no contradiction.
_LARGEST_MEAN = 1.5
_NEAR = 1.0  # s, within which it is the same jump
# Part of the information about a jump that is added to its remainder: without a remainder, none shows.
_FLOOR = 1e-9


@dataclass(frozen=True)
class Jump:
    """A change of the momentum."""

    time: float  # s since the first sample, start of the first window after it
    value: Array  # (c,) in the unknowns that the momentum is
    cost_reduction: float  # of the sum of squared residuals, over the scale of the noise
    first_seen: float  # s, its time when it was first found


class Conservation:
    """Tests a run for a momentum, at some places among the unknowns, that is not constant, window by window.

    Attributes
    ----------
    jump : the first, None where there is none
    mean : normalised innovation squared of an equation, mean over all tested windows
    """

    def __init__(self, momentum: slice) -> None:
        self._momentum = momentum
        self._size = momentum.stop - momentum.start
        self._limit = chi_square_limit(_FALSE_ALARM, self._size)
        self._starts: list[float] = []
        self._innovations = 0.0
        self._equations = 0
        self.jump: Jump | None = None
        self.mean = 1.0

    @property
    def excessive(self) -> bool:
        """Whether the windows differ more from their predictions than the noise explains."""
        enough = self._equations >= _ENOUGH and self.mean > _LARGEST_MEAN
        return enough and self._innovations > chi_square_limit(_FALSE_ALARM, self._equations)

    def update(self, window: SlidingWindow, start: float, covariance: Array, surplus: float) -> None:
        """Test a run after another window.

        Parameters
        ----------
        start : s since the first sample, of the newest window
        covariance : (u, u) of the unknowns by noise alone
        surplus : expected part of the consider parameters in the sum of squared residuals
        """
        self._starts = [*self._starts, start][-len(window.windows) :]
        redundancy = window.linear.equations - len(window.x)
        if redundancy < _ENOUGH or not window.certain or len(self._starts) < 2:
            return
        falls, changes = momentum_jumps(window, self._momentum, covariance)
        self._innovations += falls[-1]
        self._equations += self._size
        self.mean = self._innovations / self._equations
        # Later windows determine its size better; only near its first place, since a solution astray finds others.
        starts, jump = np.array(self._starts[1:]), self.jump
        best = int(
            np.argmax(falls if jump is None else np.where(np.abs(starts - jump.first_seen) <= _NEAR, falls, 0.0))
        )
        # Noise that is larger than declared is no jump: the scale of the residuals of a jump.
        scale = max((window.linear.cost - falls[best]) / (redundancy + surplus), 1.0)
        fall, time = float(falls[best]) / scale, float(starts[best])
        if fall > (self._limit if jump is None else jump.cost_reduction):
            self.jump = Jump(time, changes[best], fall, time if jump is None else jump.first_seen)


def momentum_jumps(window: SlidingWindow, momentum: slice, covariance: Array) -> tuple[Array, Array]:
    """Return by how much a jump before each of the K windows but the first would lower the cost, and its size.

    Parameters
    ----------
    momentum : c places of the momentum among the unknowns
    covariance : (u, u) of the unknowns by noise alone

    Returns
    -------
    (K - 1,), (K - 1, c)
    """
    windows, count = window.windows, len(window.x)
    white, step = windows.white, window.x - windows.x
    bordered = np.concatenate((white.rows, white.residual[..., None], windows.columns), axis=2)[1:]
    sums = np.cumsum((np.swapaxes(bordered[..., momentum], 1, 2) @ bordered)[::-1], axis=0)[::-1]
    cross, own = sums[..., :count], sums[..., momentum]
    weighed = cross @ covariance
    slope = sums[..., count] + cross @ step - weighed @ window.linear.gradient
    left = own - weighed @ np.swapaxes(cross, 1, 2)
    considered = sums[..., count + 1 :] - weighed @ window.cross_information.cross
    left = left + considered @ np.swapaxes(considered, 1, 2)
    diagonal = np.arange(left.shape[1])
    left[:, diagonal, diagonal] += _FLOOR * own[:, diagonal, diagonal]
    changes = -np.linalg.solve(left, slope[..., None])[..., 0]  # (9)
    return -np.sum(slope * changes, axis=1), changes


def noise_covariance(information: Array) -> Array:
    """Return the (u, u) inverse of the information that was solved; empty directions are left out."""
    root = inverse_root(information)
    root = square_root(information).T if root is None else root
    return np.asarray(root.T @ root)
