"""Write docs/measured/inputs.md: the outcome of joint states, poses and bags as robots really publish them.

Each kind of fault is put into bags/servicer7_mid, and the executables read it: the true mass, or the true cause first.
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
from benchmarks.input_faults import ROBOT, ROOT
from benchmarks.input_kinds import KINDS, Kind
from mbaid_ros.replay.start import noise_at_rest, replay

TRUE_MASS, FAR = 162.0, 5.0  # kg, standard deviations


def outcomes(kinds: Sequence[Kind]) -> Iterator[list[str]]:
    """Yield a row for each kind."""
    for kind in kinds:
        with tempfile.TemporaryDirectory() as folder:
            found, right = outcome(kind, Path(folder))
        print(f'{kind.name}: {"right" if right else "WRONG"}: {found}', flush=True)
        yield [kind.name, found.replace('|', '/'), 'yes' if right else '**no**']


def outcome(kind: Kind, folder: Path) -> tuple[str, bool]:
    """Return the first line that a user sees, and whether it is right."""
    bag, robot = kind.make(folder)
    out, errors = io.StringIO(), io.StringIO()
    result = folder / 'result.json'
    words = ['--params', str(ROBOT.with_name('servicer7_estimator.yaml')), '--json', str(result), *kind.arguments]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = noise_at_rest([str(bag)]) if kind.at_rest else replay([str(bag), '--model', str(robot), *words])
    if kind.at_rest:
        lines = [line.strip() for line in out.getvalue().splitlines() if line.startswith('      ')]
        return ', '.join(lines), any(line.startswith(kind.right) for line in lines)
    if code == 2:
        text = errors.getvalue().strip().replace(str(folder), '')
        return text, bool(kind.right) and kind.right in text and text.count('\n') == 0
    found: dict[str, Any] = json.loads(result.read_text())
    mass, std = found['estimate']['mass'], (found['std'] or {}).get('mass')
    first = next((each['cause'] for each in found['causes']), next(iter(found['warnings']), ''))
    if kind.right:
        return f'{found["status"]}: {first}', kind.right in first
    good = (
        mass is not None and std is not None and abs(mass - TRUE_MASS) < FAR * std and found['status'] != 'inconsistent'
    )
    number = 'no mass' if mass is None or std is None else f'{mass:.3f} ± {std:.3f} kg'
    return f'{found["status"]}: {number}', good


def main() -> None:
    """Run all kinds, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--output', type=Path, default=ROOT / 'docs')
    parser.add_argument('--only', default='', help='kinds whose name contains this')
    arguments = parser.parse_args()
    rows = list(outcomes([kind for kind in KINDS if arguments.only in kind.name]))
    right = sum(row[-1] == 'yes' for row in rows)
    header = ['fault', 'first line', 'right']
    page = arguments.output / 'measured' / 'inputs.md'
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(
        '# Inputs as robots publish them\n\nWritten by `make benchmark-inputs`. Each fault is put into '
        '`bags/servicer7_mid` (mass 162 kg), and the\nexecutables read it. Right is the true mass within 5 standard '
        f'deviations, or the true cause first.\n\n**{right} of {len(rows)} are right.**\n\n'
        f'{table(header, rows, words=True)}\n\n{provenance()}\n'
    )


if __name__ == '__main__':
    main()
