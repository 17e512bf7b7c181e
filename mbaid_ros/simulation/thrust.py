"""A pulse of thrust: a force and torque that are constant in the axes of a link or of the world, for a while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Push, Surroundings
from mbaid_ros.simulation.motion import Motion
from mbaid_ros.simulation.simulation import ChangingSimulation, Simulation, Truth


@dataclass(frozen=True)
class Pulse:
    """A force and torque that act on a link; or on the base, constant in the odometry frame."""

    begin: float  # s since the start of the run, as commanded
    end: float  # s since the start of the run, as commanded
    link: Link | None  # None for the odometry frame
    wrench: Array  # (6,) force, N, and torque about the frame's origin, N m, in its axes, as commanded
    scale: float = 1.0  # how much stronger it is than that
    # (3,) rad, rotation vector by which it is turned against that
    turn: Array = field(default_factory=lambda: np.zeros(3))
    delay: float = 0.0  # s, by which it begins and ends late

    @property
    def actual(self) -> Array:
        """The (6,) force and torque that act."""
        if self.scale == 1.0 and not self.turn.any():
            return self.wrench
        rotation = self.scale * exp(self.turn)
        return np.concatenate((rotation @ self.wrench[:3], rotation @ self.wrench[3:]))


class ThrustSimulation(ChangingSimulation):
    """A run of the free-floating robot with a pulse of thrust, which stays in `pulse`; parameters as of Simulation."""

    def __init__(
        self,
        model: RobotModel,
        motion: Motion,
        initial: State,
        pulse: Pulse,
        surroundings: Surroundings | None = None,
    ) -> None:
        self.pulse = pulse
        around = surroundings or Surroundings()

        def change(time: float, push: Push | None) -> tuple[float, Callable[[Truth], Simulation]]:
            return time, lambda at: Simulation(model, motion.later(time), _state(at), push, around.later(time))

        super().__init__(
            Simulation(model, motion, initial, surroundings=around),
            [
                change(pulse.begin + pulse.delay, Push.on(pulse.link, pulse.actual)),
                change(pulse.end + pulse.delay, None),
            ],
        )


def _state(truth: Truth) -> State:
    """Return the last of some instants as a state."""
    twist = (truth.base_linear_velocity[-1], truth.base_angular_velocity[-1], truth.joint_velocity[-1])
    return State(truth.base_position[-1], truth.base_orientation[-1], truth.joint_position[-1], np.concatenate(twist))
