"""What an inquiry has found to be wrong with a run."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.core.verdict.innovations import Innovations
from mbaid_ros.core.verdict.ranking import CATCH_ALL

# Log-likelihood, the odds of bank.MARGIN: what gains less is not named, and what leads by less leads alone no more.
WORTH = 10.0


@dataclass(frozen=True)
class Change:
    """A target that has moved in the grasp, or was exchanged for another.

    Attributes
    ----------
    time : s since the first sample, start of the window in which it was noticed
    exchanged : whether mass and momentum have changed as well
    """

    time: float
    exchanged: bool


@dataclass(frozen=True)
class Suspected:
    """What may be wrong.

    Attributes
    ----------
    text : in words
    gain : how much likelier that makes the data (log-likelihood)
    physical : whether it says what happens
    change : what has become of the target, where that leaves nothing unexplained
    of_twist : whether it is something wrong with the base's twist, which poses can do without
    """

    text: str
    gain: float
    physical: bool = True
    change: Change | None = None
    of_twist: bool = False


@dataclass(frozen=True)
class Found:
    """What an inquiry has come to.

    Attributes
    ----------
    causes : the likeliest first
    innovations : of the pass without jumps
    misfit : half of the sum of its normalised innovations squared, beyond what there should be
    """

    causes: tuple[Suspected, ...]
    innovations: Innovations
    misfit: float

    @property
    def leading(self) -> Suspected | None:
        """What happens, if nothing of another kind explains the data nearly as well."""
        first = next((each for each in self.causes if each.physical), None)
        if first is None:
            return None
        others = (each for each in self.causes if each is not first and not (each.of_twist and first.of_twist))
        rivals = (each.gain + WORTH if each.physical else CATCH_ALL * each.gain for each in others)
        return first if first.gain > max(rivals, default=0.0) else None
