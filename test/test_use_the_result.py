"""The page on the use of results: its code reads what `export` and the estimator write."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mbaid_msgs.msg import InertiaEstimate
from rclpy.qos import DurabilityPolicy, QoSProfile

from documents import ROOT, python_blocks
from graph import graph
from made_runs import BODY, estimate, run
from mbaid_ros.core.robot.urdf import parse_document
from mbaid_ros.identification import Identification
from mbaid_ros.replay.arguments import FORMATS
from mbaid_ros.replay.arguments import export as main
from mbaid_ros.replay.json_output import as_json

PAGE = ROOT / 'docs' / 'how-to' / 'use-the-result.md'
NODE, PINOCCHIO, MUJOCO = python_blocks(PAGE)
TEXT = PAGE.read_text(encoding='utf-8')
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # type: ignore[no-untyped-call]


def test_the_page_has_every_format_and_option(capsys: pytest.CaptureFixture[str]) -> None:
    table = TEXT.split('| `--format` | content |')[1].split('\n\n')[0]
    named = {name for row in table.splitlines()[2:] for name in re.findall(r'`([\w-]+)`', row.split('|')[1])}
    assert named == set(FORMATS)
    main(['--help'])
    shown = capsys.readouterr().out
    assert all(option in shown for option in re.findall(r'^\| `(--\w+)', TEXT, re.MULTILINE))


def test_the_exported_robot_is_read_by_pinocchio_and_mujoco(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path('use').mkdir()
    Path('result.json').write_text(json.dumps(as_json(run(target_link='link6'))), encoding='utf-8')
    model = str(ROOT / 'config' / 'ets7.urdf')
    for form, output in (('urdf', 'use/robot.urdf'), ('mjcf', 'use/robot.xml')):
        assert main(['result.json', '--format', form, '--model', model, '--output', output]) == 0
    known: dict[str, Any] = {}
    for code in (PINOCCHIO, MUJOCO):
        exec(compile(code, str(PAGE), 'exec'), known)
    robot = known['robot']
    assert robot.inertias[robot.njoints - 1].mass == pytest.approx(BODY[0])
    np.testing.assert_allclose(robot.inertias[robot.njoints - 1].lever, BODY[1:4], rtol=1e-9)
    assert known['model'].body('link6').mass == pytest.approx(BODY[0])


def test_everything_else_in_the_description_stays() -> None:
    urdf = (ROOT / 'config' / 'ets7.urdf').read_text(encoding='utf-8')
    control = '<ros2_control name="arm" type="system"><joint name="joint1"/></ros2_control>'
    given = urdf.replace('</robot>', f'{control}</robot>')
    written = Identification(run(target_link='link6', urdf=given)).to_urdf()
    (kept,) = parse_document(written).findall('ros2_control')
    assert (kept.get('name'), kept.find('joint') is not None) == ('arm', True)
    assert len(parse_document(written)) == len(parse_document(given))


def test_the_node_of_the_page_uses_estimates(tmp_path: Path) -> None:
    script, log = tmp_path / 'user.py', tmp_path / 'log'
    script.write_text(NODE, encoding='utf-8')
    message = InertiaEstimate(status=InertiaEstimate.ESTIMATING, identifiable=[True] + 9 * [False])
    message.inertia.m, message.covariance[0] = 7.0, 0.04
    with graph(tmp_path) as place, log.open('w') as out:
        user = subprocess.Popen([sys.executable, str(script)], env=place.environment, stdout=out, stderr=out)
        try:
            place.publisher('/estimator/estimate', InertiaEstimate, LATCHED).publish(message)
            place.wait(lambda: '7.00 +- 0.39 kg' in log.read_text(encoding='utf-8'), 'the estimate')
        finally:
            user.kill()
            user.wait()


def test_the_fields_that_the_node_in_c_plus_plus_reads_exist() -> None:
    code = TEXT.split('```cpp')[1].split('```')[0]
    fields = set(re.findall(r'message\.(\w+)', code))
    assert fields == {'stale', 'status', 'identifiable', 'inertia', 'standard_deviation'}
    assert fields <= set(InertiaEstimate.get_fields_and_field_types())
    assert estimate().status in {'converged', 'estimating'}
