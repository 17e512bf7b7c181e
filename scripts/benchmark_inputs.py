"""Write docs/measured/inputs.md: what comes of joint states, poses and bags as robots really publish them.

Each kind of fault is put into a shipped bag, and the executables read it: the true mass, or the true cause first.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.frame import provenance, table
from benchmarks.input_faults import ROOT
from benchmarks.input_kinds import KINDS, Kind
from mbaid_ros.core.errors import DataError
from mbaid_ros.replay.start import noise_at_rest, replay
from mbaid_ros.testing import running, wait_for_estimate

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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--output', type=Path, default=ROOT / 'docs')
    parser.add_argument('--only', default='', help='kinds whose name contains this')
    arguments = parser.parse_args()
    rows = list(outcomes([kind for kind in KINDS if arguments.only in kind.name]))
    right = sum(row[-1] == 'yes' for row in rows)
    header = ['fault', 'bag and executable', 'first line', 'right']
    sections = [
        f'## Faults {first} to {last}\n\n{table(header, part, words=True)}\n\n'
        for first, last in SECTIONS
        if (part := [row for row in rows if first <= int(row[0].split()[0]) <= last])
    ]
    page = arguments.output / 'measured' / 'inputs.md'
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(
        '# Inputs as robots publish them\n\nWritten by `make benchmark-inputs`. Each fault is put into a shipped bag '
        '(mass 162 kg, or 428.1 kg of\n`ets7`), and an executable reads it. Right is the true mass within 5 standard '
        f'deviations, or the true cause first.\n\n**{right} of {len(rows)} are right.**\n\n'
        f'{"".join(sections)}{provenance()}\n'
    )


if __name__ == '__main__':
    main()
