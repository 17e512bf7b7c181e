"""Thrusters as they are: stronger or weaker than commanded, not quite in the direction of their command, and late.

A wrench w = (F, T) about the origin of a frame that is off by a scale s and a small turn d is (1 + s) w + d x w, force
and torque turned alike. For a force that is always in one direction this is no approximation: any other is one of these
(s is what there is more of it along the command). One that fires late by a time t lacks t times the command for as long
as that lasts: it is off by what t brings at the begin, and has it again after the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.tide import OF_A_THRUSTER
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.known_side import KnownSide


@dataclass(frozen=True, eq=False)
class Thrusters(Unknown):
    """Scale, turn (rad, in the axes of its frame) and delay (s) of each thruster less those of its command.

    Attributes
    ----------
    frames : names of the thrusters
    """

    frames: tuple[str, ...]

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return what they take off the momentum that is to be constant: that which they have brought."""
        del kernel
        return -np.moveaxis(states.thrust, 1, 2).reshape(len(states.thrust), 6, -1)

    def moved(self, side: KnownSide, value: Array) -> KnownSide:
        """Return the known side with these thrusters."""
        return replace(side, thrust=side.thrust + value if side.thrust.size else value)


def thrusters(frames: Sequence[str], scale_std: float, direction_std: float, delay_std: float) -> Thrusters:
    """Return the thrusters as an unknown.

    Parameters
    ----------
    frames : in which they are commanded
    scale_std, direction_std, delay_std : relative, rad about each axis, s; 0 is exact
    """
    deviations = np.tile([scale_std, *(direction_std,) * 3, delay_std], len(frames))
    labels = tuple(f'thrust:{frame}' for frame in frames for _ in range(OF_A_THRUSTER))
    return Thrusters(np.diag(deviations)[:, deviations > 0.0], labels, tuple(frames))
