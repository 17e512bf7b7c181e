"""Joints that follow another (URDF's <mimic>): q = multiplier * q of the other + offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class Mimic:
    """What one joint follows.

    Attributes
    ----------
    joint : name of the other
    multiplier : of its position and rate
    offset : rad or m
    """

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Transmission:
    """How the n joints of a robot follow those k that move by themselves.

    Attributes
    ----------
    independent : (k,) places of these among all joints
    driver : (n,) place among the independent joints of the one that moves each joint
    multiplier, offset : (n,) 1 and 0 for an independent joint; offset in rad or m
    """

    independent: npt.NDArray[np.intp]
    driver: npt.NDArray[np.intp]
    multiplier: Array
    offset: Array

    @property
    def direct(self) -> bool:
        """Whether every joint moves by itself."""
        return len(self.independent) == len(self.driver)

    def positions(self, values: Array) -> Array:
        """Return the positions (..., n) of all joints at those (..., k) of the independent ones."""
        return values if self.direct else values[..., self.driver] * self.multiplier + self.offset

    def rates(self, values: Array) -> Array:
        """Return the rates (..., n) of all joints at those (..., k) of the independent ones."""
        return values if self.direct else values[..., self.driver] * self.multiplier


def transmission(joints: Sequence[str], mimics: Mapping[str, Mimic]) -> Transmission:
    """Return how the joints of a robot follow each other.

    Parameters
    ----------
    joints : names of the n joints
    mimics : what those that follow another do, by name

    Raises
    ------
    ModelError
        A joint follows one that does not move, or itself.
    """
    independent = [place for place, name in enumerate(joints) if name not in mimics]
    place = {joints[index]: k for k, index in enumerate(independent)}
    driver, multiplier, offset = [], [], []
    for name in joints:
        leader, gain, shift = _traced(name, mimics, place)
        driver.append(place[leader])
        multiplier.append(gain)
        offset.append(shift)
    return Transmission(
        np.array(independent, dtype=np.intp), np.array(driver, dtype=np.intp), np.array(multiplier), np.array(offset)
    )


def _traced(name: str, mimics: Mapping[str, Mimic], independent: Mapping[str, int]) -> tuple[str, float, float]:
    """Return the independent joint that moves a joint in the end, the multiplier and the offset."""
    leader, gain, shift = name, 1.0, 0.0
    for _ in range(len(mimics) + 1):
        if leader in independent:
            return leader, gain, shift
        if leader not in mimics:
            raise ModelError(
                f"joint '{name}' mimics '{leader[:60]}', which is no joint that moves; accepted: a revolute, "
                'continuous or prismatic joint'
            )
        step = mimics[leader]
        leader, gain, shift = step.joint, gain * step.multiplier, shift + gain * step.offset
    raise ModelError(f"joint '{name}' mimics joints that mimic it; accepted: one that moves by itself")
