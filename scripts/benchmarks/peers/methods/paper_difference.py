"""The paper's difference form (eq. 25, corrected) with recursive least squares and forgetting."""

from __future__ import annotations

from pathlib import Path

from benchmarks.peers.ours import replayed
from benchmarks.peers.recording import Answer, Known

NEEDS = 'no linear momentum'
TUNED = 'nothing: forgetting factor .99, as in the paper'


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    return replayed(bag, urdf, known, method='paper_difference')
