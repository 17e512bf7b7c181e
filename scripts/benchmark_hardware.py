"""Print the table of measured/hardware.md: intervals of recordings of real hardware, beside what was measured.

    make benchmark-hardware ARGS=CLONES

CLONES is a folder with clones of the repositories that measured/hardware.md names. Nothing is fetched: missing logs
are printed. The recording in bags/ needs no clone.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmark_iss import weighed as station
from benchmarks.fan_platform import MASS, read_fan_platform
from benchmarks.frame import PUBLISHED, replace_marked, table
from mbaid_ros.errors import MbaidError
from mbaid_ros.recordings.convert import main as convert
from mbaid_ros.recordings.iss import read_iss
from mbaid_ros.recordings.recording import write_recording
from mbaid_ros.recordings.spot import COMMANDS_FILE
from mbaid_ros.recordings.spot_captures import WEIGHED
from mbaid_ros.replay.arguments import replay

BAG = Path(__file__).parents[1] / 'bags' / 'air_bearing_thrusters'
BAND = 1.96


@dataclass(frozen=True)
class Outcome:
    """The result of a run."""

    status: str
    values: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # published, with standard deviations
    causes: tuple[str, ...] = ()

    @property
    def published(self) -> bool:
        """Whether there is an interval that may be relied on."""
        return self.status in PUBLISHED and bool(self.values)

    def deviations(self, truth: Mapping[str, Sequence[float]]) -> list[float]:
        """Return by how many standard deviations each number is off, from the measurement that is furthest."""
        return [
            max(abs(value - each) / std for each in truth[name])
            for name, (value, std) in self.values.items()
            if name in truth
        ]

    def __str__(self) -> str:
        """Return it in a line."""
        shown = [f'{name} {value:.4g} ± {BAND * std:.2g}' for name, (value, std) in self.values.items()]
        return '; '.join((self.status, *shown, *self.causes))


Pair = tuple[Outcome, Outcome | None]  # without repair, and with it; None where there is no repair


@dataclass(frozen=True)
class Recordings:
    """Recordings of one body of which something was measured."""

    name: str
    truth: Mapping[str, tuple[float, ...]]  # of each number, all measurements
    shown: str  # truth as the table has it
    settled: str  # with which of them parameters were chosen
    logs: tuple[str, ...] = ()  # patterns of paths
    form: str = ''  # of `convert`
    end: float = 0.0  # s of a bag that are used; 0: all
    parameters: tuple[str, ...] = ()  # NAME:=VALUE, beside the file's
    width: str = 'mass'  # number whose interval the table shows

    def pairs(self, clones: Path, folder: Path) -> Iterator[Pair]:
        """Return the results, and print missing logs."""
        for place, log in enumerate(self.found(clones)):
            bag, name = folder / f'log_{place}', f'{log.parent.name}/{log.stem}'
            if said := self.converted(log, bag, clones):
                print(f'{name}: refused: {said.rpartition(str(log))[2]}', flush=True)
                yield Outcome('refused'), None
            else:
                yield self.shown_pair(name, bag, folder)

    def converted(self, log: Path, bag: Path, clones: Path) -> str:
        """Make a bag of a log; return why `convert` refuses, empty if it does not."""
        arguments = [self.form, str(log), '--output', str(bag)]
        commands = next(iter(sorted(clones.rglob(COMMANDS_FILE))), None)
        if self.form == 'spot-2021' and commands is not None:
            arguments += ['--commands', str(commands)]
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as said:
            return said.getvalue().strip() if convert(arguments) else ''

    def found(self, clones: Path) -> list[Path]:
        """Return the logs, each run once, wherever it lies; print the patterns that have none."""
        found: dict[tuple[str, str], Path] = {}
        for pattern in self.logs:
            logs = [each for each in sorted(clones.rglob(pattern)) if each.is_file()]
            if not logs:
                print(f'missing: {self.name}: {pattern}')
            for log in logs:
                found.setdefault((log.parent.name, log.stem), log)
        return list(found.values())

    def shown_pair(self, name: str, bag: Path, folder: Path) -> Pair:
        """Return the results of a bag without and with `repair`, which changes nothing where there is an interval."""
        own = self.outcome(bag, folder, repair=False)
        pair = own, own if own.published else self.outcome(bag, folder, repair=True)
        print(f'{name}: {pair[0]}' + ('' if own.published else f'\n    with repair: {pair[1]}'), flush=True)
        return pair

    def outcome(self, bag: Path, folder: Path, *, repair: bool) -> Outcome:
        """Return the result of a replay of a bag with the robot and the parameters in its folder."""
        result = folder / 'result.json'
        result.unlink(missing_ok=True)
        arguments = [bag, '--model', bag / 'robot.urdf', '--params', bag / 'estimator.yaml', '--json', result]
        arguments += [part for each in self.parameters for part in ('-p', each)]
        arguments += ['--end', self.end] if self.end else []
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            replay([*map(str, arguments), *(['--repair'] if repair else [])])
        if not result.exists():
            return Outcome('nothing')
        found = json.loads(result.read_text(encoding='utf-8'))
        values, stds = ({'mass': (part := found[key] or {}).get('mass'), **(part.get('inertia') or {})}
                        for key in ('estimate', 'std'))  # fmt: skip
        numbers = {
            name: (float(value), float(stds[name]))
            for name, value in values.items()
            if name in self.truth and value is not None and stds.get(name) is not None
        }
        return Outcome(found['status'], numbers, tuple(each['cause'] for each in found['repairs'] or found['causes']))


@dataclass(frozen=True)
class Shipped(Recordings):
    """The recording in bags/."""

    def pairs(self, clones: Path, folder: Path) -> Iterator[Pair]:
        """Return its result."""
        del clones
        yield self.shown_pair(self.name, BAG, folder)


@dataclass(frozen=True)
class FanPlatform(Recordings):
    """Logs that `convert` has no format for."""

    def converted(self, log: Path, bag: Path, clones: Path) -> str:
        """Make a bag of a log."""
        del clones
        write_recording(read_fan_platform(log), bag)
        return ''


@dataclass(frozen=True)
class Station(Recordings):
    """Windows of the space station's telemetry, h: the first is what the others are compared with."""

    windows: tuple[tuple[float, float], ...] = ()

    def pairs(self, clones: Path, folder: Path) -> Iterator[Pair]:
        """Return the moments of all bodies in each window, by `calibrate`, which has no repair."""
        archive = next((each.parent for each in sorted(clones.rglob('USLAB000018.txt'))), None)
        if archive is None:
            print(f'missing: {self.name}: USLAB000018.txt')
            return
        for place, window in enumerate(self.windows):
            try:
                found = station(read_iss(archive, *window), folder / f'iss{place}')
            except MbaidError as error:
                print(f'station {window}: {error}')
                found = None
            if found is None:
                outcome = Outcome('refused')
            else:
                numbers = zip(self.truth, found[0] / 1e6, found[1] / 1e6, strict=True)
                outcome = Outcome('estimating', {name: (value, std) for name, value, std in numbers})
            print(f'station {window}: {outcome}', flush=True)
            yield outcome, None


_MARCH = 'ExperimentData_RED_2021_3_6_{}/*{}__stitched.mat'
_MAY = 'ExperimentData_RED_2021_5_{}/*__stitched.mat'
_SUMMER = '{}/Kirk_Phase3_*__stitched.mat'
SPOT_MASS = (16.881, 16.965, 16.980, 16.966)
BEARINGS = {'mass': (23.090, 23.824)}
ALL = (
    Shipped('air-bearing-thrusters', BEARINGS, 'weighed, 23.09 and 23.82 kg', 'this one'),
    Shipped(
        'the same, thrust declared to 2 %',
        BEARINGS,
        'weighed, 23.09 and 23.82 kg',
        'this one',
        parameters=('thrust.scale_std:=0.02', 'thrust.direction_std:=0.02'),
    ),
    Recordings(
        'SPOT, March 2021',
        {'mass': SPOT_MASS},
        'weighed, 16.88 to 16.98 kg',
        '15_33',
        tuple(_MARCH.format(*each) for each in (('15_33', '_3'), ('15_51', ''), ('16_8', ''), ('16_13', ''))),
        'spot-2021',
    ),
    Recordings(
        'SPOT, May 2021',
        {'mass': SPOT_MASS},
        'weighed, 16.88 to 16.98 kg',
        'none',
        tuple(
            _MAY.format(each)
            for each in ('2_15_9', '2_16_53', '2_17_16', '20_13_52', '20_14_19', '20_14_53', '20_15_46', '20_16_17')
        ),
        'spot-2021',
    ),
    Recordings(
        'SPOT, 2023, 20 s',  # the arm unfolds; nothing is held
        {'mass': (0.111,)},
        'the hand alone, 0.11 kg',
        'three of them',
        tuple(
            f'ExperimentData_RED_2023_{each}'
            for each in (
                '3_26_10_16/ExpLog8',
                '3_25_12_20/ExpLog',
                '3_26_11_7/ExpLog1',
                '4_8_9_34/ExpLog5',
                '4_8_10_3/ExpLog',
            )
        ),
        'spot-2023',
        end=20.0,
    ),
    *(
        Recordings(
            f'SPOT captures, {name}',
            {name: (value,) for name, value in WEIGHED.items()},
            'weighed, 12.04 kg; swung, 0.2257 kg m²',
            settled,
            tuple(_SUMMER.format(each) for each in folders),
            'spot-captures',
        )
        for name, settled, folders in (
            ('IC1', 'all', ('ExperimentData_RED_2021_*_IC1_*',)),
            (
                'IC2, IC3',
                'none',
                ('ExperimentData_RED_2021_8_3*_IC2_trial*', 'ExperimentData_RED_2021_8_3*_IC3v2_trial*'),
            ),
            ('pushed or filmed', 'none', ('ExperimentData_RED_2021_*perturbation*', 'ExperimentData_RED_2021_*VIDEO*')),
            (
                'all others',
                'none',
                (
                    'ExperimentData_RED_2021_[78]_*_[0-9]*_[0-9]',
                    'ExperimentData_RED_2021_[78]_*_[0-9][0-9]',
                    '*bumping*',
                    '*FirstIC2',
                    '*IC2v2',
                    '*goodIC1',
                    '[Uu]nused_*',
                ),
            ),
            ('named FAIL', 'none', ('FAIL_*',)),
        )
    ),
    FanPlatform(
        'fans and a wheel, 30 s',
        {'mass': (MASS,)},
        'weighed, 1.220 kg',
        'none',
        ('control_data_DLMI_disturbance.csv', 'control_data_DLQR_*.csv'),
        end=30.0,
    ),
    Station(
        'space station, six windows',
        {'Ixx': (118.2,), 'Iyy': (60.4,), 'Izz': (170.7,)},
        'repeats: moments of window A',
        'A and the second',
        width='Iyy',
        windows=(
            (6861.75, 6863.005),
            (6861.5, 6862.75),
            (6864.8, 6866.0),
            (6865.0, 6866.4),
            (6846.5, 6847.75),
            (6863.0, 6864.5),
        ),
    ),
)


def cells(found: Sequence[Outcome], recordings: Recordings) -> list[str]:
    """Return how many are published, how many of their numbers hold, the largest deviation, and the median width."""
    published = [each for each in found if each.published]
    if not published:
        return ['0', '-', '-']
    off = [each for one in published for each in one.deviations(recordings.truth)]
    held = f'{sum(each < BAND for each in off)} of {len(off)}, off by at most {max(off):.1f} std'
    widths = [std / abs(value) for one in published for name, (value, std) in one.values.items()
              if name == recordings.width]  # fmt: skip
    return [f'{len(published)}', held, f'± {100.0 * BAND * np.median(widths):.0f} %' if widths else '-']


def row(recordings: Recordings, found: Sequence[Pair]) -> list[str]:
    """Return a line of the table."""
    repaired = [each for _, each in found if each is not None]
    return [
        recordings.name,
        recordings.shown,
        str(len(found)),
        recordings.settled,
        *cells([own for own, _ in found], recordings),
        *(cells(repaired, recordings) if repaired else ['-', '-', '-']),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, a line for each recording, and the missing logs."""
    parser = argparse.ArgumentParser(description='Intervals of recordings of real hardware.')
    parser.add_argument('clones', type=Path, nargs='?', default=Path(), help='a folder of clones')
    parser.add_argument('--only', default='', metavar='TEXT', help='recordings whose names hold this')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='docs: write the table into its page, too')
    arguments = parser.parse_args(argv)
    rows = []
    for place, recordings in enumerate(each for each in ALL if arguments.only in each.name):
        with TemporaryDirectory() as name:
            folder = Path(name) / str(place)
            folder.mkdir()
            found = list(recordings.pairs(arguments.clones, folder))
        if found:
            rows.append(row(recordings, found))
    heads = ['recording', 'truth', 'runs', 'settled with', 'published', 'numbers that hold', 'width']
    text = table([*heads, 'published with `repair`', 'hold', 'width'], rows)
    print(text)
    if arguments.output is not None:
        replace_marked(arguments.output / 'measured' / 'hardware.md', 'hardware', text)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
