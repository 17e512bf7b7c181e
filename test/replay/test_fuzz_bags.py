"""Damaged bags through `replay`; `make fuzz` sends two thousand."""

from __future__ import annotations

import runpy

from simulated import CONFIG


def test_damaged_bags_end_with_an_exit_code_and_a_line() -> None:
    fuzz = runpy.run_path(str(CONFIG.parent / 'scripts' / 'fuzz_bags.py'))['fuzz']
    codes, _, wrong = fuzz(50, 1)
    assert wrong == []
    assert sum(codes.values()) == 50
    assert len(codes) > 1
