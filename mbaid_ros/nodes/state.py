"""What the node `estimator` knows at present."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.session import Session


@dataclass
class State:
    """What the node knows.

    Attributes
    ----------
    session : the run, None before the first usable robot description
    problem : why the last robot description or the last data could not be used; empty: they could
    estimate : the last one
    paused : True while no samples are taken, as somebody has asked for
    active : False while a managed node is not, and takes no samples either
    stale : why the last estimate is not followed by another one; empty: it is
    advice : what motion would help most, in words; empty: none is needed or known
    plan : of the motion on ~/motion whether it reaches what is wanted, and the verdict; None: there is none
    ignored : messages not handed to a session, by reason
    """

    session: Session | None = None
    problem: str = ''
    estimate: Estimate | None = None
    paused: bool = False
    active: bool = True
    stale: str = ''
    advice: str = ''
    plan: tuple[bool, str] | None = None
    ignored: Counter[str] = field(default_factory=Counter)

    @property
    def halted(self) -> str:
        """Why no samples are taken, where that has been asked for; empty while they are."""
        if not self.active:
            return 'not active: no samples are taken'
        return 'paused: no samples are taken' if self.paused else ''

    @property
    def account(self) -> str:
        """How many of the samples that have come are in the estimate, in a sentence."""
        if self.session is None or self.estimate is None:
            return 'no sample is in an estimate'
        told = f'{self.estimate.samples} of {self.session.taken} samples are in the estimate'
        return told if self.estimate.samples == self.session.taken else f'{told}, those of complete windows'
