"""Many messages let through the gates at once, where nothing is to be decided about any of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mbaid_ros.cdr import Packets
from mbaid_ros.core.intake.stream_gate import Gate
from mbaid_ros.messages import stamps_of


def let_through(gates: Mapping[str, Gate], epoch: int, messages: Mapping[str, Sequence[Any]]) -> bool:
    """Let messages pass, all of them or none; tell whether they have passed.

    Parameters
    ----------
    gates : by topic
    epoch : that all of them have to be in
    messages : by topic, in the order in which they came: a list, or packets that stay together
    """
    stamps = {name: stamps_of(part) for name, part in messages.items()}
    if not all(gate.epoch == epoch and gate.passes(stamps[name]) for name, gate in gates.items()):
        return False
    for name, gate in gates.items():
        part = messages[name]
        gate.take_regular(stamps[name], [part] if isinstance(part, Packets) else part)
    return True
