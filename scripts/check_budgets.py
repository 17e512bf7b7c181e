#!/usr/bin/env python3
"""Compare each folder's lines of Python with the budgets in architecture.md; --write sets them to the present lines.

usage: check_budgets.py [--write]
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'explanation' / 'architecture.md'
ROW = re.compile(r'^\| `([\w/]+)` \| (\d+) \| (.*) \|$', re.MULTILINE)


def lines(folder: str) -> int:
    """Return how many lines the Python files below a folder have."""
    return sum(path.read_bytes().count(b'\n') for path in (ROOT / folder).rglob('*.py'))


def main() -> int:
    """Return 1 and name every folder of the page that is over its budget."""
    page = PAGE.read_text(encoding='utf-8')
    if '--write' in sys.argv[1:]:
        PAGE.write_text(ROW.sub(lambda row: f'| `{row[1]}` | {lines(row[1])} | {row[3]} |', page), 'utf-8')
        return 0
    wrong = []
    for folder, budget, _ in ROW.findall(page):
        if lines(folder) > int(budget):
            wrong.append(f'{folder} has {lines(folder)} lines, its budget in docs/{PAGE.name} is {budget}')
    print('\n'.join(wrong) or f'{lines("mbaid_ros")} lines of package, all folders within their budgets')
    return bool(wrong)


if __name__ == '__main__':
    sys.exit(main())
