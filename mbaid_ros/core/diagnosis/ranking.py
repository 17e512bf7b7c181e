"""How noisy the sensors are, whatever the model: by fourth differences of samples, which no motion is left in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, log
from mbaid_ros.core.results.innovations import SENSORS, Innovations
from mbaid_ros.core.results.innovations import cause as correlated_cause
from mbaid_ros.core.results.verdict import Cause
from mbaid_ros.core.samples import Samples

CHANNELS = ('base_orientation', 'base_position', 'base_angular_velocity', 'base_linear_velocity', 'joint_position')
_WEIGHT = 70.0  # variance of a fourth difference of white noise of unit variance
_MEDIAN = 0.6745  # of a normal number's size: what makes a median a standard deviation
_FAR = 6.0  # robust standard deviations, from which a difference has an outlier in it
_FEWEST_SAMPLES = 12  # samples of a window: fewer have too few differences of fourth order for a median
_TOUCHED = 5  # differences of fourth order that a sample is in


@dataclass(frozen=True)
class Roughness:
    """What the samples of some windows say.

    Attributes
    ----------
    factor : (5,) of CHANNELS, how many times as noisy as declared; NaN where they cannot say
    outliers : share of the poses that are far off
    """

    factor: Array
    outliers: float


def roughness(windows: Sequence[Samples], joint_position: float) -> Roughness:
    """Return how noisy windows of samples are.

    Parameters
    ----------
    windows : with the noise of the base that is declared
    joint_position : rad, one standard deviation that is declared
    """
    parts = [_differences(window, joint_position) for window in windows if len(window) >= _FEWEST_SAMPLES]
    if not parts:
        return Roughness(np.full(len(CHANNELS), np.nan), 0.0)
    size = [np.abs(np.concatenate([part[channel] for part in parts])) for channel in range(len(CHANNELS))]
    factor = np.array([np.nanmedian(each) / _MEDIAN if np.isfinite(each).any() else np.nan for each in size])
    pose = np.maximum(*(np.max(size[channel], axis=1) / max(factor[channel], 1e-9) for channel in range(2)))
    return Roughness(factor, float(np.mean(pose > _FAR)) / _TOUCHED)


def _differences(window: Samples, joint_position: float) -> tuple[Array, ...]:
    """Return the fourth differences of each channel in units of their declared standard deviations."""
    middle = window.base_rotation[len(window) // 2]
    turned = log(window.base_rotation @ middle.T)
    pose, twist = (
        np.sqrt(_WEIGHT * np.mean(np.diagonal(each, axis1=1, axis2=2), axis=0))
        for each in (window.pose_covariance, window.twist_covariance)
    )
    return (
        np.diff(turned, 4, axis=0) / pose[3:],
        np.diff(window.base_position, 4, axis=0) / pose[:3],
        np.diff(window.base_angular_velocity, 4, axis=0) / twist[3:],
        np.diff(window.base_linear_velocity, 4, axis=0) / twist[:3],
        np.diff(window.joint_position, 4, axis=0) / (np.sqrt(_WEIGHT) * joint_position),
    )


_FEWEST_WINDOWS = 12  # windows: fewer hold a few swings and a trend of five numbers, and nothing beside
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
    if count < _FEWEST_WINDOWS:
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


_TOO_SMALL = 1.3  # times the declared noise, from which the declared one is wrong: nobody declares it better
_OUTLIERS = 0.002  # share of the poses, from which they are named: single ones do no harm, they are left out
NOISE = 'noise.'  # what begins with it names a parameter of the noise
# What explains anything counts so much of what it gains: where both explain all, what says how it happens leads.
CATCH_ALL = 0.95


def ranked(
    inquired: Mapping[str, tuple[float, bool]],
    innovations: Innovations,
    misfit: float,
    rough: Roughness,
    correlated: tuple[float, float],
) -> tuple[Cause, ...]:
    """Return what may be wrong.

    Parameters
    ----------
    inquired : by text what each would gain, and whether it says what happens
    innovations : of a pass in which nothing explains anything
    misfit : log-likelihood that is missing there
    rough : what the samples say of the noise
    correlated : s, over which they say that the odometry's errors are correlated beyond what is declared, and the
        log-likelihood that tells it; 0 where they are not
    """
    noise = _noise(innovations, rough)
    if noise:  # what samples show of the noise is what a pass with more of it has gained by
        of_passes = [gain for text, (gain, _) in inquired.items() if text.startswith(NOISE)]
        noise = [Cause(each.text, max(each.gain, *of_passes)) if of_passes else each for each in noise]
        inquired = {text: found for text, found in inquired.items() if not text.startswith(NOISE)}
    causes = [Cause(text, gain if physical else CATCH_ALL * gain) for text, (gain, physical) in inquired.items()]
    causes += noise
    time, gain = correlated
    if time > 0.0:
        causes.append(Cause(correlated_cause(time), misfit + gain))
    if rough.outliers > _OUTLIERS:
        share = f'{1e2 * rough.outliers:.1g}'
        causes.append(Cause(f'{share} % of the poses are outliers: look at what the odometry loses', misfit))
    return tuple(sorted(causes, key=lambda cause: -cause.gain))


def _noise(innovations: Innovations, rough: Roughness) -> list[Cause]:
    """Return that noise values are too small, if the samples are as noisy as that."""
    large = [place for place, factor in enumerate(rough.factor) if factor > _TOO_SMALL]
    if not large:
        return []
    told = ', '.join(f'noise.{CHANNELS[place]} {rough.factor[place]:.1f} times' for place in large)
    ratio = np.maximum(np.nan_to_num(innovations.ratio, nan=1.0), 1.0)
    explained = ratio - 1.0 - np.log(ratio)
    of_base = [place for place in large if CHANNELS[place] in SENSORS]
    own = (
        explained if len(of_base) < len(large) else np.where(np.isin(np.arange(len(SENSORS)), of_base), explained, 0.0)
    )
    gain = 0.5 * float(innovations.count @ own)
    advice = 'correct them, or the covariances in the messages, or set noise.estimate'
    return [Cause(f'the noise values are too small: {told}; {advice}', gain)]


# Log-likelihood, the odds of bank.MARGIN: what gains less is not named, and what leads by less leads alone no more.
WORTH = 10.0


@dataclass(frozen=True)
class Change:
    """A target that has moved in the grasp, or was exchanged for another.

    Attributes
    ----------
    time : s since the first sample, start of the window in which it was noticed
    exchanged : whether mass and momentum have changed as well
    """

    time: float
    exchanged: bool


@dataclass(frozen=True)
class CandidateCause:
    """What may be wrong.

    Attributes
    ----------
    text : in words
    gain : how much likelier that makes the data (log-likelihood)
    physical : whether it says what happens
    change : what has become of the target, where that leaves nothing unexplained
    of_twist : whether it is something wrong with the base's twist, which poses can do without
    """

    text: str
    gain: float
    physical: bool = True
    change: Change | None = None
    of_twist: bool = False


@dataclass(frozen=True)
class IsolationResult:
    """What an inquiry has come to.

    Attributes
    ----------
    causes : the likeliest first
    innovations : of the pass without jumps
    misfit : half of the sum of its normalised innovations squared, beyond what there should be
    """

    causes: tuple[CandidateCause, ...]
    innovations: Innovations
    misfit: float

    @property
    def leading(self) -> CandidateCause | None:
        """What happens, if nothing of another kind explains the data nearly as well."""
        first = next((each for each in self.causes if each.physical), None)
        if first is None:
            return None
        others = (each for each in self.causes if each is not first and not (each.of_twist and first.of_twist))
        rivals = (each.gain + WORTH if each.physical else CATCH_ALL * each.gain for each in others)
        return first if first.gain > max(rivals, default=0.0) else None
