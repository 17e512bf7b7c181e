"""`convert spot-captures`: a chaser grasps a body that pivots in its hand, and both are tracked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from checked import answer
from mbaid_ros.bags import BagReader
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import Kinematics, express, load_model
from mbaid_ros.recordings import spot_captures as spot
from mbaid_ros.recordings.convert import main
from mbaid_ros.recordings.recording import resource
from mbaid_ros.replay.arguments import replay

ARM = np.array([1.1, -0.4, -1.5])  # rad, locked
MASS, MOMENT = 11.0, 0.21  # kg, kg m^2, of the body
SHOULDER, LENGTHS = np.array([0.068, 0.2421]), (0.3045, 0.3045, 0.08725)  # m
PORT = np.array([0.06, 0.2])  # m, in its frame, where the hand holds it
NOISE = np.array([5e-5, 5e-5, 1.5e-4] * 2)  # m, m, rad
STEP, CAPTURE, ROWS = 0.01, 3.0, 220  # s, s, rows of 0.05 s


def about_z(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def flight(count: int) -> Array:
    """Return x, y, heading of base and body (N, 6): momenta are conserved, and the body pivots in the hand."""
    chaser = load_model(resource('spot_capture.urdf'))
    placed = Kinematics(chaser).configure(np.eye(3)[None], np.concatenate((np.zeros(3), ARM))[None])
    whole = express(chaser.body_parameters(), placed.rotation[0], placed.position[0]).sum(axis=0)
    mass, centre, moment = whole[0], whole[1:3] / whole[0], whole[9] - whole[1:3] @ whole[1:3] / whole[0]
    tip = SHOULDER + sum(about_z(np.pi / 2.0 + ARM[: k + 1].sum()) @ (LENGTHS[k], 0.0) for k in range(3))
    turn = -0.5 + 0.25 * np.sin(1.2 * STEP * np.arange(count)) + 0.1 * np.sin(2.9 * STEP * np.arange(count))
    place = np.array([tip - about_z(angle) @ PORT for angle in turn])
    poses, base, heading = [], np.zeros(2), 0.0
    start = (mass * centre + MASS * place[0]) / (mass + MASS)
    drift, total = np.array([0.02, -0.03]), -0.25  # m/s, N m s about the common centre of mass
    for k in range(count):
        axes = about_z(heading)
        base = start + k * STEP * drift - axes @ (mass * centre + MASS * place[k]) / (mass + MASS)
        poses.append((*base, heading, *(base + axes @ place[k]), heading + turn[k]))
        if k + 1 == count:
            break
        # Angular momentum about the common centre of mass, J w + l, is constant.
        apart, reduced = place[k] - centre, mass * MASS / (mass + MASS)
        speed = (place[k + 1] - place[k]) / STEP
        inertia = moment + MOMENT + reduced * apart @ apart
        inner = reduced * (apart[0] * speed[1] - apart[1] * speed[0]) + MOMENT * (turn[k + 1] - turn[k]) / STEP
        heading += STEP * (total - inner) / inertia
    return np.array(poses)


def table() -> Array:
    """Return the rows of a log: rest until the capture, then the flight; each pose twice."""
    rows = np.zeros((ROWS, spot.COLUMNS))
    rows[:, 0] = 0.05 * np.arange(ROWS)
    seen = np.arange(ROWS) // 2 * 2
    truth = flight(int((ROWS * 0.05 - CAPTURE) / STEP))
    at = np.maximum(np.round((0.05 * seen - CAPTURE) / STEP).astype(int), 0)
    noise = np.random.default_rng(3).normal(size=(ROWS, 6))[seen] * NOISE
    rows[:, 4:7], rows[:, 24:27] = np.split(truth[at] + noise, 2, axis=1)
    rows[:, 74:77] = ARM
    rows[100:103, 75] = spot.NO_ANSWER
    rows[116:118, 74:77] = 0.0
    rows[10:12, 83] = 1.0  # a false edge
    rows[int(CAPTURE / 0.05) :, 83] = 1.0
    return rows


def convert(rows: Array, folder: Path) -> list[str]:
    savemat(folder / 'run.mat', {'rt_dataPacket': rows})
    return ['spot-captures', str(folder / 'run.mat'), '--output', str(folder / 'bag')]


def test_the_body_is_identified_by_the_exchange_of_momentum_in_the_grasp(tmp_path: Path) -> None:
    assert main(convert(table(), tmp_path)) == 0
    bag, result = tmp_path / 'bag', tmp_path / 'result.json'
    arguments = [bag, '--model', bag / 'robot.urdf', '--params', bag / 'estimator.yaml', '--json', result]
    assert replay([str(each) for each in arguments]) == 0
    found = json.loads(result.read_text())
    mass, moment = found['estimate']['mass'], found['estimate']['inertia']['izz']
    assert abs(mass - MASS) < 3.0 * found['std']['mass'] < 3.0
    assert abs(moment - MOMENT) < 3.0 * found['std']['inertia']['izz'] < 0.1


def test_poses_have_the_times_at_which_the_motion_capture_took_them(tmp_path: Path) -> None:
    rows = table()
    late = rows[101].copy()
    rows[100, 4:7], rows[100, 24:27] = rows[99, 4:7], rows[99, 24:27]  # one comes a row late
    rows[101] = late
    assert main(convert(rows, tmp_path)) == 0
    with BagReader(tmp_path / 'bag') as bag:
        stamps = {topic: [] for topic in ('/odom', '/joint_states')}  # type: dict[str, list[float]]
        for topic, message, _ in bag.read(list(stamps)):
            stamps[topic].append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
    assert np.diff(stamps['/odom']) == pytest.approx(0.1)
    assert stamps['/odom'][0] == pytest.approx(CAPTURE)
    assert set(stamps['/odom']) - set(stamps['/joint_states'])  # encoders that do not answer


@pytest.mark.parametrize(
    ('spoil', 'said'),
    [
        (lambda rows: rows[:, :80], 'accepted: rows of 92 numbers'),
        (lambda rows: np.where(np.arange(92) == 83, 0.0, rows), 'does not stay set'),
        (lambda rows: rows + 0.05 * (np.arange(92) == 24) * np.maximum(rows[:, :1] - CAPTURE, 0.0), 'slides by'),
        (lambda rows: rows[:75], 'has 3 poses after the capture'),
    ],
)
def test_a_log_without_a_capture_is_one_line(
    spoil: object, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(spoil)
    assert said in answer(main, capsys, *convert(spoil(table()), tmp_path), code=2)
