"""The loop on a live ROS 2 graph: identify, plan the next motion, move, identify, until everything is known to 1 %.

`make demo-plan` runs it with everything set up. Simulator and estimator run as processes of their own. Joints move at
1 deg/s, the base may turn by 2 deg. Exit code 0: every standard deviation comes below 1 % and every error is within
four of them, else 1.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from benchmarks.data import LEVELS, model
from benchmarks.frame import declared
from demo import seconds
from demo_graph import CONFIG, ROOT, Demo, Graph, assigned, running
from mbaid_ros.cli import ArgumentParser, number, one_line, run
from mbaid_ros.config.trajectory import as_yaml
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joint_trajectory import JointTrajectory as Trajectory
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.messages import stamp_of, trajectory_of
from mbaid_ros.nodes.subscriptions import qos
from mbaid_ros.planning.goal import joint_limits
from mbaid_ros.planning.splines import Splines

WANTED = 0.01
SPEED = float(np.radians(1.0))  # rad/s
PLAN: dict[str, object] = {
    'plan.joint_velocity': SPEED,
    'plan.base_rotation': float(np.radians(2.0)),
    'plan.relative_std': [WANTED],
}
START = np.array([0.4, 0.7, -0.3, 0.9, 0.5, -0.6, 0.2])  # rad
FIRST = 8.0  # s, of the motion before the first plan
ROUNDS = 5  # of planning, at most
PATIENCE = 180.0  # s, for a plan
NEAR = 1e-3  # rad, from the end of a motion
MOST = 4.0  # standard deviations, of an error
ROBOT = 'servicer7'


def first_motion() -> Trajectory:
    """Return a drawn motion of all joints within the limit of their speed."""
    splines = Splines(4, FIRST)
    drawn = np.random.default_rng(1).standard_normal((4, model(ROBOT).joints))
    limits = joint_limits(model(ROBOT), START, SPEED, 0.1, ())
    return splines.trajectory(splines.filling(drawn, START, limits), START, model(ROBOT).joint_names)


def values(inertia: Any) -> Array:
    """Return the ten numbers of a geometry_msgs/Inertia."""
    com = (inertia.com.x, inertia.com.y, inertia.com.z)
    return np.array([inertia.m, *com, *(getattr(inertia, name) for name in PARAMETERS[4:])])


def relative(estimate: Any) -> Array:
    """Return the ten standard deviations relative to the sizes of `convergence`; NaN where there are none."""
    found = values(estimate.inertia)
    moments = np.abs(found[[4, 4, 4, 7, 7, 9]] * found[[4, 7, 9, 7, 9, 9]])
    sizes = np.concatenate((found[:1], np.ones(3), np.sqrt(moments)))
    return np.asarray(np.array(estimate.standard_deviation) / sizes)


class Loop(Demo):
    """The demo's node: it requests plans, and passes their motions on."""

    def __init__(self, made: Graph) -> None:
        super().__init__(made)
        self.motions: list[JointTrajectory] = made.collect('/estimator/motion', JointTrajectory)
        self.states: list[JointState] = made.collect('/joint_states', JointState, qos(1000))
        self._robot = made.node.create_publisher(JointTrajectory, '/joint_trajectory', qos(1))

    @property
    def time(self) -> float:
        """Of the latest estimate, s since the first sample."""
        return seconds(self.estimates[-1]) if self.estimates else 0.0

    def planned(self) -> Trajectory:
        """Return the motion that the estimator plans now."""
        self.motions.clear()
        response = self.graph.call('/estimator/plan', Trigger, Trigger.Request())
        if not response.success:
            raise DataError(response.message)
        self.wait(lambda: self.motions, 'a motion on ~/motion', PATIENCE)
        return trajectory_of(self.motions[-1])

    def move(self, motion: Trajectory) -> None:
        """Let the simulated robot follow the latest motion, and wait for an estimate after its end."""
        self.wait(lambda: self._robot.get_subscription_count() > 0, 'the simulator')
        self._robot.publish(self.motions[-1])
        self.wait(lambda: self._away(motion.position[-1]) < NEAR, 'the end of the motion', PATIENCE)
        stamp = stamp_of(self.states[-1])
        self.wait(lambda: stamp_of(self.estimates[-1]) > stamp, 'an estimate after it', PATIENCE)

    def _away(self, end: Array) -> float:
        """Return the largest distance of a joint from an end (n,), rad."""
        return float(np.abs(np.array(self.states[-1].position) - end).max()) if self.states else np.inf


def simulated(folder: Path) -> dict[str, object]:
    """Return the parameters of the simulated robot's first motion and sensors."""
    motion = {'motion.kind': 'trajectory', 'motion.trajectory_file': str(folder / 'first.yaml')}
    return {**motion, **{name: value for name, value in declared(LEVELS['mid']).items() if value}}


def loop(demo: Loop, folder: Path, speed: float) -> tuple[Any, Any, float]:
    """Identify, plan, move, and return the last estimate, the truth, and the time of planned motions, s."""
    (folder / 'first.yaml').write_text(as_yaml(first_motion()), encoding='utf-8')
    nodes = [demo.start('estimator', '--params-file', CONFIG / f'{ROBOT}_estimator.yaml', *assigned(PLAN))]
    file = CONFIG / f'{ROBOT}.urdf'
    given = {'robot_description_file': file, 'real_time_factor': speed, 'wait_for_subscribers': 1, **simulated(folder)}
    nodes.append(demo.start('simulator', *assigned(given)))
    demo.wait(lambda: demo.time >= FIRST + 0.5, 'an estimate after the first motion', PATIENCE)
    moved = FIRST
    print(f'{"after":>8}  {"moved for":>9}  {"mass":>22}  {"least known":>18}')
    for _ in range(ROUNDS):
        latest = demo.estimates[-1]
        _print_estimate(demo.time, moved, latest)
        if np.all(relative(latest) < WANTED):
            break
        motion = demo.planned()
        reach = np.degrees(np.ptp(motion.position, axis=0))
        most = ', '.join(f'{motion.joints[place]} {reach[place]:.0f} deg' for place in np.argsort(-reach)[:3])
        print(f'{"":10}planned: {motion.duration:.1f} s, most of it {most}', flush=True)
        demo.move(motion)
        moved += motion.duration
    demo.stop(*reversed(nodes))
    return demo.estimates[-1], demo.truths[-1].inertia, moved - FIRST


def _print_estimate(now: float, moved: float, estimate: Any) -> None:
    sizes = relative(estimate)
    worst = int(np.nanargmax(sizes)) if np.any(np.isfinite(sizes)) else 0
    mass = f'{estimate.inertia.m:.3f} +- {1.96 * estimate.standard_deviation[0]:.3f} kg'
    least = f'{PARAMETERS[worst]} to {100.0 * sizes[worst]:.3g} %'
    print(f'{now:6.1f} s  {moved:7.1f} s  {mass:>22}  {least:>18}', flush=True)


def judge(estimate: Any, truth: Any) -> str:
    """Return the fault of the last estimate; empty for none."""
    sizes = relative(estimate)
    if not np.all(sizes < WANTED):
        return f'{PARAMETERS[int(np.argmax(np.nan_to_num(sizes, nan=np.inf)))]} is not known to {100.0 * WANTED:g} %'
    error = np.abs(values(estimate.inertia) - values(truth)) / np.array(estimate.standard_deviation)
    worst = int(np.argmax(error))
    return f'{PARAMETERS[worst]} is off by {error[worst]:.1f} standard deviations' if error[worst] > MOST else ''


def main(argv: list[str]) -> int:
    """Run the demo and return the exit code."""
    head = (__doc__ or '').split('\n', maxsplit=1)[0]
    parser = ArgumentParser('demo_plan.py', head, 'scripts/demo_plan.py --speed 1')
    parser.add_argument('--speed', type=number(0.0, exclusive=True), default=2.0, metavar='R')
    parser.add_argument('--output', type=Path, default=ROOT / 'demo_output', metavar='FOLDER')
    arguments = parser.parse(argv)
    begin = time.monotonic()
    arguments.output.mkdir(parents=True, exist_ok=True)
    print(
        'A servicer with seven joints holds 155 kg of debris; joints move at 1 deg/s, the base may turn by 2 deg.\n'
        f'Simulator and estimator run as ROS 2 nodes, {arguments.speed:g} times as fast as real time.\n'
    )
    try:
        with running() as made:
            estimate, truth, moved = loop(Loop(made), arguments.output, arguments.speed)
        wrong = judge(estimate, truth)
    except DataError as error:
        wrong = str(error)
    if wrong:
        print(f'demo failed: {one_line(wrong)}', file=sys.stderr)
        return 1
    print(f'\nEvery parameter is known to {100.0 * WANTED:g} % ({time.monotonic() - begin:.0f} s in all).')
    print(f'Planned motions took {moved:.0f} s.')
    return 0


if __name__ == '__main__':
    sys.exit(run(main, name='demo_plan'))
