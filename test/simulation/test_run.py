"""The simulated run: conservation, dynamics, integrator, sampling; and joints that follow trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.simulator_parameters import MotionConfig, SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.urdf import Limit
from mbaid_ros.errors import DataError, ModelError, ParameterError
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.parameters import build
from mbaid_ros.simulated_robot import make_initial_state, make_motion, make_simulation
from mbaid_ros.simulated_run import SimulatedRun
from mbaid_ros.simulation.dynamics import Dynamics, State
from mbaid_ros.simulation.motion import Passive, Sinusoids, random_sinusoids, sinusoids, within_limits
from mbaid_ros.simulation.simulation import Simulation, total_momentum
from mbaid_ros.simulation.steered import SteeredMotion, motion_along
from random_robots import random_urdf
from simulated import CONFIG, relative_drift, robot, state, table1


def moving_arm(name: str, linear: float = 0.0) -> tuple[Simulation, Sinusoids]:
    model = robot(name)
    motion = random_sinusoids(np.full(model.joints, 0.3), 3, 2, 0.5, 10.0, 40.0)
    start = state(motion.start, motion.reference(0.0)[1], (0.02, -0.05, 0.03), linear)
    return Simulation(model, motion, start), motion


def test_the_base_velocity_without_linear_momentum() -> None:
    model, start = table1()
    assert start.velocity[:3] == pytest.approx([0.0624, -0.0729, 0.0], abs=5e-5)
    total = total_momentum(model, Simulation(model, Passive(), start).advance(np.zeros(1)))[0]
    assert total == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 4597.634], abs=5e-4)


@pytest.mark.parametrize('name', ['ets7', pytest.param('servicer7', marks=pytest.mark.long)])
def test_a_moving_arm_conserves_momentum_and_follows_its_trajectory(name: str) -> None:
    run, motion = moving_arm(name, linear=0.1)
    truth = run.advance(np.linspace(0.0, 60.0, 997))
    assert relative_drift(total_momentum(run.model, truth)) < 1e-9
    reference = [motion.reference(time) for time in truth.time]
    assert truth.joint_position == pytest.approx(np.array([position for position, _, _ in reference]), abs=1e-10)
    assert truth.joint_velocity == pytest.approx(np.array([velocity for _, velocity, _ in reference]), abs=1e-10)
    assert np.abs(truth.joint_effort).max() > 0.01


def test_sinusoids_are_read_joint_by_joint() -> None:
    motion = sinusoids(
        np.array([1.0, 2.0]), np.array([0.1, 0.2, 0.3, 0.4]), np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(0)
    )
    position, velocity, _ = motion.reference(0.25)
    assert position == pytest.approx([1.0 + 0.1, 2.0 - 0.3])
    # The cosines of the four terms: 0, -1 and 0, 1.
    assert velocity == pytest.approx([-0.2 * 2.0 * np.pi * 2.0, 0.4 * 2.0 * np.pi * 4.0])


SEEDS = range(6)


def random_state(rng: np.random.Generator, joints: int) -> State:
    quaternion = rng.normal(size=4)
    return State(
        rng.normal(size=3),
        quaternion / np.linalg.norm(quaternion),
        rng.normal(size=joints),
        rng.normal(size=6 + joints),
    )


def free(count: int) -> Array:
    return np.zeros(count)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_torque_gives_the_acceleration_it_is_asked_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dynamics = Dynamics(load_model(random_urdf(rng)))
    joints = dynamics.model.joints
    moving, wanted = random_state(rng, joints), rng.normal(size=joints)
    assert dynamics.acceleration(moving, dynamics.torque(moving, wanted))[6:] == pytest.approx(wanted, abs=1e-10)


@pytest.mark.parametrize('seed', SEEDS)
def test_joint_torques_do_not_change_the_momentum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng))
    torque = rng.normal(size=model.joints)

    class Push(Passive):
        def command(self, time: float, position: Array, velocity: Array) -> Array:  # type: ignore[override]
            push: Array = torque * np.sin(time) - 0.1 * velocity - 0.1 * position
            return push

    run = Simulation(model, Push(), random_state(rng, model.joints))
    assert relative_drift(total_momentum(model, run.advance(np.linspace(0.0, 3.0, 31)))) < 1e-9


def test_the_integrator_agrees_with_another_one() -> None:
    model, start = table1()
    dynamics = Dynamics(model)

    def rates(_time: float, values: Array) -> Array:
        now = State.from_array(values)
        turn = Rotation.from_quat(now.base_orientation)
        x, y, z = now.velocity[3:6]
        of_quaternion = np.array([[0, z, -y, x], [-z, 0, x, y], [y, -x, 0, z], [-x, -y, -z, 0]])
        accelerations = dynamics.acceleration(now, free(4))
        return np.concatenate(
            (turn.apply(now.velocity[:3]), 0.5 * of_quaternion @ values[3:7], now.velocity[6:], accelerations)
        )

    end = solve_ivp(rates, (0.0, 8.0), start.array, 'Radau', rtol=1e-9, atol=1e-10).y[:, -1]
    found = Simulation(model, Passive(), start).advance(np.array([8.0]))
    assert found.base_position[0] == pytest.approx(end[:3], abs=1e-7)
    assert found.base_orientation[0] == pytest.approx(end[3:7], abs=1e-7)
    assert found.joint_position[0] == pytest.approx(end[7:11], abs=1e-7)


def test_a_single_body_tumbles_as_euler_says() -> None:
    urdf = (
        '<robot name="body"><link name="base_link"><inertial><mass value="10"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial></link></robot>'
    )
    dynamics = Dynamics(load_model(urdf))
    angular, moments = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 2.5])
    turning = dynamics.acceleration(state(np.zeros(0), np.zeros(0), tuple(angular)), free(0))
    assert turning[3:] == pytest.approx(-np.cross(angular, moments * angular) / moments, abs=1e-15)


TAIL = '<joint name="tail" type="continuous"><parent link="base_link"/><child link="leaf"/><axis xyz="0 0 1"/></joint>'
BODY = '<inertial><mass value="{}"/><inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial>'


def robot_with_leaf(leaf: str, base: str = BODY.format(10, 1, 1, 1)) -> str:
    return f'<robot name="r"><link name="base_link">{base}</link><link name="leaf">{leaf}</link>{TAIL}</robot>'


@pytest.mark.parametrize('base', ['', BODY.format(10, 0, 0, 0)])
def test_a_singular_mass_matrix_is_refused(base: str) -> None:
    with pytest.raises(ModelError, match=r'singular|inertia'):
        Dynamics(load_model(robot_with_leaf(BODY.format(1e-12, 0, 0, 1), base)))


def test_a_motion_that_diverges_is_refused() -> None:
    model, start = table1()
    wild = State(start.base_position, start.base_orientation, start.joint_position, 1e200 * np.ones(10))
    with pytest.raises(ModelError, match='not finite'):
        Simulation(model, Passive(), wild).advance(np.array([1.0]))


NOTHING = np.zeros((0, 0))
SERVICER = robot('servicer7')
TIMES = np.array([0.0, 2.0])


def to(goal: float, begin: float = 0.0, time: float = 0.0) -> JointTrajectory:
    position, rest = np.array([[begin], [goal]]), np.zeros((2, 1))
    return JointTrajectory(('joint3',), TIMES + time, position, rest, rest)


def test_a_trajectory_takes_over_from_where_the_joints_are_and_as_they_move() -> None:
    first = random_sinusoids(np.zeros(7), 0, 2, 0.01, 5.0, 9.0)
    motion = SteeredMotion(first)
    for order in range(3):
        assert motion.reference(0.7)[order] == pytest.approx(first.reference(0.7)[order])
    motion.add_trajectory(to(0.2), SERVICER, 1.0)
    assert motion.reference(1.0)[0] == pytest.approx(first.reference(1.0)[0])
    assert motion.reference(1.0)[1][2] == pytest.approx(first.reference(1.0)[1][2])
    assert motion.reference(0.99)[0] == pytest.approx(first.reference(0.99)[0])
    end = motion.reference(3.5)
    assert end[0][2] == pytest.approx(0.2)
    assert np.delete(end[0], 2) == pytest.approx(np.delete(first.reference(1.0)[0], 2))
    assert not end[1].any()
    later = motion.from_time(0.5)
    assert later.reference(3.0)[0] == pytest.approx(end[0])
    later.add_trajectory(to(0.1, 0.2), SERVICER, 4.0)
    assert motion.reference(9.0)[0][2] == pytest.approx(0.1)


def test_a_first_point_that_is_still_to_come_is_gone_to() -> None:
    motion = motion_along(to(0.5, 0.4, time=1.0), SERVICER, np.zeros(7), 0.0)
    assert motion.reference(0.0)[0][2] == 0.0
    assert motion.reference(1.0)[0][2] == pytest.approx(0.4)


def test_a_trajectory_of_other_joints_or_another_place_is_refused() -> None:
    other = JointTrajectory(('elbow',), np.zeros(1), np.zeros((1, 1)), NOTHING, NOTHING)
    with pytest.raises(DataError, match="moves 'elbow'; accepted: joints among joint1, joint2"):
        motion_along(other, SERVICER, None, 0.0)
    with pytest.raises(DataError, match=r"begins with 'joint3' at 0.3, which is at 0; accepted: within 0.05 of it"):
        motion_along(to(0.5, 0.3), SERVICER, np.zeros(7), 0.0)


def test_a_run_takes_a_motion_on_the_way() -> None:
    path = str(CONFIG / 'servicer7.urdf')
    config = SimulatorConfig(
        robot_description_file=path, joint_rate=10.0, odometry_rate=10.0, motion=MotionConfig(kind='random')
    )
    run = SimulatedRun(config, SERVICER.urdf, BAG_TYPES)
    before = [timed.message for timed in run.read(1.0) if timed.topic == 'joint_states']
    place = float(before[-1].position[2])
    begin = run.add_trajectory(to(place + 0.1, place))
    assert begin == pytest.approx(1.1)
    after = [timed.message for timed in run.read(4.0) if timed.topic == 'joint_states']
    assert after[-1].position[2] == pytest.approx(place + 0.1, abs=2e-3)
    assert np.abs(after[-1].velocity).max() < 0.02


TIME = np.linspace(0.0, 400.0, 20_001)
GRIPPER = """<robot name="gripper">
  <link name="base"><inertial><mass value="20"/>{0}</inertial></link>
  <link name="left"><inertial><mass value="1"/>{0}</inertial></link>
  <link name="right"><inertial><mass value="1"/>{0}</inertial></link>
  <joint name="jaw" type="prismatic"><parent link="base"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" effort="10" velocity="0.2"/></joint>
  <joint name="other_jaw" type="prismatic"><parent link="base"/><child link="right"/><axis xyz="0 1 0"/>
    <limit lower="-0.06" upper="0" effort="10" velocity="0.005"/><mimic joint="jaw" multiplier="-2"/></joint>
</robot>""".format('<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>')


def course(motion: Sinusoids) -> tuple[Array, Array]:
    """Return positions and rates at TIME, (N, n)."""
    references = [motion.reference(float(time)) for time in TIME]
    return np.array([each[0] for each in references]), np.array([each[1] for each in references])


def limited(model: RobotModel, lower: float, upper: float, velocity: float) -> RobotModel:
    return replace(model, limits=(Limit(lower, upper, velocity),) * model.joints)


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('limits', [(-3.1, 3.1, 0.1), (-0.2, 0.3, np.inf), (0.5, 0.6, 1.0), (-0.04, 0.0, 0.001)])
def test_every_joint_stays_within_its_limits(limits: tuple[float, float, float], seed: int) -> None:
    model = limited(robot('servicer7'), *limits)
    drawn = random_sinusoids(np.zeros(model.joints), seed, 2, 0.5, 10.0, 40.0)
    motion = within_limits(drawn, model, start_given=False)
    position, velocity = course(motion)
    assert position.min() >= limits[0]
    assert position.max() <= limits[1]
    assert np.abs(velocity).max() <= limits[2]
    # A motion that is smaller than the one drawn makes use of them.
    used = np.maximum(np.ptp(position, axis=0) / (limits[1] - limits[0]), np.abs(velocity).max(axis=0) / limits[2])
    assert np.all((used > 0.6) | np.all(motion.amplitude == drawn.amplitude, axis=1))


def test_a_start_beyond_the_limits_is_refused() -> None:
    model = limited(robot('servicer7'), -0.1, 0.2, np.inf)
    with pytest.raises(ParameterError, match=r"has 0\.3 for 'joint1'; accepted: its limits, -0\.1 to 0\.2"):
        within_limits(random_sinusoids(np.full(7, 0.3), 2, 2, 0.5, 10.0, 40.0), model, start_given=True)


def test_fingers_move_together_and_no_further_than_either_may() -> None:
    model = load_model(GRIPPER)
    config = build(SimulatorConfig, {'motion.kind': 'random', 'motion.seed': 3})
    motion = make_motion(config, model)
    assert isinstance(motion, Sinusoids)
    position, velocity = course(motion)
    assert position[:, 1] == pytest.approx(-2.0 * position[:, 0], abs=1e-12)
    assert position[:, 0].min() >= 0.0
    assert position[:, 0].max() <= 0.03  # where the other one is at its end
    assert np.abs(velocity[:, 1]).max() <= 0.005
    assert np.array_equal(make_initial_state(config, model, motion).joint_position, motion.start)
    truth = make_simulation(config, model).advance(np.arange(0.0, 20.0, 0.5))
    assert truth.joint_position[:, 1] == pytest.approx(-2.0 * truth.joint_position[:, 0], abs=1e-9)
    assert truth.joint_position.min(axis=0)[0] >= 0.0


def test_joints_that_follow_others_move_at_random_by_default() -> None:
    model = load_model(GRIPPER)
    assert isinstance(make_motion(SimulatorConfig(), model), Sinusoids)
