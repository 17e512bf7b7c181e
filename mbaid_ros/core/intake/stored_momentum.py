"""The momentum of wheels or gyros as a flight computer tells it: vectors in the axes of a link."""

from __future__ import annotations

from collections import Counter

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import JointStream

NOT_FINITE_MOMENTUM = 'stored momentum with a NaN or infinite value'
OTHER_MOMENTUM_FRAME = 'stored momentum in another frame'
NOT_ASKED_FOR = 'stored momentum is told, and nobody asks for it: set wheels.momentum_frame'


class StoredMomentum:
    """Collects what is told until it is asked for.

    Parameters
    ----------
    model : RobotModel
    frame : name of the link in whose axes it is wanted; links fixed to it are accepted as well. Empty takes nothing

    Attributes
    ----------
    taken : number of messages
    dropped : those not used, by cause
    other_frame : frame of the last one in another
    """

    def __init__(self, model: RobotModel, frame: str) -> None:
        self._turns: dict[str, Array] = {}
        if frame:
            wanted = model.link(frame)
            same = (link for link in model.links if link.body == wanted.body)
            self._turns = {link.name: wanted.rotation.T @ link.rotation for link in same}
        self._stamps: list[int] = []
        self._vectors: list[Array] = []
        self.taken = 0
        self.dropped: Counter[str] = Counter()
        self.other_frame = ''

    def take(self, frame: str, stamp: int, momentum: Array) -> None:
        """Take a (3,) momentum, N m s, in a frame's axes at a stamp, ns."""
        if not self._turns:
            self.dropped[NOT_ASKED_FOR] += 1
        elif frame not in self._turns:
            self.other_frame = frame
            self.dropped[OTHER_MOMENTUM_FRAME] += 1
        elif not np.all(np.isfinite(momentum)):
            self.dropped[NOT_FINITE_MOMENTUM] += 1
        else:
            self.taken += 1
            self._stamps.append(stamp)
            self._vectors.append(self._turns[frame] @ momentum)

    def stream(self) -> JointStream | None:
        """Return what has come since the last call, as rates of three joints without positions; None for nothing."""
        if not self._stamps:
            return None
        stamps, vectors = np.array(self._stamps, dtype=np.int64), np.array(self._vectors)
        self._stamps, self._vectors = [], []
        return JointStream(stamps, np.zeros_like(vectors), vectors)
