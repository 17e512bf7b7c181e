"""What a condition is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from benchmarks.honesty.floating import World
from benchmarks.honesty.readings import Defect, clean
from benchmarks.honesty.views import View, at_once


@dataclass(frozen=True)
class Condition:
    """What is simulated, how it is seen, and what the estimator is told; everything else of it is the default.

    Attributes
    ----------
    group, name : for the table
    world : what really happens, by the seed where `varies`
    believed : the URDF of the estimator, from that of the world
    view : where the sensors look from
    defect : what is wrong with what they say
    declared : standard deviations of the noise as declared, over the true ones
    target : link to be identified; the last one where empty
    varies : whether every seed has a world of its own
    """

    group: str
    name: str
    world: Callable[[int], World]
    believed: Callable[[str], str] = str
    view: View = at_once
    defect: Defect = clean
    declared: Mapping[str, float] = field(default_factory=dict)
    target: str = ''
    varies: bool = False
