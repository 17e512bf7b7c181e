"""Print the table of measured/hardware.md: intervals of recordings of real hardware, beside the weighings.

    make benchmark-hardware ARGS=CLONES

CLONES is a folder with clones of the repositories that measured/hardware.md names. Nothing is fetched: missing logs
are printed. The recording in bags/ needs no clone.
"""

import argparse
import json
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.frame import replace_marked, table
from mbaid_ros.recordings.convert import main as convert
from mbaid_ros.replay.arguments import replay

BAG = Path(__file__).parents[1] / 'bags' / 'air_bearing_thrusters'
BAND = 1.96


@dataclass(frozen=True)
class Recordings:
    """Recordings of one body that was weighed."""

    name: str
    weighed: tuple[float, ...]  # kg; several weighings
    form: str  # of `convert`
    logs: tuple[str, ...]  # patterns of paths
    settled: str  # with which of them parameters were chosen


_MARCH = 'ExperimentData_RED_2021_3_6_{}/*{}__stitched.mat'
_MAY = 'ExperimentData_RED_2021_5_{}/*__stitched.mat'
SPOT_MASS = (16.881, 16.965, 16.980, 16.966)
ALL = (
    Recordings(
        'SPOT, March 2021',
        SPOT_MASS,
        'spot-2021',
        tuple(_MARCH.format(*each) for each in (('15_33', '_3'), ('15_51', ''), ('16_8', ''), ('16_13', ''))),
        '15_33',
    ),
    Recordings(
        'SPOT, May 2021',
        SPOT_MASS,
        'spot-2021',
        tuple(
            _MAY.format(each)
            for each in ('2_15_9', '2_16_53', '2_17_16', '20_13_52', '20_14_19', '20_14_53', '20_15_46', '20_16_17')
        ),
        'none',
    ),
)


@dataclass(frozen=True)
class Outcome:
    """The mass in the result of a replay."""

    status: str
    mass: float  # kg; NaN where it is not published
    std: float
    causes: tuple[str, ...]

    @property
    def published(self) -> bool:
        """Whether there is an interval that may be relied on."""
        return self.status in {'estimating', 'converged'} and bool(np.isfinite(self.std))

    def holds(self, weighed: Sequence[float]) -> bool:
        """Return whether the interval holds all weighings."""
        return all(abs(self.mass - each) < BAND * self.std for each in weighed)


def outcome(bag: Path, files: Path, folder: Path, *, repair: bool) -> Outcome:
    """Return the result of a replay of a bag, with robot and parameters in a folder `files`."""
    result = folder / 'result.json'
    arguments = [bag, '--model', files / 'robot.urdf', '--params', files / 'estimator.yaml', '--json', result]
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        replay([*map(str, arguments), *(['--repair'] if repair else [])])
    found = json.loads(result.read_text(encoding='utf-8'))
    mass, std = (float((found[key] or {}).get('mass') or np.nan) for key in ('estimate', 'std'))
    causes = tuple(each['cause'] for each in found['repairs'] or found['causes'])
    return Outcome(found['status'], mass, std, causes)


def both_outcomes(bag: Path, files: Path, folder: Path) -> tuple[Outcome, Outcome]:
    """Return the results without and with `repair`, which changes nothing where there is an interval."""
    own = outcome(bag, files, folder, repair=False)
    return own, own if own.published else outcome(bag, files, folder, repair=True)


def row(name: str, weighed: Sequence[float], found: Sequence[tuple[Outcome, Outcome]], settled: str) -> list[str]:
    """Return a line of the table."""
    own, repaired = zip(*found, strict=True)
    cells = [name, f'{min(weighed):.2f} to {max(weighed):.2f}', str(len(found)), settled]
    for each in (own, repaired):
        published = [one for one in each if one.published]
        held = sum(one.holds(weighed) for one in published)
        width = f'± {100.0 * BAND * np.median([one.std / one.mass for one in published]):.0f} %' if published else '-'
        cells += [f'{len(published)}', f'{held}', width]
    return cells


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, a line for each recording, and the missing logs."""
    parser = argparse.ArgumentParser(description='Intervals of recordings of real hardware.')
    parser.add_argument('clones', type=Path, nargs='?', default=Path(), help='a folder of clones')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='docs: write the table into its page, too')
    arguments = parser.parse_args(argv)
    clones = arguments.clones
    rows = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        both = both_outcomes(BAG, BAG, folder)
        print(f'air_bearing_thrusters: {both[0]}\n    with repair: {both[1]}', flush=True)
        rows.append(row('air-bearing-thrusters', (23.090, 23.824), [both], 'this one'))
        for recordings in ALL:
            found: list[tuple[Outcome, Outcome]] = []
            for pattern in recordings.logs:
                log = next(iter(sorted(clones.rglob(pattern))), None)
                if log is None:
                    print(f'missing: {recordings.name}: {pattern}')
                    continue
                bag = folder / f'{recordings.form}{len(rows)}_{len(found)}'
                with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                    convert([recordings.form, str(log), '--output', str(bag)])
                both = both_outcomes(bag, bag, folder)
                print(f'{log.parent.name}: {both[0]}\n    with repair: {both[1]}', flush=True)
                found.append(both)
            if found:
                rows.append(row(recordings.name, recordings.weighed, found, recordings.settled))
    heads = ['recording', 'weighed, kg', 'runs', 'settled with', 'published', 'hold', 'width']
    text = table([*heads, 'published with `repair`', 'hold', 'width'], rows)
    print(text)
    if arguments.output is not None:
        replace_marked(arguments.output / 'measured' / 'hardware.md', 'hardware', text)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
