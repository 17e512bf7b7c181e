"""Runs of servicer7 that something disturbs, as `simulate` makes them, and what a session says of them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.data import CONFIG, LEVELS, RATE, model
from benchmarks.speed_bag import START
from benchmarks.store import Runs
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.physical_consistency import is_physical
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import relative_factor
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.robot.urdf_edit import change_inertial
from mbaid_ros.outgoing import SensorMessages
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.session import Session
from mbaid_ros.simulated_robot import make_motion, make_simulation
from mbaid_ros.simulated_run import commands
from mbaid_ros.simulation.capture import CaptureSimulation
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.thrust import Pulse, ThrustSimulation

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test'))

import captured
import wheels

ROBOT, LEVEL, SECONDS = 'servicer7', 'mid', 60.0
LINK = 'link7'
_PULSED, _PULSE_LENGTH = 30.0, 0.1  # s
_CAPTURED = 20.0  # s
_LATE = 0.005  # s
_DIRECTIONS = np.array([2.0, -2.0, 1.0]) / 3.0, np.array([1.0, 2.0, -2.0]) / 3.0
_MESSAGES_AT_ONCE = 2_000  # as in `replay`


def _thrust(force: float, torque: float, begin: float, length: float, link: str = '') -> dict[str, object]:
    return {
        'thrust.time': begin,
        'thrust.duration': length,
        'thrust.link': link,
        'thrust.force': (force * _DIRECTIONS[0]).tolist(),
        'thrust.torque': (torque * _DIRECTIONS[1]).tolist(),
        'thrust.publish': False,
    }


def _servicer(_seed: int = 0) -> str:
    return model(ROBOT).urdf


def _spinning() -> dict[str, object]:
    """Return the motion of the arm with the wheels', as parameters."""
    arm = make_motion(_config({}), model(ROBOT))
    if not isinstance(arm, Sinusoids):
        raise TypeError(f'{ROBOT} does not move by sinusoids')
    motion = wheels.spinning(arm)
    return {
        'initial.joint_positions': motion.start.tolist(),
        'motion.amplitudes': motion.amplitude.ravel().tolist(),
        'motion.frequencies': motion.frequency.ravel().tolist(),
        'motion.phases': motion.phase.ravel().tolist(),
    }


def _capture() -> dict[str, object]:
    body = physical(captured.alone())
    return {
        'capture.time': _CAPTURED,
        'capture.mass': float(body[0]),
        'capture.com': body[1:4].tolist(),
        'capture.inertia': body[4:].tolist(),
        'capture.linear_velocity': [0.004, -0.006, 0.003],
        'capture.angular_velocity': [0.02, -0.03, 0.015],
    }


def _off(share: float) -> Callable[[int], str]:
    """Return what makes the robot description whose known links are wrong, by another draw for every seed."""

    def wrong(seed: int) -> str:
        rng, text = np.random.default_rng([seed, 2]), model(ROBOT).urdf
        for link in model(ROBOT).links:
            if link.name != LINK and link.parameters[0] > 0.0:
                factor = relative_factor(link.parameters, share)
                draws = (link.parameters + factor @ rng.normal(size=10) for _ in range(1000))
                text = change_inertial(text, link.name, physical(next(body for body in draws if is_physical(body))))
        return text

    return wrong


@dataclass(frozen=True)
class Case:
    """What disturbs a run.

    Attributes
    ----------
    title : for the table
    simulator : gives the parameters of the simulator
    robot : gives the URDF that is simulated
    believed : gives the URDF of the estimator, for a seed
    late : s, of the joints' stamps
    """

    title: str
    simulator: Callable[[], dict[str, object]] = dict
    robot: Callable[[], str] = _servicer
    believed: Callable[[int], str] = _servicer
    late: float = 0.0


CASES = {
    'none': Case('undisturbed'),
    'pulse': Case(f'pulse of 1 N s and 0.5 N m s at {_PULSED:g} s', lambda: _thrust(10.0, 5.0, _PULSED, _PULSE_LENGTH)),
    'inertial': Case('10 mN and 10 mN m, odometry axes', lambda: _thrust(0.01, 0.01, 0.0, SECONDS + 1.0, 'odom')),
    'body': Case('10 mN and 10 mN m, base axes', lambda: _thrust(0.01, 0.01, 0.0, SECONDS + 1.0)),
    'links 1 %': Case('known links off by 1 %', believed=_off(0.01)),
    'links 5 %': Case('known links off by 5 %', believed=_off(0.05)),
    'wheels': Case('four wheels spin up', _spinning, wheels.urdf, lambda _: wheels.urdf()),
    'wheels untold': Case(
        'four wheels spin up, their speeds not in JointState', _spinning, wheels.urdf, lambda _: wheels.unaware()
    ),
    'late': Case(f'joints stamped {1e3 * _LATE:g} ms late', late=_LATE),
    'capture': Case(
        f'a capture at {_CAPTURED:g} s', _capture, captured.with_bare_link, lambda _: captured.with_bare_link()
    ),
}


@dataclass(frozen=True)
class Said(Runs):
    """What a run, or many runs, said at the end.

    Attributes
    ----------
    error, std : (..., 10) of the target's parameters; after a capture (..., 16), of the captured body's and the
        momentum that it had before; NaN where not determined
    noticed : (...) s, when the first disturbance was reported; NaN for none
    events : (...) number of them
    wrong : (...) whether the model was said not to explain the data
    """

    error: Array
    std: Array
    noticed: Array
    events: Array
    wrong: Array


@dataclass(frozen=True)
class Motion:
    """A true motion, and what is to be found.

    Attributes
    ----------
    truth : Truth
    pulse : of thrust; None where there is none
    sought : (10,) physical parameters; after a capture (16,), with the momentum before
    robot : that moves
    """

    truth: Truth
    pulse: Pulse | None
    sought: Array
    robot: RobotModel


def _config(changes: Mapping[str, object]) -> SimulatorConfig:
    return build(SimulatorConfig, load_parameter_file(CONFIG / f'{ROBOT}_simulator.yaml', 'simulator') | dict(changes))


@cache
def motion(case: str) -> Motion:
    """Return the true motion of a case."""
    robot = load_model(CASES[case].robot())
    simulation = make_simulation(_config(CASES[case].simulator()), robot)
    truth = simulation.advance(np.arange(round(SECONDS * RATE)) / RATE)
    sought = physical(robot.link(LINK).parameters)
    if isinstance(simulation, CaptureSimulation):
        sought = np.concatenate((physical(captured.alone()), simulation.brought))
    pulse = simulation.pulse if isinstance(simulation, ThrustSimulation) else None
    return Motion(truth, pulse, sought, robot)


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    case : a key of CASES
    option : what allows for it
    settings : parameters of the estimator
    methods : that have the option
    told : whether the thrust is told, as a WrenchStamped
    """

    case: str
    option: str
    settings: Mapping[str, object] = field(default_factory=dict)
    methods: tuple[str, ...] = ('difference', 'trajectory')
    told: bool = False

    @property
    def name(self) -> str:
        """Short, for files."""
        return f'{self.case}-{self.option}'.replace(' ', '_').replace('%', 'percent')


def run(work: tuple[Row, str, int]) -> Said:
    """Return what a method says of one run: row, method, seed."""
    row, method, seed = work
    noise = LEVELS[LEVEL]
    declared = {f'noise.{name}': value for name, value in vars(noise).items()}
    values = {'method': method, **EXACT, **declared, **row.settings}
    session = Session(build(EstimatorConfig, values), CASES[row.case].believed(seed))
    history = []
    for number, (take, message) in enumerate(_messages(row, seed, session), start=1):
        take(message)
        if number % _MESSAGES_AT_ONCE == 0:
            history += session.process()
    history += session.process()
    last, sought = history[-1], motion(row.case).sought
    parameters, std = last.parameters, last.std
    capture = session.robot.captured(last)
    if capture is not None:
        alone = session.robot.debris(last)
        body = (np.full(10, np.nan),) * 2 if alone is None else (alone.parameters, alone.std)
        parameters = np.concatenate((body[0], capture.momentum))
        std = np.concatenate((body[1], np.sqrt(np.diag(capture.covariance))))
    noticed = next((estimate.time for estimate in history if estimate.events), np.nan)
    said = noticed, len(last.events), last.status == 'inconsistent'
    return Said(parameters - sought, std, *map(np.asarray, said))


def _messages(row: Row, seed: int, session: Session) -> Iterator[tuple[Callable[[Any], Any], Any]]:
    """Yield the messages of a run in order, each with what takes it."""
    moved = motion(row.case)
    sensors = Sensors(LEVELS[LEVEL], seed)
    joints, base = sensors.joints(moved.truth), sensors.base(moved.truth)
    messages = SensorMessages(BAG_TYPES, moved.robot, 'odom')
    told = commands(moved.pulse) if row.told and moved.pulse is not None else []
    for index, time in enumerate(moved.truth.time):
        stamp = START + round(time * 1e9)
        while told and told[0][0] <= time:
            begin, wrench = told.pop(0)
            yield session.add_thrust, messages.wrench(wrench, moved.robot.base_link, START + round(begin * 1e9))
        yield session.add_odometry, messages.odometry(base, index, stamp)
        yield session.add_joint_state, messages.joint_state(joints, index, stamp + round(CASES[row.case].late * 1e9))
