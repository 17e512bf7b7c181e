"""Conditions of the benchmarks with less data than they have there."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.honesty.disturbed import CATALOGUE


def shorten(monkeypatch: pytest.MonkeyPatch, name: str, seconds: float) -> None:
    """Let the runs of a condition end after some seconds, within a test."""
    condition = CATALOGUE[name]
    short = replace(condition, world=lambda seed: replace(condition.world(seed), seconds=seconds))
    monkeypatch.setitem(CATALOGUE, name, short)
