"""The paper's difference form (eq. 25, corrected) with recursive least squares."""

from __future__ import annotations

from pathlib import Path

from benchmarks.peers.ours import replayed
from benchmarks.peers.recording import Answer, Known

NEEDS = 'no linear momentum'
TUNED = 'forgetting factor 1, differences from the first sample; .99 and the previous one, as in the paper, are worse'


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    given = {'paper__forgetting_factor': 1.0, 'paper__reference': 'first'}
    return replayed(bag, urdf, known, method='paper_difference', **given)
