"""Instrumental variables: least squares on the momentum equations, those of nearby samples as instruments."""

from pathlib import Path

import numpy as np

from benchmarks.peers.recording import Answer, Known, read

NEEDS = 'white noise'
TUNED = 'instruments: the mean of the equations .05 to .1 s before and after'


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    recording = read(bag, urdf, known)
    matrix, right_side = recording.equations()
    shifts = (*range(-10, -4), *range(5, 11))
    instruments = np.mean([np.roll(matrix, shift, axis=0) for shift in shifts], axis=0)[10:-10].reshape(-1, 16)
    rows, values = matrix[10:-10].reshape(-1, 16), right_side[10:-10].ravel()
    inverse = np.linalg.inv(instruments.T @ rows)
    solution = inverse @ (instruments.T @ values)
    variance = np.mean((values - rows @ solution) ** 2)
    covariance = variance * inverse @ (instruments.T @ instruments) @ inverse.T
    return Answer.standard(solution[:10], covariance[:10, :10])
