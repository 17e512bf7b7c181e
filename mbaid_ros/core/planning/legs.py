"""What the search varies of a motion: of each joint the legs that it goes, how long each lasts and how fast it is.

The shortest motions go at full speed nearly all the time, so what tells them apart is when they turn. In legs that is
a few numbers, of which a small change is a small change of the motion, while in speeds at given instants a turn that
comes a little later is a large change of one of them.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array

LEGS = 8  # of a joint: more turns help where the base's limit binds
NUMBERS = 2 * LEGS + 1  # of a joint: logarithms of lengths, speeds in parts of its limit, logarithm of a part of these
_SLOWER = 3.0  # that logarithm in the beginning, at most, of half of the motions: where the base binds, joints differ


def drawn_legs(count: int, joints: int, generator: np.random.Generator) -> Array:
    """Return legs of drawn lengths and directions, (count, NUMBERS, k), in half of the motions at full speed."""
    shape = (count, LEGS, joints)
    slower = generator.uniform(-_SLOWER, 0.0, (count, 1, joints))
    slower[::2] = 0.0
    return np.concatenate((generator.standard_normal(shape), generator.choice([-1.0, 1.0], shape), slower), axis=1)


def possible_legs(legs: Array) -> Array:
    """Return legs (..., NUMBERS, k) with speeds of a part of the limits at most, but for the part of all in common."""
    kept = legs.copy()
    kept[..., LEGS:-1, :] = np.clip(legs[..., LEGS:-1, :], -1.0, 1.0)
    return kept


def speeds_of(legs: Array, count: int) -> Array:
    """Return the mean speeds in each of `count` equal parts of a motion, in parts of the joints' limits, (B, count, k).

    Parameters
    ----------
    legs : (B, NUMBERS, k)
    count : number
    """
    lasting = np.exp(legs[:, :LEGS])
    lasting /= lasting.sum(axis=1, keepdims=True)
    begin = ((0, 0), (1, 0), (0, 0))
    ends, places = (np.pad(np.cumsum(each, axis=1), begin) for each in (lasting, lasting * legs[:, LEGS:-1]))
    share = np.arange(count + 1) / count
    passed = np.empty((len(legs), count + 1, legs.shape[-1]))
    for motion, joint in np.ndindex(len(legs), legs.shape[-1]):
        passed[motion, :, joint] = np.interp(share, ends[motion, :, joint], places[motion, :, joint])
    return np.asarray(np.diff(passed, axis=1) * count * np.exp(legs[:, -1:]))
