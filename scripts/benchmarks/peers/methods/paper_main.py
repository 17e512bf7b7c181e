"""The paper's main form (eq. 22, corrected) with recursive least squares, the true angular momentum given."""

from __future__ import annotations

from pathlib import Path

from benchmarks.peers.ours import replayed
from benchmarks.peers.recording import Answer, Known

NEEDS = 'true angular momentum, no linear momentum'
TUNED = 'forgetting factor 1; .99, as in the paper, is worse'


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    momentum = [float(value) for value in known.momentum[3:]]
    given = {'paper__total_angular_momentum': momentum, 'paper__forgetting_factor': 1.0}
    return replayed(bag, urdf, known, method='paper_main', **given)
