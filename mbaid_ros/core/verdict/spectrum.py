"""Lines in the spectrum of the innovations: something that swings, and is not rigid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.core.geometry import Array

_FEWEST = 12  # windows
_FINER = 4  # frequencies tried for each that the length of the series tells apart
_SWINGS = 2.5  # in the series at least: fewer are a drift
_PEAKS = 2
_CLEAR = 4.0  # times the median of the spectrum


def lines(series: Sequence[Array], spacing: float) -> list[float]:
    """Return the frequencies (Hz) at which the spectrum of innovations has its highest peaks, the highest first.

    Parameters
    ----------
    series : of each window, its normalised innovations
    spacing : s, from window to window
    """
    count = len(series)
    poses = min(map(len, series), default=0)
    if count < _FEWEST or not poses:
        return []
    values = np.array([each[:poses] for each in series])
    # A single large one is a jump, no swing.
    size = np.median(np.abs(values), axis=0) / 0.67
    values = np.clip(values, -4.0 * size, 4.0 * size)
    windowed = (values - np.mean(values, axis=0)) * np.hanning(count)[:, None]
    power = np.sum(np.abs(np.fft.rfft(windowed, _FINER * count, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(_FINER * count, spacing)
    inner = power[1:-1]
    peak = np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > _CLEAR * np.median(power))) + 1
    peak = peak[frequency[peak] * count * spacing > _SWINGS]
    return [float(frequency[index]) for index in peak[np.argsort(-power[peak])][:_PEAKS]]
