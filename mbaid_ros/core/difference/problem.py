"""Which unknowns there are beside the body and the momentum, and what is only watched, or known to be uncertain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mbaid_ros.core.difference.coupling import Places
from mbaid_ros.core.difference.disturbances import Uncertain, Watched
from mbaid_ros.core.difference.effects import AXES, Axes, ConstantForces, Kind, body_columns
from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.subspace import subspace
from mbaid_ros.core.difference.window_rows import LINEAR, Counts
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.stacked import Stacked

# Standard deviation of the start in typical sizes: far too much to be a prior, and enough to keep every step finite.
NO_PRIOR = 100.0
_FORCE_TIME = 100.0  # s, in which a force of typical size makes a momentum of typical size


@dataclass(frozen=True)
class Beside:
    """What is there beside the body and the momentum.

    Attributes
    ----------
    linear_momentum_std : N s, of the total linear momentum about zero; 0 is no prior
    constant : axes of a constant external force and torque among the unknowns
    known_mode : whether the errors of the known bodies are estimated along, or only widen the covariance
    delay_std : s, of the joints' stamps; 0 takes them as true, else a delay is looked for
    """

    linear_momentum_std: float
    constant: Axes | Literal['none']
    known_mode: Literal['consider', 'estimate']
    delay_std: float


@dataclass(frozen=True)
class Surroundings(Stacked):
    """What may act on the robot in K windows, or is not known well.

    Attributes
    ----------
    acting : (K, 6, a) columns of the constant force and torque that was asked for
    watched : (K, 6, w) of those that are watched for, in the unknowns that they would become
    errors : (K, 6, e) of the independent errors of known bodies that only widen the covariance
    gains : (K, f, 6, 6) what each of these forces and torques has changed (P, L) by at the window's end: the one that
        was asked for, or those that are watched for, in the order of AXES
    """

    acting: Array
    watched: Array
    errors: Array
    gains: Array


class Problem:
    """The unknowns of a run, x = (m, h, I_o, P_0, L_0, F, T, errors of known bodies), the last two where asked for.

    Parameters
    ----------
    kernel : MomentumKernel
    beside : Beside
    plane : of the motion so far
    origin : (3,) m, about which L_0 is taken

    Attributes
    ----------
    origin : as given
    space : which equations hold, in which unknowns
    prior : (v, v) information about zero in these
    open_prior : (v, v) the same where nothing is known of the momentum
    typical : (v,) sizes
    open_variance : (u,) of x where nothing is known
    momentum : places of the momentum among the unknowns of the subspace
    acting : places of the constant force and torque that was asked for, and its axes
    estimated : whether the errors of known bodies are among the unknowns
    uncertain : which of the effects are errors of known bodies
    watched : constant forces that may act, and a delay that there may be
    effects : number of effects that are not solved for
    """

    def __init__(self, kernel: MomentumKernel, beside: Beside, plane: PlaneDetector, origin: Array) -> None:
        self._kernel = kernel
        self.origin = origin
        # Of the known bodies' errors the independent numbers of variance one are unknowns or effects.
        errors = np.ones(kernel.errors.count)
        self.estimated = beside.known_mode == 'estimate' and len(errors) > 0
        asked = beside.constant != 'none'
        self._forces = ConstantForces((beside.constant,) if beside.constant != 'none' else AXES, origin)
        solved = errors if self.estimated else errors[:0]
        self.space = subspace(plane, kernel, int(asked), len(solved))
        scale = unknown_scale(kernel)
        sizes = np.concatenate((scale, *[scale[10:] / _FORCE_TIME] * asked, solved))
        deviation = NO_PRIOR * sizes
        deviation[len(sizes) - len(solved) :] = solved
        self.open_variance = deviation**2
        basis = self.space.basis
        self.open_prior = np.asarray((basis.T * (1.0 / deviation**2)) @ basis)
        if beside.linear_momentum_std > 0.0:
            deviation[LINEAR] = beside.linear_momentum_std
        self.prior = np.asarray((basis.T * (1.0 / deviation**2)) @ basis)
        self.typical = np.abs(basis.T) @ sizes
        wrench, body = len(self.space.rows), 4 if self.space.planar else 10
        self.momentum = slice(body, body + wrench)
        after = self.momentum.stop
        self.acting: tuple[Places, Axes] | None = None
        if beside.constant != 'none':
            self.acting = (np.arange(after, after + wrench), beside.constant)
        places: dict[Kind, slice] = {
            axes: slice(k * wrench, (k + 1) * wrench) for k, axes in enumerate(() if asked else AXES)
        }
        priors = dict.fromkeys(places, np.diag(self.open_prior)[self.momentum] * _FORCE_TIME**2)
        count = len(places) * wrench
        self._delayed = beside.delay_std > 0.0
        if self._delayed:
            places['delay'], priors['delay'] = slice(count, count + 1 + body), np.array([1.0 / beside.delay_std**2])
            count += 1 + body
        self.watched = Watched(places, priors)
        considered = errors[len(solved) :]
        self.uncertain = Uncertain(count + np.arange(len(considered)), considered)
        self.effects = count + len(considered)

    def surroundings(self, samples: Samples, counts: Counts) -> Surroundings:
        """Take the next K windows' samples and return what may act there, whatever the joints' stamps."""
        acting: Array = np.zeros((len(counts), 6, 0))
        watched = errors = acting
        columns, gains = self._forces.columns(samples, counts)
        if self.acting is None:
            watched = np.concatenate(np.moveaxis(columns @ self.space.rows.T, 1, 0), axis=2)
        else:
            acting = columns[:, 0]
        if not self.estimated:
            known = self._kernel.errors
            errors = body_columns(self._kernel, samples, counts, known.bodies) @ known.factor
        return Surroundings(acting, watched, errors, gains)

    def of(self, surroundings: Surroundings, rows: Blocks, delay: Array) -> tuple[Blocks, Array]:
        """Return K windows' equations in the unknowns, and how they depend on the effects, (K, r, e).

        Parameters
        ----------
        surroundings : of these windows
        rows : of these windows, in (m, h, I_o, parameters of known bodies, P_0, L_0), of `observed`
        delay : (K, 6, 11) of these windows, as `Moved.columns` has it
        """
        delays = []
        if self._delayed:
            known, target = np.split(delay, [1], axis=2)
            delays = [known, target @ self.space.basis[:10, : self.momentum.start]]
        rows = rows.widened(surroundings.acting)
        if self.estimated:
            rows = rows.restrict(np.eye(6), self._errors_last(rows.rows.shape[-1]))
        effects = np.concatenate((surroundings.watched, *delays, surroundings.errors), axis=2)
        return self.space.of(rows), self.space.rows @ effects

    def _errors_last(self, columns: int) -> Array:
        """Return the matrix to (m, h, I_o, known bodies, P_0, L_0, F, T) from (m, h, I_o, P_0, L_0, F, T, errors)."""
        factor = self._kernel.errors.factor
        after, count = 10 + len(factor), columns - len(factor)
        matrix = np.zeros((columns, count + factor.shape[1]))
        matrix[:10, :10], matrix[after:, 10:count] = np.eye(10), np.eye(count - 10)
        matrix[10:after, count:] = factor
        return matrix

    def present(self, found: Sequence[Axes], gains: Array) -> Array:
        """Return the (16, u) matrix from x to (m, h, I_o, P, L) at the end of a window.

        Parameters
        ----------
        found : axes of forces among the effects that are now among the unknowns, six more numbers each after the others
        gains : (f, 6, 6) of that window, as in Surroundings
        """
        count = len(self.space.basis)
        matrix = np.eye(16, count + 6 * len(found))
        if self.acting is not None:
            matrix[10:, 16:22] = gains[0]
        for number, axes in enumerate(found):
            matrix[10:, count + 6 * number : count + 6 * number + 6] = gains[AXES.index(axes)]
        return matrix


def observed(kernel: MomentumKernel, beside: Beside) -> MomentumKernel:
    """Return the kernel whose unknown bodies make the windows' rows: with errors of known ones, if estimated."""
    return kernel.with_errors_of(kernel.errors.bodies) if beside.known_mode == 'estimate' else kernel
