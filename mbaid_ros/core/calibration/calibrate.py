"""The calibration: the momentum equations of all motions, the prior, one likelihood, bodies that can exist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.calibration.likelihood import Eliminated, Likelihood, Motion
from mbaid_ros.core.calibration.prior import NO_PRIOR, LinkPrior, Prior, make_prior
from mbaid_ros.core.calibration.result import Calibration, Scale
from mbaid_ros.core.calibration.structure import Mechanism, planar_basis, structure
from mbaid_ros.core.equations.window_rows import window_rows
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array, Flags, skew
from mbaid_ros.core.results.consistency import project
from mbaid_ros.core.results.reporting import NOISE_MARGIN
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.samples import Samples, SensorNoise

_WINDOWS_AT_ONCE = 200
# Range of a joint's window means, in standard deviations of one, from which it moves.
_MOVES = 20.0


@dataclass(frozen=True)
class CalibrationSettings:
    """What a calibration is told.

    Attributes
    ----------
    noise : of the joint sensors (the base's stands in the samples)
    priors : of each of the kernel's unknown links
    linear_momentum_std : N s, of the total linear momentum about zero; 0 is no prior
    """

    noise: SensorNoise
    priors: tuple[LinkPrior, ...]
    linear_momentum_std: float = 0.0


@dataclass(frozen=True)
class _Data:
    """The motions as equations.

    Attributes
    ----------
    motions : Motion
    mechanism : what moves
    samples, span : number, s
    """

    motions: tuple[Motion, ...]
    mechanism: Mechanism
    samples: int
    span: float


def calibrate(kernel: MomentumKernel, runs: Sequence[list[Samples]], settings: CalibrationSettings) -> Calibration:
    """Return the unknown links of a kernel after some motions of its robot.

    Parameters
    ----------
    kernel : MomentumKernel
    runs : motions, each as a list of windows; momentum is constant within one, and may differ from one to the next
    settings : CalibrationSettings

    Raises
    ------
    ModelError, ParameterError
        The prior cannot be used.
    DataError
        There are no windows.
    """
    prior = make_prior(kernel, settings.priors)
    data = _data(kernel, [run for run in runs if run], settings.noise)
    likelihood = _likelihood(kernel, data, prior, settings.linear_momentum_std)
    x = likelihood.maximum()
    information, _ = likelihood.linearise(x)
    own = likelihood.noise_information(x)
    known = Eliminated.of(information - own, likelihood.bodies)
    cautious = Eliminated.of(information - NOISE_MARGIN * own, likelihood.bodies)
    covariance = likelihood.root @ known.covariance() @ likelihood.root.T
    cost = likelihood.cost(x)
    redundancy = likelihood.equations
    bodies = likelihood.bodies
    x, corrections = _physical(x, covariance, kernel)
    momentum, momentum_covariance = _momenta(x, covariance, data.motions)
    model = kernel.model
    return Calibration(
        prior=prior,
        theta=x[:bodies],
        covariance=covariance[:bodies, :bodies],
        corrections=corrections,
        momentum=momentum,
        momentum_covariance=momentum_covariance,
        mechanism=data.mechanism,
        structure=structure(data.mechanism),
        gains=np.linalg.eigvalsh(cautious.marginal)[::-1],
        scale=_scale(x[:bodies], covariance[:bodies, :bodies], prior, known, likelihood.root),
        # The prior adds as many equations as there are unknowns.
        residual=float(np.sqrt(cost / max(redundancy, 1))),
        redundancy=redundancy,
        samples=data.samples,
        span=data.span,
        planar=data.mechanism.normal is not None,
        still=tuple(name for name, moves in zip(model.joint_names, data.mechanism.moving, strict=True) if not moves),
    )


def _data(kernel: MomentumKernel, runs: Sequence[list[Samples]], noise: SensorNoise) -> _Data:
    if not runs:
        raise DataError('the data hold no complete window; accepted: joint states and odometry that overlap in time')
    detectors = []
    for run in runs:
        detector = PlaneDetector(kernel.model)
        for window in run:
            detector.update(window)
        detectors.append(detector)
    planes = [detector.plane(kernel.model.links[0]) for detector in detectors]
    normal = planes[0].normal if planes[0] is not None and all(plane is not None for plane in planes) else None
    windows = [window for run in runs for window in run]
    posture, moving = _moving(windows, noise)
    mechanism = Mechanism(kernel, moving, posture, normal)
    motions = tuple(_motion(mechanism, run, noise, each) for run, each in zip(runs, detectors, strict=True))
    return _Data(
        motions=motions,
        mechanism=mechanism,
        samples=sum(map(len, windows)),
        span=float(sum(run[-1].time[-1] - run[0].time[0] for run in runs)),
    )


def _motion(mechanism: Mechanism, run: list[Samples], noise: SensorNoise, detector: PlaneDetector) -> Motion:
    kernel = mechanism.kernel
    origin = run[0].base_position[0].copy()
    parts = []
    for start in range(0, len(run), _WINDOWS_AT_ONCE):
        blocks = window_rows(kernel, run[start : start + _WINDOWS_AT_ONCE], noise, origin)
        if mechanism.normal is not None:
            selection = detector.rows()
            blocks = blocks.restrict(selection, _in_the_plane(mechanism, selection))
        parts.append(blocks)
    return Motion(tuple(parts), origin)


def _in_the_plane(mechanism: Mechanism, selection: Array) -> Array:
    """Return the (u, u) projector on the unknowns that motion in a plane shows; of the others speaks the prior."""
    links = mechanism.kernel.unknown
    projector = np.zeros((10 * len(links) + 6,) * 2)
    for index, link in enumerate(links):
        place = slice(10 * index, 10 * index + 10)
        basis = planar_basis(mechanism, link)
        projector[place, place] = basis @ basis.T
    projector[-6:, -6:] = selection.T @ selection
    return projector


def _moving(windows: list[Samples], noise: SensorNoise) -> tuple[Array, Flags]:
    """Return where the joints are on average and which of them move."""
    means = np.array([np.mean(window.joint_position, axis=0) for window in windows])
    count = float(np.median([len(window) for window in windows]))
    return np.mean(means, axis=0), np.ptp(means, axis=0) > _MOVES * noise.joint_position / np.sqrt(count)


def _likelihood(kernel: MomentumKernel, data: _Data, prior: Prior, linear_momentum_std: float) -> Likelihood:
    momentum = NO_PRIOR * unknown_scale(kernel)[10:]
    if linear_momentum_std > 0.0:
        momentum[:3] = linear_momentum_std
    size = len(prior.mean)
    root = np.zeros((size + 6 * len(data.motions),) * 2)
    for start in range(0, size, 10):
        place = slice(start, start + 10)
        root[place, place] = _root(prior.covariance[place, place])
    root[range(size, len(root)), range(size, len(root))] = np.tile(momentum, len(data.motions))
    mean = np.concatenate((prior.mean, np.zeros(6 * len(data.motions))))
    return Likelihood(data.motions, mean, root, np.arange(0, size, 10))


def _root(covariance: Array) -> Array:
    """Return the lower triangular factor of a covariance whose entries differ widely in size."""
    size = np.sqrt(np.diag(covariance))
    return np.asarray(size[:, None] * np.linalg.cholesky(covariance / size / size[:, None]))


def _physical(x: Array, covariance: Array, kernel: MomentumKernel) -> tuple[Array, Array]:
    """Return x with links that can exist, and by how much each had to give way.

    A link that is none moves in its own metric to the nearest that is; everything else follows as the covariance says.
    """
    scale = unknown_scale(kernel)[:10]
    corrections = np.zeros(len(kernel.unknown))
    fixed = np.zeros(len(x), dtype=bool)
    for _ in range(len(kernel.unknown)):
        for index in range(len(kernel.unknown)):
            place = np.arange(10 * index, 10 * index + 10)
            body, distance = project(x[place], covariance[np.ix_(place, place)], scale)
            if distance == 0.0:
                continue
            corrections[index] = max(corrections[index], distance)
            fixed[place] = True
            change = np.linalg.solve(covariance[np.ix_(place, place)], body - x[place])
            follow = covariance[:, place] @ change
            x = np.where(fixed, x, x + follow)
            x[place] = body
    return x, corrections


def _momenta(x: Array, covariance: Array, motions: tuple[Motion, ...]) -> tuple[Array, Array]:
    """Return (P, L) of each motion, (R, 6), about the odometry origin, and their covariances, (R, 6, 6)."""
    first = len(x) - 6 * len(motions)
    values, covariances = np.zeros((len(motions), 6)), np.zeros((len(motions), 6, 6))
    for index, motion in enumerate(motions):
        place = slice(first + 6 * index, first + 6 * index + 6)
        shift = np.eye(6)
        shift[3:, :3] = skew(motion.origin)
        values[index] = shift @ x[place]
        covariances[index] = shift @ covariance[place, place] @ shift.T
    return values, covariances


def _scale(theta: Array, covariance: Array, prior: Prior, known: Eliminated, root: Array) -> Scale:
    """Return how well the common factor is known, and what of prior and data says it."""
    size = len(theta)
    masses = np.arange(0, size, 10)
    total = float(np.sum(theta[masses]))
    relative = float(np.sqrt(np.sum(covariance[np.ix_(masses, masses)]))) / total
    # Along theta itself: nothing but the factor changes.
    along = np.linalg.solve(root[:size, :size], theta)
    data = float(along @ known.marginal @ along)
    parts = [('the known bodies', max(data, 0.0))]
    for index, (link, std) in enumerate(zip(prior.links, prior.stds, strict=True)):
        if prior.given[index, 0]:
            parts.append((f'mass of {link.name}', 1.0 / std.mass**2))
        if prior.given[index, 4]:
            # A factor changes the moments alike; the products are nearly zero.
            parts.append((f'inertia of {link.name}', 3.0 / std.inertia**2))
    whole = max(sum(part for _, part in parts), 1e-300)
    shares = sorted(((name, part / whole) for name, part in parts), key=lambda each: -each[1])
    return Scale(relative, tuple(each for each in shares if each[1] > 0.01))
