"""The benchmarks' runs go on from what a file holds of them."""

from __future__ import annotations

import runpy
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, make_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tqdm import tqdm

from mbaid_ros.core.geometry import Array
from simulated import CONFIG

FRAME = runpy.run_path(str(CONFIG.parent / 'scripts' / 'benchmarks' / 'frame.py'))
OUTCOME: Any = make_dataclass('OUTCOME', [('square', Array), ('powers', Array)], bases=(FRAME['Runs'],), frozen=True)


@dataclass(frozen=True)
class Said:
    """The square and some powers of a number."""

    square: float
    powers: Array


def completed(file: Path | None, count: int, fails_at: int = -1) -> tuple[Any, list[int]]:
    """Return the outcome of so many runs, and which of them were made."""
    made = []

    def run(number: int) -> Said:
        if number == fails_at:
            raise ArithmeticError
        made.append(number)
        return Said(number**2, number ** np.arange(3.0))

    with ThreadPoolExecutor(1) as pool, tqdm(disable=True) as bar:
        outcome = FRAME['completed'](OUTCOME, file, range(count), run, pool, bar)
    return outcome, made


def test_only_what_the_file_lacks_is_made(tmp_path: Path) -> None:
    file = tmp_path / 'new' / 'row.npz'
    whole, _ = completed(None, 23)
    assert np.array_equal(whole.powers[:, 2], np.arange(23) ** 2)
    for count, expected in ((2, range(2)), (23, range(2, 23)), (5, range(0)), (23, range(0))):
        outcome, made = completed(file, count)
        assert made == list(expected)
        assert np.array_equal(outcome.square, whole.square[:count])
        assert np.array_equal(outcome.powers, whole.powers[:count])


def test_what_was_made_before_a_failure_is_kept(tmp_path: Path) -> None:
    file = tmp_path / 'row.npz'
    with pytest.raises(ArithmeticError):
        completed(file, 30, fails_at=25)
    with np.load(file) as arrays:
        assert sorted(arrays) == ['powers', 'square']
        assert np.array_equal(arrays['square'], np.arange(20) ** 2)
    assert completed(file, 30)[1] == list(range(20, 30))
