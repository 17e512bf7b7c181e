"""From closed windows of samples to windows of nodes, linked to their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.trajectory.nodes import AFTER, BEFORE, Nodes, averages, bridged
from mbaid_ros.core.trajectory.prediction import ANGULAR_FIRST
from mbaid_ros.core.trajectory.windows import Window, WindowNoise

_NODE = 0.05  # s, wanted spacing of nodes
_FEWEST_NODES = 5
# A joint has moved when its range is this many standard deviations of one sample; noise alone reaches about five.
_MOVED = 10.0


@dataclass(frozen=True)
class Taken:
    """What a window adds: the one before with all its neighbours, itself without the later ones, if they are linked.

    `moved` tells whether a joint has moved by more than its noise by then.
    """

    ready: Window | None
    still_open: Window | None
    moved: bool


class Gathering:
    """Gathers closed windows to a chain, what is said of which has to wait for its turn.

    Parameters
    ----------
    joints : number
    noise : of the joint sensors, and of the base where the samples carry none
    length : s, of a window

    Attributes
    ----------
    origin : (3,) m, where the base was at first: the run's origin, which positions are relative to
    """

    def __init__(self, joints: int, noise: SensorNoise, length: float) -> None:
        self._noise = noise
        self._length = length
        self.origin: Array = np.zeros(3)
        self._nodes_a_window = 0
        self._number = -1
        self._sequence: list[Nodes] = []  # nodes of up to three consecutive windows
        self._latest: WindowNoise | None = None  # of the last of them
        self._lowest = np.full(joints, np.inf)
        self._highest = np.full(joints, -np.inf)

    def take(self, windows: list[Samples]) -> list[Taken]:
        """Return what closed windows add to the chain."""
        if not self._nodes_a_window:
            self.origin = windows[0].base_position[0].copy()
            self._nodes_a_window = nodes_a_window(windows[0], self._length)
        length, count = self._length, self._nodes_a_window
        numbers = [int(np.floor((window.time[0] + 1e-9) / length)) for window in windows]
        nodes = averages(windows, np.array(numbers) * length, length / count, count, self.origin)
        taken = []
        for number, window, own in zip(numbers, windows, nodes, strict=True):
            ready, still_open = self._collect(number, own, window_noise(window, self._noise))
            moved = bool(np.any(self._highest - self._lowest > _MOVED * self._noise.joint_position))
            taken.append(Taken(ready, still_open, moved))
        return taken

    def _collect(self, number: int, nodes: Nodes | None, noise_now: WindowNoise) -> tuple[Window | None, Window | None]:
        """Take a window's nodes; return the window before, which has all its neighbours now, and the window itself."""
        linked = nodes is not None and bool(self._sequence) and number == self._number + 1
        if nodes is None or not linked or (self._sequence[-1].empty[-1] and nodes.empty[0]):
            self._sequence = []  # a gap: what comes next is linked to the past by momentum and body alone
        self._number = number
        if nodes is None or (nodes.empty[0] and not self._sequence):
            return None, None
        self._lowest = np.minimum(self._lowest, np.nanmin(nodes.joint_position, axis=0))
        self._highest = np.maximum(self._highest, np.nanmax(nodes.joint_position, axis=0))
        self._sequence = [*self._sequence[-2:], nodes]
        noise, self._latest = self._latest, noise_now
        ready = None
        if len(self._sequence) > 1 and noise is not None:
            ready = self._linked(self._sequence[:-2], self._sequence[-2], nodes[:AFTER], noise)
        still_open = None if nodes.empty[-1] else self._linked(self._sequence[:-1], nodes, nodes[:0], noise_now)
        return ready, still_open

    def _linked(self, earlier: list[Nodes], nodes: Nodes, after: Nodes, noise: WindowNoise) -> Window:
        """Return a window with the neighbours it has; the last interval of one without a successor is missing."""
        before = earlier[-1][-BEFORE:] if earlier else nodes[:0]
        number = self._number - 1 if len(after) else self._number
        # An empty node is bridged from both sides: at the outer ends it is none of the neighbours.
        before = before[1:] if len(before) and before.empty[0] else before
        after = after[:-1] if len(after) and after.empty[-1] else after
        return Window(
            nodes=bridged(Nodes.concatenate([before, nodes, after])),
            inside=slice(len(before), len(before) + len(nodes) - (0 if len(after) else 1)),
            spacing=self._length / self._nodes_a_window,
            noise=noise,
            start=number * self._length,
            fresh=not earlier,
        )


def nodes_a_window(window: Samples, length: float) -> int:
    """Return how many nodes a window is cut into: near 50 ms each, and no fewer samples than nodes.

    Parameters
    ----------
    window : the first one
    length : s
    """
    spacing = float(np.median(np.diff(window.time))) if len(window) > 1 else length
    return max(round(length / max(_NODE, spacing)), _FEWEST_NODES)


def window_noise(window: Samples, noise: SensorNoise) -> WindowNoise:
    """Return the noise of a window's means; a twist's covariance as given, whether or not it is measured."""
    return WindowNoise(
        samples=len(window),
        joint_position=noise.joint_position,
        pose=np.mean(window.pose_covariance, axis=0)[ANGULAR_FIRST[:, None], ANGULAR_FIRST],
        twist=np.mean(window.twist_covariance, axis=0)[ANGULAR_FIRST[:, None], ANGULAR_FIRST],
    )
