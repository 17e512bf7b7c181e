"""Write the table of simulated twins of published benches into measured/hardware.md: whether their intervals hold.

Every seed draws its own robot, motion, delay or thrust, and noise; the log has the format of the bench.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.benches import Thrusters, Twin, air_bearing, spot_2021, spot_2023
from benchmarks.frame import PUBLISHED, Frame, Runs, provenance, statuses, table
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import BAND
from mbaid_ros.parameters import build
from mbaid_ros.recordings.air_bearing import read_air_bearing_thrusters
from mbaid_ros.recordings.recording import MODEL_FILE, PARAMETER_FILE, Recording, write_recording
from mbaid_ros.recordings.spot import read_spot_2021, read_spot_2023
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.one_bag import replay_bag

BODY = [0, 1, 2, 9]  # mass, CoM in the plane, moment about its normal
HEADER = ('twin', 'status', 'within 95 %', 'errors in standard deviations, RMS', 'RMSE of the mass', 'of the moment')


@dataclass(frozen=True)
class Bench:
    """A bench: its simulation, its reader, and parameters beside those that `convert` writes."""

    name: str
    twin: Callable[[Path, int], Twin]
    read: Callable[[Path], Recording]
    changed: tuple[tuple[str, object], ...] = ()
    table: str = 'twins'  # of the page, that has it


def _thrusters(name: str, stds: Thrusters) -> Bench:
    return Bench(
        f'thrusters: {name}', partial(air_bearing, stds=stds), read_air_bearing_thrusters, stds.declared, 'thrusters'
    )


_UNDECLARED = (('known_joints.tracking_std', 0.0),)
_SPOT_2021 = 'SPOT 2021: commands at 10 Hz, joints off by 0.02 rad, poses at 5 Hz, slope, delay'
BENCHES = (
    Bench(_SPOT_2021, spot_2021, read_spot_2021),
    Bench('the same, `tracking_std` 0: off undeclared', spot_2021, read_spot_2021, _UNDECLARED),
    Bench('SPOT 2023, 11 kg held firmly, thrusters that obey, links 1 % off', spot_2023, read_spot_2023),
    Bench('the same, links 3 % off', partial(spot_2023, links=0.03), read_spot_2023),
    _thrusters('10 % weaker or stronger each', Thrusters()),
    _thrusters('2, 5, 10, 20, 2, 5, 10, 20 % each', Thrusters(scale=(0.02, 0.05, 0.1, 0.2) * 2)),
    _thrusters('10 % each, valves 30 ms early or late', Thrusters(delay=0.03)),
    _thrusters('10 %, a force of 0.15 N that varies in 0.7 s', Thrusters(force=0.15)),
    _thrusters('as the shipped recording declares', Thrusters((0.1,) * 8, 0.1, 0.03, 0.15, 0.02)),
)


@dataclass(frozen=True)
class Outcome(Runs):
    """Ends of runs: errors and standard deviations (..., 4) of BODY, NaN where not determined."""

    error: Array
    std: Array
    status: Array


def run(number: int, seed: int) -> Outcome:
    """Return the end of one run, by the number of its bench."""
    bench = BENCHES[number]
    with TemporaryDirectory() as folder:
        twin, bag = bench.twin(Path(folder), seed), Path(folder) / 'bag'
        recording = bench.read(twin.log)
        write_recording(recording.between(*recording.span), bag)
        parameters = load_parameter_file(bag / PARAMETER_FILE, 'estimator') | dict(bench.changed)
        model = (bag / MODEL_FILE).read_text(encoding='utf-8')
        last = replay_bag(str(bag), build(EstimatorConfig, parameters), model, Inputs()).history[-1]
    return Outcome(last.parameters[BODY] - twin.truth[BODY], last.std[BODY], np.array(last.status))


def row(bench: Bench, outcome: Outcome) -> list[str]:
    """Return a row of the table."""
    published = np.isin(outcome.status, PUBLISHED)
    normalised = outcome.error[published] / outcome.std[published]
    known = np.isfinite(normalised)
    inside = np.abs(normalised[known]) < BAND
    if not known.any():
        return [bench.name, statuses(outcome.status), *('-',) * 4]
    mass, moment = (np.sqrt(np.nanmean(outcome.error[published][:, k] ** 2)) for k in (0, 3))
    return [
        bench.name,
        statuses(outcome.status),
        f'{100.0 * inside.mean():.0f} % of {inside.size}',
        f'{np.sqrt(np.mean(normalised[known] ** 2)):.2f}',
        f'{mass:.2g} kg',
        f'{moment:.2g} kg m²',
    ]


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/hardware.md', seeds=16)
    chosen = frame.chosen(range(len(BENCHES)), lambda number: BENCHES[number].name)
    outcomes = frame.outcomes(Outcome, run, {number: f'bench{number}' for number in chosen})
    rows: dict[str, list[list[str]]] = {}
    for number, outcome in outcomes:
        made = row(BENCHES[number], outcome)
        print(' | '.join(made), flush=True)
        rows.setdefault(BENCHES[number].table, []).append(made)
    for name, lines in rows.items():
        frame.write(**{name: f'{table(HEADER, lines, words=True)}\n\n{provenance()}'})


if __name__ == '__main__':
    main()
