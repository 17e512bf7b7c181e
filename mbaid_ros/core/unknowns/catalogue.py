"""A calibrated robot as unknowns with a joint prior, and the words of the unknowns' causes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.model_errors import KnownErrors, links_to_bodies
from mbaid_ros.core.unknowns.base import odometry_mount
from mbaid_ros.core.unknowns.bodies import known_bodies
from mbaid_ros.core.unknowns.declaration import Unknown, Words, diagonal, uncertain
from mbaid_ros.core.unknowns.joints import joint_placements
from mbaid_ros.core.unknowns.priors import UnknownsPrior

_LEAST_STD = 1e-6  # least standard deviation of a number in its unit: exact beside others of the same unknown


@dataclass(frozen=True, eq=False)
class CalibratedModel:
    """A calibration beside the robot description, which has its bodies, origins and axes already."""

    links: tuple[Link, ...]  # k of them
    zeros: Array  # (n,) as of a NominalModel
    mount: Array  # (6,) as of a NominalModel
    # (10 k + 6 n + 6,) squared: standard parameters of the links, each in its own frame; of each joint zero,
    # displacement of its frame and tilts of its axis; mount
    covariance: Array

    def with_kernel(
        self, kernel: MomentumKernel, declared: Iterable[Unknown], *, located: bool = True
    ) -> tuple[MomentumKernel, tuple[Unknown, ...], UnknownsPrior]:
        """Return a kernel with its target, its unknowns and their joint prior: those not calibrated as declared.

        Parameters
        ----------
        declared : all unknowns, in the order of the state
        located : whether poses are measured; nothing is mounted elsewhere than the base's own frame where not
        """
        joints = kernel.model.joints
        bodies, carry = links_to_bodies(self.links, [link.name for link in kernel.unknown])
        whole = block_diag(carry, np.eye(6 * joints + 6))
        covariance, mount = whole @ self.covariance @ whole.T, self.mount
        if not located:
            covariance[-6:] = covariance[:, -6:] = 0.0
            mount = np.zeros(6)
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        of_bodies = deviations[: len(carry)]
        each = deviations[len(carry) : -6].reshape(joints, 6)
        zeros, origins, axes = (_size(part) for part in (each[:, :1], each[:, 1:4], each[:, 4:]))
        orientation, position = _size(deviations[-6:].reshape(2, 3))
        units = np.concatenate(
            (
                of_bodies,
                np.column_stack((zeros, *(origins,) * 3, *(axes,) * 2)).ravel(),
                np.repeat((orientation, position), 3),
            )
        )
        values = np.concatenate((np.zeros(len(carry)), np.zeros(6 * joints), mount))
        values[len(carry) : -6 : 6] = self.zeros
        doubted = kernel.with_errors(KnownErrors(bodies, diagonal(of_bodies)))
        robot = uncertain(
            known_bodies(doubted.model, doubted.errors),
            joint_placements(doubted, zeros.tolist(), origins.tolist(), axes.tolist()),
        )
        of_odometry = uncertain(odometry_mount(float(position), float(orientation)))
        others = [each for each in declared if not each.calibrated]
        predicted, read = (tuple(each for each in others if each.in_readings is which) for which in (False, True))
        known = _gaussian(values, covariance, units)
        known = known.extended(_count(predicted), before=_count(robot))
        known = known.extended(_count(read), before=len(known.mean))
        return doubted, (*robot, *predicted, *of_odometry, *read), known


def _count(unknowns: Iterable[Unknown]) -> int:
    return sum(unknown.count for unknown in unknowns)


def _size(deviations: Array) -> Array:
    """Return the root mean square of each row."""
    return np.sqrt(np.mean(deviations**2, axis=-1))


def _gaussian(values: Array, covariance: Array, units: Array) -> UnknownsPrior:
    """Return numbers in their units with a factor of their covariance; those without a unit are left out."""
    uncertain = units > 0.0
    own = units[uncertain]
    scaled = covariance[np.ix_(uncertain, uncertain)] / own / own[:, None]
    size = np.maximum(np.sqrt(np.maximum(np.diag(scaled), 0.0)), _LEAST_STD)
    eigenvalues, vectors = np.linalg.eigh(scaled / size / size[:, None])
    return UnknownsPrior(values[uncertain] / own, size[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))


def _kinds(kind: type[Unknown]) -> list[type[Unknown]]:
    """Return a class of unknowns and all that derive from it."""
    return [kind, *(each for part in kind.__subclasses__() for each in _kinds(part))]


# By kind of cause: those of the priors of target and momentum.
_OF_PRIORS = {
    'target prior': Words(remedy='the prior of the target (target_prior)'),
    'momentum prior': Words(remedy='the prior of the momentum (momentum.linear_prior_std)'),
}


@cache  # at first use: by then all classes of unknowns are there
def _words() -> Mapping[str, Words]:
    """Return the words of all causes by their kind."""
    return _OF_PRIORS | {cause: words for kind in _kinds(Unknown) for cause, words in kind.words.items()}


_LARGEST_SIZE = 10.0  # that is tried (trajectory.md, eq. 8): beyond it, how many times is not known


def _words_of(cause: str) -> tuple[Words, str]:
    """Return the words of a cause's kind and the name of the thing: 'zero:elbow', or 'zero' for all zeros."""
    kind, _, name = cause.partition(':')
    return _words().get(kind, Words()), name


def in_words(cause: str) -> str:
    """Return a cause of the error budget in words: 'link:arm' is link arm, 'zero:elbow' the zero of elbow."""
    kind, _, name = cause.partition(':')
    return f'{kind} {name}' if kind == 'link' else f'the {kind} of {name}' if name else kind


@lru_cache(maxsize=1024)  # asked for at each window
def kind_in_words(cause: str) -> str:
    """Return a cause of the error budget, or a kind of them, in words: 'zero' is the joints' zeros."""
    words, name = _words_of(cause)
    return words.every if words.every and not name else in_words(cause)


def remedy_text(cause: str) -> str:
    """Return a cause in words, and its remedy."""
    words, name = _words_of(cause)
    return words.remedy.format(name) or cause


def underestimated_text(cause: str, size: float) -> str:
    """Return that a thing, 'link:arm', or all of a kind, 'link', is `size` times as far off as declared."""
    words, name = _words_of(cause)
    parameter = words.parameter or 'its standard deviation'
    times = f'{size:.1f}' if size < 0.95 * _LARGEST_SIZE else f'{_LARGEST_SIZE:g} or more'
    return (
        f'{kind_in_words(cause)} {"looks" if name else "look"} {times} times as far off as declared: intervals allow '
        f'for that; raise {parameter}'
    )


def deviation_text(cause: str, value: Array) -> str:
    """Return the value that an unknown would need, by its label and numbers (k,), SI units, and the remedy."""
    words, name = _words_of(cause)
    if words.deviation is None:
        return f'{cause} is off by {np.linalg.norm(value):.3g}'
    return words.deviation(name, value)


def target_changed_text(time: float, *, exchanged: bool) -> str:
    """Return that the body moved in the grasp at a time, s, or was exchanged for another."""
    if exchanged:
        return f'another body is in the grasp since {time:.1f} s, caught or lost: identify it from then on'
    return f'the body moved in the grasp at {time:.1f} s: identify it again from then on'
