"""`mbaid_ros.testing`: the test on the page about it runs, and what it says where there is no estimate."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from documents import ROOT, blocks
from graph import LOCAL, reserved_domain
from made_runs import BODY, STD, estimate
from mbaid_ros.errors import ParameterError
from mbaid_ros.estimate_messages import Frames, estimate_message
from mbaid_ros.nodes.subscriptions import TYPES
from mbaid_ros.testing import deviations, wait_for_estimate

PAGE = ROOT / 'docs' / 'tutorials' / 'hil-test.md'


def message(**changes: object) -> object:
    return estimate_message(estimate(**changes), TYPES, Frames('link7', 'odom'))


@pytest.mark.long
def test_the_page_has_a_test_that_passes(tmp_path: Path) -> None:
    (code,) = re.findall(r'^```python\n(.*?)^```$', PAGE.read_text(), re.DOTALL | re.MULTILINE)
    (block,) = blocks(PAGE)
    assert block.text.split() == ['ROS_DOMAIN_ID=42', 'python3', '-m', 'pytest', 'test_gripper.py']
    (tmp_path / 'test_gripper.py').write_text(code)
    with reserved_domain() as (domain, _):
        environment = {**os.environ, **LOCAL, 'ROS_DOMAIN_ID': str(domain)}
        options = ['-q', '-p', 'no:cacheprovider', '--rootdir', str(tmp_path), str(tmp_path / 'test_gripper.py')]
        command = [sys.executable, '-m', 'pytest', *options]
        run = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    assert '1 passed' in run.stdout


def test_deviations_are_in_standard_deviations() -> None:
    found = deviations(message(), {'mass': BODY[0] + 2.0 * STD[0], 'izz': BODY[9] - STD[9]})
    assert found['mass'] == pytest.approx(-2.0)
    assert found['izz'] == pytest.approx(1.0)
    open_mass = message(identifiable=np.arange(10) > 0)
    assert deviations(open_mass, {'mass': BODY[0]}) == {'mass': float('inf')}
    with pytest.raises(ParameterError, match="'weight' is not known; accepted: mass, com_x"):
        deviations(message(), {'weight': 1.0})


def test_a_wait_in_vain_says_what_was_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    with reserved_domain() as (domain, _):
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        with pytest.raises(TimeoutError, match=r'no converged estimate on /estimator/estimate within 0\.5 s: nothing'):
            wait_for_estimate(timeout=0.5)
