"""Measure whether the intervals hold on simulated twins of published benches, and write them into docs/hardware.md.

usage: benchmark_benches.py [--seeds N] [--processes N] [--store FOLDER] [--output docs]

Every seed draws its own robot, motion, delay or thrust, and noise; the log is written in the format of the bench.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.benches import Twin, spot_2021, spot_2023
from benchmarks.driver import add_run_arguments, driving, parser_of
from benchmarks.pages import replace_marked, table
from benchmarks.store import Runs
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array
from mbaid_ros.recordings.recording import MODEL_FILE, PARAMETER_FILE, Recording, write_recording
from mbaid_ros.recordings.spot import read_spot_2021
from mbaid_ros.recordings.spot_2023 import read_spot_2023
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.run import replay_bag

STATUSES = ('converged', 'estimating', 'not_identifiable', 'inconsistent', 'waiting')
BODY = (0, 1, 2, 9)  # mass, CoM in the plane, moment about its normal
BAND = 1.96
PAGE = 'hardware.md'


@dataclass(frozen=True)
class Bench:
    """How a bench is simulated, and read."""

    name: str
    twin: Callable[[Path, int], Twin]
    read: Callable[[Path], Recording]
    changed: Mapping[str, object] = field(default_factory=dict)  # parameters, beside those that convert writes


BENCHES = (
    Bench(
        'SPOT 2021: commands at 10 Hz, joints off by 0.02 rad, poses at 5 Hz, slope, delay', spot_2021, read_spot_2021
    ),
    Bench('the same, `tracking_std` 0: off undeclared', spot_2021, read_spot_2021, {'known_joints.tracking_std': 0.0}),
    Bench('SPOT 2023, 11 kg held firmly, thrusters that obey, links 1 % off', spot_2023, read_spot_2023),
    Bench('the same, links 3 % off', partial(spot_2023, links=0.03), read_spot_2023),
)


@dataclass(frozen=True)
class Found(Runs):
    """What a run, or many of them, led to.

    Attributes
    ----------
    error, std : (..., 4) of the numbers of BODY; NaN where they are not determined
    status : (...,) index in STATUSES
    """

    error: Array
    std: Array
    status: Array


def run(work: tuple[int, int]) -> Found:
    """Return what is found of a twin, by the number of its bench and a seed."""
    bench, seed = BENCHES[work[0]], work[1]
    with TemporaryDirectory() as folder:
        twin = bench.twin(Path(folder), seed)
        bag = Path(folder) / 'bag'
        recording = bench.read(twin.log)
        write_recording(recording.between(*recording.span), bag)
        parameters = load_parameter_file(bag / PARAMETER_FILE, 'estimator') | dict(bench.changed)
        config = build(EstimatorConfig, parameters)
        last = replay_bag(str(bag), config, (bag / MODEL_FILE).read_text(encoding='utf-8'), Inputs()).history[-1]
    error = last.parameters[list(BODY)] - twin.truth[list(BODY)]
    return Found(error, last.std[list(BODY)], np.array(STATUSES.index(last.status)))


def row(bench: Bench, found: Found) -> list[str]:
    """Return a row of the table."""
    said = found.status < STATUSES.index('not_identifiable')
    normalised = found.error[said] / found.std[said]
    known = np.isfinite(normalised)
    inside = np.abs(normalised[known]) < BAND
    counts = ', '.join(
        f'{np.sum(found.status == k)} {name}' for k, name in enumerate(STATUSES) if np.any(found.status == k)
    )
    if not known.any():
        return [bench.name, counts, *('-',) * 4]
    mass, moment = (np.sqrt(np.nanmean(found.error[said][:, k] ** 2)) for k in (0, 3))
    return [
        bench.name,
        counts,
        f'{100.0 * inside.mean():.0f} % of {inside.size}',
        f'{np.sqrt(np.mean(normalised[known] ** 2)):.2f}',
        f'{mass:.2g} kg',
        f'{moment:.2g} kg m²',
    ]


def main() -> None:
    """Run the benchmark."""
    parser = parser_of(__doc__)
    add_run_arguments(parser, seeds=16, default=16)
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='of the page')
    arguments = parser.parse_args()
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    rows = []
    with driving(len(BENCHES) * arguments.seeds, arguments.processes, arguments.store) as driver:
        for number, bench in enumerate(BENCHES):
            work = [(number, seed) for seed in range(arguments.seeds)]
            rows.append(row(bench, driver.completed(Found, f'bench{number}', work, run)))
    header = (
        'twin',
        'status',
        'within 95 %',
        'errors in standard deviations, RMS',
        'RMSE of the mass',
        'of the moment',
    )
    text = table(header, rows, words=True)
    print(text)
    if arguments.output is not None:
        replace_marked(arguments.output / PAGE, 'twins', 'scripts/benchmark_benches.py', text)


if __name__ == '__main__':
    main()
