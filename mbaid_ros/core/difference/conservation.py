"""Is the momentum constant? A score test of each window, and of a jump before any window of the sliding window.

How much would the sum of squared residuals fall if the momentum had jumped by d before window k? With the gradient s by
d at the solution for the other unknowns, and S its covariance, all windows from k on together, by

    s^T S^-1 s,    d = -S^-1 s                                               (docs/method.md, eq. 9)

which is chi-square distributed where nothing happened (Rao 1948). For a jump before the newest window alone it is that
window's normalised innovation squared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.sliding_window import SlidingWindow, WindowEquations
from mbaid_ros.core.difference.window_rows import (
    ANGULAR,
    BODY,
    LINEAR,
    Subspace,
    joined,
    mean_of_each,
)
from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.linear_algebra import inverse_root
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import momentum
from mbaid_ros.core.robot.orbit import orbit_fixed_frame
from mbaid_ros.core.samples import Samples

# Chance of an undisturbed window to be taken for a jump, and of all together to seem too far from their predictions:
# once in years of windows.
_FALSE_ALARM = 1e-9
_ENOUGH = 50  # redundant equations from which the tests can be trusted
# Normalised innovation squared, of an equation: noise a fifth larger than declared is no contradiction.
_LARGEST_MEAN = 1.5
_NEAR = 1.0  # s, within which it is the same jump
# Part of the information about a jump that is added to what is left of it: where nothing is left, none shows.
_FLOOR = 1e-9


@dataclass(frozen=True)
class Jump:
    """A change of the momentum.

    Attributes
    ----------
    time : s since the first sample, start of the first window after it
    value : (c,) in the unknowns that the momentum is
    fall : of the sum of squared residuals, over the scale of the noise
    seen : s, the time that it was first found to have
    """

    time: float
    value: Array
    fall: float
    seen: float


class Conservation:
    """Tests a run for a momentum that is not constant, window by window.

    Parameters
    ----------
    momentum : places of the momentum among the unknowns

    Attributes
    ----------
    jump : the first, None where there is none
    mean : normalised innovation squared of an equation, mean over all windows that were tested
    """

    def __init__(self, momentum: slice) -> None:
        self._momentum = momentum
        self._size = momentum.stop - momentum.start
        self._limit = chi_square.limit(_FALSE_ALARM, self._size)
        self._starts: list[float] = []
        self._innovations = 0.0
        self._equations = 0
        self.jump: Jump | None = None
        self.mean = 1.0

    @property
    def excessive(self) -> bool:
        """Whether the windows differ more from their predictions than the noise explains."""
        enough = self._equations >= _ENOUGH and self.mean > _LARGEST_MEAN
        return enough and self._innovations > chi_square.limit(_FALSE_ALARM, self._equations)

    def update(self, window: SlidingWindow, start: float, covariance: Array, surplus: float) -> None:
        """Test a run after another window.

        Parameters
        ----------
        window : SlidingWindow
        start : s since the first sample, of the newest window
        covariance : (u, u) of the unknowns by noise alone
        surplus : what the consider parameters add to the sum of squared residuals in expectation
        """
        self._starts = [*self._starts, start][-len(window.windows) :]
        redundancy = window.linear.equations - len(window.x)
        if redundancy < _ENOUGH or not window.certain or len(self._starts) < 2:
            return
        falls, changes = momentum_jumps(window, self._momentum, covariance)
        self._innovations += falls[-1]
        self._equations += self._size
        self.mean = self._innovations / self._equations
        # Later windows tell more of its size; only near where it was first seen, since a solution astray sees others.
        starts, jump = np.array(self._starts[1:]), self.jump
        best = int(np.argmax(falls if jump is None else np.where(np.abs(starts - jump.seen) <= _NEAR, falls, 0.0)))
        # Noise that is larger than declared is no jump: the scale of what a jump leaves.
        scale = max((window.linear.cost - falls[best]) / (redundancy + surplus), 1.0)
        fall, time = float(falls[best]) / scale, float(starts[best])
        if fall > (self._limit if jump is None else jump.fall):
            self.jump = Jump(time, changes[best], fall, time if jump is None else jump.seen)


def momentum_jumps(window: SlidingWindow, momentum: slice, covariance: Array) -> tuple[Array, Array]:
    """Return by how much a jump before each of the K windows but the first would lower the cost, and its size.

    Parameters
    ----------
    window : SlidingWindow
    momentum : c places of the momentum among the unknowns
    covariance : (u, u) of the unknowns by noise alone

    Returns
    -------
    (K - 1,) and (K - 1, c) arrays
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
    if root is not None:
        return np.asarray(root.T @ root)
    size = 1.0 / np.sqrt(np.diag(information))
    return np.linalg.pinv(information * size * size[:, None], rcond=1e-12, hermitian=True) * size * size[:, None]


_STEPS = 4  # of Gauss and Newton: inertia and momentum are in the columns
# Normalised residual squared, of an equation, up to which the data count as explained: as in conservation.
_EXPLAINED = 1.5
_LARGEST = 0.01  # rad/s: orbits are slower
_CLEAR = 5.0  # standard deviations from which a rate is one


@dataclass(frozen=True)
class TurningFrame:
    """A rate of the frame that explains the data.

    Attributes
    ----------
    rate, std : rad/s
    gain : log-likelihood of the data with it over that without
    """

    rate: float
    std: float
    gain: float

    @property
    def clarity(self) -> float:
        """How many standard deviations the rate is."""
        return self.rate / self.std

    @property
    def cause(self) -> str:
        """What may be wrong, and what would help."""
        return orbit_fixed_frame(self.rate)


def turning_frame(
    equations: WindowEquations,
    windows: Sequence[Samples],
    kernel: MomentumKernel,
    run: tuple[Subspace, Array, Array],
    jump: float,
) -> TurningFrame | None:
    """Return the rate of the frame that explains K windows; None where none does, or something else does it better.

    What else there is: a jump of the momentum where it was found, and a force that is constant in inertial axes.

    Parameters
    ----------
    equations : of the windows
    windows : the samples that they are of
    kernel : of the robot
    run : the subspace and origin (3,) of the run, and its solution (u,)
    jump : s since the first sample
    """
    space, origin, x = run
    samples, counts = joined(windows)
    passed = samples.time - np.mean(samples.time)

    def changing(course: Array) -> Callable[[Array], Array]:
        transport = np.zeros((len(samples), 6, 6))
        transport[:] = np.eye(6)
        transport[:, 3:, :3] = -skew(samples.base_position - origin)
        return lambda _: -course[:, None, None] * transport

    def fitted(columns: Callable[[Array], Array]) -> tuple[Array, Array, float]:
        return _fitted(equations, lambda full: mean_of_each(columns(full), counts), space, x)

    rate, covariance, left = fitted(lambda full: _columns(kernel, samples, full, origin))
    found, redundancy = float(np.linalg.norm(rate)), len(equations) * len(space.rows) - len(x) - 3
    if redundancy <= 0 or left > _EXPLAINED * redundancy or not 0.0 < found < _LARGEST:
        return None
    courses = [passed]
    if samples.time[0] < jump < samples.time[-1]:
        courses.append(np.where(samples.time < jump, 0.0, 1.0))
    others = [fitted(changing(course))[2] for course in courses]
    without = eiv.whitened(equations, x).cost
    # Three more numbers have to bring something (Akaike).
    if without - left < chi_square.limit(_FALSE_ALARM, 3) or left > min(others) + 2.0 * (len(space.rows) - 3):
        return None
    deviation = float(np.sqrt(rate @ covariance @ rate)) / found
    frame = TurningFrame(found, deviation, 0.5 * (without - left))
    return frame if frame.clarity > _CLEAR else None


def _fitted(
    equations: WindowEquations, columns: Callable[[Array], Array], space: Subspace, x: Array
) -> tuple[Array, Array, float]:
    """Return numbers that the equations may depend on, solved for beside the unknowns: values, covariance, cost.

    Parameters
    ----------
    equations : of K windows
    columns : from the sixteen unknowns to how the equations depend on the c numbers, (K, 6, c)
    space, x : of the run, and where to begin
    """
    for _ in range(_STEPS):
        white = eiv.whitened(equations, x)
        more = white.whitener @ (space.rows @ columns(space.basis @ x))
        rows = np.concatenate((white.rows, more), axis=2).reshape(-1, len(x) + more.shape[2])
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        inverse = np.linalg.pinv(rows / size, rcond=1e-9) / size[:, None]
        step = -inverse @ white.residual.ravel()
        left = float(np.sum((white.residual.ravel() + rows @ step) ** 2))
        x = x + step[: len(x)]
        if not np.isfinite(left) or not (space.basis @ x)[0] > 0.0:
            return step[len(x) :], inverse[len(x) :] @ inverse[len(x) :].T, np.inf
    return step[len(x) :], inverse[len(x) :] @ inverse[len(x) :].T, left


def _columns(kernel: MomentumKernel, samples: Samples, x: Array, origin: Array) -> Array:
    """Return what a rate of the frame adds to the equations of N samples, (N, 6, 3).

    Parameters
    ----------
    x : (16,) body and momentum, L about an origin (3,)
    """
    states, place = kernel.states(samples), samples.base_position
    whole = np.sum(states.known, axis=1) + express(x[BODY], states.rotation, states.position)
    linear, angular = x[LINEAR], x[ANGULAR] + np.cross(origin, x[LINEAR])
    time = (samples.time - np.mean(samples.time))[:, None]
    columns = np.empty((len(time), 6, 3))
    for axis, unit in enumerate(np.eye(3)):
        turn = np.broadcast_to(unit, place.shape)
        columns[..., axis] = momentum(whole, np.concatenate((cross(turn, place), turn), axis=1))
        pushed = np.cross(unit, linear)
        columns[:, :3, axis] += time * pushed
        columns[:, 3:, axis] += time * (np.cross(unit, angular) - cross(place, np.broadcast_to(pushed, place.shape)))
    return columns
