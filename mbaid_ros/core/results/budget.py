"""The error budget: which share of each parameter's variance comes from what."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.parameters import PARAMETERS

SENSOR_NOISE = 'sensor noise'
MAIN_CAUSES = 'main causes of the variance'  # what `told` says
UNCHECKED = 'rests on what this motion cannot check'  # what `resting` says
GROUPS = {'mass': slice(0, 1), 'centre of mass': slice(1, 4), 'inertia': slice(4, 10)}
_MOST = 0.5  # share from which one cause is told of: it alone decides what may be known
_RESTS, _TOLD = 0.1, 5  # share from which it is told that an estimate rests on what is declared; of how many things


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Shares of the ten parameters' variances.

    An estimate errs by what sensor noise and the priors of what is not exactly known contribute. These are independent,
    so their variances add up to the whole.

    Attributes
    ----------
    causes : c names, sensor noise first: 'link:base_link', 'zero:joint6', 'origin:joint6', 'axis:joint6', 'mount', ...
    shares : (10, c) in the order of PARAMETERS, each row adding up to 1; NaN where a parameter is not determined
    unchecked : (10, c) which of them rest on a declaration that the data hardly see: if it is wrong, the parameter is
        further off than its interval says, and no residual shows it; none where not given
    """

    causes: tuple[str, ...]
    shares: Array
    unchecked: Flags = field(default_factory=lambda: np.zeros((10, 1), dtype=bool))

    def of(self, parameter: str, least: float = 1e-3) -> dict[str, float]:
        """Return the shares of one parameter, the largest first, without those below `least`; empty where not known."""
        return self._ordered(self.shares[PARAMETERS.index(parameter)], least)

    def grouped(self, std: Array, least: float = 1e-3) -> dict[str, dict[str, float]]:
        """Return the shares of mass, centre of mass and inertia as wholes, where anything of them is determined.

        The variance of a whole is the sum of its elements', so it does not depend on how the axes lie.

        Parameters
        ----------
        std : (10,) standard deviations of the parameters
        least : share of what is left out
        """
        found = {}
        for group, which in GROUPS.items():
            variances, shares = std[which] ** 2, self.shares[which]
            known = np.isfinite(variances) & np.all(np.isfinite(shares), axis=1)
            total = float(np.sum(variances[known]))
            if total > 0.0:
                found[group] = self._ordered(variances[known] @ shares[known] / total, least)
        return found

    def told(self, std: Array) -> str:
        """Return what makes the largest share of the variance of mass, centre of mass and inertia, in a line.

        Parameters
        ----------
        std : (10,) standard deviations of the parameters

        Returns
        -------
        'link base_link (62 % of mass, 40 % of inertia), zero of joint7 (26 % of centre of mass)'; empty where not known
        """
        found: dict[str, list[str]] = {}
        for group, shares in self.grouped(std, 0.0).items():
            cause, share = next(iter(shares.items()))
            found.setdefault(cause, []).append(f'{percent(share)} of {group}')
        return ', '.join(f'{short(cause)} ({", ".join(groups)})' for cause, groups in found.items())

    def resting(self) -> str:
        """Return which declarations the intervals rest on that the data hardly see, in a line as that of `told`.

        The share is the largest that one has in the variance of any parameter of a group.
        """
        found: dict[str, list[tuple[float, str]]] = {}
        shares = np.where(self.unchecked & np.isfinite(self.shares), self.shares, 0.0)
        for group, which in GROUPS.items():
            for cause, share in zip(self.causes, np.max(shares[which], axis=0), strict=True):
                if share >= _RESTS:
                    found.setdefault(cause, []).append((float(share), f'{percent(share)} of {group}'))
        order = sorted(found, key=lambda cause: -max(found[cause])[0])[:_TOLD]
        return ', '.join(f'{short(cause)} ({", ".join(text for _, text in found[cause])})' for cause in order)

    def dominant(self, std: Array) -> dict[str, dict[str, float]]:
        """Return what, other than sensor noise, makes more than half of a group's variance: by group; std (10,)."""
        found: dict[str, dict[str, float]] = {}
        for group, shares in self.grouped(std).items():
            for cause, share in shares.items():
                if cause != SENSOR_NOISE and share > _MOST:
                    found.setdefault(cause, {})[group] = share
        return found

    def left_of_std(self, times: float) -> Array:
        """Return what at least is left of each standard deviation with that many times the data of the same motion.

        Where sensor noise makes the share s of a variance V, n times the data leave at least V / (1 + (n - 1) s).

        Parameters
        ----------
        times : n, at least 1

        Returns
        -------
        (10,) relative to what they are, NaN where not determined
        """
        noise = self.shares[:, self.causes.index(SENSOR_NOISE)]
        return np.asarray(1.0 / np.sqrt(1.0 + (times - 1.0) * noise))

    def _ordered(self, row: Array, least: float) -> dict[str, float]:
        pairs = [(cause, float(share)) for cause, share in zip(self.causes, row, strict=True) if share >= least]
        return dict(sorted(pairs, key=lambda pair: -pair[1]))


_SHORT = {'zero': 'zero of {}', 'origin': 'origin of {}', 'axis': 'axis of {}', 'link': 'link {}'}

_WORDS = {
    'link': 'how well link {} is known: weigh it, or calibrate before the capture (known_links)',
    'zero': 'the zero of {}: calibrate it (known_joints)',
    'origin': 'where {} is: measure or calibrate it (known_joints)',
    'axis': 'the axis of {}: measure or calibrate it (known_joints)',
    'mount': 'where the odometry is mounted: measure it (odometry_mount)',
    'time offset': 'the offset between the stamps: more motion tells it',
    'clock drift': 'the drift between the clocks of joints and odometry: synchronise them (time_offset.drift_std)',
    'odometry scale': 'the scale of the odometry: calibrate it (odometry.scale_std)',
    'twist bias': 'the bias of the angular velocity: more motion tells it (odometry.angular_velocity_bias_std)',
    'gravity gradient': 'an orbit that is not declared: orbit.mean_motion, or 0 for orbit.undeclared_rate',
    'orbit shape': 'an orbit that may be no circle: orbit.eccentricity, or 0 for orbit.undeclared_eccentricity',
    'external torque': 'a torque from outside: shield it, or a longer motion tells it (disturbance.torque_std)',
    'target prior': 'what was given of the target (target_prior)',
    'momentum prior': 'what was given of the momentum (momentum.linear_prior_std)',
}


def short(cause: str) -> str:
    """Return a cause in a few words."""
    kind, _, name = cause.partition(':')
    return _SHORT.get(kind, '{}').format(name) if name else cause


def described(cause: str) -> str:
    """Return a cause in words, and what would help."""
    kind, _, name = cause.partition(':')
    return _WORDS[kind].format(name) if kind in _WORDS else cause


def percent(share: float) -> str:
    """Return a share in words."""
    return f'{100.0 * share:.0f} %'
