"""Weighted least squares on the momentum equations: rows weighted by the sensors' noise, propagated through them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.peers.recording import Answer, Known, Recording, least_squares, read
from mbaid_ros.core.geometry import Array, exp

NEEDS = 'sensor noise'
TUNED = 'nothing'
_ITERATIONS = 4  # of weights and solution; the fourth changes no digit of the table


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    recording = read(bag, urdf, known)
    matrix, right_side = recording.equations()
    changes = [(a - matrix, b - right_side) for a, b in map(Recording.equations, _disturbed(recording, known))]
    weighted, wanted = matrix, right_side
    for _ in range(_ITERATIONS):
        solution, covariance = least_squares(weighted.reshape(-1, 16), wanted.ravel(), recording.scale)
        effects = np.stack([a @ solution - b for a, b in changes], axis=-1)  # (N, 6, channels), of one deviation each
        factor = np.linalg.cholesky(effects @ np.swapaxes(effects, 1, 2))
        weighted = np.linalg.solve(factor, matrix)
        wanted = np.linalg.solve(factor, right_side[..., None])[..., 0]
    return Answer.standard(solution[:10], covariance[:10, :10])


def _disturbed(recording: Recording, known: Known) -> Iterator[Recording]:
    """Yield the recording with each sensor channel off by one standard deviation."""
    noise, samples = known.noise, recording.samples
    for name in ('joint_position', 'joint_velocity', 'base_position', 'base_linear_velocity', 'base_angular_velocity'):
        values: Array = getattr(samples, name)
        for step in getattr(noise, name) * np.eye(values.shape[1]):
            yield replace(recording, samples=replace(samples, **{name: values + step}))
    for step in noise.base_orientation * np.eye(3):
        yield replace(recording, samples=replace(samples, base_rotation=exp(step) @ samples.base_rotation))
