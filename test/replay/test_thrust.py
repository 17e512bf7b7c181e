"""Recorded thrust in replay and calibrate: taken from the bag, or from the topic that is named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import recorded
from mbaid_ros.bags import BagWriter
from mbaid_ros.core.sensors.external_momentum import EXACT_THRUST
from mbaid_ros.replay.calibrate import main as calibrate
from mbaid_ros.replay.replay import main as replay
from simulated import CONFIG
from thrusting import WRENCH, messages, pulse

TYPES = {'/joint_states': recorded.JOINT_STATE, '/odom': recorded.ODOMETRY}
MODEL = ['--model', str(CONFIG / 'servicer7.urdf')]
PARAMETERS = ['--params', str(CONFIG / 'servicer7_estimator.yaml')]


def write(path: Path, topic: str) -> str:
    with BagWriter(path) as bag:
        for name, kind in {**TYPES, topic: WRENCH}.items():
            bag.add_topic(name, kind)
        for name, message, time in messages(2, *pulse()):
            bag.write(topic if name == '/thrust' else name, message, recorded.EPOCH * 1_000_000_000 + time)
    return str(path)


@pytest.mark.parametrize(('topic', 'options'), [('/thrust', []), ('/base/thrust', ['--thrust', '/base/thrust'])])
def test_thrust_in_a_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str], topic: str, options: list[str]) -> None:
    bag = write(tmp_path / 'bag', topic)
    assert replay([bag, *MODEL, *PARAMETERS, '--json', '-', *options]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['events'] == []
    assert result['warnings'] == [EXACT_THRUST]
    # Not where it is called otherwise and nobody says so.
    if options:
        assert replay([bag, *MODEL, *PARAMETERS, '--json', '-']) == 0
        assert [event['kind'] for event in json.loads(capsys.readouterr().out)['events']] == ['step']


def test_a_topic_that_is_not_there_or_something_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write(tmp_path / 'bag', '/thrust')
    for topic, reason in (('/jets', '/jets'), ('/odom', 'geometry_msgs/msg/WrenchStamped')):
        assert replay([bag, *MODEL, '--thrust', topic]) == 2
        error = capsys.readouterr().err
        assert error.count('\n') == 1
        assert reason in error


def test_a_calibration_knows_of_thrust(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write(tmp_path / 'bag', '/thrust')
    assert calibrate([bag, *MODEL, '--unknown', 'link7', '--json', '-']) == 0
    known = json.loads(capsys.readouterr().out)
    assert known['residual'] == pytest.approx(1.0, abs=0.15)
    other = write(tmp_path / 'other', '/jets')
    assert calibrate([other, *MODEL, '--unknown', 'link7', '--json', '-']) == 4
    assert json.loads(capsys.readouterr().out)['residual'] > 1.3 * known['residual']
    assert np.isfinite(known['momentum'][0]['linear']).all()
