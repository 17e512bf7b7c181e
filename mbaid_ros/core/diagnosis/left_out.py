"""What would be gained if a part of the data were not taken, for it may not be what it is taken for.

What is left out counts as if it were explained.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.diagnosis.conventions import FITTED, as_described
from mbaid_ros.core.diagnosis.encoders import slipped_readings, stopped_readings
from mbaid_ros.core.diagnosis.ranking import WORTH, CandidateCause
from mbaid_ros.core.diagnosis.twist_conventions import twist_convention_error
from mbaid_ros.core.diagnosis.wider_priors import WiderPriors, tried
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.filter.window import Window, without_twist
from mbaid_ros.core.results.innovations import SENSORS, Innovations
from mbaid_ros.core.unknowns.hypotheses import Hypothesis

FEWEST = 4  # windows that have to be left: fewer have hardly more numbers (six each) than body and momentum, sixteen
_TRIED = 2  # joints, of each kind: two that fail at once are rare, and each takes passes of its own

_Found = Generator[int, None, list[CandidateCause]]


@dataclass(frozen=True)
class LeftOut:
    """Asks what a part of the data would explain by not being there.

    Attributes
    ----------
    wide : passes what is left
    hypothesis : under which
    base : after all of the data
    """

    wide: WiderPriors
    hypothesis: Hypothesis
    base: SquareRootInformation

    def twist(self, windows: Sequence[Window]) -> _Found:
        """Return what would be gained without a twist that is something else than the rate of the poses."""
        text = twist_convention_error(windows)
        yield 1
        if not text:
            return []
        return (yield from self._left(text, [without_twist(window) for window in windows], of_twist=True))

    def stopped(self, windows: Sequence[Window]) -> _Found:
        """Return what would be gained without the windows in which a joint's reading stands still."""
        found: list[CandidateCause] = []
        for stopped in stopped_readings(windows, self.wide.layout.kernel.model.joint_names)[:_TRIED]:
            found += yield from self._left(stopped.text, stopped.windows)
        return found

    def slipped(self, windows: Sequence[Window]) -> _Found:
        """Return what would be gained if a joint's reading had jumped."""
        found: list[CandidateCause] = []
        for slipped in slipped_readings(windows, self.wide.layout.kernel.model.joint_names)[:_TRIED]:
            jumped = yield from self._left(slipped.text, slipped.windows)
            if jumped:
                # A contact jolts the joints, and is left out with the same windows.
                still = yield from self._left(slipped.text, slipped.as_read)
                found += [one for one, other in zip(jumped, still, strict=False) if one.gain > other.gain + WORTH]
        return found

    def _left(self, text: str, windows: Sequence[Window], *, of_twist: bool = False) -> _Found:
        if len(windows) < FEWEST:
            return []
        # The run has been led astray by what is left out.
        point = as_described(self.wide.layout, windows)
        yield FITTED
        track = yield from tried(self.wide.repeated(windows, point, self.hypothesis))
        return (
            [] if track is None else [CandidateCause(text, self.base.misfit - track.belief.misfit, of_twist=of_twist)]
        )


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
