"""The rows of the benchmark: a robot, its sensors, and a difference; and the true motion of each."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.bounds import trajectory_bound
from benchmarks.data import Case, drawn, model, motion, motion_of, simulator_config, true_model
from benchmarks.honesty import robots
from benchmarks.in_mujoco import InMuJoCo
from benchmarks.model_errors import DEFAULT, attainable, settings
from benchmarks.peers import redysim
from mbaid_ros.config.estimator_parameters import EXACT
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.simulated_robot import make_initial_state, make_motion, make_simulation
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Driven
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ModelErrors

ORBIT = {'orbit.mean_motion': 1.1308e-3, 'orbit.nadir': (0.6, 0.0, 0.8), 'orbit.normal': (0.8, 0.0, -0.6)}
_AWAY = (12.0, -10.0, 13.0)  # m from the origin of the falling frame, in orbit
_PANEL, _PANEL_JOINT = 'panel', 'panel_joint'
_FREQUENCY, _DAMPING, _DEFLECTION = 0.3, 0.005, 0.01  # Hz, of critical, rad
_FREQUENCY_OFF = 0.05  # how far the declared frequency is off: the default uncertainty of this package
_STEP = 0.005  # s, of MuJoCo: agrees with the simulator to 3e-9
_PERIOD, _PACE = 20.0, 0.5  # s, between two stops; fastest pace over that of the motion without stops


@dataclass(frozen=True)
class Condition:
    """One row: several seeds of the same motion."""

    robot: str  # name of a URDF of config/, or of another file, without its ending
    level: str  # of the sensors' noise
    differs: str = ''  # from a robot that is exactly its URDF, in free fall, moved by the project's simulator
    recorded: Path | None = None  # folder with the motion as ReDySim recorded it

    @property
    def name(self) -> str:
        """Short, for tables and files."""
        return ', '.join(filter(None, (f'{Path(self.robot).name} {self.level}', self.differs)))


NOT_URDF, IN_ORBIT, STOPS = 'not its URDF', 'in orbit', 'slow with stops'
OTHER_ENGINE, PANEL, KNOWN_PANEL = 'moved by MuJoCo, torques 1 % off', 'swinging panel', 'swinging panel, declared'
CONDITIONS = (
    *(Condition(robot, level) for robot in ('servicer7', 'ets7', 'table1') for level in ('low', 'mid', 'high')),
    *(Condition('ets7', 'mid', differs) for differs in (NOT_URDF, IN_ORBIT, STOPS, OTHER_ENGINE)),
    *(Condition('servicer7', 'mid', differs) for differs in (PANEL, KNOWN_PANEL)),
)


def of_redysim(clone: Path, folder: Path) -> tuple[Condition, ...]:
    """Return the rows of a clone of ReDySim; robot descriptions go to a folder."""
    for name, own in redysim.FOLDERS.items():
        (folder / f'{name}.urdf').write_text(redysim.urdf(clone / own), encoding='utf-8')
    names = redysim.FOLDERS.items()
    return tuple(Condition(str(folder.resolve() / name), 'mid', recorded=clone / own) for name, own in names)


@dataclass(frozen=True)
class Moved:
    """A run without its sensors."""

    nominal: RobotModel  # of the URDF, the target link true
    truth: Truth
    errors: ModelErrors | None  # zeros and mount, that the sensors ignore
    moving: RobotModel
    bound: Array  # (10,) standard deviations that no unbiased method surpasses; NaN for what the motion leaves open


def moved(condition: Condition, seed: int, seconds: float) -> Moved:
    """Return the motion of a seed; it depends on the seed only where the robot is not its URDF."""
    return _not_urdf(condition, seed, seconds) if condition.differs == NOT_URDF else _moved(condition, seconds)


def declared(condition: Condition, seed: int) -> dict[str, object]:
    """Return the parameters that declare how far the robot may be off its URDF, its orbit and its passive joint."""
    if condition.differs == NOT_URDF:
        off = {name: value for name, value in settings(DEFAULT).items() if not name.startswith('noise.')}
        return {**EXACT, **off}
    if condition.differs == KNOWN_PANEL:
        frequency = _FREQUENCY * (1.0 + _FREQUENCY_OFF * np.random.default_rng([seed, 2]).normal())
        return {**EXACT, 'flexible.joints': [_PANEL_JOINT], f'flexible.{_PANEL_JOINT}.frequency': frequency}
    return {**EXACT, **(ORBIT if condition.differs == IN_ORBIT else {})}


def _not_urdf(condition: Condition, seed: int, seconds: float) -> Moved:
    robot, errors = condition.robot, drawn(condition.robot, DEFAULT, seed)
    moving = true_model(robot, errors)
    truth = _until(motion_of(robot, moving), seconds)
    return Moved(model(robot), truth, errors, moving, attainable(robot, truth, errors, DEFAULT)[0])


@cache
def _moved(condition: Condition, seconds: float) -> Moved:
    robot, differs, case = model(condition.robot), condition.differs, Case(condition.robot, condition.level)
    recorded = redysim.motion(condition.recorded) if condition.recorded else motion(condition.robot)
    plain = truth = _until(recorded, seconds)
    instants = truth.time
    moving = nominal = robot
    if differs == IN_ORBIT:
        config = simulator_config(condition.robot, {**ORBIT, 'initial.base_position': _AWAY})
        truth = make_simulation(config, robot).advance(instants)
    elif differs == STOPS:
        driven = Stopping(_driven(condition.robot))
        plain = truth = make_simulation(simulator_config(condition.robot), robot, driven).advance(instants)
    elif differs == OTHER_ENGINE:
        begin = _begin(condition.robot)
        truth = InMuJoCo(robot, _STEP).driven(_driven(condition.robot), begin, instants, robot.joint_names)
    elif differs in {PANEL, KNOWN_PANEL}:
        moving, nominal, truth = _with_panel(condition.robot, instants)
    return Moved(nominal, truth, None, moving, trajectory_bound(case, plain, (seconds + 1.0,))[0])


def _until(truth: Truth, seconds: float) -> Truth:
    return truth[: int(np.searchsorted(truth.time, seconds + 1e-9))]


def _driven(robot: str) -> Driven:
    driven = make_motion(simulator_config(robot), model(robot))
    assert isinstance(driven, Driven), f'the joints of {robot} are not driven'
    return driven


def _begin(robot: str) -> State:
    return make_initial_state(simulator_config(robot), model(robot), _driven(robot))


def _with_panel(robot: str, instants: Array) -> tuple[RobotModel, RobotModel, Truth]:
    """Return a robot with a panel on a spring, the same as its URDF has it, fixed, and the motion."""
    urdf = robots.with_panel(model(robot).urdf)
    moving, names = load_model(urdf), model(robot).joint_names
    about_hinge = moving.link(_PANEL).parameters[4]
    rate = 2.0 * np.pi * _FREQUENCY
    springs = {_PANEL_JOINT: (about_hinge * rate**2, 2.0 * _DAMPING * about_hinge * rate)}
    plain, driven = _begin(robot), _driven(robot)
    arm = np.array([name in names for name in moving.joint_names])
    position, velocity = np.full(len(arm), _DEFLECTION), np.zeros(len(arm))
    position[arm], velocity[arm] = plain.joint_position, plain.joint_velocity
    begin = replace(plain, joint_position=position, velocity=np.concatenate((plain.velocity[:6], velocity)))
    truth = InMuJoCo(moving, _STEP, springs=springs).driven(driven, begin, instants, names)
    return moving, load_model(robots.locked(urdf, _PANEL)), truth


@dataclass(frozen=True)
class Stopping(Driven):
    """A motion at half its pace that rests for half of each period, by a time of its own: s' = pace max(0, sin)^2."""

    motion: Driven
    begin: float = 0.0  # s

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n,) each."""
        whole, part = divmod(time + self.begin, _PERIOD)
        rate = 2.0 * np.pi / _PERIOD
        moving = min(part, 0.5 * _PERIOD)
        own = _PACE * (0.25 * _PERIOD * whole + 0.5 * moving - np.sin(2.0 * rate * moving) / (4.0 * rate))
        pace, change = _PACE * np.sin(rate * moving) ** 2, _PACE * rate * np.sin(2.0 * rate * moving)
        position, velocity, acceleration = self.motion.reference(own)
        return position, pace * velocity, pace * pace * acceleration + change * velocity

    def from_time(self, time: float) -> 'Stopping':
        """Return the same motion, begun at a time (s) of this one."""
        return Stopping(self.motion, self.begin + time)
