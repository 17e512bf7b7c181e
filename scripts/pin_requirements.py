"""Write constraints.txt: every package that requirements.txt leads to, at one version for each supported Python.

usage: pin_requirements.py [--keep] PYTHON3.10 PYTHON3.11 PYTHON3.12 PYTHON3.13    (interpreters with a recent pip)

requirements.lock has the same with the SHA-256 of each file. With --keep the versions stay, and only that is written.
"""

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
CONSTRAINTS, LOCK = ROOT / 'constraints.txt', ROOT / 'requirements.lock'
LOCK_HEADER = """\
# constraints.txt with the SHA-256 of the file that pip takes on Linux x86_64 (glibc) for each of these Pythons:
# `make setup HASHES=1` accepts no other. Written by scripts/pin_requirements.py.
"""


Packages = dict[str, tuple[str, str]]  # version, and SHA-256 of the file, by name


def resolve(python: str, *, keep: bool) -> tuple[str, Packages]:
    """Return the version of an interpreter, like 3.12, and the packages that pip would install for it."""
    command = [python, '-m', 'pip', 'install', '--quiet', '--dry-run', '--ignore-installed', '--report', '-']
    command += ['-r', str(ROOT / 'requirements.txt'), *(['-c', str(CONSTRAINTS)] if keep else [])]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    packages: Packages = {}
    for item in report['install']:
        name = re.sub('[-_.]+', '-', item['metadata']['name']).lower()
        packages[name] = item['metadata']['version'], item['download_info']['archive_info']['hashes']['sha256']
    return report['environment']['python_version'], packages


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


def write(found: dict[str, Packages], *, keep: bool) -> None:
    """Write both files, or the hashes alone, from the packages by the version of the interpreter."""
    pythons = sorted(found, key=lambda python: int(python.split('.')[1]))
    pinned, with_hashes = [], []
    for name in sorted(set().union(*found.values())):
        versions = {python: found[python][name][0] if name in found[python] else None for python in pythons}
        for line in lines(name, versions):
            version = line.partition('==')[2].partition(';')[0]
            of_it = {found[python][name][1] for python in pythons if versions[python] == version}
            pinned.append(line)
            with_hashes.append(' '.join([line, *(f'--hash=sha256:{each}' for each in sorted(of_it))]))
    if not keep:
        CONSTRAINTS.write_text(HEADER + '\n'.join(pinned) + '\n')
    LOCK.write_text(LOCK_HEADER + '\n'.join(with_hashes) + '\n')


def main() -> None:
    """Resolve for each interpreter, and write both files."""
    keep = '--keep' in sys.argv
    pythons = [word for word in sys.argv[1:] if word != '--keep']
    if not pythons:
        sys.exit(__doc__)
    write(dict(resolve(python, keep=keep) for python in pythons), keep=keep)


if __name__ == '__main__':
    main()
