"""The loop on a live ROS 2 graph: identify, plan the next motion, move, identify, until everything is known to 1 %.

usage: demo_plan.py [--speed R] [--output FOLDER]    (`make demo-plan` runs it with everything set up)

Simulator and estimator run as processes of their own. Joints go at 1 deg/s, the base may be turned by 2 deg. In the end
it is told how long random sinusoids within the same limits would take from where the first motion ends. Exit code:
0 if every standard deviation comes below 1 % and every error is within four of them, else 1.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from benchmarks.random_sinusoids import LENGTHS, SINUSOIDS, best_of_sinusoids
from demo_graph import CONFIG, ROOT, Processes, Spectator, running  # it chooses the graph, before rclpy begins
from make_bags import MID_NOISE
from mbaid_ros.cli import ArgumentParser, number, one_line, run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.config.trajectory import as_yaml
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joint_trajectory import JointTrajectory as Trajectory
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.messages import trajectory_of
from mbaid_ros.nodes.subscriptions import qos
from mbaid_ros.planning.limits import joint_limits
from mbaid_ros.planning.search import Wanted
from mbaid_ros.planning.splines import Splines
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.session import Session
from mbaid_ros.session.planning import make_planner, plan_settings
from mbaid_ros.simulated_run import SimulatedRun

WANTED = 0.01
SPEED = float(np.radians(1.0))  # rad/s
PLAN = {'joint_velocity': SPEED, 'base_rotation': float(np.radians(2.0)), 'relative_std': f'[{WANTED}]'}
START = np.array([0.4, 0.7, -0.3, 0.9, 0.5, -0.6, 0.2])  # rad
FIRST = 8.0  # s, of the motion that nobody has planned
ROUNDS = 5  # of planning, at most
PATIENCE = 180.0  # s, for a plan
NEAR = 1e-3  # rad, from the end of a motion
MOST = 4.0  # standard deviations that an error may have
ROBOT = CONFIG / 'servicer7.urdf'


def first_motion() -> Trajectory:
    """Return a drawn motion of all joints at the speed that is allowed."""
    model = load_model(read_robot_description(ROBOT))
    splines = Splines(4, FIRST)
    drawn = np.random.default_rng(1).standard_normal((4, model.joints))
    limits = joint_limits(model, START, SPEED, 0.1, ())
    return splines.trajectory(splines.filling(drawn, START, limits), START, model.joint_names)


def values(inertia: Any) -> Array:
    """Return the ten numbers of a geometry_msgs/Inertia."""
    com = (inertia.com.x, inertia.com.y, inertia.com.z)
    return np.array([inertia.m, *com, *(getattr(inertia, name) for name in PARAMETERS[4:])])


def relative(estimate: Any) -> Array:
    """Return the ten standard deviations relative to the sizes that `convergence` has; NaN where there are none."""
    found = values(estimate.inertia)
    moments = np.abs(found[[4, 4, 4, 7, 7, 9]] * found[[4, 7, 9, 7, 9, 9]])
    sizes = np.concatenate((found[:1], np.ones(3), np.sqrt(moments)))
    return np.asarray(np.array(estimate.standard_deviation) / sizes)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


class Loop(Spectator):
    """The demo's node: it sees estimates and motions, asks for plans, and passes motions on."""

    def __init__(self, processes: Processes) -> None:
        super().__init__(processes)
        self.motions: list[JointTrajectory] = []
        latched = qos(10, latched=True)
        self._node.create_subscription(JointTrajectory, '/estimator/motion', self.motions.append, latched)
        self.states: list[JointState] = []
        self._node.create_subscription(JointState, '/joint_states', self.states.append, qos(1000))
        self._robot = self._node.create_publisher(JointTrajectory, '/joint_trajectory', qos(1))
        self._plan = self._node.create_client(Trigger, '/estimator/plan')

    @property
    def time(self) -> float:
        """Of the latest estimate, s since the first sample."""
        if not self.estimates:
            return 0.0
        span = self.estimates[-1].span
        return float(span.sec + 1e-9 * span.nanosec)

    def planned(self) -> Trajectory:
        """Return the motion that the estimator plans now."""
        self.wait(self._plan.service_is_ready, 'the service ~/plan')
        self.motions.clear()
        answer = self._plan.call_async(Trigger.Request())
        self.wait(answer.done, 'an answer of ~/plan')
        response = answer.result()  # type: ignore[no-untyped-call]
        if not response.success:
            raise DataError(response.message)
        self.wait(lambda: self.motions, 'a motion on ~/motion', PATIENCE)
        return trajectory_of(self.motions[-1])

    def move(self, motion: Trajectory) -> None:
        """Let the simulated robot follow the latest motion, and wait for an estimate that has seen its end."""
        self.wait(lambda: self._robot.get_subscription_count() > 0, 'the simulator')
        self._robot.publish(self.motions[-1])
        end = motion.position[-1]
        self.wait(lambda: self._away(end) < NEAR, 'the end of the motion', PATIENCE)
        stamp = _seconds(self.states[-1].header.stamp)
        self.wait(lambda: _seconds(self.estimates[-1].header.stamp) > stamp, 'an estimate after it', PATIENCE)

    def _away(self, end: Array) -> float:
        """Return how far a joint is at most from an end (n,), rad."""
        return float(np.abs(np.array(self.states[-1].position) - end).max()) if self.states else np.inf


def simulated(folder: Path) -> dict[str, object]:
    """Return the parameters of the simulated robot's first motion and sensors."""
    motion = {'motion.kind': 'trajectory', 'motion.trajectory_file': str(folder / 'first.yaml')}
    return {**motion, **{f'noise.{channel}': value for channel, value in MID_NOISE.items()}}


def time_of_sinusoids(folder: Path) -> float:
    """Return the shortest time, s, that one of the random sinusoids takes from the end of the first motion.

    Simulator and estimator are the same, without a graph. Infinite where none of them reaches what is wanted.
    """
    urdf = read_robot_description(ROBOT)
    robot = SimulatedRun(build(SimulatorConfig, simulated(folder)), urdf, BAG_TYPES)
    values = load_parameter_file(CONFIG / 'servicer7_estimator.yaml', 'estimator')
    plan = {f'plan.{name}': value for name, value in PLAN.items()} | {'plan.relative_std': [WANTED]}
    session = Session(build(EstimatorConfig, values | plan | {'robot_description_file': ''}), urdf)
    take = {'joint_states': session.add_joint_state, 'odom': session.add_odometry}
    for timed in robot.read(FIRST + 0.5):
        take[timed.topic](timed.message)
    session.process()
    known = session.posterior()
    if known is None:
        raise DataError('there is no solution after the first motion')
    planner = make_planner(session.config, known)
    settings = plan_settings(session.config)
    wanted = Wanted(settings.relative, planner.information.asked)
    return best_of_sinusoids(planner.motions, wanted, settings.base, np.random.default_rng(0))


def loop(processes: Processes, folder: Path, speed: float) -> tuple[Any, Any, float]:
    """Identify, plan, move, and return the last estimate, the truth, and how long planned motions took, s."""
    (folder / 'first.yaml').write_text(as_yaml(first_motion()), encoding='utf-8')
    plan = [word for name, value in PLAN.items() for word in ('-p', f'plan.{name}:={value}')]
    processes.start('estimator', '--ros-args', '--params-file', CONFIG / 'servicer7_estimator.yaml', *plan)
    spectator = Loop(processes)
    given = {'robot_description_file': ROBOT, 'real_time_factor': speed, 'wait_for_subscribers': 1, **simulated(folder)}
    words = [word for name, value in given.items() for word in ('-p', f'{name}:={value}')]
    processes.start('simulator', '--ros-args', *words)
    spectator.wait(lambda: spectator.time >= FIRST + 0.5, 'an estimate after the first motion', PATIENCE)
    moved = FIRST
    print(f'{"after":>8}  {"moved for":>9}  {"mass":>22}  {"least known":>18}')
    for _ in range(ROUNDS):
        latest = spectator.estimates[-1]
        _tell(spectator.time, moved, latest)
        if np.all(relative(latest) < WANTED):
            break
        motion = spectator.planned()
        _tell_plan(motion)
        spectator.move(motion)
        moved += motion.duration
    return spectator.estimates[-1], spectator.truths[-1].inertia, moved - FIRST


def _tell(seconds: float, moved: float, estimate: Any) -> None:
    sizes = relative(estimate)
    worst = int(np.nanargmax(sizes)) if np.any(np.isfinite(sizes)) else 0
    mass = f'{estimate.inertia.m:.3f} +- {1.96 * estimate.standard_deviation[0]:.3f} kg'
    least = f'{PARAMETERS[worst]} to {100.0 * sizes[worst]:.3g} %'
    print(f'{seconds:6.1f} s  {moved:7.1f} s  {mass:>22}  {least:>18}', flush=True)


def _tell_plan(motion: Trajectory) -> None:
    reach = np.degrees(np.ptp(motion.position, axis=0))
    most = ', '.join(f'{motion.joints[place]} {reach[place]:.0f} deg' for place in np.argsort(-reach)[:3])
    print(f'{"":10}planned: {motion.duration:.1f} s, most of it {most}', flush=True)


def judge(estimate: Any, truth: Any) -> str:
    """Return what is wrong with the last estimate; empty for nothing."""
    sizes = relative(estimate)
    if not np.all(sizes < WANTED):
        return f'{PARAMETERS[int(np.argmax(np.nan_to_num(sizes, nan=np.inf)))]} is not known to {100.0 * WANTED:g} %'
    error = np.abs(values(estimate.inertia) - values(truth)) / np.array(estimate.standard_deviation)
    worst = int(np.argmax(error))
    return f'{PARAMETERS[worst]} is off by {error[worst]:.1f} standard deviations' if error[worst] > MOST else ''


def main(argv: list[str]) -> int:
    """Run the demo and return the exit code."""
    parser = ArgumentParser(
        'demo_plan.py', (__doc__ or '').split('\n', maxsplit=1)[0], 'scripts/demo_plan.py --speed 1'
    )
    parser.add_argument('--speed', type=number(0.0, exclusive=True), default=2.0, metavar='R')
    parser.add_argument('--output', type=Path, default=ROOT / 'demo_output', metavar='FOLDER')
    arguments = parser.parse(argv)
    begin = time.monotonic()
    arguments.output.mkdir(parents=True, exist_ok=True)
    print(
        'A servicer with seven joints holds 155 kg of debris; joints go at 1 deg/s, the base may be turned by 2 deg.\n'
        f'Simulator and estimator run as ROS 2 nodes, {arguments.speed:g} times as fast as real time.\n'
    )
    try:
        with running(arguments.output) as processes:
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            estimate, truth, moved = loop(processes, arguments.output, arguments.speed)
            processes.stop('simulator')
            processes.stop('estimator')
            try_shutdown()
        wrong = judge(estimate, truth)
    except DataError as error:
        wrong = str(error)
    if wrong:
        print(f'demo failed: {one_line(wrong)}', file=sys.stderr)
        return 1
    print(f'\nEvery parameter is known to {100.0 * WANTED:g} % ({time.monotonic() - begin:.0f} s in all).')
    best = time_of_sinusoids(arguments.output)
    one = f'the best of {SINUSOIDS} would take {best:.0f} s'
    none = f'none of {SINUSOIDS} would do so in {LENGTHS[-1]:g} s'
    told = one if np.isfinite(best) else none
    print(f'Planned motions took {moved:.0f} s; of random sinusoids within the same limits {told}.')
    return 0


if __name__ == '__main__':
    sys.exit(run(main, name='demo_plan'))
