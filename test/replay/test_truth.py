"""Truth files: found beside a bag or named, and told when they cannot be used."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import recorded
from mbaid_ros.core.errors import DataError
from mbaid_ros.replay.replay import main
from mbaid_ros.replay.truth import read_truth, truth_beside
from simulated import CONFIG


def cells(text: str, row: str) -> list[str]:
    """Return the cells of the first row that begins with a name."""
    found = re.search(rf'<tr><td>{row}</td>(.*?)</tr>', text)
    assert found
    return re.findall(r'>([^<]*)</td>', found[1])


def truth_file(folder: Path, **changes: Any) -> Path:
    content = {
        'target_link': 'link4', 'mass': 934.45, 'com': [2.3, 0.9, 0.0],
        'inertia': {'ixx': 1100.0, 'ixy': 0.0, 'ixz': 0.0, 'iyy': 2800.0, 'iyz': 0.0, 'izz': 3435.0}, **changes,
    }  # fmt: skip
    file = folder / 'truth.json'
    file.write_text(json.dumps(content), encoding='utf-8')
    return file


def test_the_truth_beside_a_bag_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = recorded.papers_case(tmp_path / 'bag', 5.0, 20.0)
    truth_file(bag)
    report = tmp_path / 'report.html'
    for path in (bag, bag / 'bag.mcap'):
        main([str(path), '--model', str(CONFIG / 'table1.urdf'), '--report', str(report)])
        assert cells(report.read_text(encoding='utf-8'), 'mass')[4] == '934.45'
    other = truth_file(tmp_path, mass=900.0)
    main([str(bag), '--model', str(CONFIG / 'table1.urdf'), '--report', str(report), '--truth', str(other)])
    assert cells(report.read_text(encoding='utf-8'), 'mass')[4] == '900'
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        ('{', 'is not JSON'),
        ('[]', 'accepted: a JSON object'),
        ('{"mass": 1}', "'inertia'"),
        ('{"target_link": "a", "mass": "x", "com": [0, 0, 0], "inertia": {}}', "'ixx'"),
    ],
)
def test_a_truth_that_cannot_be_used_is_told(tmp_path: Path, content: str, reason: str) -> None:
    (tmp_path / 'truth.json').write_text(content, encoding='utf-8')
    with pytest.raises(DataError, match=re.escape(reason)):
        read_truth(tmp_path / 'truth.json')
    beside = truth_beside(str(tmp_path))
    assert beside is not None
    assert reason in beside.why_not('link4')
    assert not np.any(np.isfinite(beside.parameters))


@pytest.mark.parametrize('changes', [{'com': [1.0, 2.0]}, {'mass': float('nan')}, {'momentum': {'linear': [1.0]}}])
def test_a_truth_with_odd_numbers_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(DataError, match=r'cannot be used|NaN is no number of JSON'):
        read_truth(truth_file(tmp_path, **changes))


def test_no_truth_file_is_no_mistake_unless_it_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert truth_beside(str(tmp_path)) is None
    assert main([str(tmp_path), '--model', 'x', '--report', str(tmp_path / 'r'), '--truth', '/absent.json']) == 2
    assert "cannot read truth '/absent.json'" in capsys.readouterr().err
