"""Which tests import a file, and how directly."""

from __future__ import annotations

import ast
from collections import deque
from functools import cache
from pathlib import Path

_SOURCES = ('', 'test', 'scripts')  # folders that Python looks for modules in
_PACKAGE, _TESTS = 'mbaid_ros', 'test'


class Imports:
    """The imports of the project's files.

    Parameters
    ----------
    root : folder of the project
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._tests = sorted((root / _TESTS).rglob('test_*.py'))
        self.imported = cache(self._imported)

    def tests_of(self, path: Path) -> tuple[list[str], list[str]]:
        """Return the test files that may notice a mistake in a file, those first that import it most directly.

        First all of the mirrored folder, or of the nearest one above it; then others that import the file themselves or
        by a module of the tests.
        """
        folder = self._root / _TESTS / path.parent.relative_to(self._root / _PACKAGE)
        while not any(folder.glob('test_*.py')):
            folder = folder.parent
        mirrored, others = [], []
        for test in self._tests:
            distance, size = self._distances(test).get(path), len(self._distances(test))
            if test.parent == folder:
                mirrored.append((distance is None, distance or 0, size, test))
            elif path in self._reached_by_tests(test):
                others.append((distance is None, distance or 0, size, test))
        first, later = ([str(each[-1].relative_to(self._root)) for each in sorted(part)] for part in (mirrored, others))
        return first, later

    @cache  # noqa: B019 - as long as the program
    def _distances(self, test: Path) -> dict[Path, int]:
        """Return all files that a test imports, by how many imports."""
        found, queue = {test: 0}, deque([test])
        while queue:
            here = queue.popleft()
            for each in self.imported(here):
                if each not in found:
                    found[each] = found[here] + 1
                    queue.append(each)
        return found

    @cache  # noqa: B019
    def _reached_by_tests(self, test: Path) -> set[Path]:
        """Return the files that a test imports, or another module of the tests that it imports."""
        own = [each for each in self._distances(test) if (self._root / _PACKAGE) not in each.parents]
        return {imported for each in own for imported in self.imported(each)}

    def _imported(self, path: Path) -> tuple[Path, ...]:
        """Return the project's files that a file imports."""
        names = []
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names += [each.name for each in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names += [node.module, *(f'{node.module}.{each.name}' for each in node.names)]
        return tuple(dict.fromkeys(file for name in names if (file := self._file(name))))

    @cache  # noqa: B019
    def _file(self, name: str) -> Path | None:
        """Return the file of a module of the project."""
        for source in _SOURCES:
            place = self._root.joinpath(source, *name.split('.'))
            for file in (place.with_suffix('.py'), place / '__init__.py'):
                if file.is_file():
                    return file
        return None
