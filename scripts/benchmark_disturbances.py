"""Write measured/disturbances.md: thrust, forces, wheels, late joints, a capture."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.data import CONFIG, NOISE, RATE, history, model, simulator_config
from benchmarks.frame import Frame, Runs, declared, number, percent
from benchmarks.honesty.paths import servicer
from benchmarks.precapture import free_urdf
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.parameters import build
from mbaid_ros.replay.campaigns.statistics import coverage
from mbaid_ros.sensor_messages import Joints, Poses, Thrust, joints_of, poses_of
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulated_run import commands
from mbaid_ros.simulation.changes import CaptureSimulation, Pulse, ThrustSimulation
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth

sys.path.insert(0, str(CONFIG.parent / 'test'))

import servicers

ROBOT, LINK, SECONDS = 'servicer7', 'link7', 60.0
_CAPTURED, _LATE = 20.0, 0.005  # s
_FORCE, _TORQUE = np.array([2.0, -2.0, 1.0]) / 3.0, np.array([1.0, 2.0, -2.0]) / 3.0  # directions


def _thrust(force: float, torque: float, begin: float, length: float, link: str = '') -> dict[str, object]:
    times = {'thrust.time': begin, 'thrust.duration': length, 'thrust.link': link, 'thrust.publish': False}
    return {**times, 'thrust.force': (force * _FORCE).tolist(), 'thrust.torque': (torque * _TORQUE).tolist()}


_WHEELS = servicers.spinning(servicer())
_SPINNING = {  # arm and wheels
    'initial.joint_positions': _WHEELS.start.tolist(),
    'motion.amplitudes': _WHEELS.amplitude.ravel().tolist(),
    'motion.frequencies': _WHEELS.frequency.ravel().tolist(),
    'motion.phases': _WHEELS.phase.ravel().tolist(),
}
_BODY = physical(servicers.alone())
_CAPTURE = {
    'capture.time': _CAPTURED,
    'capture.mass': float(_BODY[0]),
    'capture.com': _BODY[1:4].tolist(),
    'capture.inertia': _BODY[4:].tolist(),
    'capture.linear_velocity': [0.004, -0.006, 0.003],
    'capture.angular_velocity': [0.02, -0.03, 0.015],
}
SERVICER, WHEELED, UNREAD, FREE = model(ROBOT).urdf, servicers.wheeled_urdf(), servicers.unaware(), free_urdf()


@dataclass(frozen=True)
class Case:
    """A disturbance."""

    title: str
    simulator: Mapping[str, object]  # parameters of the simulator
    robot: str = SERVICER  # URDF of the simulator
    believed: str = SERVICER  # URDF of the estimator
    late: float = 0.0  # s, of the joints' stamps


CASES = {
    'none': Case('undisturbed', {}),
    'pulse': Case('pulse of 1 N s and 0.5 N m s at 30 s', _thrust(10.0, 5.0, 30.0, 0.1)),
    'inertial': Case('10 mN and 10 mN m, odometry axes', _thrust(0.01, 0.01, 0.0, SECONDS + 1.0, 'odom')),
    'body': Case('10 mN and 10 mN m, base axes', _thrust(0.01, 0.01, 0.0, SECONDS + 1.0)),
    'wheels': Case('four wheels spin up', _SPINNING, WHEELED, WHEELED),
    'wheels unread': Case('four wheels spin up, their speeds not in JointState', _SPINNING, WHEELED, UNREAD),
    'late': Case(f'joints stamped {1e3 * _LATE:g} ms late', {}, late=_LATE),
    'capture': Case(f'a capture at {_CAPTURED:g} s', _CAPTURE, FREE, FREE),
}


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    case: str  # a key of CASES
    option: str  # of the estimator, in words
    settings: tuple[tuple[str, object], ...] = ()  # parameters of the estimator
    methods: tuple[str, ...] = ('difference', 'trajectory')
    commanded: bool = False  # whether the thrust is published as a WrenchStamped


_TRAJECTORY = ('trajectory',)
_IN_ODOMETRY, _IN_BASE = ((('disturbance.constant', axes),) for axes in ('inertial', 'body'))
PLAIN = Row('none', 'nothing')
ROWS = (
    PLAIN,
    Row('none', 'a force, odometry axes', _IN_ODOMETRY, _TRAJECTORY),
    Row('none', 'a force, base axes', _IN_BASE, _TRAJECTORY),
    Row('pulse', 'detected'),
    Row('pulse', 'commanded', commanded=True),
    Row('inertial', 'detected'),
    Row('inertial', 'declared', _IN_ODOMETRY, _TRAJECTORY),
    Row('body', 'detected'),
    Row('body', 'declared', _IN_BASE, _TRAJECTORY),
    Row('wheels', 'speeds are read'),
    Row('wheels unread', 'detected'),
    Row('late', 'not modelled', (('time_offset.estimate', False),)),
    Row('late', 'estimated'),
    Row('capture', 'declared', (('capture.time', _CAPTURED), ('debris.report', True))),
)


@dataclass(frozen=True)
class Outcome(Runs):
    """Ends of runs; after a capture the errors are of the captured body (10) and its momentum before (6)."""

    error: Array  # (..., 10) or (..., 16); NaN where not determined
    std: Array
    noticed: Array  # s, when the first disturbance was reported; NaN for none
    events: Array  # number of them
    inconsistent: Array


@cache
def motion(case: str) -> tuple[RobotModel, Truth, Array, Pulse | None]:
    """Return a robot, its true motion, the true values as in Outcome, and the pulse of thrust."""
    robot = load_model(CASES[case].robot)
    simulation = make_simulation(simulator_config(ROBOT, CASES[case].simulator), robot)
    truth = simulation.advance(np.arange(round(SECONDS * RATE)) / RATE)
    sought = physical(robot.link(LINK).parameters)
    if isinstance(simulation, CaptureSimulation):
        sought = np.concatenate((_BODY, simulation.target_momentum))
    return robot, truth, sought, simulation.pulse if isinstance(simulation, ThrustSimulation) else None


def run(work: tuple[Row, str], seed: int) -> Outcome:
    """Return the end of one run: row, method."""
    row, method = work
    values = {'method': method, **EXACT, **declared(NOISE), **dict(row.settings)}
    session = Session(build(EstimatorConfig, values), CASES[row.case].believed)
    estimates = history(session, _readings(row, seed), CASES[row.case].late)
    last = estimates[-1]
    parameters, std = last.parameters, last.std
    capture = session.robot.captured(last)
    if capture is not None:
        alone = session.robot.debris(last)
        body = (np.full(10, np.nan),) * 2 if alone is None else (alone.parameters, alone.std)
        parameters = np.concatenate((body[0], capture.momentum))
        std = np.concatenate((body[1], np.sqrt(np.diag(capture.covariance))))
    noticed = next((estimate.time for estimate in estimates if estimate.events), np.nan)
    ends = noticed, len(last.events), last.status == 'inconsistent'
    return Outcome(parameters - motion(row.case)[2], std, *map(np.asarray, ends))


def _readings(row: Row, seed: int) -> list[Joints | Poses | Thrust]:
    (robot, truth, _, pulse), sensors = motion(row.case), Sensors(NOISE, seed)
    joints, base = sensors.joints(truth), sensors.base(truth)
    parts: list[Joints | Poses | Thrust] = []
    if row.commanded and pulse is not None:
        times, wrenches = zip(*commands(pulse), strict=True)
        parts = [Thrust(np.array(times), np.array(wrenches), robot.base_link)]
    return [*parts, poses_of(base, robot.base_link), joints_of(joints, robot.joint_names)]


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/disturbances.md', seeds=50)
    rows = dict.fromkeys([PLAIN, *frame.chosen(ROWS, lambda row: f'{row.case}: {row.option}')])
    for case in {row.case for row in rows}:
        motion(case)  # simulated here once; the workers inherit it
    files = {(row, method): f'{method}-{row.case}-{row.option}' for row in rows for method in row.methods}
    plain: dict[str, Outcome] = {}
    outcomes = frame.outcomes(Outcome, run, files)
    frame.tabulate(_HEADER, outcomes, lambda at, outcome: _line(*at, outcome, plain.setdefault(at[1], outcome)))


def _line(row: Row, method: str, outcome: Outcome, plain: Outcome) -> list[str]:
    known = np.isfinite(outcome.std) & np.isfinite(outcome.error)
    deviation = np.abs(np.divide(outcome.error, outcome.std, where=known, out=np.full(known.shape, np.nan)))
    share = coverage(outcome.error, outcome.std)
    ratio = widened = np.full(1, np.nan)
    if outcome.error.shape[1] == plain.error.shape[1]:
        # A parameter that some runs leave open is judged by the others.
        ratio, widened = (
            np.sqrt(np.mean(now**2, axis=0, where=known) / np.mean(before**2, axis=0))
            for now, before in ((outcome.error, plain.error), (outcome.std, plain.std))
        )
    noticed = outcome.noticed[np.isfinite(outcome.noticed)]
    return [
        CASES[row.case].title,
        method,
        row.option,
        *(number(float(value)) for value in (np.median(ratio), np.max(ratio), np.median(widened))),
        percent(float(np.mean(share))),
        percent(float(np.min(share))),
        number(float(np.nanmax(deviation)), 1),
        f'{np.mean(outcome.events):.1f} in {percent(len(noticed) / len(outcome.noticed))}',
        percent(float(np.mean(outcome.inconsistent))),
        f'{np.max(noticed):.1f} s' if len(noticed) else '-',
    ]


_HEADER = (
    *('case', 'method', 'in the model', 'RMSE over undisturbed', 'worst', 'std', 'covered', 'least', 'largest error'),
    *('events', 'inconsistent', 'by'),
)


if __name__ == '__main__':
    main()
