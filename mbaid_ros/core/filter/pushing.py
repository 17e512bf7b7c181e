"""The momentum that unknowns bring: constants, and Gauss-Markov processes with their course between two instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class MomentumChange:
    """The change of the momentum over some seconds, and of the f Gauss-Markov processes that bring a part of it."""

    brought: Array  # (p, v) by the variables at the begin
    stepped: Array  # (h, f) of the first variables with a process, when that grows by one until the end
    noise: Array  # (p, f) factor, given the processes at both ends
    kept: Array  # (f,) autocorrelation of the processes that bring momentum; 0 of others


def momentum_change(brought: Array, rate_length: float, seconds: float, variables: Variables) -> MomentumChange:
    """Return the change of the momentum over some seconds.

    A process v of unit variance and time constant T with the values v and v' at the ends of D seconds has an integral
    with mean g D (v + v') / 2 and variance D^2 (1 - g) / x, where x = D / (2 T) and g = tanh(x) / x.

    Parameters
    ----------
    brought, rate_length : (p, v) change over a length in s by constant variables
    """
    brought = brought * (seconds / rate_length)
    count = len(variables.wandering)
    stepped = np.zeros((variables.head, count))
    if not count:
        return MomentumChange(brought, stepped, np.zeros((len(brought), 0)), np.zeros(0))
    of_processes = brought[:, variables.wandering]
    half = 0.5 * seconds / variables.times[np.isfinite(variables.times)]
    share = np.tanh(half) / half
    brought[:, variables.wandering] = share * of_processes
    stepped[variables.poses :] = 0.5 * share * of_processes
    noise = of_processes * np.sqrt((1.0 - share) / half)
    return MomentumChange(brought, stepped, noise, variables.kept(seconds) * of_processes.any(axis=0))
