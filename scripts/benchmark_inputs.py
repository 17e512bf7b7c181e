"""Write docs/measured/inputs.md: what comes of joint states, poses and bags as robots really publish them.

Each kind of fault is put into a shipped bag, and the executables read it: the true mass, or the true cause first.
"""

import contextlib
import io
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import input_faults as faults
from benchmarks import input_files as files
from benchmarks.frame import Frame, provenance, table
from benchmarks.input_faults import ETS7, JOINTS, ODOM, SERVICER7, Made, Source, changed, parted
from mbaid_ros.errors import DataError
from mbaid_ros.replay.arguments import noise_at_rest, replay
from mbaid_ros.testing import running, wait_for_estimate

Make = Callable[[Path, Source], Made]


@dataclass(frozen=True)
class Kind:
    """A fault: makers of its bag and robot description, and the right outcome."""

    name: str
    make: Make
    right: str = ''  # part of the first cause or of a warning; empty is the true mass
    arguments: tuple[str, ...] = ()
    at_rest: bool = False
    source: Source = SERVICER7
    live: bool = False  # whether it goes through the node
    whole: bool = False  # whether the cause needs all of the bag


DIFFERENCE, TRAJECTORY = ('--method', 'difference'), ('--method', 'trajectory')
TWO, NO_FLOAT = 'joint states come from two sources', 'the base does not move while the arm does'
WHOLE, DEGREES = 'reads whole numbers', 'far beyond its limits in the robot description: degrees'


def made(make: Callable[..., Made], *values: Any, **named: Any) -> Make:
    """Return a maker that has more arguments than its folder and its source."""
    return lambda folder, source: make(folder, source, *values, **named)


joints, poses, both = (partial(made, changed, topics) for topics in ([JOINTS], [ODOM], [JOINTS, ODOM]))
wheel, finger = (partial(made, faults.with_part, name) for name in ('wheel', 'finger'))
turned = partial(Rotation.from_euler, degrees=True)
second, parts = (partial(made, parted, each) for each in (faults.second_stream, faults.in_parts))

KINDS = (
    Kind('1 chunks without message index', made(files.rewritten, **files.UNINDEXED)),
    Kind('1 no chunks', made(files.rewritten, **files.UNCHUNKED), source=ETS7),
    Kind('1 chunks compressed by LZ4', made(files.rewritten, **files.LZ4)),
    Kind('1 cut off by a crash', files.cut),
    Kind('2 compressed file, no metadata', made(files.compressed)),
    Kind('2 compressed parts, the last one open', made(files.compressed, 20.0, 40.0), source=ETS7),
    Kind('3 a joint named as a link', made(files.renamed, 'joint3', 'link2')),
    Kind('3 a joint named universe', made(files.renamed, 'joint2', 'universe'), source=ETS7),
    Kind('3 a joint named root_joint', made(files.renamed, 'joint1', 'root_joint')),
    Kind('3 names with spaces and slashes', made(files.renamed, 'joint5', 'arm/é joint 5')),
    Kind('4 a joint parked at a half turn, at rest', files.parked, 'joint_position: 1.0e-04', at_rest=True),
    Kind('5 a wheel at 8 rad a reading', wheel(lambda t: 400.0 * t, 400.0)),
    Kind('5 the same, on and on', wheel(lambda t: 400.0 * t, 400.0, wrapped=False), live=True),
    Kind('5 a wheel at -3 rad a reading', wheel(lambda t: -150.0 * t, -150.0), arguments=TRAJECTORY),
    Kind('5 a wheel at 60 rad a reading', wheel(lambda t: 3e3 * t, 3e3), arguments=DIFFERENCE),
    Kind(
        '5 a wheel at 2 rad a reading, no velocity',
        wheel(lambda t: 100.0 * t, None),
        'wheel turns by more than a quarter',
    ),
    Kind('6 joint states of zeros, 1 in 300', joints(faults.dropouts, 300)),
    Kind('6 zeros, 1 in 50', joints(faults.dropouts, 50), source=ETS7),
    Kind('6 zeros, 1 in 2000', joints(faults.dropouts, 2000), arguments=TRAJECTORY),
    Kind('6 zeros of three joints, 1 in 200', joints(faults.dropouts, 200, slice(2, 5)), live=True),
    Kind('6 3e-246 of one joint, 1 in 400', joints(faults.dropouts, 400, 5, 3e-246), arguments=DIFFERENCE),
    Kind('7 a source of zeros, same stamps', second(1, 0.0, np.zeros_like), TWO),
    Kind('7 zeros between, 10 Hz, no velocities', second(5, 0.01, np.zeros_like, rates=False), TWO),
    Kind('7 of two joints, 25 Hz', second(2, 0.007, np.zeros_like, joints=slice(2, 4)), live=True),
    Kind('7 a pose of planning', second(3, 0.01, lambda q: 0 * q + 0.3, rates=False), TWO, source=ETS7),
    Kind('8 default namespace in the URDF', made(files.replaced, '<robot ', '<robot xmlns="urdf" ')),
    Kind(
        '8 mark of the byte order, namespace with a prefix',
        made(files.replaced, '<robot ', '<robot xmlns:xacro="x" ', '<', '\ufeff<'),
    ),
    Kind('9 a base without inertia', made(files.inertia, 'base_link', 0.0), 'no inertia'),
    Kind('9 a base with an inertia 1e6 times as large', made(files.inertia, 'base_link', 1e6), 'base_link'),
    Kind('9 the same of a link', made(files.inertia, 'link3', 1e6), 'link3', TRAJECTORY),
    Kind('10 joints new every 0.1 s', joints(faults.held(5))),
    Kind(
        '10 joints new every 0.3 s',
        joints(faults.held(15)),
        'too few joint states for windows',
        source=ETS7,
        whole=True,
    ),
    Kind('10 the same, with longer windows', joints(faults.held(15)), arguments=('-p', 'window:=1.5'), source=ETS7),
    Kind('10 joints new every 0.06 s', joints(faults.held(3)), arguments=DIFFERENCE, live=True),
    Kind('10 one joint new every 0.2 s', joints(faults.held(10, 3)), 'joint4 repeats its readings'),
    Kind('11 positions in other axes', poses(faults.axes, [[1, 0, 0], [0, 0, -1], [0, 1, 0]]), '(x, -z, y) in'),
    Kind(
        '11 two axes exchanged, one turned round',
        poses(faults.axes, [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
        '(y, x, -z) in',
        source=ETS7,
    ),
    Kind('11 left-handed axes', poses(faults.axes, np.diag([1, -1, 1])), '(x, -y, z) in', TRAJECTORY, whole=True),
    Kind(
        '11 the frame turned by 90 degrees',
        poses(faults.axes, turn=turned('z', 90)),
        'turned by 90 degrees about (0, 0, 1)',
    ),
    Kind(
        '11 by -90 degrees about x',
        poses(faults.axes, turn=turned('x', -90)),
        'turned by 90 degrees about (-1, 0, 0)',
        source=ETS7,
    ),
    Kind(
        '11 by 120 degrees',
        poses(faults.axes, turn=Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])),
        'turned by 120 degrees about (0.58, 0.58, 0.58)',
    ),
    Kind('12 a table with a mark of the byte order', made(files.table, first='\ufeff')),
    Kind('12 a table with semicolons and CRLF', made(files.table, ';', '\ufeff', '\r\n'), source=ETS7),
    Kind('12 a table of degrees', made(files.table, degrees=True), DEGREES),
    Kind('13 all stamps set back by 0.4 s', both(faults.clock, -0.4)),
    Kind('13 all set back by 1 s', both(faults.clock, -1.0, 20.0), source=ETS7),
    Kind('13 stamps of the joints set back', joints(faults.clock, -0.4), 'joint states went back by 0.4 s'),
    Kind('13 by 0.1 s', joints(faults.clock, -0.1), 'joint states went back by 0.1 s', TRAJECTORY),
    Kind('13 by 1 s', joints(faults.clock, -1.0, 15.0), 'joint states went back by 1 s', DIFFERENCE),
    Kind('13 poses set back by 0.2 s', poses(faults.clock, -0.2), 'the base went back by 0.2 s', live=True),
    Kind('13 poses set forward by 2 s', poses(faults.clock, 2.0), 'the base went forward by 2 s', source=ETS7),
    Kind('14 joints in parts after all at once', parts(slice(0, 4), slice(4, 7))),
    Kind('14 each joint by itself', parts(*(slice(k, k + 1) for k in range(7)), whole=False), live=True),
    Kind('14 parts in another order', parts(slice(3, 6), slice(0, 3)), source=ETS7),
    Kind('15 three seconds of lost tracking', poses(faults.lost, 20.0, 23.0)),
    Kind('15 none for the first two seconds', poses(faults.lost, 0.0, 2.0), 'first 100 poses of the base', live=True),
    Kind('15 ten seconds of poses of NaN', poses(faults.lost, 15.0, 25.0, [np.nan] * 7), source=ETS7),
    Kind('15 quaternions of zeros, at rest', files.parked, 'base_orientation: 5', at_rest=True),
    Kind('15 quaternions of zeros for a second', poses(faults.lost, 30.0, 31.0, [0] * 7)),
    Kind('16 poses stamped in batches of 5', poses(faults.batched, 5), 'base come in batches'),
    Kind('16 in batches of 3', poses(faults.batched, 3), 'base come in batches', source=ETS7),
    Kind('16 joints stamped in batches of 10', joints(faults.batched, 10), 'joint states come in batches', live=True),
    Kind('18 a finger at rest, at 2.5 Hz', finger(lambda _: 0.1, 0.0, 20)),
    Kind('18 at 5 Hz', finger(lambda _: -0.7, 0.0, 10), source=ETS7),
    Kind('18 a joint that moves, at 5 Hz', parts(slice(0, 6), slice(6, 7), whole=False, last=10)),
    Kind('19 velocities of zero', joints(faults.velocities, lambda _q, v: 0 * v), arguments=DIFFERENCE),
    Kind('19 of one joint', joints(faults.velocities, lambda _q, v: 0 * v, 3), arguments=DIFFERENCE),
    Kind(
        '19 constant velocities', joints(faults.velocities, lambda _q, v: 0 * v + 0.1), arguments=DIFFERENCE, live=True
    ),
    Kind('19 the positions as velocities', joints(faults.velocities, lambda q, _v: q)),
    Kind('19 velocities in degrees a second', joints(faults.velocities, lambda _q, v: 57.3 * v), arguments=DIFFERENCE),
    Kind('20 ticks, 4096 a turn', joints(faults.units, 4096 / 2 / np.pi, 2048.0, whole=True), WHOLE),
    Kind('20 ticks of one joint', joints(faults.units, 652.0, 0.0, 3, whole=True), 'joint4 reads whole', live=True),
    Kind('20 ticks, 65536 a turn', joints(faults.units, 65536 / 2 / np.pi, whole=True), WHOLE, DIFFERENCE, source=ETS7),
    Kind('20 degrees', joints(faults.units, 180.0 / np.pi, whole=False), DEGREES),
    Kind('20 whole degrees', joints(faults.units, 180.0 / np.pi, whole=True), WHOLE, source=ETS7),
    Kind('22 a bag of ROS 1', files.ros1, 'ROS 1'),
    Kind('23 recorded at time zero at first', made(files.recorded_at, lambda number, time: 0 if number < 20 else time)),
    Kind('23 all recorded at one time', made(files.recorded_at, lambda _number, _time: 10**18), source=ETS7),
    Kind('25 a joint that is NaN', joints(faults.dropouts, 1, 3, np.nan), 'position of joint4 is NaN'),
    Kind('25 another one', joints(faults.dropouts, 1, 0, np.nan), 'position of joint1 is NaN', source=ETS7),
    Kind('25 the velocity of a joint', joints(faults.dropouts, 1, 2, np.nan, of='velocity')),
    Kind('26 a base that is bolted', poses(faults.fixed, 1e-3), NO_FLOAT),
    Kind('26 exactly', poses(faults.fixed, 0.0), NO_FLOAT, DIFFERENCE),
    Kind('26 with more noise', poses(faults.fixed, 2e-3), NO_FLOAT, source=ETS7, whole=True),
    Kind("26 another body's poses, which drifts", poses(faults.fixed, 1e-3, 0.01), NO_FLOAT, TRAJECTORY),
)


FAR = 5.0  # standard deviations
BRIEF = '25'  # s, of a bag, that show a cause


def outcomes(kinds: Sequence[Kind]) -> Iterator[list[str]]:
    """Yield a row for each kind."""
    for kind in kinds:
        with tempfile.TemporaryDirectory() as folder:
            bag, robot = kind.make(Path(folder), kind.source)
            how = live if kind.live else at_rest if kind.at_rest else replayed
            found, right = how(kind, bag, robot, Path(folder))
        print(f'{kind.name}: {"right" if right else "WRONG"}: {found}', flush=True)
        where = 'noise_at_rest' if kind.at_rest else 'node' if kind.live else ' '.join(('replay', *kind.arguments))
        shown = found.replace('|', '/').replace(folder, '')
        yield [kind.name, f'{kind.source.bag}, {where}', shown, 'yes' if right else '**no**']


def at_rest(kind: Kind, bag: Path, _robot: Path, _folder: Path) -> tuple[str, bool]:
    """Return the noise that is found, and whether it is right."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        noise_at_rest([str(bag)])
    lines = [line.strip() for line in out.getvalue().splitlines() if line.startswith('      ')]
    return ', '.join(lines), any(line.startswith(kind.right) for line in lines)


def replayed(kind: Kind, bag: Path, robot: Path, folder: Path) -> tuple[str, bool]:
    """Return what a user of `replay` sees first, and whether it is right."""
    errors, result = io.StringIO(), folder / 'result.json'
    words = [str(bag), '--model', str(robot), '--params', str(kind.source.parameters), '--json', str(result)]
    words += ['--end', BRIEF] if kind.right and not kind.whole else []
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        code = replay([*words, *kind.arguments])
    if code == 2:
        text = errors.getvalue().strip()
        return text, bool(kind.right) and kind.right in text and text.count('\n') == 0
    found: dict[str, Any] = json.loads(result.read_text())
    causes = [each['cause'] for each in found['causes']]
    mass, std = found['estimate']['mass'], (found['std'] or {}).get('mass')
    return judged(kind, found['status'], causes or found['warnings'], mass, std)


def live(kind: Kind, bag: Path, robot: Path, _folder: Path) -> tuple[str, bool]:
    """Return the last estimate of the node, which a player feeds at twice the speed, and whether it is right."""
    given = ['--ros-args', '--params-file', str(kind.source.parameters), '-p', f'robot_description_file:={robot}']
    given += ['-p', f'method:={kind.arguments[1]}'] if kind.arguments else []
    with running('estimator', *given), running('player', str(bag), '--rate', '2', '--wait-for-subscribers', '60'):
        try:
            found = wait_for_estimate('stale', 600.0)  # a run without a solution searches on
        except TimeoutError as error:
            raise DataError(f'{kind.name}: {error}') from error
    return judged(kind, found.status, list(found.warnings), found.inertia.m, found.standard_deviation[0])


def judged(kind: Kind, status: str, named: Sequence[str], mass: float | None, std: float | None) -> tuple[str, bool]:
    """Return what a user sees first, and whether that is the true cause or mass."""
    if kind.right:
        first = next(iter(named), '')
        return f'{status}: {first}', kind.right in first
    if mass is None or std is None:
        return f'{status}: no mass; {next(iter(named), "")}', False
    good = abs(mass - kind.source.mass) < FAR * std and status != 'inconsistent'
    return f'{status}: {mass:.3f} ± {std:.3f} kg', good


SECTIONS = ((1, 9), (10, 15), (16, 26))  # of the page, by the numbers that the rows begin with


def main() -> None:
    """Run all kinds, and write the page."""
    frame = Frame(__doc__, 'measured/inputs.md', only='')
    rows = list(outcomes([kind for kind in KINDS if frame.arguments.only in kind.name]))
    header = ['fault', 'bag and executable', 'first line', 'right']
    sections = [
        f'## Faults {first} to {last}\n\n{table(header, part, words=True)}'
        for first, last in SECTIONS
        if (part := [row for row in rows if first <= int(row[0].split()[0]) <= last])
    ]
    right = f'**{sum(row[-1] == "yes" for row in rows)} of {len(rows)} are right.**'
    frame.write(faults='\n\n'.join([right, *sections, provenance()]))


if __name__ == '__main__':
    main()
