"""Estimates and other results as they were: a change of code that changes one is meant, and written anew, or a mistake.

`pytest -n 0 --write-estimates TESTS` writes those of some tests; the change is read in the difference of the files.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate

_FOLDER = Path(__file__).with_name('estimates')
# Of a standard deviation or a size: rounding differs between processors by far less, a mistake that matters by more.
_CLOSE = 1e-3
_UNKNOWN = 1e4  # standard deviations of undetermined numbers are as large: rounding decides how much larger
_OF_ONE = 'share', 'course of residuals'  # numbers of size one: of far smaller ones rounding is left
_WORDS = 30  # letters of a cause: wording may change


class Unchanged:
    """Compares a test's estimates with those of its file, or writes them there; of long tests there are none."""

    def __init__(self, test: str, path: Path, *, long: bool, write: bool) -> None:
        self._test, self._long, self._write = test, long, write
        self._path = _FOLDER / f'{path.parent.name}_{path.stem[5:]}.json'
        self._count = 0

    def __call__(self, estimate: Estimate) -> None:
        """Compare the next estimate of a test."""
        self._compare(dict(_parts(estimate)))

    def course(self, estimates: Sequence[Estimate]) -> Estimate:
        """Compare the next estimates of a test, all of a run, and return the last."""
        self._compare({**dict(_parts(estimates[-1])), **dict(_course(estimates))})
        return estimates[-1]

    def values(self, **found: Any) -> None:
        """Compare the next results of a test, by names: their numbers, each to a thousandth, and their texts."""
        parts: dict[str, Array | list[str] | str | int] = {}
        for name, value in found.items():
            leaves = [*_leaves(value)]
            texts = [_shortened(each) for each in leaves if isinstance(each, str)]
            parts[name] = np.array([each for each in leaves if not isinstance(each, str)], dtype=float)
            parts |= {f'{name} in words': texts} if texts else {}
        self._compare(parts)

    def _compare(self, found: dict[str, Array | list[str] | str | int]) -> None:
        if self._long:
            return
        name = f'{self._test}#{self._count}' if self._count else self._test
        self._count += 1
        kept = json.loads(self._path.read_text(encoding='utf-8')) if self._path.is_file() else {}
        if self._write:
            kept[name] = {part: _rounded(value) for part, value in found.items()}
            lines = (f'{json.dumps(each)}: {json.dumps(kept[each])}' for each in sorted(kept))
            self._path.write_text('{\n' + ',\n'.join(lines) + '\n}\n', encoding='utf-8')
            return
        assert set(found) == set(kept[name])
        for part, value in found.items():
            before = kept[name][part]
            if isinstance(value, np.ndarray):
                size = np.array(kept[name].get(f'{part} std', np.zeros(len(value))), dtype=float)
                close = _CLOSE * np.where(np.isfinite(size), size, 0.0)
                finite, expected = np.isfinite(value), np.array(before, dtype=float)
                numbers = np.minimum(value, _UNKNOWN if part.endswith('std') else np.inf)
                expected = np.minimum(expected, _UNKNOWN if part.endswith('std') else np.inf)
                np.testing.assert_array_less(
                    np.abs(np.where(finite, np.nan_to_num(numbers) - np.nan_to_num(expected), 0.0)),
                    close
                    + _CLOSE * np.maximum(np.abs(np.nan_to_num(numbers)), float(part.startswith(_OF_ONE)))
                    + 1e-9 * np.max(np.abs(np.nan_to_num(numbers)), initial=1e-3),
                    f'{part} was {before}, is {value.tolist()}',
                )
                assert finite.tolist() == np.isfinite(expected).tolist(), part
            else:
                assert value == before, part


def _parts(estimate: Estimate) -> Iterator[tuple[str, Array | list[str] | str | int]]:
    """Yield what an estimate holds, by names; what has a standard deviation is compared by it."""
    yield 'status', str(estimate.status)
    yield 'samples', estimate.samples
    yield 'body', estimate.parameters
    yield 'body std', estimate.std
    yield 'momentum', estimate.momentum
    yield 'momentum std', np.sqrt(np.diag(estimate.momentum_covariance))
    yield 'time offset', np.array([estimate.time_offset])
    yield 'time offset std', np.array([estimate.time_offset_std])
    yield 'residual', np.array([estimate.residual])
    known = estimate.identifiable
    covariance = estimate.covariance[np.ix_(known, known)]
    if known.any() and np.all(np.isfinite(covariance)):  # the paper's methods have none
        yield 'volume', np.array([np.linalg.slogdet(covariance)[1]])
    if estimate.noise is not None:
        yield 'noise', np.append(estimate.noise.estimated, estimate.noise.correlation_time)
    for sensor in estimate.sensors:
        yield f'sensor {sensor.name}', np.array([sensor.count, sensor.residual])
    for thruster in estimate.thrusters:
        yield 'thruster', np.array([thruster.scale, *thruster.turn, thruster.delay])
        yield 'thruster std', np.array([thruster.scale_std, *thruster.turn_std, thruster.delay_std])
    for joint in estimate.flexible:
        yield joint.joint, np.array([joint.frequency, joint.damping])
        yield f'{joint.joint} std', np.array([joint.frequency_std, joint.damping_std])
    for place, event in enumerate(estimate.events):
        yield f'event {place}', event.kind
        yield f'event {place} size', np.array([event.time, *event.linear, *event.angular])
    yield 'causes', [cause[:_WORDS] for cause, _ in estimate.causes[:1]]
    yield 'gain', np.array([gain for _, gain in estimate.causes[:1]])
    if estimate.budget is not None:
        for cause, shares in zip(estimate.budget.causes, estimate.budget.shares.T, strict=True):
            if np.nan_to_num(shares).max() > 0.02:
                yield f'share of {cause}', shares


def _course(estimates: Sequence[Estimate]) -> Iterator[tuple[str, Array | list[str] | str | int]]:
    """Yield how the estimates of a run follow each other, by a few numbers of up to forty of them."""
    estimates = estimates[:: -1 - (len(estimates) - 1) // 40][::-1]
    yield 'course', ' '.join(f'{each.status[0]}{len(each.warnings)}{len(each.events)}' for each in estimates)
    for name, numbers in (
        ('masses', [(each.parameters[0], each.std[0]) for each in estimates]),
        ('momenta', [(np.sum(each.momentum), np.sqrt(np.sum(each.momentum_covariance))) for each in estimates]),
        ('residuals', [(each.residual, np.nan) for each in estimates]),
    ):
        values, deviations = np.array(numbers).T
        yield f'course of {name}', values
        yield f'course of {name} std', deviations


def _leaves(value: Any) -> Iterator[float | str]:
    """Yield the numbers and texts that something holds, in order; of functions nothing."""
    if isinstance(value, np.ndarray | np.generic):
        yield from np.ravel(value).tolist()
    elif isinstance(value, str | bool | int | float):
        yield value
    elif is_dataclass(value):
        parts = [(getattr(value, each.name), each.default) for each in fields(value)]
        yield from _leaves([part for part, default in parts if part is not default])  # a further part changes nothing
    elif isinstance(value, Mapping):
        yield from _leaves([*value.items()])
    elif isinstance(value, Sequence):
        for each in value:
            yield from _leaves(each)
    elif value is None:
        yield 'none'


def _shortened(text: str) -> str:
    """Return the begin of a text, and all numbers after it."""
    return ' '.join((text[:_WORDS], *re.findall(r'-?\d[\d.e+-]*', text[_WORDS:])))


def _rounded(value: Array | list[str] | str | int) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    return [float(f'{each:.6g}') for each in value.tolist()]


@pytest.fixture
def unchanged(request: pytest.FixtureRequest) -> Unchanged:
    """Compare estimates of a test with what they were."""
    node, write = request.node, request.config.getoption('--write-estimates')
    return Unchanged(node.name, node.path, long=node.get_closest_marker('long') is not None, write=write)
