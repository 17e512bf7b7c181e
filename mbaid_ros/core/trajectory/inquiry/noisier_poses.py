"""Base poses and twists that are a little noisier than declared where samples do not show it: stamps that are off, say.

Such noise is as large as the base is fast. It pushes the base in any direction, and what pushes it in one only, as a
joint's far side does, has to gain more than this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbaid_ros.core.trajectory.windows.window import Window
from mbaid_ros.core.verdict.innovations import SENSORS, Innovations

# Times the declared noise: what is less is within its tolerance, and more would show in the samples.
_TOLD, _MOST = 1.3, 3.0


def noisier_poses(windows: Sequence[Window], innovations: Innovations) -> tuple[str, list[Window]]:
    """Return windows as noisy as innovations say, and that in words; no words where it is not this.

    Parameters
    ----------
    windows : in order
    innovations : of a pass over them, by which their noise grows
    """
    times = np.sqrt(np.maximum(np.nan_to_num(innovations.ratio[:4], nan=1.0), 1.0))
    large = [
        f'noise.{SENSORS[place]} is {times[place]:.1f} times too small' for place in range(4) if times[place] > _TOLD
    ]
    if not large or times.max() > _MOST:
        return '', []
    pose, twist = np.repeat(times, 3).reshape(2, 6)
    noisier = [
        replace(
            window,
            noise=replace(
                window.noise,
                pose=pose[:, None] * window.noise.pose * pose,
                twist=twist[:, None] * window.noise.twist * twist,
            ),
        )
        for window in windows
    ]
    return f'{", ".join(large)}, or poses are stamped early or late by turns', noisier
