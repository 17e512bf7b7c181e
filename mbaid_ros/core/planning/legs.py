"""What the search varies of a motion: of each joint the legs that it goes, how long each lasts and where it ends.

The shortest motions go at full speed nearly all the time, so what tells them apart is when they turn. In legs that is
a few numbers, of which a small change is a small change of the motion, while in speeds at given instants a turn that
comes a little later is a large change of one of them. Where the base's limit binds, what counts is where the joints
are: a change of one place leaves those after it as they were.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array

LEGS = 8  # of a joint: more turns help where the base's limit binds
NUMBERS = 2 * LEGS + 1  # of a joint: logarithms of lengths, places, logarithm of a part of the speed
_SLOWER = 3.0  # that logarithm in the beginning, at most, of half of the motions: where the base binds, joints differ


def drawn_legs(count: int, joints: int, generator: np.random.Generator) -> Array:
    """Return legs of drawn lengths and directions, (count, NUMBERS, k), in half of the motions at full speed."""
    shape = (count, LEGS, joints)
    slower = generator.uniform(-_SLOWER, 0.0, (count, 1, joints))
    slower[::2] = 0.0
    lengths = generator.standard_normal(shape)
    places = np.cumsum(_lasting(lengths) * generator.choice([-1.0, 1.0], shape), axis=1)
    return np.concatenate((lengths, LEGS * places, slower), axis=1)


def _lasting(lengths: Array) -> Array:
    """Return which part of a motion each leg lasts, (B, LEGS, k), by logarithms."""
    lasting = np.exp(lengths)
    return np.asarray(lasting / lasting.sum(axis=1, keepdims=True))


def speeds_of(legs: Array, count: int) -> Array:
    """Return the mean speeds in each of `count` equal parts of a motion, in parts of the joints' limits, (B, count, k).

    Places are in units of an equal share of the way at full speed; what is faster the limits cut off later.

    Parameters
    ----------
    legs : (B, NUMBERS, k)
    count : number
    """
    begin = ((0, 0), (1, 0), (0, 0))
    ends = np.pad(np.cumsum(_lasting(legs[:, :LEGS]), axis=1), begin)
    places = np.pad(legs[:, LEGS:-1] / LEGS, begin)
    share = np.arange(count + 1) / count
    passed = np.empty((len(legs), count + 1, legs.shape[-1]))
    for motion, joint in np.ndindex(len(legs), legs.shape[-1]):
        passed[motion, :, joint] = np.interp(share, ends[motion, :, joint], places[motion, :, joint])
    return np.asarray(np.diff(passed, axis=1) * count * np.exp(legs[:, -1:]))
