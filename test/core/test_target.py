"""The target that was tracked before its capture: the use of its poses, and their worth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.tracked import CAPTURE, Caught, caught, session_of
from checked import some
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.core.geometry import quaternion_from_rotation, rotate, rotation_from_quaternion
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.target import NOT_A_POSE, TargetTrack, TrackedTargetConfig
from mbaid_ros.replay.json_output import _capture as capture_as_json
from mbaid_ros.sensor_messages import TargetPoses
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


def track_of(given: TargetPoses, **config: float) -> TargetTrack:
    track = TargetTrack(TrackedTargetConfig(**config), '')
    track.odometry_frame = 'odom'
    for index, time in enumerate(given.time):
        track.add(given.message(BAG_TYPES, index, round(float(time) * 1e9)))
    return track


def flown(given: TargetPoses, **config: float) -> tuple[bool, str]:
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


def test_poses_in_an_unknown_frame() -> None:
    found, notes = flown(replace(poses(), frame='camera'))
    assert not found
    assert "298 poses of the target are in the frame 'camera', which is neither 'odom' nor that of a link" in notes
    assert notes.endswith('the run goes on without the poses of the target')


def part(until: float, since: float = 0.0) -> TargetPoses:
    given = poses()
    kept = (given.time < until) & (given.time >= since)
    return TargetPoses(given.time[kept], given.position[kept], given.orientation[kept])


def test_poses_that_stop_long_before() -> None:
    assert flown(part(50.0), **MESSAGES) == (
        True,
        'the poses of the target end 10.2 s before the capture: its motion is predicted',
    )
    found, notes = flown(part(20.0), **MESSAGES)
    assert (found, 'end 40.2 s before the capture' in notes) == (False, True)


def test_a_capture_before_any_pose() -> None:
    given = poses()
    found, notes = flown(replace(given, time=given.time + 100.0))
    assert (found, notes.startswith('0 usable poses of the target before the capture')) == (False, True)


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


def test_poses_of_a_camera_on_a_link() -> None:
    windows, given = bare(), poses()
    kernel = chaser()
    link = kernel.model.link('link4')
    sample = windows[0][:1]
    rotation, position = (
        each[0] for each in kernel.kinematics.configure(sample.base_rotation, sample.joint_position).link_pose(link)
    )
    turned = rotation.T @ rotation_from_quaternion(given.orientation)
    seen = replace(
        given,
        position=(given.position - position) @ rotation,
        orientation=quaternion_from_rotation(turned),
        frame='link4',
    )
    here, there = (
        some(track_of(each, **MESSAGES).flight(kernel, windows, 0, CAPTURE - 0.5, CAPTURE)[0]) for each in (given, seen)
    )
    assert there.velocity == pytest.approx(here.velocity, abs=1e-6)
    assert there.centre == pytest.approx(here.centre, abs=1e-4)


@pytest.mark.long
def test_wrong_poses_are_left_out_and_the_run_goes_on(unchanged: Unchanged) -> None:
    run = caught('servicer7', 4, 0.05, after=14.0)
    # Scaled about the capture, as by a wrong size of a marker: the flight of another, faster free body.
    end = run.poses.position[-1]
    wrong = replace(run, poses=replace(run.poses, position=end + 3.0 * (run.poses.position - end)))
    estimates, _ = session_of(wrong, tracked=True)
    assert 'the motion of the tracked target is left out' in ' '.join(estimates[-1].warnings)
    last = estimates[-1]
    unchanged(last)
    good = np.abs(last.parameters - run.together) < 4.0 * last.std
    assert good[last.identifiable].all()
