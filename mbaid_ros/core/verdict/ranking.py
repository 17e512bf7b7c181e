"""The causes of an inquiry with those that the samples themselves show, the likeliest first."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbaid_ros.core.verdict.correlated import cause as correlated_cause
from mbaid_ros.core.verdict.innovations import SENSORS, Innovations
from mbaid_ros.core.verdict.judgement import Cause
from mbaid_ros.core.verdict.roughness import CHANNELS, Roughness

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
