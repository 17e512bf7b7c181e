"""What would be gained if a part of the data were not taken, for it may not be what it is taken for.

What is left out counts as if it were explained.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

from mbaid_ros.core.trajectory.filter.belief import Belief
from mbaid_ros.core.trajectory.inquiry.findings import WORTH, Suspected
from mbaid_ros.core.trajectory.inquiry.misread_twists import misread_twist
from mbaid_ros.core.trajectory.inquiry.misreadings import FITTED, as_described
from mbaid_ros.core.trajectory.inquiry.slipped_readings import slipped_readings
from mbaid_ros.core.trajectory.inquiry.stopped_readings import stopped_readings
from mbaid_ros.core.trajectory.inquiry.wide_pass import WidePass, tried
from mbaid_ros.core.trajectory.windows.window import Window, without_twist
from mbaid_ros.core.unknowns.hypotheses import Hypothesis

FEWEST = 4  # windows that have to be left: fewer have hardly more numbers (six each) than body and momentum, sixteen
_TRIED = 2  # joints, of each kind: two that fail at once are rare, and each takes passes of its own

_Found = Generator[int, None, list[Suspected]]


@dataclass(frozen=True)
class LeftOut:
    """Asks what a part of the data would explain by not being there.

    Attributes
    ----------
    wide : passes what is left
    hypothesis : under which
    base : after all of the data
    """

    wide: WidePass
    hypothesis: Hypothesis
    base: Belief

    def twist(self, windows: Sequence[Window]) -> _Found:
        """Return what would be gained without a twist that is something else than the rate of the poses."""
        text = misread_twist(windows)
        yield 1
        if not text:
            return []
        return (yield from self._left(text, [without_twist(window) for window in windows], of_twist=True))

    def stopped(self, windows: Sequence[Window]) -> _Found:
        """Return what would be gained without the windows in which a joint's reading stands still."""
        found: list[Suspected] = []
        for stopped in stopped_readings(windows, self.wide.layout.kernel.model.joint_names)[:_TRIED]:
            found += yield from self._left(stopped.text, stopped.windows)
        return found

    def slipped(self, windows: Sequence[Window]) -> _Found:
        """Return what would be gained if a joint's reading had jumped."""
        found: list[Suspected] = []
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
        return [] if track is None else [Suspected(text, self.base.misfit - track.belief.misfit, of_twist=of_twist)]
