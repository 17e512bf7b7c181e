"""Damaged bags through `replay`; `make fuzz` sends thousands."""

from __future__ import annotations

import pytest

import fuzz_files


@pytest.mark.parametrize('inputs', [5, pytest.param(40, marks=pytest.mark.long)])
def test_damaged_files_end_with_an_exit_code_and_a_line(inputs: int) -> None:
    outcome = fuzz_files.fuzz(inputs, 2)
    assert len(outcome) == 12
    for found in outcome.values():
        assert found.wrong == []
        assert sum(found.codes.values()) == inputs
    assert all(found.codes[2] for kind, found in outcome.items() if kind != 'metadata')
