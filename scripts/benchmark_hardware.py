"""Write the table of measured/hardware.md: intervals of recordings of real hardware, beside what was measured.

    make benchmark-hardware ARGS="--clones CLONES --store FOLDER"

CLONES is a folder with clones of the repositories that measured/hardware.md names. Nothing is fetched: missing logs
are printed. The recording in bags/ needs no clone. FOLDER keeps finished runs of a commit; the same command goes on.
The page is written only if every log of every row was measured on one commit.
"""

import json
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmark_iss import weighed as station
from benchmarks.fan_platform import MASS, read_fan_platform
from benchmarks.frame import PUBLISHED, Frame, Runs
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import BAND
from mbaid_ros.errors import MbaidError
from mbaid_ros.recordings.convert import main as convert
from mbaid_ros.recordings.iss import read_iss
from mbaid_ros.recordings.recording import write_recording
from mbaid_ros.recordings.spot import COMMANDS_FILE
from mbaid_ros.recordings.spot_captures import WEIGHED
from mbaid_ros.replay.arguments import replay

ROOT = Path(__file__).resolve().parents[1]
BAG = ROOT / 'bags' / 'air_bearing_thrusters'
FAILED = 'failed'  # status of a recording that cannot be measured
MOST = 99  # recordings of a row, more than any has
HEADER = (
    'recording', 'truth', 'runs', 'used to tune', 'published', 'intervals right', 'width', 'published with `repair`',
    'intervals right', 'width',
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """The result of a replay."""

    status: str = ''  # empty: not tried
    values: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # published, with standard deviations
    causes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return it in a line."""
        shown = [f'{name} {value:.4g} ± {BAND * std:.2g}' for name, (value, std) in self.values.items()]
        return '; '.join((self.status, *shown, *self.causes))


@dataclass(frozen=True)
class Outcome(Runs):
    """Results of recordings, each without `repair` and with it, of k numbers that were measured."""

    status: Array  # (2,) '' where it was not tried
    value: Array  # (2, k) NaN: not published
    std: Array  # (2, k)
    shown: Array  # () in words

    @staticmethod
    def of_results(name: str, names: Iterable[str], own: Result, repaired: Result) -> 'Outcome':
        """Return the outcome of one recording."""
        pair, none = (own, repaired), (np.nan, np.nan)
        numbers = np.array([[each.values.get(number, none) for number in names] for each in pair])
        words = f'{name}: {own}'
        if repaired.status and repaired is not own:
            words += f'\n    with repair: {repaired}'
        return Outcome(np.array([each.status for each in pair]), numbers[..., 0], numbers[..., 1], np.array(words))


@dataclass(frozen=True)
class Recordings:
    """Recordings of one body of which something was measured."""

    name: str
    truth: Mapping[str, tuple[float, ...]]  # of each number, all measurements
    shown: str  # truth as the table has it
    settled: str  # with which of them parameters were chosen
    count: int  # recordings
    logs: tuple[str, ...] = ()  # patterns of paths
    form: str = ''  # of `convert`
    end: float = 0.0  # s of a bag that are used; 0: all
    parameters: tuple[str, ...] = ()  # NAME:=VALUE, beside the file's
    width: str = 'mass'  # number whose interval the table shows

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

    def outcome(self, log: Path, place: int, folder: Path, clones: Path) -> Outcome:
        """Return the outcome of the log at a place in the list."""
        del place
        name, bag = f'{log.parent.name}/{log.stem}', folder / 'log'
        if said := self.converted(log, bag, clones):
            refused = Result('refused', causes=(said.rpartition(str(log))[2].lstrip("' "),))
            return Outcome.of_results(name, self.truth, refused, Result())
        return self.outcome_of_bag(name, bag, folder)

    def converted(self, log: Path, bag: Path, clones: Path) -> str:
        """Make a bag of a log; return why `convert` refuses, empty if it does not."""
        arguments = [self.form, str(log), '--output', str(bag)]
        commands = next(iter(sorted(clones.rglob(COMMANDS_FILE))), None)
        if self.form == 'spot-2021' and commands is not None:
            arguments += ['--commands', str(commands)]
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as said:
            return said.getvalue().strip() if convert(arguments) else ''

    def outcome_of_bag(self, name: str, bag: Path, folder: Path) -> Outcome:
        """Return the outcome of a bag; `repair` changes nothing where there is an interval."""
        own = self.replayed(bag, folder, repair=False)
        published = own.status in PUBLISHED and own.values
        repaired = own if published else self.replayed(bag, folder, repair=True)
        return Outcome.of_results(name, self.truth, own, repaired)

    def replayed(self, bag: Path, folder: Path, *, repair: bool) -> Result:
        """Return the result of a replay of a bag with the robot and the parameters in its folder."""
        result = folder / 'result.json'
        result.unlink(missing_ok=True)
        arguments = [bag, '--model', bag / 'robot.urdf', '--params', bag / 'estimator.yaml', '--json', result]
        arguments += [part for each in self.parameters for part in ('-p', each)]
        arguments += ['--end', self.end] if self.end else []
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as said:
            replay([*map(str, arguments), *(['--repair'] if repair else [])])
        if not result.exists():
            return Result('no result', causes=tuple(said.getvalue().strip().splitlines()[-1:]))
        found = json.loads(result.read_text(encoding='utf-8'))
        values, stds = ({'mass': (part := found[key] or {}).get('mass'), **(part.get('inertia') or {})}
                        for key in ('estimate', 'std'))  # fmt: skip
        numbers = {
            name: (float(value), float(stds[name]))
            for name, value in values.items()
            if name in self.truth and value is not None and stds.get(name) is not None
        }
        return Result(found['status'], numbers, tuple(each['cause'] for each in found['repairs'] or found['causes']))


@dataclass(frozen=True)
class Shipped(Recordings):
    """The recording in bags/."""

    def found(self, clones: Path) -> list[Path]:
        """Return its bag."""
        del clones
        return [BAG]

    def outcome(self, log: Path, place: int, folder: Path, clones: Path) -> Outcome:
        """Return its outcome."""
        del place, clones
        return self.outcome_of_bag(self.name, log, folder)


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
    """Windows of the space station's telemetry, h: the first is what the others are compared with.

    `calibrate` has no `repair`: both columns are of the same run.
    """

    windows: tuple[tuple[float, float], ...] = ()

    def found(self, clones: Path) -> list[Path]:
        """Return the folder of the telemetry, once for each window."""
        archive = next((each.parent for each in sorted(clones.rglob('USLAB000018.txt'))), None)
        if archive is None:
            print(f'missing: {self.name}: USLAB000018.txt')
        return [] if archive is None else [archive] * len(self.windows)

    def outcome(self, log: Path, place: int, folder: Path, clones: Path) -> Outcome:
        """Return the moments of all bodies in a window, by `calibrate`."""
        del clones
        result = Result('refused')
        try:
            if (found := station(read_iss(log, *self.windows[place]), folder)) is not None:
                numbers = zip(self.truth, found[0] / 1e6, found[1] / 1e6, strict=True)
                result = Result('estimating', {name: (value, std) for name, value, std in numbers})
        except MbaidError as error:
            result = Result('refused', causes=(str(error),))
        return Outcome.of_results(f'station {self.windows[place]}', self.truth, result, result)


_MARCH = 'ExperimentData_RED_2021_3_6_{}/*{}__stitched.mat'
_MAY = 'ExperimentData_RED_2021_5_{}/*__stitched.mat'
_2023 = ('3_26_10_16/ExpLog8', '3_25_12_20/ExpLog', '3_26_11_7/ExpLog1', '4_8_9_34/ExpLog5', '4_8_10_3/ExpLog')
_SUMMER = '{}/Kirk_Phase3_*__stitched.mat'
SPOT_MASS = (16.881, 16.965, 16.980, 16.966)
BEARINGS = {'mass': (23.090, 23.824)}
ALL = (
    Shipped('air-bearing-thrusters', BEARINGS, 'weighed, 23.09 and 23.82 kg', 'this one', 1),
    Shipped(
        'the same, thrust to 2 %, a force of 0.05 N',
        BEARINGS,
        'weighed, 23.09 and 23.82 kg',
        'this one',
        1,
        parameters=(
            'thrust.scale_std:=0.02',
            'thrust.direction_std:=0.02',
            'disturbance.force_std:=0.05',
            'disturbance.torque_std:=0.005',
        ),
    ),
    Recordings(
        'SPOT, March 2021',
        {'mass': SPOT_MASS},
        'weighed, 16.88 to 16.98 kg',
        '15_33',
        4,
        tuple(_MARCH.format(*each) for each in (('15_33', '_3'), ('15_51', ''), ('16_8', ''), ('16_13', ''))),
        'spot-2021',
    ),
    Recordings(
        'SPOT, May 2021',
        {'mass': SPOT_MASS},
        'weighed, 16.88 to 16.98 kg',
        'none',
        8,
        tuple(
            _MAY.format(each)
            for each in ('2_15_9', '2_16_53', '2_17_16', '20_13_52', '20_14_19', '20_14_53', '20_15_46', '20_16_17')
        ),
        'spot-2021',
    ),
    Recordings(
        'SPOT, 2023, 20 s',  # the arm unfolds; to the end a log takes many minutes
        {'mass': (0.111,)},
        'the hand alone, 0.11 kg',
        'three of them',
        5,
        tuple(f'ExperimentData_RED_2023_{each}' for each in _2023),
        'spot-2023',
        20.0,
    ),
    *(
        Recordings(
            f'SPOT captures, {name}',
            {name: (value,) for name, value in WEIGHED.items()},
            'weighed, 12.04 kg; swung, 0.2257 kg m²',
            settled,
            count,
            tuple(_SUMMER.format(each) for each in folders),
            'spot-captures',
        )
        for name, settled, count, folders in (
            ('IC1', 'all', 5, ('ExperimentData_RED_2021_*_IC1_*',)),
            (
                'IC2, IC3',
                'none',
                10,
                ('ExperimentData_RED_2021_8_3*_IC2_trial*', 'ExperimentData_RED_2021_8_3*_IC3v2_trial*'),
            ),
            (
                'pushed or filmed',
                'none',
                4,
                ('ExperimentData_RED_2021_*perturbation*', 'ExperimentData_RED_2021_*VIDEO*'),
            ),
            (
                'all others',
                'none',
                33,
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
            ('named FAIL', 'none', 9, ('FAIL_*',)),
        )
    ),
    FanPlatform(
        'fans and a wheel, 30 s',
        {'mass': (MASS,)},
        'weighed, 1.220 kg',
        'none',
        5,
        ('control_data_DLMI_disturbance.csv', 'control_data_DLQR_*.csv'),
        end=30.0,
    ),
    Station(
        'space station, six windows',
        {'Ixx': (118.2,), 'Iyy': (60.4,), 'Izz': (170.7,)},
        'repeats: moments of window A',
        'A and the second',
        6,
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


def cells(found: Outcome, which: int, recordings: Recordings) -> list[str]:
    """Return how many are published, how many of their numbers hold, the largest deviation, and the median width."""
    value, std = found.value[:, which], found.std[:, which]
    published = np.isin(found.status[:, which], PUBLISHED) & np.isfinite(value).any(axis=1)
    if not published.any():
        return ['0', '-', '-']
    off = np.concatenate([
        np.max(np.abs(np.array(each)[:, None] - value[published, place]) / std[published, place], axis=0)
        for place, each in enumerate(recordings.truth.values())
    ])  # fmt: skip
    off = off[np.isfinite(off)]
    shown = list(recordings.truth).index(recordings.width)
    widths = (std / np.abs(value))[published, shown]
    return [
        f'{published.sum()}',
        f'{np.sum(off < BAND)} of {len(off)}, off by at most {off.max():.1f} std',
        f'± {100.0 * BAND * np.nanmedian(widths):.0f} %' if np.isfinite(widths).any() else '-',
    ]


def row(recordings: Recordings, found: Outcome) -> list[str]:
    """Return a line of the table."""
    repaired = cells(found, 1, recordings) if np.any(found.status[:, 1] != '') else ['-', '-', '-']
    return [recordings.name, recordings.shown, f'{len(found)}', recordings.settled,
            *cells(found, 0, recordings), *repaired]  # fmt: skip


def run(clones: Path, logs: Mapping[int, Sequence[Path]], number: int, place: int) -> Outcome:
    """Return the outcome of one log of a row; of one that fails, why."""
    log = logs[number][place]
    with TemporaryDirectory() as folder:
        try:
            return ALL[number].outcome(log, place, Path(folder), clones)
        except Exception as error:  # noqa: BLE001 - the other recordings are measured all the same
            failed = Result(FAILED, causes=(' '.join(f'{type(error).__name__}: {error}'.split()),))
            return Outcome.of_results(f'{log.parent.name}/{log.stem}', ALL[number].truth, failed, Result())


def commit() -> str:
    """Return the commit that is measured; empty if files differ from it, or outside a clone."""

    def git(*arguments: str) -> str:
        command = ['git', '-C', str(ROOT), *arguments]
        return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False).stdout.strip()

    return '' if git('status', '--porcelain', '--', '.', ':!docs') else git('rev-parse', '--short', 'HEAD')


def unfit(state: str, counts: Mapping[int, int]) -> Iterable[str]:
    """Yield why the page cannot be written; `counts` are the logs of each row that is measured."""
    if not state:
        yield 'files differ from the commit'
    if left_out := len(ALL) - len(counts):
        yield f'{left_out} rows are left out'
    for number, count in counts.items():
        if count != ALL[number].count:
            yield f'{ALL[number].name}: {count} of {ALL[number].count} logs'


def main() -> None:
    """Write the table; print a line for each recording, and the missing logs."""
    frame = Frame(__doc__, 'measured/hardware.md', seeds=MOST, clones='clones')
    chosen = frame.chosen(range(len(ALL)), lambda number: ALL[number].name)
    clones, state = Path(frame.arguments.clones), commit()
    logs = {number: ALL[number].found(clones) for number in chosen}
    counts = {number: min(len(logs[number]), frame.arguments.seeds) for number in chosen}
    reasons = list(unfit(state, counts))
    if not state:
        frame.arguments.store = None  # what it has may be of other files
    if reasons:
        frame.arguments.output = None
    files = {number: f'hardware {state} {number}' for number, count in counts.items() if count}

    def line(number: int, found: Outcome) -> list[str]:
        print('\n'.join(found.shown))
        if failed := int(np.sum(found.status[:, 0] == FAILED)):
            reasons.append(f'{ALL[number].name}: {failed} failed')
            frame.arguments.output = None
        return row(ALL[number], found)

    frame.tabulate(HEADER, frame.outcomes(Outcome, partial(run, clones, logs), files, counts), line, 'hardware',
                   f'commit {state}')  # fmt: skip
    for reason in reasons:
        print(f'the page stays as it was: {reason}')


if __name__ == '__main__':
    main()
