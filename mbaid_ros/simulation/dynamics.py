"""Motion of the free-floating robot: pinocchio's articulated-body algorithm under the torques of its joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel, configurations, parse
from mbaid_ros.errors import ModelError, listing
from mbaid_ros.simulation.environment import BodyPoses, BodyWrench, Effect, Springs

# Smallest eigenvalue, relative to the largest, of the joint-space inertia scaled to a unit diagonal. Rounding leaves
# 1e-16; the stiffest of the robots tested has 1e-5.
_SMALLEST_EIGENVALUE = 1e-12
# The inertia of a massless tail vanishes in every configuration; others may in a few only. Try several.
_CONFIGURATIONS_TRIED = 5

_OF_A_PLACE = ('rotation', 'translation')
DIVERGED = 'the simulated motion is not finite: masses, rates or torques are extreme'


@dataclass(frozen=True)
class State:
    """One instant of the robot's motion."""

    base_position: Array  # (3,) m, origin of the base link in the odometry frame
    base_orientation: Array  # (4,) unit quaternion (x, y, z, w), base link to odometry frame
    joint_position: Array  # (n,) rad or m; continuous joints count their turns
    velocity: Array  # (6 + n,) of the base origin (m/s), angular of the base (rad/s), both in base axes; joint rates

    @property
    def joint_velocity(self) -> Array:
        """The (n,) joint rates, rad/s or m/s."""
        return self.velocity[6:]

    @property
    def array(self) -> Array:
        """All its numbers in the order of the attributes, (13 + 2 n,)."""
        return np.concatenate((self.base_position, self.base_orientation, self.joint_position, self.velocity))

    @staticmethod
    def from_array(values: Array) -> State:
        """Return the state with these numbers, its quaternion of unit length."""
        joints = 7 + (len(values) - 13) // 2
        orientation = values[3:7] / math.sqrt(values[3:7] @ values[3:7])
        return State(values[:3], orientation, values[7:joints], values[joints:])


class Dynamics:
    """Forward and inverse dynamics of one robot, without gravity.

    Raises ModelError: The mass matrix is singular or not positive: something that moves has no inertia.

    Parameters
    ----------
    push : external wrench on it
    effects : further effects on its bodies
    springs : of joints that nothing drives
    """

    def __init__(
        self,
        model: RobotModel,
        push: BodyWrench | None = None,
        effects: Sequence[Effect] = (),
        springs: Springs | None = None,
    ) -> None:
        self.model = model
        self._springs = springs
        self._pinocchio = parse(model)
        self._data = self._pinocchio.createData()
        self._forces = pinocchio.StdVec_Force([pinocchio.Force.Zero()] * self._pinocchio.njoints)
        self._inertial = push if push is not None and push.body is None else None
        if push is not None and push.body is not None:
            self._apply_wrench(push.body, push.force, push.torque)
        self._effects = tuple(effects)
        self._pushed = np.array([force.vector for force in self._forces])[1:]
        self._refuse_singular()

    def acceleration(self, state: State, torque: Array, time: float = 0.0) -> Array:
        """Return the acceleration under joint torques.

        Raises ModelError: The result is not finite: the mass matrix is singular in this state, or the motion has
        diverged.

        Parameters
        ----------
        torque : (n,) N m, or N for a prismatic joint
        time : s, which the effects depend on

        Returns
        -------
        (6 + n,) rate of change of `State.velocity`, component by component
        """
        generalised = np.concatenate((np.zeros(6), torque))
        configuration = self._configuration(state)
        self._apply_wrenches(time, state, configuration)
        result = pinocchio.aba(self._pinocchio, self._data, configuration, state.velocity, generalised, self._forces)
        if not math.isfinite(result.sum()):
            raise ModelError(DIVERGED)
        return np.array(result)

    def torque(self, state: State, joint_acceleration: Array, time: float = 0.0) -> Array:
        """Return the joint torques that give the joints an acceleration while the base floats (computed torque).

        Raises ModelError: The inertia of the whole robot is singular in this state, so that nothing gives the base's
        acceleration.

        Parameters
        ----------
        joint_acceleration : (n,) rad/s^2 or m/s^2
        time : s, which the effects depend on

        Returns
        -------
        (n,) array, N m or N; internal, so the total momentum does not change
        """
        configuration = self._configuration(state)
        if self._effects:
            self._apply_wrenches(time, state, configuration)
        forces = (self._forces,) if self._effects else ()
        # Nothing else drives the base, nor springs their joints: their rows of the inverse dynamics give how they
        # accelerate.
        free, wanted = np.arange(6), np.zeros(6, dtype=float)
        if self._springs is not None:
            free = np.concatenate((free, 6 + self._springs.joints))
            wanted = np.concatenate((wanted, self._springs.torque(state.joint_position, state.joint_velocity)))
        acceleration = np.concatenate((np.zeros(6), joint_acceleration))
        acceleration[free] = 0.0
        motion = (self._pinocchio, self._data, configuration, state.velocity)
        missing = wanted - pinocchio.rnea(*motion, acceleration, *forces)[free]
        try:
            acceleration[free] = np.linalg.solve(self._mass_matrix(configuration)[np.ix_(free, free)], missing)
        except np.linalg.LinAlgError as error:
            raise ModelError(DIVERGED) from error
        return np.array(pinocchio.rnea(*motion, acceleration, *forces)[6:])

    def spring_torque(self, state: State) -> Array:
        """Return the torques of springs on the joints, (n,), N m or N."""
        torque = np.zeros(self.model.joints)
        if self._springs is not None:
            torque[self._springs.joints] = self._springs.torque(state.joint_position, state.joint_velocity)
        return torque

    def _apply_wrenches(self, time: float, state: State, configuration: Array) -> None:
        """Apply the external wrenches that depend on time or state in pinocchio."""
        inertial = None
        if self._inertial is not None:
            inertial = self._inertial.on_base(state.base_position, state.base_orientation)
        if self._effects:
            pinocchio.forwardKinematics(self._pinocchio, self._data, configuration)
            places = list(self._data.oMi)[1:]
            rotation, position = (np.array([getattr(each, part) for each in places]) for part in _OF_A_PLACE)
            now = BodyPoses(time, rotation, position, state.velocity[3:6])
            wrenches = self._pushed + sum(effect.wrenches(now) for effect in self._effects)
            if inertial is not None:
                wrenches[0] += np.concatenate(inertial)
            for body, wrench in enumerate(wrenches):
                self._apply_wrench(body, wrench[:3], wrench[3:])
        elif inertial is not None:
            self._apply_wrench(0, *inertial)

    def _apply_wrench(self, body: int, force: Array, torque: Array) -> None:
        """Apply an external wrench on a body, in its axes, in pinocchio."""
        # Its universe comes before the bodies.
        self._forces[body + 1] = pinocchio.Force(force, torque)

    def _configuration(self, state: State) -> Array:
        """Return pinocchio's configuration vector, in which a continuous joint is (cos, sin)."""
        configuration = configurations(self.model, state.joint_position)
        configuration[:3], configuration[3:7] = state.base_position, state.base_orientation
        return configuration

    def _mass_matrix(self, configuration: Array) -> Array:
        """Return the symmetric (6 + n, 6 + n) joint-space inertia."""
        upper = np.triu(pinocchio.crba(self._pinocchio, self._data, configuration))
        return np.asarray(upper + np.triu(upper, 1).T)

    def _refuse_singular(self) -> None:
        generator = np.random.default_rng(0)
        joints = self.model.joints
        for _ in range(_CONFIGURATIONS_TRIED):
            angles = generator.uniform(-1.0, 1.0, joints)
            upright = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), angles, np.zeros(6 + joints))
            self._refuse_singular_mass(self._mass_matrix(self._configuration(upright)))

    def _refuse_singular_mass(self, mass: Array) -> None:
        diagonal = np.diag(mass)
        idle = [name for name, own in zip(self.model.joint_names, diagonal[6:], strict=True) if not own > 0.0]
        if idle:
            message = (
                f'nothing that has inertia moves with joints {listing(idle)}; give the links they carry <inertial>'
            )
            raise ModelError(message)
        if np.all(diagonal > 0.0):
            scale = 1.0 / np.sqrt(diagonal)
            eigenvalues = np.linalg.eigvalsh(mass * scale * scale[:, None])
            if eigenvalues[0] > _SMALLEST_EIGENVALUE * eigenvalues[-1]:
                return
        message = (
            'the mass matrix of the robot is singular or not positive: check that it has mass, that the links at the '
            'ends of its chains have <inertial>, and that every inertia is that of a real body'
        )
        raise ModelError(message)
