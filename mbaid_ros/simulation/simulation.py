"""The simulated run: the robot's true motion at the instants asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.integrate import DOP853, DenseOutput

from mbaid_ros.core.geometry import Array, cross, quaternion_from_rotation, rotate_back, rotation_from_quaternion
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.model import Kinematics, RobotModel, express
from mbaid_ros.core.robot.momentum import momentum
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.errors import DataError, ModelError
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.dynamics import DIVERGED, Dynamics, State
from mbaid_ros.simulation.environment import BodyWrench, Environment, Wheels
from mbaid_ros.simulation.motion import Motion

LONGEST_STEP = 0.1  # s, of the integrator, which may be ahead by so much
_MOST = 30_000  # evaluations in a second of the run: spins of hundreds of rad/s take fewer
_RELATIVE, _ABSOLUTE = 1e-11, 1e-12  # errors of a step: momentum is conserved to 1e-9


@dataclass(frozen=True)
class Truth(ArrayRecord):
    """The true motion at N instants."""

    time: Array  # (N,) s since the start of the run
    # joint_position, joint_velocity, joint_effort: (N, n) rad, rad/s, N m (m, m/s, N for a prismatic joint)
    joint_position: Array
    joint_velocity: Array
    joint_effort: Array
    base_position: Array  # (N, 3) m, origin of the base link in the odometry frame
    base_orientation: Array  # (N, 4) unit quaternion (x, y, z, w), base link to odometry frame, continuous in time
    # base_linear_velocity, base_angular_velocity: (N, 3) m/s, rad/s, of the base link's origin, in base axes
    base_linear_velocity: Array
    base_angular_velocity: Array
    # (N, w) rad/s, of wheels inside the base; none where not given
    wheel_speed: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Default to no wheels."""
        if self.wheel_speed.shape[:-1] != self.time.shape:
            object.__setattr__(self, 'wheel_speed', np.zeros((*self.time.shape, 0)))


class Simulation:
    """A run of the free-floating robot, integrated by Dormand and Prince's method of order 8.

    The motion does not depend on the instants asked for, nor on how they are cut into batches.

    Raises ModelError: The robot's mass matrix is singular.

    Parameters
    ----------
    motion : of the joints
    initial : state at time 0
    push : constant external wrench on the robot
    environment : further effects on its bodies
    """

    def __init__(
        self,
        model: RobotModel,
        motion: Motion,
        initial: State,
        push: BodyWrench | None = None,
        environment: Environment | None = None,
    ) -> None:
        self.model = model
        self.motion = motion
        # Positions count from the start: far from the odometry origin their rounding would show in the velocities.
        self._origin = initial.base_position
        around = environment or Environment()
        self._wheels = around.wheels
        push = None if push is None else push.with_origin(self._origin)
        self._dynamics = Dynamics(model, push, around.effects(model, self._origin), around.springs)
        start = replace(initial, base_position=np.zeros(3)).array
        tolerances = {'rtol': _RELATIVE, 'atol': _ABSOLUTE, 'max_step': LONGEST_STEP}
        self._solver = DOP853(self._rates, 0.0, start, np.inf, **tolerances)
        self._steps: list[DenseOutput] = []  # those that later instants may lie in
        self._last = 0.0  # s, the last instant asked for

    def advance(self, instants: Array) -> Truth:
        """Return the true motion at instants, and forget the motion before the last of them.

        Raises DataError: An instant lies before one already passed.
        Raises ModelError: The motion has diverged.

        Parameters
        ----------
        instants : (N,) s, in order, none before the last one of the previous call
        """
        if np.any(np.diff(instants, prepend=self._last) < 0.0):
            raise DataError('the simulation was asked for a past instant; instants in order are accepted')
        self._last = float(instants[-1]) if len(instants) else self._last
        while not self._steps or self._solver.t < self._last:
            self._solver.step()
            if self._solver.status == 'failed' or self._solver.nfev > _MOST * (1.0 + self._solver.t):
                raise ModelError(DIVERGED)
            self._steps.append(self._solver.dense_output())
        ends = np.array([step.t for step in self._steps])
        within = np.searchsorted(ends, instants)
        values = np.array([self._steps[step](time) for step, time in zip(within, instants, strict=True)])
        self._steps = self._steps[int(np.searchsorted(ends, self._last)) :]
        return self._truth(instants, values.reshape(len(instants), self._solver.n))

    def _rates(self, time: float, values: Array) -> Array:
        """Return the rates of change of a state's numbers; the quaternion's is q w / 2."""
        state = State.from_array(values)
        linear = quaternions.rotate(state.base_orientation, state.velocity[:3])
        turning = 0.5 * quaternions.product(values[3:7], quaternions.pure(state.velocity[3:6]))
        acceleration = self._dynamics.acceleration(state, self._torque(time, state), time)
        return np.concatenate((linear, turning, state.joint_velocity, acceleration))

    def _torque(self, time: float, state: State) -> Array:
        command = self.motion.command(time, state.joint_position, state.joint_velocity)
        return self._dynamics.spring_torque(state) if command is None else self._dynamics.torque(state, command, time)

    def _truth(self, instants: Array, values: Array) -> Truth:
        states = [State.from_array(each) for each in values]
        efforts = [self._torque(float(time), state) for time, state in zip(instants, states, strict=True)]
        joints = self.model.joints
        velocity = values[:, 7 + joints :]
        return Truth(
            time=np.array(instants, dtype=float),
            joint_position=values[:, 7 : 7 + joints],
            joint_velocity=velocity[:, 6:],
            joint_effort=np.array(efforts).reshape(len(instants), joints),
            base_position=values[:, :3] + self._origin,
            base_orientation=quaternions.normalised(values[:, 3:7]),
            base_linear_velocity=velocity[:, :3],
            base_angular_velocity=velocity[:, 3:6],
            wheel_speed=np.zeros((len(instants), 0)) if self._wheels is None else self._wheels.speeds(instants),
        )


class PiecewiseSimulation:
    """A run whose integrator restarts at each change of the dynamics.

    Parameters
    ----------
    first : until the first change
    changes : s, and what makes the run from there on, whose time 0 it is, of the motion at it
    """

    def __init__(self, first: Simulation, changes: list[tuple[float, Callable[[Truth], Simulation]]]) -> None:
        self._simulation, self._changes, self._start = first, changes, 0.0

    def advance(self, instants: Array) -> Truth:
        """Return the true motion at instants, as Simulation does."""
        parts: list[Truth] = []
        while self._changes and len(instants) and instants[-1] >= self._changes[0][0]:
            time, change = self._changes.pop(0)
            early = instants < time
            part = self._advance_stage(np.append(instants[early], time))
            parts.append(part[: len(part) - 1])
            instants = instants[~early]
            self._start, self._simulation = time, change(part[len(part) - 1 :])
        parts.append(self._advance_stage(instants))
        return Truth.concatenate(parts)

    def _advance_stage(self, instants: Array) -> Truth:
        return replace(self._simulation.advance(instants - self._start), time=instants)


def total_momentum(model: RobotModel, truth: Truth, wheels: Wheels | None = None) -> Array:
    """Return the momentum (P, L) of the whole robot, (N, 6), odometry axes, L about the odometry origin.

    Parameters
    ----------
    truth : of N instants
    wheels : whose momentum counts, too
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
        total[:, 3:] += quaternions.rotate(orientation, wheels.momentum(truth.wheel_speed))
    return total


def without_linear_momentum(model: RobotModel, state: State) -> State:
    """Return the state with a linear velocity of the base for which the robot's momentum P is zero.

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
    """Return a motion in the falling frame as seen from the frame that turns with the orbit.

    Parameters
    ----------
    orbit : Orbit, the epoch at time 0
    truth : in the falling frame
    relative_twist : whether the twist is that relative to the turning frame, or stays that to the falling one
    """
    turn = orbit.to_inertial(truth.time)
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
