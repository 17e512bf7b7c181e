"""A pulse of thrust: a force and torque that are constant in the axes of a link or of the world, for a while."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Push, Surroundings
from mbaid_ros.simulation.motion import Motion
from mbaid_ros.simulation.simulation import Simulation, Truth


@dataclass(frozen=True)
class Pulse:
    """A force and torque that act on a link; or on the base, constant in the odometry frame.

    Attributes
    ----------
    begin, end : s since the start of the run, as commanded
    link : None for the odometry frame
    wrench : (6,) force, N, and torque about the frame's origin, N m, in its axes, as commanded
    scale : how much stronger it is than that
    turn : (3,) rad, rotation vector by which it is turned against that
    delay : s, by which it begins and ends late
    """

    begin: float
    end: float
    link: Link | None
    wrench: Array
    scale: float = 1.0
    turn: Array = field(default_factory=lambda: np.zeros(3))
    delay: float = 0.0

    @property
    def actual(self) -> Array:
        """The (6,) force and torque that act."""
        if self.scale == 1.0 and not self.turn.any():
            return self.wrench
        rotation = self.scale * exp(self.turn)
        return np.concatenate((rotation @ self.wrench[:3], rotation @ self.wrench[3:]))


class ThrustSimulation:
    """A run of the free-floating robot with a pulse of thrust, with the interface of Simulation.

    The integrator begins anew where the pulse begins and ends: its steps stay smooth.

    Parameters
    ----------
    model : RobotModel
    motion : of the joints
    initial : state at time 0
    step : s, of the integrator
    pulse : Pulse
    surroundings : further effects on its bodies

    Attributes
    ----------
    pulse : as given

    Raises
    ------
    ModelError
        The robot's mass matrix is singular.
    """

    def __init__(
        self,
        model: RobotModel,
        motion: Motion,
        initial: State,
        step: float,
        pulse: Pulse,
        surroundings: Surroundings | None = None,
    ) -> None:
        self._model, self._motion, self._step = model, motion, step
        self._surroundings = surroundings or Surroundings()
        self.pulse = pulse
        self._changes: list[tuple[float, Push | None]] = [
            (pulse.begin + pulse.delay, Push.on(pulse.link, pulse.actual)),
            (pulse.end + pulse.delay, None),
        ]
        self._start = 0.0
        self._simulation = Simulation(model, motion, initial, step, surroundings=surroundings)

    def advance(self, instants: Array) -> Truth:
        """Return the true motion at instants (s, in order), and forget the motion before the last of them.

        Raises
        ------
        DataError
            An instant lies before one already passed.
        ModelError
            The motion has diverged.
        """
        parts: list[Truth] = []
        while self._changes and len(instants) and instants[-1] >= self._changes[0][0]:
            time, push = self._changes.pop(0)
            early = instants < time
            part = self._now(np.append(instants[early], time))
            parts.append(part[: len(part) - 1])
            instants = instants[~early]
            self._start = time
            now = (self._motion.later(time), _state(part), self._step, push, self._surroundings.later(time))
            self._simulation = Simulation(self._model, *now)
        parts.append(self._now(instants))
        return Truth.concatenate(parts)

    def _now(self, instants: Array) -> Truth:
        return replace(self._simulation.advance(instants - self._start), time=instants)


def _state(truth: Truth) -> State:
    """Return the last of some instants as a state."""
    twist = (truth.base_linear_velocity[-1], truth.base_angular_velocity[-1], truth.joint_velocity[-1])
    return State(truth.base_position[-1], truth.base_orientation[-1], truth.joint_position[-1], np.concatenate(twist))
