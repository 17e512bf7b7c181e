"""The package's own methods, as a user runs them: `replay` with the declared noise and uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.frame import declared
from benchmarks.peers.recording import Answer, Known
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.run import replay_bag


def replayed(bag: Path, urdf: str, known: Known, **settings: object) -> Answer:
    """Return the last estimate of a replay with parameters of the estimator, dots as two underscores."""
    given = {name.replace('__', '.'): value for name, value in settings.items()}
    values = {'target_link': known.target_link, **declared(known.noise), **known.declared, **given}
    last = replay_bag(str(bag), build(EstimatorConfig, values), known.passive_urdf or urdf, Inputs()).final
    doubt = '; '.join((last.status, *last.warnings)) if last.status not in {'estimating', 'converged'} else ''
    return Answer(last.parameters, last.covariance if np.any(np.isfinite(last.covariance)) else None, doubt)
