"""What the tests for disturbances can find at most, from what they found when they were last made.

The sum of squared residuals rises with every window. Were something more unknown, it would rise as well, or stay: by
what the first rises, the difference between both grows at most. Until that could be of any interest, the tests need not
be made again.
"""

from __future__ import annotations

import numpy as np


class Ceiling:
    """An upper bound of how much a sum of squared residuals would fall if something more were unknown.

    It holds as long as windows are only added to one quadratic form.
    """

    def __init__(self) -> None:
        self._fall = np.inf
        self._cost = 0.0
        self._form = -1

    def after(self, cost: float, form: int) -> float:
        """Return the bound after another window.

        Parameters
        ----------
        cost : the sum of squared residuals by now
        form : number of the quadratic form that it is of
        """
        self._fall = self._fall + max(cost - self._cost, 0.0) if form == self._form else np.inf
        self._cost, self._form = cost, form
        return self._fall

    def found(self, fall: float) -> None:
        """Take what the tests have found now."""
        self._fall = fall
