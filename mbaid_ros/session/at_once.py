"""Many messages let through the gates at once, where nothing is to be decided about any of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mbaid_ros.core.intake.stream_gate import Gate
from mbaid_ros.messages import stamp_of


def let_through(gates: Mapping[str, Gate], epoch: int, messages: Mapping[str, Sequence[Any]]) -> bool:
    """Let messages pass, all of them or none; tell whether they have passed.

    Parameters
    ----------
    gates : by topic
    epoch : that all of them have to be in
    messages : by topic, in the order in which they came
    """
    stamps = {
        name: np.array([stamp_of(message) for message in part], dtype=np.int64) for name, part in messages.items()
    }
    if not all(gate.epoch == epoch and gate.passes(stamps[name]) for name, gate in gates.items()):
        return False
    for name, gate in gates.items():
        gate.take_regular(stamps[name], messages[name])
    return True
