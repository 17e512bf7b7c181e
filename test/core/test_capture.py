"""A capture: the momentum that it brings, and the captured body alone, from the core to what `replay` writes."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from scipy.stats import chi2

import recorded
from benchmarks.precapture import BARE_LINK7, free_model, free_urdf
from checked import answer, central_difference, generic, same, some
from mbaid_ros.core import capture as module
from mbaid_ros.core.capture import _REMEMBERED, BEFORE, DISTURBED, CaptureEstimator, Chaser, KnownMomentum
from mbaid_ros.core.geometry import Array, cross, exp
from mbaid_ros.core.odometry.model import odometry_mount
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.samples import FEWEST, Samples
from mbaid_ros.core.target import debris
from mbaid_ros.replay.arguments import export, replay
from observed import MID, configured_motion, estimator, kernel, observe, windows
from servicers import CHASER, Joined, alone, capture, chaser, sensed
from simulated import CONFIG
from unchanged import Unchanged

BEGIN, END = 8.0, 12.0  # s: the capture, and how long the run goes on after it
VELOCITY = np.array([0.004, -0.006, 0.003])  # m/s
SPIN = np.array([0.02, -0.03, 0.015])  # rad/s
RARE = 1e-3


@cache
def joined() -> Joined:
    return capture(BEGIN, END, VELOCITY, SPIN)


def pieces(seed: int | None = 1) -> list[Samples]:
    return windows(observe(joined().truth, MID, seed))


def make(method: str = 'difference') -> CaptureEstimator:
    robot = chaser()
    again = partial(estimator, robot, MID, method=method)
    return CaptureEstimator(robot, again, MID, 2.0)


def announced(method: str = 'difference') -> CaptureEstimator:
    made = make(method)
    made.time = BEGIN
    return made


def body(estimate: Estimate) -> Array:
    """Return the captured body's parameters."""
    found = some(debris(estimate, chaser().target.parameters))
    error = found.parameters - physical(alone())
    assert float(error @ np.linalg.solve(found.covariance, error)) < chi2.isf(RARE, 10)
    return found.parameters


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_what_the_body_brought_along(method: str, unchanged: Unchanged) -> None:
    run = announced(method=method)
    last = unchanged.course(run.update(pieces(), 0))
    found = some(run.capture(body(last)))
    unchanged.values(capture=found)
    assert found.time == BEGIN
    error = found.momentum - joined().momentum
    assert float(error @ np.linalg.solve(found.covariance, error)) < chi2.isf(RARE, 6)
    assert found.velocity == pytest.approx(VELOCITY, abs=1e-3)
    assert found.spin == pytest.approx(SPIN, abs=1e-2)


def test_the_known_model_before_it() -> None:
    run = announced()
    made = run.update(pieces(), 0)
    before = [estimate for estimate in made if estimate.warnings == (BEFORE,)]
    assert len(before) == BEGIN / 0.5
    assert {estimate.status for estimate in before} == {'waiting'}
    found = some(run.capture(None))
    assert found.chaser is not None
    error = found.chaser.momentum - CHASER
    assert float(error @ np.linalg.solve(found.chaser.covariance, error)) < chi2.isf(RARE, 6)
    assert found.chaser.residual == pytest.approx(1.0, abs=0.25)
    # The windows within the margin are used by neither.
    assert found.chaser.samples == (BEGIN - 0.5) * 100.0
    assert made[len(before)].time > BEGIN + 0.5
    assert np.all(np.isnan(found.spin))


def test_a_capture_called_when_it_happens_leads_to_the_same_numbers() -> None:
    known, later = announced(), make()
    expected = known.update(pieces(), 0)
    found = []
    for window in pieces():
        found += later.update([window], 0)
        if later.time is None and window.time[-1] > BEGIN - 0.3:
            later.time = BEGIN
    names = ('time', 'momentum', 'parameters')
    for one, other in zip(found, expected, strict=True):
        assert all(same(getattr(one, name), getattr(other, name)) for name in names)
    captures = later.capture(None), known.capture(None)
    assert captures[0] is not None
    assert captures[1] is not None
    assert np.array_equal(captures[0].momentum, captures[1].momentum)


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_a_capture_called_too_early_can_be_moved(method: str) -> None:
    known, moved = announced(method=method), make(method=method)
    expected = known.update(pieces(), 0)
    moved.time = BEGIN - 4.0
    found = []
    for window in pieces():
        found += moved.update([window], 0)
        if moved.time < BEGIN and window.time[-1] > BEGIN - 0.3:
            moved.restart_at(BEGIN)
    assert np.array_equal(found[-1].parameters, expected[-1].parameters)
    assert np.array_equal(found[-1].covariance, expected[-1].covariance)
    assert moved.phase == 'post_capture'


def test_a_capture_is_detected(unchanged: Unchanged) -> None:
    robot = chaser()
    run = CaptureEstimator(robot, lambda: estimator(robot, MID, method='difference'), MID, 2.0, detect=True)
    last = [run.update([window], 0) for window in pieces()][-1][-1]
    assert run.time == pytest.approx(BEGIN, abs=0.5)
    assert run.time in {float(window.time[0]) for window in pieces()}
    found, known = run.capture(body(last)), announced()
    known.update(pieces(), 0)
    expected = some(known.capture(None))
    assert found is not None
    unchanged.values(time=run.time, momentum=found.momentum)
    assert found.momentum == pytest.approx(expected.momentum, abs=0.02)
    assert found.spin == pytest.approx(SPIN, abs=1e-2)


def test_the_robot_at_the_capture_is_the_sample_nearest_to_it() -> None:
    made = make()
    for place, window in enumerate(pieces()[:3]):
        made._note_target_pose(window, float(window.time[7]) + 1e-3 / (1 + place))
    assert made._at_capture is not None
    latest = pieces()[2]
    assert made._at_capture.time.tolist() == [latest.time[7]]
    _, rotation, position = some(made._target_pose)
    placed = chaser().states(latest[7:8])
    assert rotation == pytest.approx(placed.rotation[0])
    assert position == pytest.approx(latest.base_position[7] + placed.position[0])


@pytest.mark.parametrize(
    ('until', 'settling', 'frame', 'waits'),
    [(5.9, 2.0, None, True), (6.0, 2.0, None, False), (5.9, 0.0, None, False), (5.9, 2.0, 'given', False)],
)
def test_estimates_wait_for_poses_of_a_body_that_settles(
    until: float, settling: float, frame: str | None, waits: bool
) -> None:
    """A second longer than they are used: a live run has those that come late by then, as a replay has."""
    made: Any = announced()
    made._settling, made._track = settling, SimpleNamespace(frame=frame)
    latest: Any = SimpleNamespace(time=np.array([0.0, BEGIN + until]))
    assert made._waits_for_poses([latest]) is waits


def test_a_run_begins_once_with_the_first_windows_after_the_margin() -> None:
    """However the windows are cut into calls; none is given to the method before."""
    made: Any = announced()
    every, begun, given = pieces(), list[Any](), list[Any]()

    def begin(later: list[Samples], _origin: int) -> None:
        begun.append([float(window.time[0]) for window in later])
        made._begun = True

    def update(later: list[Samples], _origin: int) -> list[Estimate]:
        given.append(len(later))
        return []

    made._begin, made._waits_for_poses, made._method = begin, lambda _: False, SimpleNamespace(update=update)
    for part in (every[:1], every[15:17], every[17:19], every[19:22]):
        made.update(part, 0)
    assert begun == [[BEGIN + 0.5, BEGIN + 1.0]]
    assert given == [2, 3]


@pytest.mark.parametrize(
    ('since', 'kind', 'momentum'), [(60.0, 'step', 30.0), (11.2, 'step', np.nan), (0.0, 'ramp', np.nan)]
)
def test_the_body_brought_what_was_there_before_an_event(
    since: float, kind: Literal['step', 'ramp'], momentum: float
) -> None:
    made = announced()
    event = Event(since, kind, np.ones(3), np.zeros(3), 'a push')
    for place in range(400):
        time = 11.5 + 0.5 * place
        pushed = time > since
        of_all = np.full(6, 35.0 if pushed else 30.0)
        made._remember(Estimate('trajectory', 'converged', time, momentum=of_all, events=(event,) * pushed))
        found = made._undisturbed_estimate()
        brought = np.nan if found is None else found.momentum[0]
        assert brought == pytest.approx(30.0 if time <= since else momentum, nan_ok=True)


def test_momentum_that_a_force_takes_part_in_is_withheld_with_the_reason() -> None:
    """In every estimate, however windows are cut into calls, as soon as the force is found."""
    pushed = Event(0.0, 'ramp', np.ones(3), np.zeros(3), 'a push')
    last = pieces()[-3:]
    texts = []
    for calls in ([last], [[each] for each in last]):
        made: Any = announced()
        estimates = iter([Estimate('trajectory', 'converged', 11.0 + n, events=(pushed,) * (n > 0)) for n in range(3)])
        made._method.update = lambda windows, _, left=estimates: [next(left) for _ in windows]
        texts.append([estimate.warnings for call in calls for estimate in made.update(call, 0)])
        assert np.isnan(some(made.capture(None)).momentum).all()
    assert texts == [[(), *((DISTURBED.format(0.0),),) * 2]] * 2


def test_nothing_is_taken_for_a_capture_that_is_none() -> None:
    robot = chaser()
    run = CaptureEstimator(robot, lambda: estimator(robot, MID, method='difference'), MID, 2.0, detect=True)
    run.update([window for window in pieces(2) if window.time[-1] < BEGIN], 0)
    assert (run.time, run.phase) == (None, 'pre_capture')


def test_a_planar_capture_determines_the_parameters_of_a_plane(unchanged: Unchanged) -> None:
    planar = kernel('table1')
    run = CaptureEstimator(planar, lambda: estimator(planar, MID), MID, 2.0)
    run.time = 3.0
    run.update(windows(observe(configured_motion('table1', 15.0, 50.0), MID, 1)), 0)
    found = some(run.capture(None))
    unchanged.values(capture=found)
    known = np.isfinite(found.momentum)
    assert known.tolist() == [True, True, False, False, False, True]
    assert np.all(np.isfinite(found.covariance[np.ix_(known, known)]))
    # Nothing was captured: the last link was there before, as its inertial says.
    z = found.momentum[known] / np.sqrt(np.diag(found.covariance)[known])
    assert np.all(np.abs(z) < 4.0)


def test_a_wrong_known_model_is_doubted_before_and_after() -> None:
    robot = chaser()
    change = np.zeros_like(robot.known)
    change[0] = 0.3 * robot.known[0]
    wrong = robot.with_body_changes(change)
    run = CaptureEstimator(wrong, lambda: estimator(wrong, MID), MID, 2.0)
    run.time = BEGIN
    made = run.update(pieces(), 0)
    doubts = [estimate for estimate in made if any('the known model changes' in text for text in estimate.warnings)]
    assert doubts[0].status == 'inconsistent'
    assert doubts[0].time < BEGIN
    assert made[-1] is doubts[-1]


def test_momentum_is_known_by_windows_and_jumps_beside_noise_alone(unchanged: Unchanged) -> None:
    """Each window's innovation is chi-square of six numbers, until the capture; no window before 50 equations."""
    known, found = KnownMomentum(chaser(), MID, 3), []
    for place, window in enumerate(pieces()):
        found.append(known.innovation_squared(window))
        assert (found[-1] == 0.0) is (place < 10)
        if window.time[-1] < BEGIN - 0.5:
            known.add(window)
    known.add(pieces()[0][: FEWEST - 1])
    assert known.redundancy == 6 * 14
    assert len(known.windows) == 3
    assert np.mean(found[10:15]) == pytest.approx(6.0, abs=5.0)
    assert min(found[17:]) > 60.0
    shift = odometry_mount(1e-3, 1e-3)
    unchanged.values(innovations=found, chaser=known.chaser(), columns=known.columns(shift))


def test_known_momentum_depends_on_an_unknown_as_windows_off_by_it_show() -> None:
    """About the odometry's origin, far from where the run begins."""
    far = [replace(each, base_position=each.base_position + 3.0 * generic(1, 3)) for each in pieces(None)[:10]]

    def momentum(value: Array) -> Array:
        known = KnownMomentum(chaser(), MID)
        for each in far:
            rotation = each.base_rotation @ exp(value[:3])
            place = each.base_position + each.base_rotation @ value[3:]
            lever = cross(each.base_angular_velocity, each.base_rotation @ value[3:])
            velocity = each.base_linear_velocity + lever
            known.add(replace(each, base_rotation=rotation, base_position=place, base_linear_velocity=velocity))
        return some(known.chaser()).momentum

    known, by_poses = KnownMomentum(chaser(), MID, 20), KnownMomentum(chaser(), MID, 20)
    for each in far:
        known.add(each)
        unknown = np.full(each.base_position.shape, np.nan)
        by_poses.add(replace(each, base_linear_velocity=unknown, base_angular_velocity=unknown))
    mount = odometry_mount(1.0, 1.0)
    expected = central_difference(momentum, np.zeros(6), 1e-4)
    assert known.columns(mount) == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())
    assert by_poses.columns(mount) == pytest.approx(expected, abs=0.3 * np.abs(expected).max())


BAG = CONFIG.parent / 'bags' / 'servicer7_mid'


@pytest.fixture(scope='module', name='folder')
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what a replay writes."""
    folder = tmp_path_factory.mktemp('captured')
    (folder / 'robot.urdf').write_text(free_urdf(), encoding='utf-8')
    parameters = (CONFIG / 'servicer7_estimator.yaml').read_text(encoding='utf-8')
    (folder / 'estimator.yaml').write_text(f'{parameters}    debris: {{report: true}}\n')
    outputs = (('--json', 'result.json'), ('--report', 'report.html'), ('--output', 'estimates'))
    arguments = [str(BAG), '--model', str(folder / 'robot.urdf'), '--params', str(folder / 'estimator.yaml')]
    assert replay([*arguments, *(word for option, name in outputs for word in (option, str(folder / name)))]) == 0
    return folder


def test_the_body_is_found(folder: Path) -> None:
    result = json.loads((folder / 'result.json').read_text())
    found = result['debris']
    values = np.array([found['mass'], *found['com'], *found['inertia'].values()])
    covariance = np.array(found['covariance'])
    error = values - physical(alone())
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(1e-3, 10)
    assert found['mass'] == pytest.approx(result['estimate']['mass'] - BARE_LINK7[0])
    std = [found['std']['mass'], *found['std']['com'], *found['std']['inertia'].values()]
    assert std == pytest.approx(np.sqrt(np.diag(covariance)))


exported = partial(answer, export)


def test_it_is_exported_from_json_and_bag_alike(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    from_json, from_bag = (
        json.loads(exported(capsys, str(folder / name), '--debris', '--format', 'json'))
        for name in ('result.json', 'estimates')
    )
    assert from_json == from_bag
    together = json.loads(exported(capsys, str(folder / 'estimates'), '--format', 'json'))
    assert together['target_link'] == 'link7'
    assert together['mass'] - from_json['mass'] == pytest.approx(BARE_LINK7[0])
    text = exported(capsys, str(folder / 'result.json'), '--debris', '--output', str(folder / 'body.urdf'))
    assert "body.urdf: the captured body in 'link7' as " in text


def test_a_capture_in_a_bag(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    run = capture(4.0, 10.0, np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015]))
    bag = recorded.write(tmp_path / 'bag', free_model(), sensed(run.truth, 2))
    urdf, parameters, report = (tmp_path / name for name in ('robot.urdf', 'estimator.yaml', 'report.html'))
    urdf.write_text(free_urdf(), encoding='utf-8')
    given = 'estimator: {ros__parameters: {capture.time: 4.0, debris.report: true}}'
    parameters.write_text(given)
    arguments = [str(bag), '--model', str(urdf), '--target', 'link7', '--params', str(parameters), '--json', '-']
    assert replay([*arguments, '--report', str(report)]) == 0
    result = json.loads(capsys.readouterr().out)
    found = result['capture']
    assert found['t'] == 4.0
    for part, expected in (('linear', run.momentum[:3]), ('angular', run.momentum[3:])):
        z = (np.array(found[f'target_{part}_momentum']) - expected) / np.array(found[f'target_{part}_momentum_std'])
        assert np.all(np.abs(z) < 4.0)
    assert found['chaser']['residual'] == pytest.approx(1.0, abs=0.4)
    assert found['chaser']['samples'] == 350
    assert np.linalg.norm(found['target_angular_velocity']) == pytest.approx(0.039, abs=0.02)
    text = report.read_text()
    assert 'Captured at 4 s.' in text
    assert 'spin z' in text
    # A capture that is not announced is momentum that is not conserved.
    parameters.write_text(given.replace('4.0', '400.0'))
    assert replay(arguments) == 4
    result = json.loads(capsys.readouterr().out)
    assert (result['status'], result['capture']) == ('inconsistent', None)
    assert any('the known model changes' in warning for warning in result['warnings'])
    # A bag that ends before the capture leads to no estimate.
    early = recorded.write(tmp_path / 'early', free_model(), sensed(run.truth, 2)[:350])
    assert replay([str(early), *arguments[1:-2]]) == 3
    assert 'the data end before the capture: capture.time puts it at 400 s' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('settling', 'starts', 'used'),
    [
        (0.0, [0.0, 0.499, 0.5, 1.0], [0.5, 1.0]),  # half a second, in which bodies touch and slip
        (0.2, [0.499, 0.5], [0.5]),
        (2.0, [0.5, 1.999, 2.0, 2.5], [2.0, 2.5]),
    ],
)
def test_windows_count_from_the_margin_or_until_the_body_has_settled(
    settling: float, starts: list[float], used: list[float]
) -> None:
    made: Any = announced()
    given, noted = list[float](), list[float]()
    made._settling, made._begun = settling, True

    def update(windows: list[Samples], _origin: int) -> list[Estimate]:
        given.extend(float(each.time[0]) for each in windows)
        return []

    made._method = SimpleNamespace(update=update)
    made._note_target_pose = lambda window, time: noted.append(float(window.time[0]) - time)
    made._target_pose = 'a pose'
    ended = list[float]()
    made._add_known_windows = ended.append
    window = pieces()[0]
    later = [replace(window, time=BEGIN + start + 0.01 * np.arange(len(window.time))) for start in starts]
    made.update(later, 0)
    assert given == pytest.approx([BEGIN + each for each in used])
    assert noted == pytest.approx(starts)
    assert ended == [BEGIN - 0.5] * len(starts)
    made._estimates.append('an estimate')
    made.update(later, 0)
    assert len(noted) == len(starts)  # the pose is known as well as it will be
    made._target_pose = None
    made.update(later, 0)
    assert len(noted) == 2 * len(starts)


@pytest.mark.parametrize(
    ('time', 'latest', 'estimates', 'phase'),
    [
        (None, 99.0, 0, 'pre_capture'),
        (5.0, 4.9, 0, 'pre_capture'),
        (5.0, 5.0, 0, 'capture'),
        (5.0, 5.0, 1, 'post_capture'),
    ],
)
def test_the_phase_of_a_capture(time: float | None, latest: float, estimates: int, phase: str) -> None:
    made: Any = announced()
    made.time, made._latest = time, latest
    made._estimates.extend(['an estimate'] * estimates)
    assert made.phase == phase


def test_a_jump_in_two_windows_is_a_capture_in_the_first_of_them() -> None:
    made: Any = announced()
    made.time = None
    sizes = iter([59.0, 61.0, 59.0, 61.0, 61.0])
    made._known = SimpleNamespace(innovation_squared=lambda _: next(sizes))
    times = []
    for window in pieces()[:5]:
        made._detect_capture(window)
        times.append(made.time)
    assert times == [None] * 4 + [float(pieces()[3].time[0])]


@pytest.mark.parametrize(
    ('residual', 'redundancy', 'doubted'),
    [(2.1, 1000, True), (1.9, 1000, False), (2.1, 0, False), (np.nan, 1000, False)],
)
def test_a_known_model_is_doubted_by_what_enough_windows_leave(
    residual: float, redundancy: int, *, doubted: bool
) -> None:
    made: Any = announced()
    made._largest_residual = 2.0
    made._known = SimpleNamespace(chaser=lambda: SimpleNamespace(residual=residual), redundancy=redundancy)
    assert bool(made._doubts()) is doubted
    made._known.chaser = lambda: None
    assert not made._doubts()


def test_what_a_body_brought_is_its_velocity_and_its_spin_about_its_centre() -> None:
    """Of a body of known inertia that moves and turns as given, about the origin of the odometry."""
    made: Any = announced()
    body = np.array([5.0, 0.3, -0.2, 0.4, 2.0, 0.3, -0.1, 3.0, 0.2, 4.0])
    (rotation,), place = exp(generic(1, 1, 3)), generic(2, 3)
    velocity, spin = generic(3, 3), generic(4, 3)
    inertia = np.array([[2.0, 0.3, -0.1], [0.3, 3.0, 0.2], [-0.1, 0.2, 4.0]])
    momentum = np.concatenate((5.0 * velocity, rotation @ inertia @ rotation.T @ spin))
    momentum[3:] += np.cross(place + rotation @ body[1:4], momentum[:3])
    made._target_pose = 0.1, rotation, place
    found = made._motion(momentum, body)
    assert found[0] == pytest.approx(velocity)
    assert found[1] == pytest.approx(spin)
    assert np.isnan(made._motion(momentum, None)).all()
    made._target_pose = None
    assert np.isnan(made._motion(momentum, body)).all()


@pytest.mark.parametrize('count', [1, 2, 3, 4])
def test_a_body_is_held_as_its_poses_in_three_seconds_after_it_has_settled_show(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many windows there are by then: their poses end with them, or after three seconds."""
    made: Any = announced()
    made._settling, made._at_capture = 2.0, 'a sample'
    chaser_before = Chaser(np.zeros(6), np.eye(6), 1.0, 9)
    made._known = SimpleNamespace(chaser=lambda: chaser_before, windows=['a window'], columns=None)
    asked = list[tuple[Any, ...]]()

    def frame_in_hand(_kernel: object, windows: list[Samples], *others: object) -> str:
        asked.append(([float(each.time[0]) for each in windows], *others))
        return 'a frame'

    flight = SimpleNamespace(noise='noise of poses')
    made._track = SimpleNamespace(flight=lambda *_: (flight, ()), frame=None, frame_in_hand=frame_in_hand)
    tracked = SimpleNamespace(distance_from_robot=(0.0, 0.0))
    monkeypatch.setattr(module, 'TargetAtCapture', lambda *_, frame, **__: tracked if frame == 'a frame' else None)
    made._make_tracked = lambda given: given
    window = pieces()[0]
    within = np.linspace(0.0, 1.1, len(window.time))
    later = [replace(window, time=BEGIN + 2.0 + 1.2 * place + within) for place in range(count)]
    made._begin(later, 5)
    ((starts, origin, part, noise),) = asked
    assert starts == pytest.approx([BEGIN + each for each in (2.0, 3.2, 4.4)[:count]])
    assert part == pytest.approx((BEGIN + 2.0, BEGIN + min(1.9 + 1.2 * count, 5.0)))
    assert (origin, noise, made._method) == (5, 'noise of poses', tracked)


@pytest.mark.parametrize('without', ['windows before it', 'an undisturbed estimate', ''])
def test_what_a_body_brought_is_the_difference_of_two_momenta_each_of_which_may_lack(without: str) -> None:
    """Less what thrusters gave; as uncertain as both, the robot's by its residuals of twice the noise."""
    made: Any = announced()
    momentum, impulse, of_robot = (10.0 * generic(seed, 6) for seed in range(3))
    covariances = 1e-4 * np.diag(np.arange(1.0, 7.0)), 1e-4 * np.diag(np.arange(2.0, 14.0, 2.0))
    robot_alone = Chaser(of_robot, covariances[1], 2.0, 9)
    made._latest = BEGIN
    made._known = SimpleNamespace(chaser=lambda: None if without.startswith('windows') else robot_alone)
    last = Estimate('trajectory', 'converged', 11.0, momentum=momentum, impulse=impulse)
    last = replace(last, momentum_covariance=covariances[0], target_misfit=(7.0, 6))
    if without.startswith('an'):
        last = replace(last, events=(Event(0.0, 'ramp', np.ones(3), np.zeros(3), 'a push'),))
    for each in (replace(last, time=10.0, target_misfit=(1.0, 1)), last):
        made._remember(each)
    found = some(made.capture(None))
    assert found.time == BEGIN
    assert found.chaser == made._known.chaser()
    if without:
        assert np.isnan(found.momentum).all()
        assert np.isnan(found.covariance).all()
    else:
        assert found.momentum == pytest.approx(momentum - impulse - of_robot)
        assert found.covariance == pytest.approx(covariances[0] + 4.0 * covariances[1])
        assert found.misfit == (7.0, 6)


@pytest.mark.parametrize(('since', 'kept'), [(0.5, 0.0), (0.0, 0.0), (-0.5, None), (np.inf, 0.0)])
def test_of_estimates_that_are_forgotten_the_last_undisturbed_one_is_kept(since: float, kept: float | None) -> None:
    made: Any = announced()
    event = Event(since, 'step', np.ones(3), np.zeros(3), 'a push')
    for place in range(_REMEMBERED + 1):
        made._remember(Estimate('trajectory', 'converged', float(place), events=(event,) * bool(np.isfinite(since))))
    assert (made._earlier and made._earlier.time) == kept
    assert len(made._estimates) == _REMEMBERED


@pytest.mark.parametrize(('residual', 'times'), [(0.5, 1.0), (1.0, 1.0), (3.0, 9.0), (np.nan, 1.0)])
def test_the_momentum_before_a_capture_is_as_uncertain_as_its_residuals_show(residual: float, times: float) -> None:
    covariance = np.diag(np.arange(1.0, 7.0))
    assert Chaser(np.zeros(6), covariance, residual, 9).widened == pytest.approx(times * covariance)
