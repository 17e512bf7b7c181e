"""The run of the filter: a start over the first windows, then one step a window."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.chain import PARAMETERS, Point, WindowModel, window_models
from mbaid_ros.core.trajectory.filter import Coordinates, Walk, prepare
from mbaid_ros.core.trajectory.nodes import Window
from mbaid_ros.core.trajectory.start import Start
from mbaid_ros.core.trajectory.tracks import Track, best, follow

# Mean normalised innovation squared from which the model is wrong rather than the run unlucky.
LARGEST_SURPRISE = 1.5
_GROWTH = 1.5  # of a young run, until all of it is linearised again
_RETRY = 2  # windows after which a start that has not settled is tried again


class Tracker:
    """Follows momentum, body and time offset through the windows, under several hypotheses of what drifts.

    The linear models are absolute, so each window may keep the linearisation point it was first seen at. While the run
    is young all windows are linearised again at the latest estimate, as often as it takes to settle.

    Attributes
    ----------
    planar : whether it takes the motion for planar
    settled : whether the latest passes over the young run have come to one point that stays

    Parameters
    ----------
    kernel : MomentumKernel
    variables : Coordinates
    uncertain : indices of the known bodies whose errors are among the variables
    walks : the hypotheses; the first is the one to beat
    pace : windows before the first estimate, and how many are linearised again while the run is young
    """

    def __init__(
        self,
        kernel: MomentumKernel,
        variables: Coordinates,
        uncertain: tuple[int, ...],
        walks: tuple[Walk, ...],
        pace: tuple[int, int],
    ) -> None:
        self._kernel = kernel
        self._variables = variables
        self._uncertain = uncertain
        self._start = Start(kernel, variables, uncertain, walks)
        self._next_pass, self._kept = pace
        self._young: list[Window] | None = []
        self._tracks: tuple[Track, ...] = ()
        self._latest: tuple[Track, ...] = ()  # with the window that is still open
        self._delay = 0.0  # s, at which the windows so far are linearised
        self.planar = len(variables.measured) < 6
        self.settled = False

    @property
    def started(self) -> bool:
        """Whether there is a state."""
        return bool(self._latest)

    @property
    def best(self) -> Track:
        """The hypothesis to report: the first, unless another one explains the data far better."""
        return best(self._latest)

    def state(self) -> tuple[Array, Array]:
        """Return mean (s,) and covariance (s, s) of the latest state under the best hypothesis."""
        return self._variables.state(self.best.belief)

    def take(self, ready: Window | None, still_open: Window | None, *, moved: bool) -> None:
        """Take the next window into the run, and what the one after it tells already into the latest state only.

        Parameters
        ----------
        ready : a window with all its neighbours; None where there is none
        still_open : the window after it, without its later neighbours
        moved : whether a joint has moved so far; before, no start is looked for
        """
        if ready is not None and self._young is not None:
            self._young.append(ready)
            if moved and len(self._young) >= self._next_pass:
                self._settle(self._young)
                ready = None
            elif len(self._young) > self._kept:
                self._young = self._young[len(self._young) // 2 :]
        self._latest = self._tracks
        if not self._tracks:
            return
        # One call for both windows: a point one window old is as good.
        windows = [window for window in (ready, still_open) if window is not None]
        models = window_models(self._kernel, windows, self._point(), self._uncertain) if windows else []
        if ready is not None:
            self._tracks = self._latest = self._step(self._tracks, ready, models[0])
        if still_open is not None:
            self._latest = self._step((best(self._tracks),), still_open, models[-1])

    def _settle(self, young: list[Window]) -> None:
        """Linearise all of the young run again; from some length on it is grown up, and no window ever is again."""
        start = self._start.settle(young, Point.of(self._mean()) if self.settled else None)
        self._tracks, point, self.settled = start
        self._delay = point.delay
        self._next_pass = self._after(len(young))
        if self._next_pass <= self._kept:
            return
        belief = best(self._tracks).belief
        if self.settled and belief.surprise < LARGEST_SURPRISE * belief.measured:
            self._young = None
        else:
            # Unsound: begin anew with the later half.
            self._young = young[len(young) // 2 :]
            self._next_pass = self._after(len(self._young))

    def _after(self, windows: int) -> int:
        """Return at how many windows to pass over all of them again."""
        return int(np.ceil(_GROWTH * windows)) if self.settled else windows + _RETRY

    def _mean(self) -> Array:
        return self._variables.state(best(self._tracks).belief)[0]

    def _point(self) -> Point:
        """Return where to linearise what follows: at the delay of the windows before, which it has to be linked to."""
        return Point(self._mean()[PARAMETERS], self._delay)

    def _step(self, tracks: tuple[Track, ...], window: Window, model: WindowModel) -> tuple[Track, ...]:
        step = prepare(model, self._variables)
        return tuple(follow(track, window, step, self._variables) for track in tracks)
