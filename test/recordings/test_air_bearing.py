"""`convert air-bearing-thrusters`: motion capture and thruster commands of a body without joints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.benches import Thrusters, air_bearing
from checked import answer
from documents import ROOT
from mbaid_ros.bags import BagReader
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.recordings.air_bearing import FORCES
from mbaid_ros.recordings.convert import main
from mbaid_ros.replay.arguments import replay

SHIPPED = ROOT / 'bags' / 'air_bearing_thrusters'
WEIGHED = 23.090, 23.824  # kg
HEAD = 'Step,Control_Time,Telemetry_X_mm,Telemetry_Z_mm,Telemetry_Yaw_deg,Command_Vector\n'


def log(folder: Path, command: str = '[1, 0, 1, 0, 0, 0, 0, 0]') -> list[str]:
    rows = ''.join(f'{k},{0.06 * k:.2f},{1000 + k},-200,179.9,"{command}"\n' for k in range(20))
    (folder / 'run.csv').write_text(HEAD + rows)
    return ['air-bearing-thrusters', str(folder / 'run.csv'), '--output', str(folder / 'bag')]


def test_poses_and_commands_become_messages(tmp_path: Path) -> None:
    assert main(log(tmp_path)) == 0
    with BagReader(tmp_path / 'bag') as bag:
        read = list(bag.read(['/odom', '/thrust', '/joint_states']))
    poses = [message for topic, message, _ in read if topic == '/odom']
    assert len(poses) == 20
    assert (poses[3].pose.pose.position.x, poses[3].pose.pose.position.y) == pytest.approx((1.003, -0.2))
    thrust = [message for topic, message, _ in read if topic == '/thrust']
    assert {message.header.frame_id for message in thrust} == {'thruster1', 'thruster3'}
    assert len(thrust) == 6  # at the begin, and again every 0.48 s
    assert {message.wrench.force.x for message in thrust} == {FORCES[0], FORCES[2]}
    assert load_model((tmp_path / 'bag' / 'robot.urdf').read_text()).joints == 0
    assert '23.09' in (tmp_path / 'bag' / 'weighed.json').read_text()


@pytest.mark.parametrize('command', ['[1, 0]', '[2, 0, 1, 0, 0, 0, 0, 0]', 'on'])
def test_other_commands_are_one_line(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert 'has a row that is none of such a run' in answer(main, capsys, *log(tmp_path, command), code=2)


def test_the_interval_of_the_shipped_recording_holds_what_was_weighed(tmp_path: Path) -> None:
    found = replayed(tmp_path)
    mass, std = found['estimate']['mass'], found['std']['mass']
    assert found['status'] == 'estimating'
    assert all(abs(mass - each) < 1.96 * std for each in WEIGHED)
    assert std < 2.5
    assert json.loads((SHIPPED / 'weighed.json').read_text())['weighed']['mass'] == list(WEIGHED)
    assert not any('cannot be used' in warning for warning in found['warnings'])
    assert 'Permission is hereby granted' in (SHIPPED / 'LICENSE').read_text()


def test_a_simulated_log_identifies_the_body(tmp_path: Path) -> None:
    twin = air_bearing(tmp_path, 1, Thrusters(), 12.0)
    assert main(['air-bearing-thrusters', str(twin.log), '--output', str(tmp_path / 'bag')]) == 0
    found = replayed(tmp_path, *(f'{name}:={value}' for name, value in Thrusters().declared), bag=tmp_path / 'bag')
    value, std = ((found[key]['mass'], found[key]['inertia']['izz']) for key in ('estimate', 'std'))
    assert found['status'] == 'estimating'
    assert all(abs(value[k] - twin.truth[9 * k]) < 4.0 * std[k] for k in (0, 1))
    assert std[0] < 0.06 * twin.truth[0]


@pytest.mark.parametrize(('seed', 'force', 'torque'), [(13, 0.15, 0.0), (4, 0.15, 0.02)])
def test_a_force_as_large_as_the_thrust_shows_no_mass(seed: int, force: float, torque: float, tmp_path: Path) -> None:
    """Noise in the force that the filter sees would make the body seem lighter and better known."""
    errors = Thrusters(force=force, torque=torque)
    twin = air_bearing(tmp_path, seed, errors)
    assert main(['air-bearing-thrusters', str(twin.log), '--output', str(tmp_path / 'bag')]) == 0
    found = replayed(tmp_path, *(f'{name}:={value}' for name, value in errors.declared), bag=tmp_path / 'bag')
    value, std = ((found[key]['mass'], found[key]['inertia']['izz']) for key in ('estimate', 'std'))
    assert found['status'] == 'estimating'
    assert all(abs(value[k] - twin.truth[9 * k]) < 2.5 * std[k] for k in (0, 1) if value[k] is not None)
    assert std[0] > 0.04 * twin.truth[0]  # what the thrusters' own errors leave is 0.035


@pytest.mark.long
def test_thrust_declared_too_well_is_refused_and_names_the_thruster(tmp_path: Path) -> None:
    exact = [f'thrust.{name}_std:=0.02' for name in ('scale', 'direction')]
    found = replayed(tmp_path, *exact, 'disturbance.force_std:=0.05', 'disturbance.torque_std:=0.005', code=4)
    assert found['status'] in {'inconsistent', 'not_identifiable'}
    assert 'thruster2' in found['causes'][0]['cause']


def replayed(folder: Path, *settings: str, code: int = 0, bag: Path = SHIPPED) -> dict[str, Any]:
    """Return the JSON of a replay of the shipped recording, or of another bag, with other parameters."""
    files = [bag, '--model', bag / 'robot.urdf', '--params', bag / 'estimator.yaml']
    given = [part for setting in settings for part in ('-p', setting)]
    assert replay([*map(str, files), *given, '--json', str(folder / 'result.json')]) == code
    found: dict[str, Any] = json.loads((folder / 'result.json').read_text())
    return found
