"""Write measured/orbit.md: runs in orbits that are declared or not, over the same runs in empty space.

--rows chooses tables: grid, undeclared.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
from scipy.stats import chi2

from benchmarks.data import NOISE, history, model, simulator_config, target
from benchmarks.frame import PUBLISHED, Frame, Runs, declared, provenance, statuses, table
from benchmarks.honesty.paths import servicer
from benchmarks.honesty.readings import read
from benchmarks.honesty.runs import published
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.estimate import BAND
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_robot import make_simulation, make_view
from mbaid_ros.simulation.simulation import Truth

ROBOT = 'servicer7'
MEAN_MOTION = 1.1308e-3  # rad/s, at 400 km
NADIR, NORMAL = (0.6, 0.0, 0.8), (0.8, 0.0, -0.6)
PLACES = {'at': (0.0, 0.0, 0.0), 'away': (12.0, -10.0, 13.0)}  # m from the frame's origin: 0 and 20
PACES = {'fast': 8.0, 'slow': 0.25}  # times the sinusoids of config/: up to 20 to 40 deg/s, and 0.6 to 1.3
FRAMES = ('inertial', 'lvlh', 'hill')
DURATIONS = (60.0, 300.0)  # s: a shorter run is the begin of the longer one
RATE = 20.0  # Hz
_WRONG = float(chi2.isf(1e-3, 10))  # NEES that one run in a thousand exceeds


@dataclass(frozen=True)
class Row:
    """A row of one of the tables."""

    part: str  # which
    pace: str  # of the motion
    frame: str = ''  # of the odometry; empty without an orbit
    place: str = 'at'


@dataclass(frozen=True)
class Outcome(Runs):
    """Estimates after each of D durations; NaN for parameters if any is not determined."""

    status: Array  # (..., D)
    error: Array  # (..., D, 10)
    std: Array  # (..., D, 10)
    nees: Array  # (..., D) squared error in the covariance
    named: Array  # (..., D) the first cause or event

    @property
    def known(self) -> Flags:
        """Where all parameters are determined, (..., D)."""
        return np.asarray(np.isfinite(self.error).all(axis=-1))


def _declared(frame: str) -> dict[str, object]:
    """Return the parameters of the orbit as seen in a frame of the odometry, of simulator and estimator alike."""
    if not frame:
        return {}
    directions = {'orbit.nadir': NADIR, 'orbit.normal': NORMAL} if frame == 'inertial' else {}
    return {'orbit.mean_motion': MEAN_MOTION, 'orbit.frame': frame, **directions}


@cache
def moved(pace: str, frame: str, place: str) -> Truth:
    """Return the motion seen from the odometry's frame; in empty space without one."""
    config = simulator_config(ROBOT, {**_declared(frame), 'initial.base_position': PLACES[place]})
    driven = replace(servicer(), frequency=PACES[pace] * servicer().frequency)
    truth = make_simulation(config, model(ROBOT), driven).advance(np.arange(round(DURATIONS[-1] * RATE) + 1) / RATE)
    view = make_view(config)
    return truth if view is None else view(truth)


def run(row: Row, seed: int) -> Outcome:
    """Return the estimates of one run."""
    undeclared = row.part == 'undeclared'
    exact = {name: value for name, value in EXACT.items() if not (undeclared and name.startswith('orbit'))}
    values = {'target_link': 'link7', **declared(NOISE), **exact, **({} if undeclared else _declared(row.frame))}
    session = Session(build(EstimatorConfig, values), model(ROBOT).urdf)
    truth = moved(row.pace, row.frame, row.place)
    found, ends = history(session, published(read(truth, NOISE, seed), model(ROBOT), NOISE)), []
    for seconds in DURATIONS:
        last = [each for each in found if each.time < seconds + 1e-6][-1]
        error = last.parameters - target(ROBOT)
        known = np.isfinite(error).all()
        nees = float(error @ np.linalg.solve(last.covariance, error)) if known else np.nan
        named = [cause for cause, _ in last.causes] + [event.cause for event in last.events]
        numbers = (error, last.std) if known else (np.full(10, np.nan),) * 2
        ends.append((last.status, *numbers, nees, next(iter(named), '')))
    return Outcome(*(np.array(column) for column in zip(*ends, strict=True)))


def _rows(part: str) -> Iterator[Row]:
    for pace in PACES:
        if part == 'grid':
            yield Row(part, pace)
        yield from (Row(part, pace, *each) for each in product(FRAMES, PLACES))


# The head of each table.
PARTS = {
    'grid': ('motion', 'frame', 'where', 'runs', 'coverage', 'NEES', 'RMSE over that in no orbit', 'status'),
    'undeclared': (
        *('motion', 'frame', 'where', 'runs', 'status', 'coverage of those that claim one', 'wrong', 'named first'),
    ),
}


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/orbit.md', seeds=20)
    for part in frame.chosen(PARTS, str):
        files = {row: f'orbit-{"-".join(map(str, vars(row).values()))}' for row in _rows(part)}
        found = dict(frame.outcomes(Outcome, run, files))
        text = f'{_table(part, found)}\n\n{provenance(f"{frame.arguments.seeds} seeds")}'
        print(f'{text}\n', flush=True)
        frame.write(**{part: text})


def _table(part: str, found: Mapping[Row, Outcome]) -> str:
    cells = []
    for (at, seconds), pace in product(enumerate(DURATIONS), PACES):
        for row, outcome in found.items():
            if row.pace == pace:
                figures = _undeclared(outcome, at) if part == 'undeclared' else _compared(found, row, at)
                place = (row.frame, row.place) if row.frame else ('no orbit', '-')
                cells.append((f'{seconds:.0f} s, {pace}', *place, *figures))
    text = table(PARTS[part], cells, words=True)
    if part == 'grid':
        every = Outcome.concatenate(list(found.values()))
        inside = np.abs(every.error[every.known]) < BAND * every.std[every.known]
        return f'{text}\n\nAll together {100.0 * np.mean(inside):.1f} % are covered.'
    first, wrong = (sum(int(of(each).sum()) for each in found.values()) for of in (_named_first, _silently_wrong))
    count = sum(each.status.size for each in found.values())
    return f'{text}\n\nThe orbit is named first in {first} of {count} runs; {wrong or "none"} is silently wrong.'


def _compared(found: Mapping[Row, Outcome], row: Row, at: int) -> tuple[str, ...]:
    """Return number of runs, coverage, NEES, RMSE over that without an orbit, status."""
    own, free = found[row], found[Row(row.part, row.pace)]
    known = own.known[:, at] & free.known[:, at]
    if not known.any():
        return str(len(own)), '-', '-', '-', statuses(own.status[:, at])
    # In reported deviations of the reference: every parameter counts alike.
    squares = [np.mean((each.error[known, at] / free.std[known, at]) ** 2) for each in (own, free)]
    covered = 100.0 * np.mean(np.abs(own.error[known, at]) < BAND * own.std[known, at])
    nees, ratio = np.mean(own.nees[known, at]), np.sqrt(squares[0] / squares[1])
    return str(len(own)), f'{covered:.1f} %', f'{nees:.1f}', f'{ratio:.3f}', statuses(own.status[:, at])


def _undeclared(own: Outcome, at: int) -> tuple[str, ...]:
    """Return number of runs, status, coverage of those that claim one, and how many are wrong and name the orbit."""
    claimed = np.isin(own.status[:, at], PUBLISHED) & own.known[:, at]
    inside = np.abs(own.error[claimed, at]) < BAND * own.std[claimed, at]
    covered = f'{100.0 * np.mean(inside):.0f} %' if claimed.any() else '-'
    wrong, named = int(_silently_wrong(own)[:, at].sum()), int(_named_first(own)[:, at].sum())
    return str(len(own)), statuses(own.status[:, at]), covered, str(wrong), f'{named} of {len(own)}'


def _silently_wrong(own: Outcome) -> Flags:
    return np.isin(own.status, PUBLISHED) & (own.nees > _WRONG)


def _named_first(own: Outcome) -> Flags:
    return np.array([['set orbit.mean_motion' in causes for causes in each] for each in own.named])


if __name__ == '__main__':
    main()
