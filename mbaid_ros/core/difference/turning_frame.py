"""Whether the data would be explained if the frame of the odometry turned, as one does that is fixed to an orbit.

In a frame that turns at a small rate W, velocities lack W x p and W, and a momentum that is constant in inertial axes
turns back by t W. To first order that adds columns for W to the equations of a window,

    M (W x p, W) + t T (W x P_0, W x L_0),

M the inertia of the whole robot about its base. W is solved for with everything else, over the sliding window.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.difference.linearised import WindowEquations
from mbaid_ros.core.equations import errors_in_variables as eiv
from mbaid_ros.core.equations.subspace import Subspace
from mbaid_ros.core.equations.window_rows import ANGULAR, BODY, LINEAR, joined, mean_of_each
from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.orbit import orbit_fixed_frame
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import momentum
from mbaid_ros.core.samples import Samples

_STEPS = 4  # of Gauss and Newton: inertia and momentum are in the columns
# Chance that noise gains as much by three numbers: a contradicted run is asked for as long as it goes on.
_FALSE_ALARM = 1e-9
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
