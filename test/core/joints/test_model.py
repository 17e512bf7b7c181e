"""Joints that bend, or wander from where they are read to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from checked import assert_derivative, central_difference, generic, some
from declarations import exact_but
from floating import float_freely, make, normalised
from mbaid_ros.core.contracts import NominalModel, Unknown, deviation_text
from mbaid_ros.core.filter.time_update import _gauss_markov_step
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.joints.model import geared_joints, joint_lags, joint_placements, joint_tracking
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.state import BODY, Layout, Variables
from mbaid_ros.core.windows import Midpoints, with_gears
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
from observed import MID, observe, windows
from random_robots import two_links
from windowed import residuals, window_model, window_of

SPACING, STEP = 0.05, 0.01  # s
JOINT, SIZE = 3, 0.01  # rad


def state(robot: MomentumKernel, start: Array, numbers: Array) -> Array:
    return np.concatenate((np.zeros(6), start, robot.target.parameters, numbers))


@pytest.mark.parametrize('taken', [0.0, 0.8])
@pytest.mark.parametrize('numbers', [(SIZE, 0.0, 0.0), (0.3 * SIZE, -0.5 * SIZE, 0.4 * SIZE)])
def test_joints_that_deviate_with_their_angle_leave_nothing_in_a_window(
    servicer7: MomentumKernel, tumbling: Truth, start: Array, numbers: tuple[float, ...], taken: float
) -> None:
    """Also where windows are linearised at a part of the deviation."""
    own, joints = np.eye(servicer7.model.joints)[JOINT], servicer7.model.joints
    angle = tumbling.joint_position[:, JOINT, None]
    off = numbers[0] * np.sin(angle) + numbers[1] * np.cos(angle) + numbers[2] * angle
    window = window_of(observe(replace(tumbling, joint_position=tumbling.joint_position - off * own), MID), SPACING)
    unknown = geared_joints(servicer7.model.joint_names, [SIZE] * joints, [SIZE] * joints)
    layout = Layout.from_unknowns(servicer7, (unknown,))
    whole = np.outer(own, numbers).ravel()
    found = []
    for each in (np.zeros(3 * joints), whole):
        here = layout.point(state(servicer7, start, taken * whole / SIZE))
        x = state(servicer7, start, np.linalg.solve(unknown.factor, each))
        model = window_model(layout, window, here)
        x[:6] = np.linalg.solve(model.pose.rows[:, :6], residuals(model, x)[0])
        found.append(np.abs(residuals(model, x)[1]).max())
    assert found[1] < 0.05 * found[0]
    assert layout.size == BODY.stop + 3 * joints


def test_a_gear_moves_its_joint_at_the_rate_of_its_deflection() -> None:
    """By sine and cosine of the angle, and in proportion to it; of no other joint."""
    unknown = geared_joints(['elbow', 'wrist', 'hand'], [1e-3] * 3, [1e-3] * 3)
    angle, rate = generic(0, 1, 3), generic(1, 1, 3)
    places, rates = unknown.deflections(angle, rate, 0.0 * rate)
    own = [np.sin(angle[0, 1]), np.cos(angle[0, 1]), angle[0, 1]]
    assert places[0, 1] == pytest.approx([*(0.0,) * 3, *own, *(0.0,) * 3])

    def deflected(time: Array) -> Array:
        return unknown.deflections(angle + time * rate, rate, 0.0 * rate)[0][0]

    assert_derivative(rates[0][..., None], deflected, np.zeros(1))


GAIN, OFFSET = -2.0, 0.1  # of j1, which follows j2 though it is nearer to the base
FOLLOWS = MomentumKernel(
    load_model(
        two_links(f'type="revolute"><mimic joint="j2" multiplier="{GAIN}" offset="{OFFSET}"/', 'type="revolute"')
    ),
    'link2',
)


@pytest.mark.parametrize('kind', ['zero', 'tracking'])
def test_an_error_of_a_leader_moves_its_followers(kind: str) -> None:
    """By zero or tracking, which are causes of the leader alone; the follower's own moves no other joint."""
    model, size = FOLLOWS.model, 1e-3
    deviations, none = [0.0, size], [0.0, 0.0]
    both: list[Unknown] = [
        joint_placements(FOLLOWS, sizes, none, none)
        if kind == 'zero'
        else joint_tracking(model.joint_names, sizes, [TIME] * 2, model.transmission)
        for sizes in (deviations, [size, size])
    ]
    turn, read, rate, twist = exp(generic(1, 3, 3)), generic(2, 3, 1), generic(3, 3, 1), generic(4, 3, 6)
    moved = model.transmission

    def momentum(error: Array) -> Array:
        """Return the momentum where readings of the leader have the second error, and its follower the first beside."""
        places = moved.positions(read + error[1]) + np.array([error[0], 0.0])
        every = FOLLOWS.states_of(turn, places, moved.rates(rate), twist)
        return every.known_momentum

    expected = central_difference(momentum, np.zeros(2), 1e-5)
    states = FOLLOWS.states_of(turn, moved.positions(read), moved.rates(rate), twist)
    for unknown in both:
        columns = some(unknown.momentum_columns(FOLLOWS, states)) @ unknown.factor
        assert columns == pytest.approx(size * expected[..., -unknown.count :], abs=1e-9)
    assert both[0].causes == (f'{kind}:j2',)
    assert both[1].causes == (f'{kind}:j1', f'{kind}:j2')
    if kind == 'zero':
        nominal = both[0].applied_to(NominalModel.nominal(FOLLOWS), both[0].factor @ [1.0])
        assert nominal.zeros == pytest.approx([GAIN * size, size])


def test_a_follower_is_as_late_as_its_leader_and_deviates_with_it() -> None:
    """A gear of the leader moves its follower, by the leader's angle, also where windows are linearised at it."""
    moved, names = FOLLOWS.model.transmission, FOLLOWS.model.joint_names
    read, rate = generic(2, 3, 1), generic(3, 3, 1)
    position, rates = moved.positions(read), moved.rates(rate)
    lags = joint_lags(names, [0.0, 0.02], moved)
    assert lags.causes == ('lag:j2',)
    places, _ = lags.deflections(position, rates, rates)
    assert (places @ lags.factor)[..., 0] == pytest.approx(0.02 * rates)
    gears = geared_joints(names, [0.0, SIZE], [0.0, SIZE], moved)
    numbers = gears.factor @ [1.0, -0.5, 0.3]
    places, faster = gears.deflections(position, rates, rates)
    off = numbers[3] * np.sin(read) + numbers[4] * np.cos(read) + numbers[5] * read
    assert places @ numbers == pytest.approx(off * [GAIN, 1.0])
    knots = np.zeros((3, 0))
    here = Midpoints(position, rates, *(knots,) * 6)
    then = with_gears(here, numbers.reshape(-1, 3), moved)
    assert then.joint_position == pytest.approx(moved.positions(read + off))
    assert then.joint_velocity == pytest.approx(rates + faster @ numbers)


LATE = 0.03  # s


@pytest.mark.parametrize('taken', [0.0, 0.8])
def test_a_joint_that_is_read_late_is_explained_by_its_lag(
    servicer7: MomentumKernel, tumbling: Truth, start: Array, taken: float
) -> None:
    """Also where windows are linearised at a part of the lag."""
    joints = servicer7.model.joints
    late = np.arange(joints) == JOINT
    then = np.interp(tumbling.time - LATE, tumbling.time, tumbling.joint_position[:, JOINT])
    read = np.where(late, then[:, None], tumbling.joint_position)
    window = window_of(observe(replace(tumbling, joint_position=read), MID), SPACING)
    unknown = joint_lags(servicer7.model.joint_names, [1e-2] * joints)
    layout = Layout.from_unknowns(servicer7, (unknown,))
    found = []
    for each in (np.zeros(joints), LATE * late):
        here = layout.point(state(servicer7, start, taken * LATE / 1e-2 * late))
        x = state(servicer7, start, each / 1e-2)
        model = window_model(layout, window, here)
        x[:6] = np.linalg.solve(model.pose.rows[:, :6], residuals(model, x)[0])
        found.append(np.abs(residuals(model, x)[1]).max())
    assert found[1] < 0.1 * found[0]


def test_the_lag_of_one_joint_and_those_of_all_are_causes_with_repairs(servicer7: MomentumKernel) -> None:
    names, sizes = servicer7.model.joint_names, np.array([0.02] * servicer7.model.joints)
    unknown = joint_lags(names, sizes.tolist())
    assert deviation_text('lag:joint2', np.array([0.06])).startswith('joint2 is read +60 ms late')
    assert f'{names[1]} +20 ms' in deviation_text('lag', sizes, names)
    one = unknown.repair('lag:joint2', np.array([0.06]), np.array([0.001]), servicer7)
    assert one.parameters == {'known_joints.joint2.lag_std': 0.1}
    assert unknown.repair('lag', sizes, 0.1 * sizes, servicer7).parameters == {'known_joints.lag_std': 0.05}
    assert unknown.part('lag:joint2').count == 1
    assert unknown.part('lag').count == unknown.count == unknown.without(['lag:joint2']).count + 1


def test_a_gear_and_a_scale_are_a_cause_with_a_repair(servicer7: MomentumKernel) -> None:
    names = servicer7.model.joint_names
    unknown = geared_joints(names, [0.0, 0.01, *(0.0,) * (len(names) - 2)], [0.02] * len(names))
    assert unknown.count == len(names) + 2  # 0 is exact
    value = np.array([0.03, -0.01, 0.004])
    assert deviation_text('geared:joint2', value).startswith('joint2 is flexible or geared: it deviates')
    repair = unknown.repair('geared:joint2', value, 0.01 * value, servicer7)
    assert '32 mrad (mm) once a turn and +0.4' in repair.cause
    assert repair.parameters == {'known_joints.joint2.turn_std': 0.05, 'known_joints.joint2.scale_std': 0.01}


WANDER, TIME = 1e-3, 2.0  # rad, s: the time constant is that of tracking errors that are declared
LONG = 25.0


def wandering(rng: np.random.Generator, time: Array, joints: int, size: float = WANDER) -> Array:
    """Return a Gauss-Markov process for each joint at even times, (N, n)."""
    kept = np.exp(-(time[1] - time[0]) / TIME)
    error = np.zeros((len(time), joints))
    error[0] = rng.normal(size=joints)
    for index in range(1, len(time)):
        error[index] = kept * error[index - 1] + np.sqrt(1.0 - kept**2) * rng.normal(size=joints)
    return size * error


def commanded(tumbling: Truth, seed: int, size: float = WANDER) -> Truth:
    """Return a motion with joint states that hold the commands, which the joints have followed with errors."""
    error = wandering(np.random.default_rng([seed, 7]), tumbling.time, tumbling.joint_position.shape[1], size)
    reported = tumbling.joint_position - error
    return replace(tumbling, joint_position=reported, joint_velocity=np.gradient(reported, tumbling.time, axis=0))


def last(robot: MomentumKernel, tumbling: Truth, seed: int, tracking_std: float) -> Estimate:
    declared = exact_but(robot, known_joints__tracking_std=tracking_std)
    return make(robot, MID, declared=declared).update(windows(observe(commanded(tumbling, seed), MID, seed)), 0)[-1]


def test_the_momentum_changes_as_by_the_zeros(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> None:
    unknown = joint_tracking(servicer7.model.joint_names, [WANDER, 0.0, *[WANDER] * 5], [TIME] * 7)
    assert unknown.count == 6
    assert set(unknown.causes) == {f'tracking:{name}' for name in servicer7.model.joint_names if name != 'joint2'}
    states = servicer7.states(observe(float_freely(servicer7, joints, start, 0.1), MID))
    zeros = joint_placements(servicer7, [WANDER] * 7, [0.0] * 7, [0.0] * 7).momentum_columns(servicer7, states)
    assert np.allclose(unknown.momentum_columns(servicer7, states), zeros[..., ::6], rtol=1e-12, atol=0.0)


def test_what_wanders_takes_the_pose_along() -> None:
    """The covariance after a step is that of the linear map that it is."""
    rng = np.random.default_rng(3)
    size, poses, places = 9, 3, np.array([5, 7])
    triangle = np.triu(rng.normal(size=(size, size)) + 3.0 * np.eye(size))
    root = np.asfortranarray(np.column_stack((triangle, np.zeros((size, 2)))))
    root[:, -1] = rng.normal(size=size)
    stepped, kept, gained = rng.normal(size=(poses, 2)), np.array([0.8, 0.0]), np.array([0.3, 0.0])
    mapped, noise = np.eye(size), np.zeros((size, 2))
    mapped[places, places] = kept
    mapped[np.ix_(np.arange(poses), places)] = stepped * (kept - 1.0)
    deviation = np.sqrt(1.0 - kept**2 + gained)
    noise[places] = np.diag(deviation)
    noise[:poses] = stepped * deviation
    back = np.linalg.inv(root[:, :-2])
    after = _gauss_markov_step(root, places, kept, stepped, gained)
    factor = np.linalg.inv(after[:, :-2])
    assert factor @ factor.T == pytest.approx(mapped @ back @ back.T @ mapped.T + noise @ noise.T)
    assert factor @ after[:, -1] == pytest.approx(mapped @ back @ root[:, -1])


def test_what_is_left_of_a_run_that_a_force_acted_in() -> None:
    """The force, whose numbers come last, is another one then: nothing is known of it, and of the rest what was."""
    rng, size = np.random.default_rng(5), BODY.stop
    scale = np.eye(size)
    space = Variables(scale, np.ones(size), np.eye(6), np.eye(6), np.zeros(size), scale, np.zeros((0, 0)), np.ones(6))
    root = np.triu(rng.normal(size=(size + 3, size + 3)) + 5.0 * np.eye(size + 3))
    both = np.column_stack((root, np.zeros(size + 3), rng.normal(size=size + 3)))
    left = some(space.for_new_target(both, np.ones(size), exchanged=False).previous_information)
    factor, before = np.linalg.inv(left[:, :-1]), np.linalg.inv(root)
    assert factor @ factor.T == pytest.approx((before @ before.T)[:size, :size])
    assert factor @ left[:, -1] == pytest.approx((before @ both[:, -1])[:size])
    continued = replace(space, previous_bias=np.ones((10, 11)))
    for exchanged in (False, True):  # noise in the rows of another body says nothing of this one
        following = continued.for_new_target(both, np.ones(size), exchanged=exchanged)
        assert following.bias.any() is np.bool_(not exchanged)


@pytest.mark.long
def test_a_servicer_whose_commands_are_logged(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> None:
    tumbling = float_freely(servicer7, joints, start, LONG)
    misfits, silent = [], []
    for seed in range(2):
        followed = last(servicer7, tumbling, seed, WANDER)
        assert followed.status in {'estimating', 'converged'}
        assert 0.6 < followed.residual < 1.3
        misfits.append(normalised(followed, servicer7))
        silent.append(last(servicer7, tumbling, seed, 0.0))
    assert max(misfits) < chi2.isf(1e-3, 10)
    # Ignored, it shows.
    assert all(each.status in {'inconsistent', 'not_identifiable'} for each in silent)
