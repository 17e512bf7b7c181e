"""The simulated run: the robot's true motion at the instants asked for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array, cross, quaternion_from_rotation, rotate_back, rotation_from_quaternion
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel, express
from mbaid_ros.core.robot.momentum import momentum
from mbaid_ros.core.robot.orbit import Orbit
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.dynamics import Dynamics, State
from mbaid_ros.simulation.environment import Push, Surroundings, Wheels
from mbaid_ros.simulation.hermite import HermiteSpline
from mbaid_ros.simulation.motion import Motion

# An instant this close to a step of the integrator (in steps) is that step.
_ON_GRID = 1e-9


@dataclass(frozen=True)
class Truth(ArrayRecord):
    """The true motion at N instants.

    Attributes
    ----------
    time : (N,) s since the start of the run
    joint_position, joint_velocity, joint_effort : (N, n) rad, rad/s, N m (m, m/s, N for a prismatic joint)
    base_position : (N, 3) m, origin of the base link in the odometry frame
    base_orientation : (N, 4) unit quaternion (x, y, z, w), base link to odometry frame, continuous in time
    base_linear_velocity, base_angular_velocity : (N, 3) m/s, rad/s, of the base link's origin, in base axes
    wheel_speed : (N, w) rad/s, of wheels inside the base; none where not given
    """

    time: Array
    joint_position: Array
    joint_velocity: Array
    joint_effort: Array
    base_position: Array
    base_orientation: Array
    base_linear_velocity: Array
    base_angular_velocity: Array
    wheel_speed: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Take it that there are no wheels where nothing is said."""
        if self.wheel_speed.shape[:-1] != self.time.shape:
            object.__setattr__(self, 'wheel_speed', np.zeros((*self.time.shape, 0)))


class Simulation:
    """A run of the free-floating robot, integrated with a fixed step.

    The motion does not depend on the instants asked for, nor on how they are cut into batches: between two steps it is
    interpolated to the integrator's own order.

    Parameters
    ----------
    model : RobotModel
    motion : of the joints
    initial : state at time 0
    step : s, of the integrator
    push : constant external wrench on the robot
    surroundings : further effects on its bodies

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
        push: Push | None = None,
        surroundings: Surroundings | None = None,
    ) -> None:
        self.model = model
        self.motion = motion
        self.step = step
        # Positions count from the start: far from the odometry origin their rounding would show in the velocities.
        self._origin = initial.base_position
        around = surroundings or Surroundings()
        self._wheels = around.wheels
        self._dynamics = Dynamics(
            model,
            None if push is None else push.about(self._origin),
            around.effects(model, self._origin),
            around.springs,
        )
        start = replace(initial, base_position=np.zeros(3))
        self._first = 0  # index of the first step kept
        self._states = [start]
        self._accelerations = [self._dynamics.acceleration(start, self._torque(0.0, start))]

    def advance(self, instants: Array) -> Truth:
        """Return the true motion at instants, and forget the motion before the last of them.

        Parameters
        ----------
        instants : (N,) s, in order, none before the last one of the previous call

        Returns
        -------
        Truth

        Raises
        ------
        DataError
            An instant lies before one already passed.
        ModelError
            The motion has diverged.
        """
        whole = np.floor(instants / self.step + _ON_GRID).astype(int)
        if np.any(whole < self._first) or np.any(np.diff(instants) < 0.0):
            raise DataError('the simulation was asked for a past instant; instants in order are accepted')
        last = int(whole[-1]) if len(whole) else self._first
        self._integrate_to(last + 1)
        curve = _spline(self.step, self._states, self._accelerations)
        values, rates = curve.at(whole - self._first, np.maximum(instants / self.step - whole, 0.0))
        del self._states[: last - self._first], self._accelerations[: last - self._first]
        self._first = last
        return self._truth(instants, values, rates)

    def _integrate_to(self, last: int) -> None:
        """Extend the states kept through step number `last`."""
        for index in range(self._first + len(self._states) - 1, last):
            time = index * self.step
            state = self._dynamics.step(time, self._states[-1], self._accelerations[-1], self.step, self._torque)
            self._states.append(state)
            torque = self._torque(time + self.step, state)
            self._accelerations.append(self._dynamics.acceleration(state, torque, time + self.step))

    def _torque(self, time: float, state: State) -> Array:
        command = self.motion.command(time, state.joint_position, state.joint_velocity)
        return self._dynamics.spring_torque(state) if command is None else self._dynamics.torque(state, command, time)

    def _truth(self, instants: Array, values: Array, rates: Array) -> Truth:
        """Return the state from the interpolated curve (position, quaternion, joints) and its rates."""
        orientation = quaternions.normalised(values[:, 3:7])
        back = quaternions.conjugate(orientation)
        # w = 2 conj(q) q'; the real part is the rate of the length, which interpolation leaves at rounding's size.
        angular = 2.0 * quaternions.product(back, rates[:, 3:7])[:, :3]
        linear = quaternions.rotate(back, rates[:, :3])
        velocity = np.concatenate((linear, angular, rates[:, 7:]), axis=1)
        states = [State(*parts) for parts in zip(values[:, :3], orientation, values[:, 7:], velocity, strict=True)]
        efforts = [self._torque(float(time), state) for time, state in zip(instants, states, strict=True)]
        return Truth(
            time=np.array(instants, dtype=float),
            joint_position=values[:, 7:],
            joint_velocity=rates[:, 7:],
            joint_effort=np.array(efforts).reshape(len(instants), self.model.joints),
            base_position=values[:, :3] + self._origin,
            base_orientation=orientation,
            base_linear_velocity=linear,
            base_angular_velocity=angular,
            wheel_speed=np.zeros((len(instants), 0)) if self._wheels is None else self._wheels.speeds(instants),
        )


def _spline(step: float, states: list[State], accelerations: list[Array]) -> HermiteSpline:
    """Return base position, quaternion and joints (K, 7 + n) with their first two derivatives."""
    position = np.array([state.base_position for state in states])
    orientation = np.array([state.base_orientation for state in states])
    joints = np.array([state.joint_position for state in states])
    velocity = np.array([state.velocity for state in states])
    acceleration = np.array(accelerations)
    linear, angular = velocity[:, :3], velocity[:, 3:6]
    spin = quaternions.pure(angular)
    turning = 0.5 * quaternions.product(orientation, spin)  # q' = q w / 2
    turning_rate = 0.5 * (
        quaternions.product(turning, spin) + quaternions.product(orientation, quaternions.pure(acceleration[:, 3:6]))
    )
    # d/dt (R v) = R (v' + w x v)
    push = quaternions.rotate(orientation, acceleration[:, :3] + cross(angular, linear))
    pace = quaternions.rotate(orientation, linear)
    return HermiteSpline(
        step,
        value=np.concatenate((position, orientation, joints), axis=1),
        rate=np.concatenate((pace, turning, velocity[:, 6:]), axis=1),
        curvature=np.concatenate((push, turning_rate, acceleration[:, 6:]), axis=1),
    )


def total_momentum(model: RobotModel, truth: Truth, wheels: Wheels | None = None) -> Array:
    """Return the momentum of the whole robot, from the masses of its URDF.

    Parameters
    ----------
    model : RobotModel
    truth : of N instants
    wheels : whose momentum counts, too

    Returns
    -------
    (N, 6) array (P, L), odometry axes, L about the odometry origin: kg m/s, kg m^2/s
    """
    orientation = truth.base_orientation
    kinematics = Kinematics(model)
    configuration = kinematics.configure(rotation_from_quaternion(orientation), truth.joint_position)
    linear = quaternions.rotate(orientation, truth.base_linear_velocity)
    angular = quaternions.rotate(orientation, truth.base_angular_velocity)
    twists = kinematics.body_twists(configuration, truth.joint_velocity, np.concatenate((linear, angular), axis=-1))
    bodies = express(model.body_parameters(), configuration.rotation, configuration.position)
    total: Array = momentum(bodies, twists).sum(axis=1)
    total[:, 3:] += cross(truth.base_position, total[:, :3])
    if wheels is not None:
        total[:, 3:] += quaternions.rotate(orientation, wheels.stored(truth.wheel_speed))
    return total


def without_linear_momentum(model: RobotModel, state: State) -> State:
    """Return the state with the base's linear velocity replaced by the one that brings the robot's momentum P to zero.

    In orbit: the odometry frame then moves with the system's centre of mass.
    """
    velocity = state.velocity.copy()
    velocity[:3] = 0.0
    truth = Truth(
        time=np.zeros(1),
        joint_position=state.joint_position[None],
        joint_velocity=state.joint_velocity[None],
        joint_effort=np.zeros((1, model.joints)),
        base_position=state.base_position[None],
        base_orientation=state.base_orientation[None],
        base_linear_velocity=velocity[None, :3],
        base_angular_velocity=velocity[None, 3:6],
    )
    linear = total_momentum(model, truth)[:, :3]
    mass = model.body_parameters()[:, 0].sum()
    # P is linear in the base's velocity with the total mass as its factor.
    velocity[:3] = -quaternions.rotate(quaternions.conjugate(state.base_orientation), linear[0]) / mass
    return replace(state, velocity=velocity)


def seen_from_orbit(orbit: Orbit, truth: Truth, *, relative_twist: bool) -> Truth:
    """Return a motion in the falling frame as the frame sees it that turns with the orbit.

    Parameters
    ----------
    orbit : Orbit, the epoch at time 0
    truth : in the falling frame
    relative_twist : whether the twist is that relative to the turning frame, or stays that to the falling one
    """
    turn = orbit.turned(truth.time)
    place = rotate_back(turn, truth.base_position)
    back = quaternions.conjugate(quaternion_from_rotation(turn))
    orientation = quaternions.product(back, truth.base_orientation)
    seen = replace(truth, base_position=place, base_orientation=orientation)
    if not relative_twist:
        return seen
    to_base = quaternions.conjugate(orientation)
    rate = orbit.rate(truth.time)
    carried = cross(rate, place)
    return replace(
        seen,
        base_linear_velocity=truth.base_linear_velocity - quaternions.rotate(to_base, carried),
        base_angular_velocity=truth.base_angular_velocity - quaternions.rotate(to_base, rate),
    )
