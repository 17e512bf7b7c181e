"""Windows linearised in stacks, ahead of their turn."""

from __future__ import annotations

from collections.abc import Sequence

from mbaid_ros.core.trajectory.linearised.chain import window_models
from mbaid_ros.core.trajectory.linearised.whitened import WhitenedWindow, prepared
from mbaid_ros.core.trajectory.state import Layout, Point
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.trajectory.windows.window import Stack, Window, stacked

LINEARISED = 5  # work of linearising a window, where that of one step of the filter is 1
_MOST = 128  # windows linearised at once: more gain no time, and take memory
# Windows linearised at once, at least, where as many are to come: the others cost little more than the first.
_FEWEST = 8


class LinearisationCache:
    """Windows as the filter takes them, each linearised when it is asked for, or earlier together with another.

    One numpy call costs much the same for one window as for ten. So where several windows are known to come, they are
    linearised together at the point at which the first one is asked for. That is in vain where the point moves before
    their turn: there are no more than it has served so far, or the one before did.

    Parameters
    ----------
    layout : of the state
    variables : of the filter
    """

    def __init__(self, layout: Layout, variables: Variables) -> None:
        self._layout = layout
        self._variables = variables
        self._coming: Sequence[Window] = ()
        self._turn: dict[Window, int] = {}
        self._made: dict[Window, WhitenedWindow] = {}
        self._point: Point | None = None
        self._served = 0  # windows by this point
        self._likely = 0  # by the one before

    def expect(self, windows: Sequence[Window]) -> None:
        """Take the windows that are going to be asked for, in the order of their turn."""
        if windows is not self._coming:
            self._coming = windows
            self._turn = {window: turn for turn, window in enumerate(windows)}
            self._made.clear()

    def whitened(self, window: Window, point: Point) -> WhitenedWindow:
        """Return a window, linearised at a point."""
        if point is not self._point:
            self._point, self._served, self._likely = point, 0, self._served
            self._made.clear()
        if window not in self._made:
            together = self._next(window)
            self._made.update(self.all_whitened(stacked(together), point))
        self._served += 1
        return self._made.pop(window)

    def all_whitened(self, stacks: Sequence[Stack], point: Point) -> list[tuple[Window, WhitenedWindow]]:
        """Return stacked windows in their order before they were stacked, each as it is and linearised."""
        models = window_models(self._layout, stacks, point)
        placed = dict(pair for stack in stacks for pair in zip(stack.places, stack.windows, strict=True))
        windows = [placed[place] for place in sorted(placed)]
        return list(zip(windows, prepared(models, self._variables), strict=True))

    def _next(self, window: Window) -> Sequence[Window]:
        """Return a window and those that come after it, as many as the point is likely to serve."""
        turn = self._turn.get(window)
        if turn is None:
            return [window]
        return self._coming[turn : turn + min(max(_FEWEST, self._likely - self._served, self._served), _MOST)]
