"""Write measured/appendages.md: robots with panels, propellant or an elastic grasp, beside the rigid robot."""

import time
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.appendages import (
    PANELS,
    SLOSH,
    servicer,
    with_fuel,
    with_grasp,
    with_mast,
    with_panel_on_the_target,
    with_panels,
)
from benchmarks.data import CONFIG, NOISE, RATE
from benchmarks.frame import PUBLISHED, Frame, Runs, declared, number, percent, statuses
from benchmarks.honesty.runs import FAR
from benchmarks.precapture import POSTURE
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import BAND
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun

DECLARED = 0.05  # relative standard deviation of declared frequencies


@dataclass(frozen=True)
class Row:
    """A robot, its passive joints, their frequency (Hz), and the deflections at the start (rad or m)."""

    name: str
    urdf: str
    joints: tuple[str, ...] = ()
    frequency: float = 0.0
    start: tuple[float, ...] = ()
    target: str = 'link7'
    speed: float = 1.0  # of the arm, over that of the configured motion
    errors: bool = False  # whether the robot deviates from its description, as the default parameters declare it

    @property
    def frequencies(self) -> Array:
        """Of each joint, Hz; each a little higher than the one before where they are panels."""
        step = 1.03 if self.joints == PANELS else 1.0
        return np.asarray(self.frequency * step ** np.arange(len(self.joints)))


def _panels(name: str, frequency: float, swing: float, speed: float = 1.0, *, errors: bool = False) -> Row:
    text = f'two panels of 20 kg, {frequency:g} Hz{name}'
    return Row(text, with_panels(), PANELS, frequency, (swing, -0.5 * swing), speed=speed, errors=errors)


SLOW, FAST = ', the arm at 1 deg/s', ', the arm three times as fast'
ERRORS = ', links off by 1 %, joints by 1 mrad and 1 mm'
ROWS = (
    Row('none', servicer()),
    *(_panels('', each, swing) for each, swing in ((0.1, 0.02), (0.3, 0.02), (1.0, 0.006), (2.0, 0.003))),
    Row('a panel of 20 kg on the target, 0.3 Hz', with_panel_on_the_target(), PANELS[:1], 0.3, (0.02,)),
    *(
        Row(f'a grasp of {each:g} Hz', with_grasp(), ('grasp',), each, (swing,), 'target')
        for each, swing in ((3.0, 0.003), (1.0, 0.005))
    ),
    *(
        Row(f'{mass:g} kg of propellant, {each:g} Hz', with_fuel(mass), SLOSH, each, (0.02, 0.0, 0.01))
        for mass in (20.0, 2.0)
        for each in (0.1, 0.5)
    ),
    Row(f'none{SLOW}', servicer(), speed=0.2),
    _panels(SLOW, 0.3, 0.02, 0.2),
    Row(f'none{FAST}', servicer(), speed=3.0),
    _panels(FAST, 0.3, 0.02, 3.0),
    Row(f'none{ERRORS}', servicer(), errors=True),
    _panels(ERRORS, 0.3, 0.02, errors=True),
    Row(f'a mast of 18 kg, 1 Hz{ERRORS}', with_mast(), ('mast',), 1.0, (0.05,), errors=True),
)
_DRAWN = {f'model_errors.{part}': 1e-3 for part in ('zero_std', 'origin_std', 'axis_std')}
_DRAWN['model_errors.links_relative_std'] = 0.01
_OF_THE_ROBOT = ('known_links.', 'known_joints.')


@dataclass(frozen=True)
class Outcome(Runs):
    """Runs at their end."""

    # error, std: (runs, 10)
    error: Array
    std: Array
    status: Array
    nees: Array
    frequency: Array  # the largest error of a resolved frequency, in standard deviations; NaN without any
    seconds: Array  # of processor time


def run(duration: float, row: Row, seed: int) -> Outcome:
    """Return the outcome of one run of a duration (s)."""
    values = load_parameter_file(CONFIG / 'servicer7_simulator.yaml', 'simulator')
    values |= {'joint_rate': RATE, 'odometry_rate': RATE, **declared(NOISE), 'seed': seed, 'target_link': row.target}
    values |= {'flexible.joints': list(row.joints), 'model_errors.seed': seed, **(_DRAWN if row.errors else {})}
    values['motion.frequencies'] = (row.speed * np.array(values['motion.frequencies'])).tolist()
    values['initial.joint_positions'] = [*POSTURE, *row.start]
    values |= {f'flexible.{name}.frequency': each for name, each in zip(row.joints, row.frequencies, strict=True)}
    simulated = SimulatedRun(build(SimulatorConfig, values), row.urdf, BAG_TYPES)
    off = 1.0 + DECLARED * np.random.default_rng(1000 + seed).standard_normal(len(row.joints))
    given = zip(row.joints, off * row.frequencies, strict=True)
    exact = {name: each for name, each in EXACT.items() if not (row.errors and name.startswith(_OF_THE_ROBOT))}
    parameters = {**exact, **declared(NOISE), 'method': 'trajectory', 'target_link': row.target}
    parameters |= {'flexible.joints': list(row.joints), **{f'flexible.{name}.frequency': each for name, each in given}}
    session = Session(build(EstimatorConfig, parameters), row.urdf)
    for each in simulated.read(duration):
        (session.add_joint_state if each.topic == 'joint_states' else session.add_odometry)(each.message)
    begin = time.process_time()
    estimates = session.process()
    seconds = time.process_time() - begin
    nothing = np.full(10, np.nan)
    if not estimates:
        return Outcome(nothing, nothing, *map(np.array, ('no estimate', np.nan, np.nan, seconds)))
    last = estimates[-1]
    error = last.parameters - simulated.target_inertia
    nees = error @ np.linalg.pinv(last.covariance) @ error if np.isfinite(last.covariance).all() else np.nan
    swinging = [pair for pair in zip(last.flexible, row.frequencies, strict=False) if pair[0].resolved]
    far = [abs(each.frequency - true) / each.frequency_std for each, true in swinging]
    return Outcome(error, last.std, *map(np.array, (last.status, nees, max(far, default=np.nan), seconds)))


def cells(row: Row, own: Outcome, rigid: Outcome) -> tuple[str, ...]:
    """Return a line of the table."""
    claimed = np.isin(own.status, PUBLISHED)
    far = np.abs(own.error / own.std)[claimed]
    known = np.isfinite(far)
    wrong = int(np.any(np.where(known, far, 0.0) > FAR, axis=1).sum())
    # In reported deviations of the rigid robot: every parameter counts alike.
    errors = [(each.error / np.nanmean(rigid.std, axis=0))[np.isin(each.status, PUBLISHED)] for each in (own, rigid)]
    squares = [np.nanmean(each**2) if len(each) else np.nan for each in errors]
    return (
        row.name,
        statuses(own.status),
        percent(float(np.mean(far[known] < BAND))) if known.any() else '-',
        number(float(np.nanmean(own.nees[claimed])) if claimed.any() else np.nan, 1),
        number(float(np.max(far[known], initial=0.0)), 1),
        str(wrong or '-'),
        number(float(np.sqrt(squares[0] / squares[1]))),
        number(float(np.nanmax(own.frequency, initial=-np.inf)), 1),
        number(float(np.mean(own.seconds)), 1),
    )


HEADER = (
    *('appendage', 'status', 'covered', 'NEES of 10', 'largest error over its deviation', 'wrong'),
    *('RMSE over that of the rigid robot', 'largest error of a frequency over its deviation', 'processor time, s'),
)


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/appendages.md', seeds=20, seconds=40.0)
    seconds, rigid = frame.arguments.seconds, dict[tuple[float, bool], Outcome]()
    chosen = frame.chosen(ROWS, lambda each: each.name)
    needed = {(each.speed, each.errors) for each in chosen}
    rows = [each for each in ROWS if each in chosen or (not each.joints and (each.speed, each.errors) in needed)]
    outcomes = frame.outcomes(Outcome, partial(run, seconds), {row: f'appendages-{row.name}' for row in rows})
    frame.tabulate(
        HEADER,
        outcomes,
        lambda row, own: cells(row, own, rigid.setdefault((row.speed, row.errors), own)),
        'rows',
        f'{frame.arguments.seeds} seeds of {seconds:g} s',
    )


if __name__ == '__main__':
    main()
