"""The words of each cause: of every unknown by its label, and of the priors of target and momentum."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.unknowns import base, bodies, environment, flexible, joints, sensors
from mbaid_ros.core.unknowns.declaration import Unknown, Words

# By kind of cause: those of every unknown, and of the priors of target and momentum.
_WORDS: dict[str, Words] = {
    'target prior': Words(remedy='the prior of the target (target_prior)'),
    'momentum prior': Words(remedy='the prior of the momentum (momentum.linear_prior_std)'),
}
for _module in (base, bodies, environment, flexible, joints, sensors):
    for _unknown in vars(_module).values():
        if isinstance(_unknown, type) and issubclass(_unknown, Unknown):
            _WORDS.update(_unknown.words)
_LARGEST_SIZE = 10.0  # that is tried (trajectory.md, eq. 8): beyond it, how many times is not known


def _words_of(cause: str) -> tuple[Words, str]:
    """Return the words of a cause's kind and the name of the thing: 'zero:elbow', or 'zero' for all zeros."""
    kind, _, name = cause.partition(':')
    return _WORDS.get(kind, Words()), name


def in_words(cause: str) -> str:
    """Return a cause of the error budget in words: 'link:arm' is link arm, 'zero:elbow' the zero of elbow."""
    kind, _, name = cause.partition(':')
    return f'{kind} {name}' if kind == 'link' else f'the {kind} of {name}' if name else kind


@lru_cache(maxsize=1024)  # asked for at each window
def kind_in_words(cause: str) -> str:
    """Return a cause of the error budget, or a kind of them, in words: 'zero' is the joints' zeros."""
    words, name = _words_of(cause)
    return words.every if words.every and not name else in_words(cause)


def remedy_text(cause: str) -> str:
    """Return a cause in words, and its remedy."""
    words, name = _words_of(cause)
    return words.remedy.format(name) or cause


def underestimated_text(cause: str, size: float) -> str:
    """Return that a thing, 'link:arm', or all of a kind, 'link', is `size` times as far off as declared."""
    words, name = _words_of(cause)
    parameter = words.parameter or 'its standard deviation'
    times = f'{size:.1f}' if size < 0.95 * _LARGEST_SIZE else f'{_LARGEST_SIZE:g} or more'
    return (
        f'{kind_in_words(cause)} {"looks" if name else "look"} {times} times as far off as declared: intervals allow '
        f'for that; raise {parameter}'
    )


def deviation_text(cause: str, value: Array) -> str:
    """Return the value that an unknown would need, by its label and numbers (k,), SI units, and the remedy."""
    words, name = _words_of(cause)
    if words.deviation is None:
        return f'{cause} is off by {np.linalg.norm(value):.3g}'
    return words.deviation(name, value)


def target_changed_text(time: float, *, exchanged: bool) -> str:
    """Return that the body moved in the grasp at a time, s, or was exchanged for another."""
    if exchanged:
        return f'another body is in the grasp since {time:.1f} s, caught or lost: identify it from then on'
    return f'the body moved in the grasp at {time:.1f} s: identify it again from then on'
