"""Ordinary least squares on the momentum equations: body and total momentum, every row alike."""

from pathlib import Path

from benchmarks.peers.recording import Answer, Known, least_squares, read

NEEDS = 'nothing'
TUNED = 'nothing'


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    recording = read(bag, urdf, known)
    matrix, right_side = recording.equations()
    solution, covariance = least_squares(matrix.reshape(-1, 16), right_side.ravel(), recording.scale)
    return Answer.standard(solution[:10], covariance[:10, :10])
