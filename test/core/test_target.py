"""The target that was tracked before its capture: the use of its poses, and their worth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.precapture import free_urdf
from benchmarks.tracked import CAPTURE, POSES, Caught, caught, session_of
from checked import central_difference, generic, some
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core import target
from mbaid_ros.core.contracts import Unknown
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.free_flight import RATIOS, FreeFlight, PoseNoise, Track
from mbaid_ros.core.geometry import (
    Array,
    exp,
    log,
    quaternion_from_rotation,
    rotate,
    rotation_from_quaternion,
    skew,
    unvec,
    vec,
)
from mbaid_ros.core.method import ON_POSES
from mbaid_ros.core.odometry.model import odometry_mount
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import BODY, Declared, Layout, variables
from mbaid_ros.core.target import (
    NOT_A_POSE,
    OTHER_FRAME,
    CaptureRows,
    ChangedTarget,
    GraspedFrame,
    TargetAtCapture,
    TargetPriorConfig,
    TargetTrack,
    TrackedTargetConfig,
    declared_target,
    described_prior,
    other_targets,
)
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.replay.json_output import _capture as capture_as_json
from mbaid_ros.sensor_messages import TargetPoses
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun
from observed import MID, configured_motion, kernel, observe
from servicers import chaser
from unchanged import Unchanged

RARE = 1e-3
MESSAGES = {'position_std': 5e-3, 'orientation_std': 5e-3}


@pytest.mark.parametrize('name', ['servicer7', 'table1'])
def test_mass_and_centre_of_mass_with_the_arm_at_rest(name: str, unchanged: Unchanged) -> None:
    run = caught(name, 4, 0.05, after=2.9)
    estimates, session = session_of(run, tracked=True)
    last = estimates[-1]
    unchanged(last)
    assert last.status == 'estimating'
    known = last.identifiable
    assert known[:3].all()
    error = (last.parameters - run.together)[known]
    covariance = last.covariance[np.ix_(known, known)]
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(RARE, int(known.sum()))
    assert last.std[0] < 15.0
    assert np.all(last.std[1:3] < 0.15)
    found = some(session.robot.captured(last))
    velocity, velocity_std, spin, spin_std = some(found.tracked).motion()
    assert np.all(np.abs(velocity - run.target.velocity) < 4.0 * velocity_std)
    assert np.all(np.abs(spin - run.target.spin) < 4.0 * spin_std)
    misfit, numbers = found.misfit
    assert 0.0 < misfit < chi2.isf(RARE, numbers)
    written = capture_as_json(found)['tracked']
    assert written['poses'] > 290
    assert written['numbers'] == numbers


def bare(seconds: float = 60.0) -> list[Samples]:
    """Return windows of a robot at rest."""
    joints = chaser().model.joints
    time = np.arange(round(seconds * 20.0)) / 20.0
    count = len(time)
    still, turned = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    position = np.tile(np.linspace(0.1, 0.7, joints), (count, 1))
    covariance = np.tile(1e-6 * np.eye(6), (count, 1, 1))
    samples = Samples(
        time, position, np.zeros_like(position), still, turned, still, still, covariance, covariance.copy()
    )
    return [samples[begin : begin + 10] for begin in range(0, count, 10)]


def poses() -> TargetPoses:
    return caught_poses()[0]


@cache
def caught_poses() -> tuple[TargetPoses, Caught]:
    run = caught('servicer7', 4, 0.05, after=0.1)
    return run.poses, run


def track_of(given: TargetPoses, **config: Any) -> TargetTrack:
    track = TargetTrack(TrackedTargetConfig(**config), '')
    track.odometry_frame = 'odom'
    for index, time in enumerate(given.time):
        track.add(given.message(BAG_TYPES, index, round(float(time) * 1e9)))
    return track


def flown(given: TargetPoses, **config: Any) -> tuple[bool, str]:
    """Return whether there is a motion at the capture, and the notes."""
    track = track_of(given, **config)
    flight, notes = track.flight(chaser(), bare(), 0, CAPTURE - 0.5, CAPTURE)
    return flight is not None, '; '.join(notes)


def test_good_poses_need_no_words() -> None:
    assert flown(poses(), **MESSAGES) == (True, '')


def test_a_pose_that_jumps_and_one_that_is_none() -> None:
    position, orientation = poses().position.copy(), poses().orientation.copy()
    position[100, 0] += 1.0
    position[110, 1], orientation[120] = np.nan, 0.0
    given = replace(poses(), position=position, orientation=orientation)
    assert flown(given, **MESSAGES) == (True, '1 of 296 poses of the target jump and are not used')
    assert track_of(given).dropped == {NOT_A_POSE: 2}


def test_inverted_poses_are_named() -> None:
    given = poses()
    back = np.swapaxes(rotation_from_quaternion(given.orientation), 1, 2)
    inverse = replace(given, position=-rotate(back, given.position), orientation=quaternion_from_rotation(back))
    found, notes = flown(inverse, **MESSAGES)
    assert not found
    assert 'inverted they fit: publish the target in the frame' in notes


def test_a_body_that_something_pushes_is_not_free() -> None:
    given = poses()
    pushed = given.position + 1e-3 * given.time[:, None] ** 2 * np.array([1.0, 0.0, 0.0]) * (given.time > 30.0)[:, None]
    found, notes = flown(replace(given, position=pushed), **MESSAGES)
    assert (found, 'miss those of a free body by' in notes) == (False, True)


@pytest.mark.parametrize(
    ('times', 'excess', 'used', 'noted'),
    [
        ((30.0, 47.1, 12), 1.4, True, ()),
        ((30.0, 46.9, 12), 1.4, True, ('end',)),  # a second and the margin without a pose
        ((30.0, 47.1, 11), 1.4, False, ('11',)),
        ((39.9, 45.0, 12), 1.4, True, ('end',)),
        ((40.1, 45.0, 12), 1.4, False, ('end',)),  # longer without poses than with them
        ((30.0, 47.1, 12), 1.6, False, ('cause',)),
    ],
)
def test_which_poses_lead_to_a_flight(
    times: tuple[float, float, int],
    excess: float,
    noted: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    *,
    used: bool,
) -> None:
    nothing: Any = None
    falling: Any = SimpleNamespace(gradient=lambda stamp: stamp)
    track = TargetTrack(TrackedTargetConfig(), '', falling)
    poses = Track(np.linspace(*times), np.zeros((times[2], 3)), np.zeros((times[2], 3, 3)))
    monkeypatch.setattr(track, '_located', lambda *given: (poses if given[-1] == (-72.0, 48.0) else None, ()))
    monkeypatch.setattr(target, 'free_flight', lambda given, _: SimpleNamespace(track=given, dropped=0))
    monkeypatch.setattr(target, '_excess', lambda *_: excess)
    monkeypatch.setattr(target, '_not_free', lambda *_: 'the cause')
    flight, notes = track.flight(nothing, [], 7, 48.0, 50.0)
    assert [word in note for word, note in zip(noted, notes, strict=True)] == [True] * len(noted)
    assert (flight is not None) is used
    taken: Any = flight
    if used:
        assert taken.track.time == pytest.approx(poses.time - 50.0)
        assert taken.track.gradient(np.array([-2.0])).tolist() == [48_000_000_007]


def test_poses_are_located_by_their_frames_and_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the odometry's frame as it falls, or that of a link as its base moves between two samples."""
    windows, robot, (turn,), place = bare(4.0), chaser(), exp(generic(3, 1, 3)), generic(8, 3)
    turns, places, joints = exp(0.3 * generic(4, 10, 3)), generic(5, 10, 3), generic(6, 10, robot.model.joints)
    windows[3] = replace(windows[3], base_rotation=turns, base_position=places, joint_position=joints)
    falling: Any = SimpleNamespace(turned=lambda stamps: exp(1e-9 * stamps[:, None] * generic(7, 3)))
    track = TargetTrack(TrackedTargetConfig(), 'arm_', falling)
    track.odometry_frame = '/odom'
    frames = [('odom', 2.0), ('odom', 1.0), ('arm_link4', 1.6375), ('arm_link4', 1.47), ('link4', 1.7), ('odom', 3.0)]
    for frame, time in [*frames, ('odom', 3.01)]:
        track._readings.append(target._Reading(frame, round((time + 5.0) * 1e9), place, turn))
    found, (note,) = track._located(robot, windows, 5_000_000_000, (1.0, 3.0))
    assert note.startswith("1 poses of the target are in the frame 'link4', which is neither 'odom' nor")
    assert found.time.tolist() == pytest.approx([1.6375, 2.0, 3.0])
    base = turns[2] @ exp(0.75 * log(turns[2].T @ turns[3]))
    moved, held = (each[2] + 0.75 * (each[3] - each[2]) for each in (places, joints))
    link = robot.kinematics.configure(base[None], held[None]).link_pose(robot.model.link('link4'))
    axes = np.concatenate((link[0], exp(np.array([[7.0], [8.0]]) * generic(7, 3))))
    assert found.rotation == pytest.approx(axes @ turn)
    assert found.position == pytest.approx(axes @ place + [moved + link[1][0], np.zeros(3), np.zeros(3)])
    monkeypatch.setattr(target, '_MOST', 2)  # of three poses every second one
    assert track._located(robot, windows, 5_000_000_000, (1.0, 3.0))[0].time.tolist() == pytest.approx([1.6375, 3.0])
    assert track.dropped[OTHER_FRAME] == 1


def turned(given: TargetPoses) -> TargetPoses:
    """Return poses of a camera whose frame is turned by 12 degrees."""
    turn = exp(np.deg2rad(12.0) * np.array([0.6, -0.64, 0.48]))
    rotation = turn @ rotation_from_quaternion(given.orientation)
    return replace(given, position=given.position @ turn.T, orientation=quaternion_from_rotation(rotation))


WRONG: dict[str, tuple[Callable[[TargetPoses], TargetPoses], str]] = {
    # As of a marker that is smaller than it is taken for: the flight of another, slower free body.
    'scale': (
        lambda given: replace(given, position=1.15 * given.position),
        'lengths in the poses of the target are 1.15 times the true ones',
    ),
    'stamps': (
        lambda given: replace(given, time=given.time + 2.0),
        'the stamps of the poses of the target are 2.1 s late',
    ),
    'frame': (turned, "the frame of the target's poses is turned by 12 deg"),
}


@pytest.mark.long
@pytest.mark.parametrize('wrong', WRONG)
def test_wrong_poses_are_left_out_with_the_cause_and_the_run_goes_on(wrong: str, unchanged: Unchanged) -> None:
    run = caught('servicer7', 4, 0.05, after=10.0)
    change, cause = WRONG[wrong]
    estimates, _ = session_of(replace(run, poses=change(run.poses)), tracked=True)
    left_out = 'the motion of the tracked target is left out, because it contradicts that since the capture: '
    assert left_out + cause in ' '.join(estimates[-1].warnings)
    last = estimates[-1]
    unchanged(last)
    good = np.abs(last.parameters - run.together) < 4.0 * last.std
    assert good[last.identifiable].all()
    # Until then every published estimate says what it rests on.
    early = [each for each in estimates if each.time > CAPTURE and left_out not in ' '.join(each.warnings)]
    assert all(ON_POSES in each.warnings for each in early if each.identifiable.any() and each.status != 'inconsistent')


FRAME = (*POSES.place, 0.0, 0.0, 0.0, 1.0)


def judged(run: Caught, estimates: list[Estimate]) -> Estimate:
    """Return the last estimate, whose numbers are within their covariance."""
    last = estimates[-1]
    known = last.identifiable
    assert known[:3].all()
    error, covariance = (last.parameters - run.together)[known], last.covariance[np.ix_(known, known)]
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(RARE, int(known.sum()))
    return last


@pytest.mark.parametrize('name', ['servicer7', pytest.param('table1', marks=pytest.mark.long)])
def test_where_the_hand_holds_a_body_that_slipped_is_given(name: str) -> None:
    run = caught(name, 5, 0.05, after=4.9, settling=2.0)
    last = judged(run, session_of(run, tracked=True, **{'capture.settling': 2.0, 'target.frame': FRAME})[0])
    assert last.std[0] < 10.0
    assert last.std[1] < 0.02


@pytest.mark.long
@pytest.mark.parametrize('later', [0.0, 6.0])
def test_a_body_that_slips_is_placed_by_poses_that_go_on_or_by_the_arm(later: float) -> None:
    run = caught('servicer7', 5, 0.05, after=9.0, settling=2.0, later=later)
    estimates, session = session_of(run, tracked=True, **{'capture.settling': 2.0})
    assert judged(run, estimates).std[0] < 1.5
    assert some(some(session.robot.captured(estimates[-1])).tracked).grasp_known == (later > 0.0)


@pytest.mark.long
def test_a_given_frame_that_is_missed_is_reported() -> None:
    run = caught('table1', 4, 0.05, after=2.9, settling=2.0)
    estimates, _ = session_of(run, tracked=True, **{'target.frame': FRAME})
    assert 'from where target.frame has it: the body slips in the grasp (set capture.settling)' in ' '.join(
        estimates[-1].warnings
    )


def test_poses_that_go_on_place_the_frame_in_the_hand() -> None:
    windows, robot = bare(10.0), chaser()
    link = robot.kinematics.configure(windows[0].base_rotation[:1], windows[0].joint_position[:1]).link_pose(
        robot.target
    )
    (rotation,), (position,) = link
    (turn,), place, time = exp(generic(11, 1, 3)), generic(12, 3), np.arange(5.0, 9.9, 0.1)
    rng = np.random.default_rng(3)
    away, tilt = 5e-3 * rng.standard_normal((2, len(time), 3))
    seen = exp(tilt) @ (rotation @ turn)
    given = TargetPoses(time, position + rotation @ place + away, quaternion_from_rotation(seen))
    white, slow = PoseNoise(5e-3, 5e-3), PoseNoise(5e-3, 1e-2, (1.0, 1.0))
    found = some(track_of(given).frame_in_hand(robot, windows, 0, (4.0, 10.0), white))
    std = np.sqrt(np.diag(some(found.factor) @ some(found.factor).T))
    assert std == pytest.approx(np.full(6, 5e-3 / np.sqrt(len(time))), rel=0.3)
    assert np.all(np.abs(log(found.rotation @ turn.T)) < 4.0 * std[:3])
    assert np.all(np.abs(found.position - place) < 4.0 * std[3:])
    factor = some(some(track_of(given).frame_in_hand(robot, windows, 0, (4.0, 10.0), slow)).factor)
    fewer = (1.0 - np.exp(-0.1)) / (1.0 + np.exp(-0.1))  # of errors that follow each other in a tenth of their time
    assert np.diag(factor)[:3] == pytest.approx(1e-2 / np.sqrt(fewer * len(time)))
    assert np.diag(factor)[3:] == pytest.approx(
        np.maximum(std[3:] * np.sqrt(len(time)), 5e-3) / np.sqrt(fewer * len(time))
    )
    assert track_of(given).frame_in_hand(robot, windows, 0, (9.5, 10.0), white) is None  # too few
    # Poses after that, which a replay has already, do not count.
    sooner = replace(given, time=time[:30], position=given.position[:30], orientation=given.orientation[:30])
    both = [some(track_of(each).frame_in_hand(robot, windows, 0, (4.0, time[29]), white)) for each in (given, sooner)]
    assert all(np.array_equal(*(getattr(each, name) for each in both)) for name in ('rotation', 'position', 'factor'))


def test_a_quaternion_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"'target\.frame' ends with a quaternion of length 0\.5; accepted: 1"):
        TargetTrack(TrackedTargetConfig(frame=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)), '')


def test_the_link_of_a_known_frame_is_as_uncertain_as_flight_and_frame_make_it() -> None:
    (turn,), place = exp(generic(11, 1, 3)), generic(12, 3)
    made = replace(at_capture(1e3), frame=GraspedFrame(turn, place, np.eye(6)))

    def link(held: TargetAtCapture) -> Array:
        """Return turn and place against those of no error."""
        return np.concatenate((log(held.link[0] @ made.link[0].T), held.link[1] - made.link[1]))

    by_flight = central_difference(lambda step: link(replace(made, flight=made.flight.moved(step))), np.zeros(20), 1e-5)
    factor = np.linalg.cholesky(made.flight.covariance)
    assert made.link_by_flight == pytest.approx(by_flight @ factor, abs=1e-9)

    def other(step: Array) -> Array:
        return link(replace(made, frame=GraspedFrame(exp(step[:3]) @ turn, place + step[3:])))

    assert made.link_factor == pytest.approx(central_difference(other, np.zeros(6), 1e-5), abs=1e-8)
    assert made.distance_from_robot == pytest.approx(np.linalg.norm(link(at_capture(1e3)).reshape(2, 3), axis=1))


def at_capture(tightness: float, *, rigid: bool = True) -> TargetAtCapture:
    """Return a target at a generic place, whose motion is known so well, and the servicer as it moves."""
    robot = kernel('servicer7')
    sample = observe(configured_motion('servicer7', 4.0, 20.0), MID)[60:61]
    sample = replace(sample, base_position=sample.base_position + generic(1, 3))
    (turn,), centre, velocity, spin, lever = exp(generic(2, 1, 3)), generic(3, 3), *(0.1 * generic(4, 3, 3))
    rows = np.concatenate((tightness * np.eye(20), np.zeros((20, 1))), axis=1)
    noise = PoseNoise(1e-3, 1e-3, (0.0, 0.0))
    flight = FreeFlight(turn, centre, velocity, spin, lever, 0.3 * generic(5, 5), rows, noise, 1.0, 100)
    momentum = generic(6, 6)
    return TargetAtCapture(3.0, flight, robot, sample, momentum, np.eye(6), lambda _: np.zeros((6, 0)), rigid=rigid)


def test_what_the_flight_leaves_open_is_a_ball_at_the_link() -> None:
    made, mass = at_capture(1e-3), 50.0
    rotation, position = made.link
    body, momentum = made.guess(mass)
    found = physical(body - made.kernel.target.parameters)
    assert found[1:4] == pytest.approx(np.zeros(3), abs=1e-9)
    inertia = unvec(found[4:])
    assert inertia == pytest.approx(inertia[0, 0] * np.eye(3))
    spin = made.flight.rotation @ made.flight.spin
    velocity = made.flight.velocity + np.cross(spin, position - made.flight.centre)  # of the body's point there
    own = momentum - made.momentum
    assert own[:3] == pytest.approx(mass * velocity)
    assert own[3:] == pytest.approx(np.cross(position, own[:3]) + rotation @ inertia @ rotation.T @ spin)


def test_the_link_is_as_uncertain_as_the_pose_of_the_base_makes_it() -> None:
    made = at_capture(1e4)
    root = np.eye(6) + 0.3 * generic(7, 6, 6)
    covariance = 1e-6 * root @ root.T
    made = replace(made, sample=replace(made.sample, pose_covariance=covariance[None]))
    away = made.link[1] - made.sample.base_position[0]

    def link(error: Array) -> Array:
        """Return turn and place by errors of position and orientation of the base."""
        return np.concatenate((error[3:], error[:3] + exp(error[3:]) @ away))

    by_pose = central_difference(link, np.zeros(6), 1e-5)
    assert np.abs(away).min() > 0.05
    assert made.link_factor @ made.link_factor.T == pytest.approx(by_pose @ covariance @ by_pose.T, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(
    ('stds', 'exchanged', 'said'),
    [
        ((9.0, 4.9), True, '; the centre of mass has changed by (+0.1, -0.3, +0.2) m, the mass by -50 kg'),
        ((9.0, 4.9), False, '; the centre of mass has changed by (+0.1, -0.3, +0.2) m'),
        ((11.0, 4.9), True, ''),  # a mass that is not known to a tenth
        ((9.0, 5.1), True, ''),
    ],
)
def test_a_changed_target_is_reported_with_its_size_where_both_masses_are_known(
    stds: tuple[float, float], said: str, *, exchanged: bool
) -> None:
    def state(mass: float, centre: list[float], std: float) -> MeanAndCovariance:
        mean, deviation = np.zeros(BODY.stop), np.zeros(BODY.stop)
        mean[BODY.start : BODY.start + 4], deviation[BODY.start] = [mass, *(mass * np.array(centre))], std
        return cast('MeanAndCovariance', SimpleNamespace(mean=mean, deviation=deviation))

    before, after = state(100.0, [0.2, 0.1, -0.3], stds[0]), state(50.0, [0.3, -0.2, -0.1], stds[1])
    event = ChangedTarget(7.0, 'the target changed', exchanged, before).event(after)
    assert (event.time, event.kind, event.cause) == (7.0, 'target_changed', f'the target changed{said}')
    assert ChangedTarget(7.0, 'the target changed', exchanged, None).event(after).cause == 'the target changed'


def rows_of(made: TargetAtCapture, *unknowns: Unknown) -> tuple[CaptureRows, Array]:
    """Return the rows of a target about an origin, and a state with a body that moves as the target did."""
    rows = CaptureRows(made, Layout.from_unknowns(made.kernel, unknowns), generic(21, 3))
    return rows, rows.point(50.0).state


def motion_by_momenta(numbers: Array, made: TargetAtCapture) -> Array:
    """Return the motion (17,) of a body with the momentum that it has beside the robot's, held as the link is."""
    (turn,), (rotation, position) = exp(numbers[None, 16:19]), made.link
    rotation, place, came = turn @ rotation, position + numbers[19:22], numbers[:6] - numbers[22:]
    body = physical(numbers[6:16])
    centre, inertia = place + rotation @ body[1:4], rotation @ unvec(body[4:]) @ rotation.T
    velocity = came[:3] / body[0]
    spin = np.linalg.solve(inertia, came[3:] - np.cross(centre, came[:3]))
    ratios = 3.0 * np.tensordot(RATIOS, inertia, axes=2) / np.trace(inertia)
    return np.concatenate((velocity + np.cross(spin, position - centre), spin, centre, ratios, velocity))


@pytest.mark.parametrize('framed', [False, True])
def test_a_capture_misses_the_motion_by_as_much_as_that_is_moved(framed: bool) -> None:
    """By all 17 numbers, and as momenta, body and link change them; of errors its noise has unit variance."""
    (turn,), root = exp(generic(11, 1, 3)), 1e-3 * (np.eye(6) + 0.3 * generic(22, 6, 6))
    made = replace(
        at_capture(1e4), frame=GraspedFrame(turn, generic(12, 3), root) if framed else None, factor=10.0 * root
    )
    made = replace(made, sample=replace(made.sample, pose_covariance=(root @ root.T)[None]))
    (rows, state), motion = rows_of(made), made.measured[0]
    numbers = rows._at_zero + rows._by_state @ state
    missed, by_numbers = rows._misfit(numbers)
    assert missed == pytest.approx(np.zeros(17), abs=1e-9)
    assert motion_by_momenta(numbers, made) == pytest.approx(motion, abs=1e-9)
    steps = np.concatenate((np.repeat(1e-4, 6), 1e-5 * np.maximum(np.abs(numbers[6:16]), 1.0), np.repeat(1e-5, 12)))
    expected = central_difference(lambda each: motion_by_momenta(each, made), numbers, steps)
    assert by_numbers == pytest.approx(expected, abs=1e-6 * float(np.abs(expected).max()), rel=1e-5)
    if not framed:
        for step in 0.1 * np.eye(20):
            moved = replace(made, flight=made.flight.moved(step))
            assert rows_of(moved)[0]._misfit(numbers)[0] == pytest.approx(motion - moved.measured[0], abs=1e-9)
    flight, selected = np.linalg.cholesky(made.flight.covariance), made.selection(None)[0]

    def value(errors: Array) -> Array:
        moved, there = replace(made, flight=made.flight.moved(flight @ errors[:20])), numbers.copy()
        there[16:22] += made.link_factor @ errors[20:26]
        there[22:] += made.factor @ errors[26:]
        return selected @ replace(rows, target=moved)._misfit(there)[0]

    by_errors = central_difference(value, np.zeros(32), 1e-3)
    _, by_state, noise = rows._motion_rows(state)
    assert noise @ noise.T == pytest.approx(by_errors @ by_errors.T, abs=2e-4 * float(np.max(noise) ** 2))
    assert by_state == pytest.approx(np.linalg.solve(noise, selected @ by_numbers))
    other, factor = (
        state * 1.001,
        1e-3 * np.abs(state[:, None]) * np.random.default_rng(23).normal(size=(len(state), 3)),
    )
    raw, by_raw = rows._misfit(rows._at_zero + rows._by_state @ other)
    _, _, noise = rows._motion_rows(other)
    seen = selected @ by_raw @ rows._by_state @ factor
    misfit, whitening = rows.normalised_misfit(other, factor)
    assert whitening @ raw == pytest.approx(misfit)
    expected = np.linalg.inv(noise @ noise.T + seen @ seen.T)
    assert misfit @ misfit == pytest.approx(selected @ raw @ expected @ selected @ raw)


def test_rows_of_a_capture_are_those_of_its_misfit_and_of_a_plausible_size() -> None:
    rows, state = rows_of(at_capture(1e4), odometry_mount(1e-2, 1e-2))
    rows = replace(rows, target=replace(rows.target, momentum_columns=lambda _: generic(24, 6, 6)))
    robot, detector = rows.layout.kernel, PlaneDetector(rows.layout.kernel.model)
    space = variables(rows.layout, detector, Declared((odometry_mount(1e-2, 1e-2),)))
    point, numbers = rows.layout.point(1.01 * state), rows._at_zero + rows._by_state @ (1.01 * state)
    found = rows.at(point, space)
    assert len(found) == 14 + 6
    left = found[:, :-1] @ (space.from_state @ point.state) - found[:, -1]
    (value, size), (by_value, by_size) = zip(rows._motion_rows(point.state)[:2], rows._size(numbers), strict=True)
    assert left == pytest.approx(np.concatenate((value, size)))
    assert found[:, :-1] @ space.from_state == pytest.approx(
        np.concatenate((by_value, by_size)) @ rows._by_state, abs=1e-6
    )
    steps, scale = 1e-5 * np.maximum(np.abs(numbers), 1.0), numbers[6] * 2.5**2  # of the mass there
    expected = central_difference(lambda each: physical(each[6:16])[4:] / scale, numbers, steps)
    assert by_size == pytest.approx(expected, abs=1e-8)
    body = physical(numbers[6:16])
    assert size == pytest.approx((body[4:] - body[0] * 0.7**2 * vec(np.eye(3))) / scale)
    by_mount = rows._by_state[:, rows.layout.places[0]]
    assert np.array_equal(by_mount[22:], generic(24, 6, 6))
    assert np.array_equal(by_mount[16:22], rows.target.link_columns(rows.layout.unknowns[0]))
    assert robot.target.parameters == pytest.approx(-rows._at_zero[6:16])
    moved = 0.5 * generic(25, rows.layout.size)
    there = rows._by_state @ moved
    assert there[:3] == pytest.approx(moved[6:9])
    assert there[3:6] == pytest.approx(moved[9:12] + np.cross(rows.origin, moved[6:9]))
    with pytest.raises(np.linalg.LinAlgError):
        rows._misfit(-numbers)


@pytest.mark.parametrize(
    ('change', 'named'),
    [
        ([0.0] * 5, ''),
        ([0.0, 0.0, 0.0, 0.1, 0.0], 'lengths in the poses of the target are 1.1 times the true ones'),
        ([0.0, 0.0, 0.0, -0.1, 0.0], 'lengths in the poses of the target are 0.9 times the true ones'),
        ([0.0, 0.0, 0.0, 0.0, 0.2], 'the stamps of the poses of the target are 0.2 s early'),
        ([0.0, 0.0, 0.0, 0.0, -0.2], 'the stamps of the poses of the target are 0.2 s late'),
        ([0.06, -0.064, 0.048, 0.0, 0.0], "the frame of the target's poses is turned by 5.7 deg"),
    ],
)
def test_which_error_of_the_poses_explains_a_contradiction(change: list[float], named: str) -> None:
    made = at_capture(1e4)
    rows, state = rows_of(made)
    wrong = replace(rows, target=made.with_other_poses(np.array(change)))
    assert wrong.pose_error(state, 1e-6 * np.ones((len(state), 1))).startswith(named)
    assert bool(wrong.pose_error(state, np.zeros((len(state), 1)))) is bool(named)


def test_poses_that_are_turned_larger_or_later_are_of_a_flight_that_is() -> None:
    made, flight = at_capture(1e4), at_capture(1e4).flight
    (turn,) = exp(np.array([[0.3, -0.2, 0.4]]))
    other = made.with_other_poses(np.array([0.3, -0.2, 0.4, 0.1, 0.0])).flight
    for vector, expected in ((other.centre, flight.centre), (other.velocity, flight.velocity)):
        assert vector == pytest.approx(1.1 * turn @ expected)
    assert other.rotation == pytest.approx(turn @ flight.rotation)
    assert other.lever == pytest.approx(1.1 * flight.lever)
    later = made.with_other_poses(np.array([0.0, 0.0, 0.0, 0.0, 1e-2])).flight
    assert later.centre == pytest.approx(flight.centre + 1e-2 * flight.velocity, abs=1e-12)
    assert log(later.rotation @ flight.rotation.T) == pytest.approx(1e-2 * flight.rotation @ flight.spin, abs=1e-9)
    before, after, unchanged = (
        one.rotation @ flight.inertia @ other.spin for one, other in ((flight, flight), (later, later), (later, flight))
    )
    assert np.linalg.norm(after - before) < 0.02 * np.linalg.norm(unchanged - before)  # as nothing acts
    by_change = made.motion_jacobian(np.zeros(5))
    spin = flight.rotation @ flight.spin
    assert by_change[14:, :3] == pytest.approx(-skew(flight.velocity), abs=1e-6)
    assert by_change[3:6, :3] == pytest.approx(-skew(spin), abs=1e-6)
    assert pytest.approx(np.array([flight.centre, flight.velocity]), abs=1e-6) == by_change[6:9, 3:].T


@pytest.mark.parametrize(
    ('centre', 'ratios', 'plane', 'used'),
    [
        ([0.09, 0.09, 0.09], 0.09, False, (14, True, True)),
        ([0.09, 0.09, 0.09], 0.11, False, (9, True, False)),
        ([0.09, 0.11, 0.11], 0.09, False, (12, True, True)),
        ([0.11, 0.11, 0.11], 0.09, False, (11, False, True)),
        ([0.09, 0.09, 0.09], 0.09, True, (5, True, False)),
        ([0.09, 0.11, 0.11], 0.09, True, (4, True, False)),
    ],
)
@pytest.mark.parametrize('held', [True, False])
def test_what_a_flight_determines_counts(
    centre: list[float], ratios: float, used: tuple[int, bool, bool], *, plane: bool, held: bool
) -> None:
    """Centre of mass and ratios where they are sharp; of a body that may slip the velocity of its centre alone."""
    made, values = at_capture(1.0, rigid=held), np.zeros(17)
    values[3:6] = 0.3, -0.4, 1.2
    std = np.concatenate((np.full(3, 0.01), np.full(3, 0.02), centre, np.full(5, ratios), np.full(3, 0.03)))
    made.__dict__['measured'] = values, np.diag(std)
    equations = np.zeros((3, 6))
    equations[[0, 1, 2], [0, 1, 5]] = 1.0
    found, flags = made.selection(equations if plane else None)
    if not held:
        expected = np.zeros((2 if plane else 3, 17))
        expected[:, 14:] = np.eye(3)[: len(expected)] / 0.03
        assert found == pytest.approx(expected)
        assert flags.tolist() == [True, False, False]
        return
    assert (len(found), *flags[1:].tolist()) == used
    # A tight direction of the centre is as uncertain as that of the spin turns the widest by.
    more = 0.0 if max(centre[: 2 if plane else 3]) < 0.1 else 3.0 * 0.02**2 / 1.69 * 0.11**2
    variance = std**2 + np.repeat([0.0, more, 0.0], (6, 3, 8))
    assert found @ np.diag(variance) @ found.T == pytest.approx(np.eye(len(found)))
    assert not found[:, 14:].any()
    assert bool(found[:, 9:14].any()) is used[2]


ORBIT = {'orbit.mean_motion': 1.13e-3, 'orbit.frame': 'lvlh'}
IN_ORBIT: dict[str, object] = {
    **ORBIT,
    'duration': 46.0,
    'joint_rate': 20.0,
    'odometry_rate': 20.0,
    'motion.kind': 'random',
    'motion.within_limits': False,
    'initial.base_position': [4.0, -3.0, 8.0],
    'capture.time': 40.0,
    'capture.mass': 155.0,
    'capture.com': [0.34, -0.22, 0.78],
    'capture.inertia': [24.0, -2.5, 2.0, 33.0, -0.5, 29.0],
    'capture.linear_velocity': [0.03, -0.04, 0.02],
    'capture.angular_velocity': [0.02, -0.03, 0.03],
    'target_pose.rate': 5.0,
    'target_pose.position_noise': 5e-3,
    'target_pose.orientation_noise': 5e-3,
}


@pytest.mark.long
def test_a_target_that_was_tracked_in_an_orbit() -> None:
    """In a frame that turns with it; on a straight line its velocity would be off by 1 mm/s."""
    noise = {f'noise.{name}': value for name, value in vars(MID).items() if value and name != 'base_correlation_time'}
    made = SimulatedRun(build(SimulatorConfig, {**IN_ORBIT, **noise}), free_urdf(), BAG_TYPES)
    given = {**EXACT, **noise, **ORBIT, 'capture.time': 40.0, 'maximum_gap': 0.2}
    session = Session(build(EstimatorConfig, given), free_urdf())
    add: dict[str, Callable[[Any], object]] = {
        'joint_states': session.add_joint_state,
        'odom': session.add_odometry,
        'target_pose': session.add_target_pose,
    }
    for each in made.read(46.0):
        add[each.topic](each.message)
    last = [*session.process(), *session.finish()][-1]
    velocity, deviation, _, _ = some(some(session.robot.captured(last)).tracked).motion()
    assert np.all(np.abs(velocity - [0.03, -0.04, 0.02]) < 4.0 * deviation)
    assert np.all(deviation < 2e-3)
    assert last.identifiable.all()
    error = last.parameters - made.target_inertia
    assert float(error @ np.linalg.solve(last.covariance, error)) < chi2.isf(RARE, 10)


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ({}, ''),
        ({'mass': 5.0, 'mass_std': 0.1}, ''),
        ({'mass': 5.0, 'mass_std': 0.1, 'com': (0.1, 0.2, 0.3), 'com_std': 0.01}, ''),
        ({'mass': 5.0}, "'target_prior.mass' is 5 kg without 'target_prior.mass_std'"),
        ({'mass_std': 0.1}, "'target_prior.mass_std' is 0.1 kg without 'target_prior.mass'"),
        ({'com': (0.1, 0.2, 0.3)}, "'target_prior.com' is [0.1, 0.2, 0.3] m without 'target_prior.com_std'"),
        ({'com_std': 0.01}, "'target_prior.com_std' is 0.01 m without 'target_prior.com'"),
        ({'com': (0.1, 0.2, 0.3), 'com_std': 0.01}, "without 'target_prior.mass_std'"),
    ],
)
def test_a_prior_of_the_target_has_values_with_their_deviations(given: dict[str, Any], said: str) -> None:
    if not said:
        assert declared_target(TargetPriorConfig(**given)).mass == given.get('mass', 0.0)
        return
    with pytest.raises(ParameterError) as error:
        declared_target(TargetPriorConfig(**given))
    assert said in str(error.value)


ALL_PARTS = {'mass_relative_std': 0.1, 'com_std': 0.01, 'inertia_relative_std': 0.2}


@pytest.mark.parametrize(
    ('given', 'prior', 'said'),
    [
        (ALL_PARTS, {}, ''),
        ({**ALL_PARTS, 'com_std': 0.0}, {}, 'is of the link that is identified'),
        ({'mass_relative_std': 0.1, 'com_std': 0.01}, {}, 'is of the link that is identified'),
        (ALL_PARTS, {'mass': 5.0, 'mass_std': 0.1}, "and 'target_prior' are both of the same link"),
    ],
)
def test_a_described_target_is_as_uncertain_as_its_link(
    given: dict[str, float], prior: dict[str, Any], said: str
) -> None:
    robot = kernel('servicer7')
    if not said:
        assert described_prior(TargetPriorConfig(), robot, given) is not None
        return
    with pytest.raises(ParameterError) as error:
        described_prior(TargetPriorConfig(**prior), robot, given)
    assert said in str(error.value)


def test_another_target_is_the_last_described_link_of_each_other_body() -> None:
    robot = kernel('servicer7')
    found = {some(some(each.repair).parameters)['target_link']: each for each in other_targets(robot)}
    described = {link.body: link for link in robot.model.links if link.parameters[0] > 0.0}
    assert set(found) == {link.name for body, link in described.items() if body != robot.target.body}
    for name, each in found.items():
        assert each.kernel.target.name == name
        assert 0.0 < some(each.least_mass) < robot.model.link(name).parameters[0]
