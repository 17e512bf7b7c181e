"""What the search varies of a motion: of each joint the legs that it goes, how long each lasts and how fast it is.

The shortest motions go at full speed nearly all the time, so what tells them apart is when they turn. In legs that is
a few numbers, of which a small change is a small change of the motion, while in speeds at given instants a turn that
comes a little later is a large change of one of them.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array

LEGS = 8  # of a joint: more turns help where the base's limit binds


def drawn_legs(count: int, joints: int, generator: np.random.Generator) -> Array:
    """Return legs at full speed, of drawn lengths and directions, (count, 2 LEGS, k).

    The first half are logarithms of lengths, in parts of their sum; the others speeds, in parts of the joint's limit.
    """
    shape = (count, LEGS, joints)
    return np.concatenate((generator.standard_normal(shape), generator.choice([-1.0, 1.0], shape)), axis=1)


def possible_legs(legs: Array) -> Array:
    """Return legs (..., 2 LEGS, k) none of which is faster than the joint's limit."""
    kept = legs.copy()
    kept[..., LEGS:, :] = np.clip(legs[..., LEGS:, :], -1.0, 1.0)
    return kept


def speeds_of(legs: Array, count: int) -> Array:
    """Return the mean speeds in each of `count` equal parts of a motion, in parts of the joints' limits, (B, count, k).

    Parameters
    ----------
    legs : (B, 2 LEGS, k)
    count : number
    """
    lasting = np.exp(legs[:, :LEGS])
    lasting /= lasting.sum(axis=1, keepdims=True)
    begin = ((0, 0), (1, 0), (0, 0))
    ends, places = (np.pad(np.cumsum(each, axis=1), begin) for each in (lasting, lasting * legs[:, LEGS:]))
    share = np.arange(count + 1) / count
    passed = np.empty((len(legs), count + 1, legs.shape[-1]))
    for motion, joint in np.ndindex(len(legs), legs.shape[-1]):
        passed[motion, :, joint] = np.interp(share, ends[motion, :, joint], places[motion, :, joint])
    return np.diff(passed, axis=1) * count
