"""The error budget: which share of each variance is due to which cause."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.interval import PARAMETERS

SENSOR_NOISE = 'sensor noise'
MAIN_CAUSES = 'main causes of the variance'  # the heading of `ErrorBudget.main_causes`
UNOBSERVABLE = 'unobservable with this motion'  # the heading of `ErrorBudget.unobservable`
GROUPS = {'mass': slice(0, 1), 'centre of mass': slice(1, 4), 'inertia': slice(4, 10)}
_MOST = 0.5  # share from which one cause is named: it alone limits the precision
_RESTS, _NAMED = 0.1, 5  # share from which an unobservable declaration is named; how many of them
_SHORT = {'zero': 'zero of {}', 'origin': 'origin of {}', 'axis': 'axis of {}', 'link': 'link {}'}


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Shares of the ten parameters' variances: the contributions of sensor noise and the independent priors add up."""

    # c names, sensor noise first: 'link:base_link', 'zero:joint6', 'origin:joint6', 'axis:joint6', 'mount',
    causes: tuple[str, ...]
    # (10, c) in the order of PARAMETERS, each row adding up to 1; NaN where a parameter is not determined
    shares: Array
    # (10, c) which of them rest on a declaration that the data hardly see: if it is wrong, the parameter is further off
    # than its interval, and no residual shows it; none where not given
    unobserved: Flags = field(default_factory=lambda: np.zeros((10, 1), dtype=bool))

    def shares_of(self, parameter: str, least: float = 1e-3) -> dict[str, float]:
        """Return the shares of one parameter, the largest first, without those below `least`; empty where not known."""
        return self._ordered(self.shares[PARAMETERS.index(parameter)], least)

    def grouped(self, std: Array, least: float = 1e-3) -> dict[str, dict[str, float]]:
        """Return the shares, from `least` on, of mass, centre of mass and inertia as wholes, where any is determined.

        The variance of a whole is the sum of its elements', so it does not depend on how the axes lie; std (10,).
        """
        found = {}
        for group, which in GROUPS.items():
            variances, shares = std[which] ** 2, self.shares[which]
            known = np.isfinite(variances) & np.all(np.isfinite(shares), axis=1)
            total = float(np.sum(variances[known]))
            if total > 0.0:
                found[group] = self._ordered(variances[known] @ shares[known] / total, least)
        return found

    def main_causes(self, std: Array) -> str:
        """Return the largest share of each group's variance in a line, empty where not known; std (10,).

        'link base_link (62 % of mass, 40 % of inertia), zero of joint7 (26 % of centre of mass)'
        """
        found: dict[str, list[str]] = {}
        for group, shares in self.grouped(std, 0.0).items():
            cause, share = next(iter(shares.items()))
            found.setdefault(cause, []).append(f'{percent(share)} of {group}')
        return _listed(found, found)

    def unobservable(self) -> str:
        """Return the declarations that dominate the intervals and are hardly observable, in a line as by `main_causes`.

        The share is the largest that one has in the variance of any parameter of a group.
        """
        found: dict[str, list[tuple[float, str]]] = {}
        shares = np.where(self.unobserved & np.isfinite(self.shares), self.shares, 0.0)
        for group, which in GROUPS.items():
            for cause, share in zip(self.causes, np.max(shares[which], axis=0), strict=True):
                if share >= _RESTS:
                    found.setdefault(cause, []).append((float(share), f'{percent(share)} of {group}'))
        order = sorted(found, key=lambda cause: -max(found[cause])[0])[:_NAMED]
        return _listed(order, {cause: [text for _, text in found[cause]] for cause in order})

    def dominant(self, std: Array) -> dict[str, dict[str, float]]:
        """Return the sources, other than sensor noise, of more than half of a group's variance: by group; std (10,)."""
        found: dict[str, dict[str, float]] = {}
        for group, shares in self.grouped(std).items():
            for cause, share in shares.items():
                if cause != SENSOR_NOISE and share > _MOST:
                    found.setdefault(cause, {})[group] = share
        return found

    def left_of_std(self, times: float) -> Array:
        """Return the least that n = `times` times the data of the same motion leave of each standard deviation, (10,).

        Where sensor noise makes the share s of a variance V, they leave at least V / (1 + (n - 1) s). Relative, NaN
        where not determined.
        """
        noise = self.shares[:, self.causes.index(SENSOR_NOISE)]
        return np.asarray(1.0 / np.sqrt(1.0 + (times - 1.0) * noise))

    def _ordered(self, row: Array, least: float) -> dict[str, float]:
        pairs = [(cause, float(share)) for cause, share in zip(self.causes, row, strict=True) if share >= least]
        return dict(sorted(pairs, key=lambda pair: -pair[1]))


class DeferredBudget(ErrorBudget):
    """An error budget that is computed when it is read: most estimates are published or kept without anybody asking.

    Parameters
    ----------
    causes : as of `ErrorBudget`
    compute : returns its shares and the unobservable part
    """

    def __init__(self, causes: tuple[str, ...], compute: Callable[[], tuple[Array, Flags]]) -> None:
        object.__setattr__(self, 'causes', causes)
        object.__setattr__(self, '_compute', compute)

    @cached_property
    def _computed(self) -> tuple[Array, Flags]:
        computed: tuple[Array, Flags] = self.__dict__.pop('_compute')()  # with the state that it is computed of
        return computed

    @property
    def shares(self) -> Array:
        """The shares, (10, c)."""
        return self._computed[0]

    @property
    def unobserved(self) -> Flags:
        """Which of them the data hardly see, (10, c)."""
        return self._computed[1]

    def __reduce__(self) -> tuple[type[ErrorBudget], tuple[tuple[str, ...], Array, Flags]]:
        """Leave the state behind when it is sent to another process."""
        return ErrorBudget, (self.causes, self.shares, self.unobserved)


def _listed(causes: Iterable[str], shares: dict[str, list[str]]) -> str:
    return ', '.join(f'{short(cause)} ({", ".join(shares[cause])})' for cause in causes)


def short(cause: str) -> str:
    """Return a cause in a few words."""
    kind, _, name = cause.partition(':')
    return _SHORT.get(kind, '{}').format(name) if name else cause


def percent(share: float) -> str:
    """Return a share in words."""
    return f'{100.0 * share:.0f} %'
