"""Write the tables of docs/explanation/orbit.md: runs in orbit, with wheels, and with a thruster off its command.

They are compared with the same runs in empty space. --rows chooses tables: grid, undeclared, circle, wheels, thruster.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
from scipy.stats import chi2

from benchmarks.data import NOISE, history, model, simulator_config, target
from benchmarks.frame import Frame, Runs, declared, provenance, statuses, table
from benchmarks.honesty.paths import sinusoids
from benchmarks.honesty.readings import read
from benchmarks.honesty.runs import messages
from benchmarks.honesty.worlds import World, float_freely
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array, Flags, unvec
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import BAND
from mbaid_ros.core.robot.orbit import Orbit
from mbaid_ros.replay.run import BAG_TYPES
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun
from mbaid_ros.simulation.simulation import Truth, seen_from_orbit

ROBOT = 'servicer7'
MEAN_MOTION = 1.1308e-3  # rad/s, at 400 km
NADIR, NORMAL = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
ANOMALY = np.pi / 3.0  # rad, at the begin of an eccentric orbit
PLACES = {'at': np.zeros(3), 'away': np.array([12.0, -10.0, 13.0])}  # m from the frame's origin: 0 and 20
PACES = {'fast': 8.0, 'slow': 0.25}  # times the sinusoids of config/: up to 20 to 40 deg/s, and 0.6 to 1.3
FRAMES = ('inertial', 'lvlh', 'hill')
# Eccentricity of an orbit that is declared without, and whether it is declared as a circle.
CIRCLES = ((0.0, True), (0.0, False), (0.001, True), (0.001, False), (0.002, False))
DURATIONS = (60.0, 300.0)  # s: a shorter run is the begin of the longer one
RATE = 20.0  # Hz
STRONGER, TURN = 1.1, np.radians(5.0)  # thrust over its command; rad from its direction, about x
_CLAIMED = ('converged', 'estimating')
_WRONG = float(chi2.isf(1e-3, 10))  # NEES that one run in a thousand exceeds
_NOTHING = np.full(10, np.nan)
Parameters = Mapping[str, object]


@dataclass(frozen=True)
class Row:
    """A row of one of the tables."""

    part: str  # which
    pace: str = ''  # of the motion
    frame: str = ''  # of the odometry; in the tables of wheels and thruster, the variant
    place: str = ''
    eccentricity: float = 0.0
    circle: bool = False  # whether it is declared as a circle

    @property
    def reference(self) -> Row:
        """The row that this one is compared with."""
        if self.part == 'circle':
            return replace(self, eccentricity=0.0, circle=True)
        return replace(self, frame='', place='at' if self.part == 'grid' else '')

    @property
    def label(self) -> tuple[str, ...]:
        """Its first cells, after the motion."""
        if self.part in VARIANTS:
            return (VARIANTS[self.part][self.frame],)
        circle = f', e = {self.eccentricity:g}, {"declared as" if self.circle else "perhaps no"} circle'
        where = self.place + circle * (self.part == 'circle')
        return (self.frame, where) if self.frame else ('no orbit', '-')


@dataclass(frozen=True)
class Outcome(Runs):
    """Estimates after each of D durations; NaN for parameters if any is not determined."""

    status: Array  # (..., D)
    error: Array  # (..., D, 10)
    std: Array  # (..., D, 10)
    nees: Array  # (..., D) squared error in the covariance
    named: Array  # (..., D) the first three causes or events, a line each
    thrust: Array  # (..., D, 4) estimated scale and turn of a thruster
    thrust_std: Array  # (..., D, 4)

    @property
    def known(self) -> Flags:
        """Where all parameters are determined, (..., D)."""
        return np.asarray(np.isfinite(self.error).all(axis=-1))


def orbit_of(frame: str, eccentricity: float = 0.0) -> Orbit:
    """Return the orbit as seen in a frame of the odometry."""
    if frame == 'inertial':
        circle = Orbit.inertial(MEAN_MOTION, NADIR, NORMAL)
    else:
        circle = Orbit.turning_with(MEAN_MOTION, 'lvlh' if frame == 'lvlh' else 'hill')
    return circle.eccentric(eccentricity, ANOMALY)


@cache
def moved(pace: str, frame: str, place: str, eccentricity: float) -> Truth:
    """Return the motion seen from the odometry's frame; in empty space without one."""
    world = World(model(ROBOT).urdf, sinusoids(pace=PACES[pace]), seconds=DURATIONS[-1], rate=RATE)
    if not frame:
        return float_freely(world)
    around, away = orbit_of(frame, eccentricity), PLACES[place]

    def tide(now: float, rotation: Array, position: Array, whole: Array) -> Array:
        """Return force and torque of gravity on the robot, by the integrals of x and x x^T over its mass."""
        gradient = around.gradient(np.array([now]))[0]
        first, inertia = rotation @ whole[1:4], rotation @ unvec(whole[4:]) @ rotation.T
        second = 0.5 * np.trace(inertia) * np.eye(3) - inertia  # about the base
        mean = position + away
        force = gradient @ (whole[0] * mean + first)
        weighed = (second + np.outer(first, mean) + np.outer(position, whole[0] * mean + first)) @ gradient
        couple = weighed[[1, 2, 0], [2, 0, 1]] - weighed[[2, 0, 1], [1, 2, 0]]
        return np.concatenate((force, couple))

    truth = float_freely(replace(world, wrench=tide))
    truth = replace(truth, base_position=truth.base_position + away)
    return seen_from_orbit(around, truth, relative_twist=True) if around.turning else truth


def _orbit(row: Row) -> Parameters:
    """Return the parameters of the estimator."""
    exact = {name: value for name, value in EXACT.items() if row.part == 'grid' or not name.startswith('orbit')}
    if not row.frame or row.part == 'undeclared':
        return exact
    given: dict[str, object] = {'orbit.mean_motion': MEAN_MOTION, 'orbit.frame': row.frame}
    if row.frame == 'inertial':
        given |= {'orbit.nadir': NADIR.tolist(), 'orbit.normal': NORMAL.tolist()}
    return {**exact, **given, **({'orbit.undeclared_eccentricity': 0.0} if row.circle else {})}


_WHEELS: dict[str, object] = {
    'wheels.names': ['rw1', 'rw2', 'rw3', 'rw4'],
    'wheels.axes': [1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 1.0],
    'wheels.spin_inertias': [0.05] * 4,
}
_OFF: dict[str, object] = {**_WHEELS, 'wheels.spin_inertias': [0.0525, 0.0475, 0.0525, 0.0475]}  # 5 %
_THRUST: dict[str, object] = {
    'thrust.time': 20.0,
    'thrust.duration': 6.0,
    'thrust.force': [0.0, 1.0, 0.0],
    'thrust.torque': [0.0, 0.0, 0.6],
}
_PRIOR: dict[str, object] = {'thrust.scale_std': 0.15, 'thrust.direction_std': 0.1}
VARIANTS = {
    'wheels': {
        '': 'none',
        'names': 'by names',
        'stored': 'by stored momentum',
        'unread': 'not read',
        'off': 'by names, inertia 5 % off, declared',
        'off, exact': 'by names, inertia 5 % off, exact',
    },
    'thruster': {
        '': 'none',
        'right': 'as commanded',
        'right, prior': 'as commanded, may be off',
        'off, prior': 'off, may be off',
        'off': 'off, taken as commanded',
    },
}


def _variant(row: Row) -> tuple[Parameters, Parameters]:
    """Return parameters of simulator and estimator: four wheels up to 5 N m s each, or 1 N for six seconds."""
    how = row.frame
    if not how:
        return {}, {}
    if row.part == 'thruster':
        off = {'thrust.scale': STRONGER, 'thrust.turn': [float(TURN), 0.0, 0.0]} if how.startswith('off') else {}
        return {**_THRUST, **off}, _PRIOR if how.endswith('prior') else {}
    publish = {'stored': 'stored_momentum', 'unread': 'none'}.get(how, 'joint_states')
    turning = {'wheels.accelerations': [1.7, -1.7, 1.5, 1.6], 'wheels.publish': publish, 'wheels.speed_noise': 0.05}
    read_by: dict[str, Parameters] = {
        'names': _WHEELS,
        'stored': {'wheels.momentum_frame': 'base_link'},
        'unread': {},
        'off': {**_OFF, 'wheels.spin_inertia_relative_std': 0.05},
        'off, exact': _OFF,
    }
    return {**_WHEELS, **turning}, read_by[how]


def run(work: tuple[Row, int]) -> Outcome:
    """Return the estimates of one run: row, seed."""
    row, seed = work
    parameters = {'target_link': 'link7', **declared(NOISE)}
    if row.part in VARIANTS:
        simulated, known = _variant(row)
        session = Session(build(EstimatorConfig, {**EXACT, **parameters, **known}), model(ROBOT).urdf)
        return _ends(_simulated(session, seed, simulated), DURATIONS[:1])
    session = Session(build(EstimatorConfig, {**parameters, **_orbit(row)}), model(ROBOT).urdf)
    truth = moved(row.pace, row.frame, row.place, row.eccentricity)
    found = history(session, messages(session, read(truth, NOISE, seed), model(ROBOT), NOISE))
    return _ends(found, DURATIONS)


def _simulated(session: Session, seed: int, simulated: Parameters) -> list[Estimate]:
    values = {'duration': DURATIONS[0], 'joint_rate': RATE, 'odometry_rate': RATE, 'seed': seed, 'step': 0.05}
    noise = {name: value for name, value in declared(NOISE).items() if not name.endswith('time')}
    run_of = SimulatedRun(simulator_config(ROBOT, {**values, **noise, **simulated}), model(ROBOT).urdf, BAG_TYPES)
    take = {
        'joint_states': session.add_joint_state,
        'odom': session.add_odometry,
        'stored_momentum': session.add_stored_momentum,
        'thrust': session.add_thrust,
    }
    return history(session, ((take[each.topic], each.message) for each in run_of.read(DURATIONS[0])))


def _ends(found: list[Estimate], durations: tuple[float, ...]) -> Outcome:
    ends = []
    for seconds in durations:
        last = [each for each in found if each.time < seconds + 1e-6][-1]
        error = last.parameters - target(ROBOT)
        known = np.isfinite(error).all()
        nees = float(error @ np.linalg.solve(last.covariance, error)) if known else np.nan
        named = [cause for cause, _ in last.causes] + [event.cause for event in last.events]
        thrust: tuple[Array, ...] = (np.full(4, np.nan),) * 2
        for one in last.thrusters:
            thrust = np.append(one.scale, one.turn), np.append(one.scale_std, one.turn_std)
        numbers = (error, last.std) if known else (_NOTHING, _NOTHING)
        ends.append((last.status, *numbers, nees, '\n'.join(named[:3]), *thrust))
    return Outcome(*(np.array(column) for column in zip(*ends, strict=True)))


def _rows(part: str) -> Iterator[Row]:
    if part in VARIANTS:
        yield from (Row(part, frame=how) for how in VARIANTS[part])
    for pace in () if part in VARIANTS else PACES:
        if part == 'grid':
            yield Row(part, pace, '', 'at')
        for frame, place in product(FRAMES[:2] if part == 'circle' else FRAMES, PLACES):
            cases = CIRCLES if part == 'circle' else ((0.0, False),)
            yield from (Row(part, pace, frame, place, *case) for case in cases)


# Seeds of each part, at most, and the head of its table.
_FIGURES = ('runs', 'coverage', 'NEES')
_PLACED = ('motion', 'frame', 'where')
PARTS = {
    'grid': (20, (*_PLACED, *_FIGURES, 'RMSE over that in no orbit', 'status')),
    'undeclared': (20, (*_PLACED, 'runs', 'status', 'coverage of those that claim one', 'wrong', 'named first')),
    'circle': (1, (*_PLACED, *_FIGURES, 'RMSE over that of a circle', 'status')),
    'wheels': (8, ('wheels', *_FIGURES, 'RMSE over that without', 'status', 'named')),
    'thruster': (8, ('thruster', *_FIGURES, 'RMSE over that without', 'status', 'scale', 'turn')),
}


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/orbit.md', seeds=20)
    for part in frame.chosen(PARTS, str):
        seeds = range(min(frame.arguments.seeds, PARTS[part][0]))
        work = {
            row: (f'orbit-{"-".join(map(str, vars(row).values()))}', [(row, seed) for seed in seeds])
            for row in _rows(part)
        }
        found = dict(frame.outcomes(Outcome, run, work))
        text = f'{_table(part, found)}\n\n{provenance(f"{len(seeds)} seeds")}'
        print(f'{text}\n', flush=True)
        frame.write(**{part: text})


def _table(part: str, found: Mapping[Row, Outcome]) -> str:
    cells = []
    durations = DURATIONS[: next(iter(found.values())).status.shape[1]]
    for (at, seconds), pace in product(enumerate(durations), dict.fromkeys(row.pace for row in found)):
        for row, outcome in found.items():
            if row.pace == pace:
                motion = (f'{seconds:.0f} s, {pace}',) if pace else ()
                figures = _undeclared(outcome, at) if part == 'undeclared' else _compared(found, row, at)
                cells.append((*motion, *row.label, *figures))
    text = table(PARTS[part][1], cells, words=True)
    if part == 'grid':
        every = Outcome.concatenate(list(found.values()))
        inside = np.abs(every.error[every.known]) < BAND * every.std[every.known]
        return f'{text}\n\nAll together {100.0 * np.mean(inside):.1f} % are covered.'
    if part == 'undeclared':
        first, wrong = (sum(int(of(each).sum()) for each in found.values()) for of in (_named_first, _silently_wrong))
        count = sum(each.status.size for each in found.values())
        text += f'\n\nThe orbit is named first in {first} of {count} runs; {wrong or "none"} is silently wrong.'
    return text


def _compared(found: Mapping[Row, Outcome], row: Row, at: int) -> tuple[str, ...]:
    """Return number of runs, coverage, NEES, RMSE over that of the reference, status, and further columns."""
    own, free = found[row], found[row.reference]
    known = own.known[:, at] & free.known[:, at]
    runs, others = str(len(own)), _beside(row, own)
    if not known.any():
        return (runs, '-', '-', '-', statuses(own.status[:, at]), *others)
    # In reported deviations of the reference: every parameter counts alike.
    squares = [np.mean((each.error[known, at] / free.std[known, at]) ** 2) for each in (own, free)]
    covered = 100.0 * np.mean(np.abs(own.error[known, at]) < BAND * own.std[known, at])
    nees, ratio = np.mean(own.nees[known, at]), np.sqrt(squares[0] / squares[1])
    return (runs, f'{covered:.1f} %', f'{nees:.1f}', f'{ratio:.3f}', statuses(own.status[:, at]), *others)


def _beside(row: Row, own: Outcome) -> tuple[str, ...]:
    if row.part == 'wheels':
        named = sum('wheels' in '\n'.join(causes.split('\n')[:2]) for causes in own.named[:, 0])
        return (f'{named} of {len(own)}',)
    if row.part != 'thruster':
        return ()
    known = np.isfinite(own.thrust[:, 0, 0])
    if not known.any():
        return '-', '-'
    strength, turn = (STRONGER, TURN) if row.frame.startswith('off') else (1.0, 0.0)
    # The force along its command, and across it.
    errors = np.abs(own.thrust[known, 0] - strength * np.array([np.cos(turn), np.sin(turn), 0.0, 0.0]))
    std, (scale, off) = own.thrust_std[known, 0], (errors[:, 0].max(), np.degrees(errors[:, 1:].max()))
    turned = np.degrees(std[:, 1:].max(axis=1).mean())
    return f'{scale:.4f} ({std[:, 0].mean():.4f})', f'{off:.2f}° ({turned:.2f}°)'


def _undeclared(own: Outcome, at: int) -> tuple[str, ...]:
    """Return number of runs, status, coverage of those that claim one, and how many are wrong and name the orbit."""
    claimed = np.isin(own.status[:, at], _CLAIMED) & own.known[:, at]
    inside = np.abs(own.error[claimed, at]) < BAND * own.std[claimed, at]
    covered = f'{100.0 * np.mean(inside):.0f} %' if claimed.any() else '-'
    wrong, named = int(_silently_wrong(own)[:, at].sum()), int(_named_first(own)[:, at].sum())
    return str(len(own)), statuses(own.status[:, at]), covered, str(wrong), f'{named} of {len(own)}'


def _silently_wrong(own: Outcome) -> Flags:
    return np.isin(own.status, _CLAIMED) & (own.nees > _WRONG)


def _named_first(own: Outcome) -> Flags:
    first = [['set orbit.mean_motion' in causes.split('\n')[0] for causes in each] for each in own.named]
    return np.array(first)


if __name__ == '__main__':
    main()
