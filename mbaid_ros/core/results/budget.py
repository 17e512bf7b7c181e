"""The error budget: which share of each parameter's variance comes from what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PARAMETERS

SENSOR_NOISE = 'sensor noise'
_MOST = 0.5  # share from which one cause is told of


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Shares of the ten parameters' variances.

    An estimate errs by what sensor noise and the priors of what is not exactly known contribute. These are independent,
    so their variances add up to the whole. What is not sensor noise no further data of the same motion take away.

    Attributes
    ----------
    causes : c names, sensor noise first: 'link:base_link', 'zero:joint6', 'origin:joint6', 'axis:joint6', 'mount', ...
    shares : (10, c) in the order of PARAMETERS, each row adding up to 1; NaN where a parameter is not determined
    """

    causes: tuple[str, ...]
    shares: Array

    def of(self, parameter: str, least: float = 1e-3) -> dict[str, float]:
        """Return the shares of one parameter, the largest first, without those below `least`; empty where not known."""
        row = self.shares[PARAMETERS.index(parameter)]
        pairs = [(cause, float(share)) for cause, share in zip(self.causes, row, strict=True) if share >= least]
        return dict(sorted(pairs, key=lambda pair: -pair[1]))

    @property
    def dominant(self) -> dict[str, tuple[str, ...]]:
        """Causes other than sensor noise that make more than half of a parameter's variance, and of which ones."""
        found: dict[str, list[str]] = {}
        for parameter, row in zip(PARAMETERS, self.shares, strict=True):
            if not np.isnan(row).any() and row[1:].max(initial=0.0) > _MOST:
                found.setdefault(self.causes[1 + int(np.argmax(row[1:]))], []).append(parameter)
        return {cause: tuple(parameters) for cause, parameters in found.items()}

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each of these: what limits the estimate, and what would help."""
        return tuple(
            f'more than half of the variance of {", ".join(parameters)} is {described(cause)}'
            for cause, parameters in self.dominant.items()
        )


_WORDS = {
    'link': 'how well link {} is known: weigh it, or calibrate before the capture (known_links)',
    'zero': 'the zero of joint {}: calibrate it (known_joints)',
    'origin': 'where joint {} is: measure or calibrate it (known_joints)',
    'axis': 'the axis of joint {}: measure or calibrate it (known_joints)',
    'mount': 'where the odometry is mounted: measure it (odometry_mount)',
    'time offset': 'the offset between the stamps: more motion tells it',
    'target prior': 'what was given of the target (target_prior)',
    'momentum prior': 'what was given of the momentum (momentum.linear_prior_std)',
}


def described(cause: str) -> str:
    """Return a cause in words, and what would help."""
    kind, _, name = cause.partition(':')
    return _WORDS.get(kind, '{}').format(name or cause)
