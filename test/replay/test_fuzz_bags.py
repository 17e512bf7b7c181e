"""Damaged bags through `replay`; `make fuzz` sends thousands."""

from __future__ import annotations

import pytest

import fuzz_files


@pytest.mark.parametrize(('inputs', 'apart'), [(8, ['MCAP schemas']), pytest.param(40, None, marks=pytest.mark.long)])
def test_damaged_files_end_with_an_exit_code_and_a_line(inputs: int, apart: list[str] | None) -> None:
    outcome = fuzz_files.fuzz(inputs, 2)
    assert len(outcome) == 11
    for found in outcome.values():
        assert found.wrong == []
        assert sum(found.codes.values()) == inputs
    assert all(found.codes[2] for kind, found in outcome.items() if kind != 'metadata')
    # An executable in a process of its own does the same: of one kind, or of each.
    assert not any(found.wrong for found in fuzz_files.fuzz(1, 2, apart, every=1).values())
