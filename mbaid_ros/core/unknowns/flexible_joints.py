"""Joints whose far side does not go with their encoder: they give under load, lag behind, or turn unevenly.

What a joint carries is further on than is read by e = -c torque + d rate + a sin q + b cos q.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.unknowns.declaration import JointMotion, Linear

FLEXIBLE = 'flexible'
# Standard deviations of compliance (rad/(N m)), lag (s), swing (rad, rad): far below what drives have; a thousand
# times as much is plausible.
_EACH = (3e-6, 1e-5, 1e-5, 1e-5)


@dataclass(frozen=True, eq=False)
class FlexibleJoints(Linear):
    """Of each joint: compliance (rad/(N m) or m/N), lag (s), and how it swings with its own angle (rad or m)."""

    read = False
    of_joints = True

    def deflections(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return what each number adds to the position of its own joint, and to its rate."""
        sine, cosine = np.sin(motion.position), np.cos(motion.position)
        off = np.stack((-motion.torque, motion.rate, sine, cosine), axis=-1)
        changing = (-motion.torque_rate, motion.acceleration, cosine * motion.rate, -sine * motion.rate)
        joints = np.eye(off.shape[1])[:, :, None]
        shape = (*off.shape[:2], off.shape[1] * len(_EACH))
        position, rate = ((joints * part[:, :, None, :]).reshape(shape) for part in (off, np.stack(changing, axis=-1)))
        return position, rate


def flexible_joints(names: Sequence[str]) -> FlexibleJoints:
    """Return them as nearly rigid, for joints of these names."""
    labels = tuple(f'{FLEXIBLE}:{name}' for name in names for _ in _EACH)
    return FlexibleJoints(np.diag(np.tile(_EACH, len(names))), labels)
