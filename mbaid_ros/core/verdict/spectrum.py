"""Lines in the spectrum of what is not predicted: something that swings, and is not rigid."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array

_FEWEST = 12  # windows: fewer hold a few swings and a trend of five numbers, and nothing beside
_FINER = 4  # frequencies tried for each that the length of the series tells apart
_SWINGS = 2.5  # in the series at least: fewer are a drift
# Robust standard deviations (by the median) at which the series is clipped: a single large one is a jump, no swing.
_LARGEST = 4.0
_TREND = 5  # numbers of a polynomial that is no swing
_PEAKS = 2  # frequencies that are tried: each takes passes of its own
# Times the median of the spectrum: of noise, one frequency in 4000 (2^-12) is as high in one of the six numbers.
_CLEAR = 12.0


def lines(values: Array, spacing: float) -> list[float]:
    """Return the frequencies (Hz) at which a spectrum has its highest peaks, the highest first.

    Parameters
    ----------
    values : (W, k) of W windows
    spacing : s, from window to window
    """
    count = len(values)
    if count < _FEWEST:
        return []
    trend = np.vander(np.linspace(-1.0, 1.0, count), _TREND)
    left = values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0]
    # A single large one is a jump, no swing.
    size = np.median(np.abs(left), axis=0) / 0.67
    clipped = np.clip(left, -_LARGEST * size, _LARGEST * size)
    power = np.abs(np.fft.rfft(clipped * np.hanning(count)[:, None], _FINER * count, axis=0)) ** 2
    power = np.max(power / np.maximum(np.median(power, axis=0), 1e-300), axis=1)
    frequency = np.fft.rfftfreq(_FINER * count, spacing)
    inner = power[1:-1]
    peak = np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > _CLEAR)) + 1
    peak = peak[frequency[peak] * count * spacing > _SWINGS]
    return [float(frequency[index]) for index in peak[np.argsort(-power[peak])][:_PEAKS]]
