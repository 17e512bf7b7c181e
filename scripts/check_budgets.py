#!/usr/bin/env python3
"""Compare each folder's lines of Python with the budgets in architecture.md; --write sets them to the present lines.

usage: check_budgets.py [--write]
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'explanation' / 'architecture.md'
ROW = re.compile(r'^\| `([\w/]+)` \| (\d+) \| (.*) \|$', re.MULTILINE)
# Folders with a budget of their own; `mbaid_ros` counts all of the package.
FOLDERS = (
    'mbaid_ros',
    *('mbaid_ros/core', 'mbaid_ros/core/filter', 'mbaid_ros/core/diagnosis', 'mbaid_ros/core/difference'),
    *('mbaid_ros/core/results', 'mbaid_ros/core/robot', 'mbaid_ros/core/sensors', 'mbaid_ros/core/unknowns'),
    *('mbaid_ros/simulation', 'mbaid_ros/planning', 'mbaid_ros/calibration', 'mbaid_ros/config', 'mbaid_ros/session'),
    *('mbaid_ros/nodes', 'mbaid_ros/replay', 'mbaid_ros/bags', 'mbaid_ros/recordings', 'scripts', 'test'),
)


def lines(folder: str) -> int:
    """Return how many lines the Python files below a folder have."""
    return sum(path.read_bytes().count(b'\n') for path in (ROOT / folder).rglob('*.py'))


def main() -> int:
    """Return 1 and name every folder that is over its budget, or that has none."""
    page = PAGE.read_text(encoding='utf-8')
    reasons = {folder: (int(budget), reason) for folder, budget, reason in ROW.findall(page)}
    if '--write' in sys.argv[1:]:
        rows = [f'| `{each}` | {lines(each)} | {reasons.get(each, (0, "as before"))[1]} |' for each in FOLDERS]
        head, rest = page.split('|---|---|---|\n', 1)
        PAGE.write_text('\n'.join([f'{head}|---|---|---|', *rows, rest[rest.index('<!-- end of budgets') :]]), 'utf-8')
        return 0
    wrong = [f'{each} has no budget in {PAGE.name}' for each in FOLDERS if each not in reasons]
    for folder, (budget, _) in reasons.items():
        if lines(folder) > budget:
            wrong.append(f'{folder} has {lines(folder)} lines, its budget in docs/{PAGE.name} is {budget}')
    print('\n'.join(wrong) or f'{lines("mbaid_ros")} lines of package, all folders within their budgets')
    return bool(wrong)


if __name__ == '__main__':
    sys.exit(main())
