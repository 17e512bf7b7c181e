"""Write constraints.txt: every package that requirements.txt leads to, at one version for each supported Python.

usage: pin_requirements.py PYTHON3.10 PYTHON3.11 PYTHON3.12 PYTHON3.13    (paths of interpreters with a recent pip)
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HEADER = """\
# Every package that requirements.txt leads to, pinned; tried with CPython 3.10, 3.11, 3.12 and 3.13.
# Written by scripts/pin_requirements.py.
"""


def resolve(python: str) -> tuple[str, dict[str, str]]:
    """Return the version of an interpreter, like 3.12, and the packages that pip would install for it."""
    command = [python, '-m', 'pip', 'install', '--quiet', '--dry-run', '--ignore-installed', '--report', '-']
    run = subprocess.run([*command, '-r', str(ROOT / 'requirements.txt')], check=True, capture_output=True, text=True)
    report = json.loads(run.stdout)
    packages = [item['metadata'] for item in report['install']]
    names = [re.sub('[-_.]+', '-', package['name']).lower() for package in packages]
    return report['environment']['python_version'], {
        name: package['version'] for name, package in zip(names, packages, strict=True)
    }


def lines(name: str, versions: dict[str, str | None]) -> list[str]:
    """Return the constraints of one package, given its version for each Python in ascending order."""
    if len(set(versions.values())) == 1:
        return [f'{name}=={next(iter(versions.values()))}']
    pythons = list(versions)
    constraints = []
    for version, group in groupby(pythons, key=versions.__getitem__):
        first, *_, last = [*group] * 2
        bounds = [f"python_version >= '{first}'"] if first != pythons[0] else []
        bounds += [f"python_version <= '{last}'"] if last != pythons[-1] else []
        bounds = [f"python_version == '{first}'"] if first == last else bounds
        if version is not None:
            constraints.append(f'{name}=={version}; {" and ".join(bounds)}')
    return constraints


def main() -> None:
    """Resolve for each interpreter and write what they agree on once, what differs with markers."""
    if len(sys.argv) == 1:
        sys.exit(__doc__)
    resolved = dict(resolve(python) for python in sys.argv[1:])
    pythons = sorted(resolved, key=lambda python: int(python.split('.')[1]))
    names = sorted(set().union(*resolved.values()))
    pinned = [
        line for name in names for line in lines(name, {python: resolved[python].get(name) for python in pythons})
    ]
    (ROOT / 'constraints.txt').write_text(HEADER + '\n'.join(pinned) + '\n')


if __name__ == '__main__':
    main()
