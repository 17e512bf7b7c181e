"""Make the bags of bags/ anew: three by simulation, seeded, and one recorded from a live ROS 2 graph.

usage: make_bags.py [NAME ...] [--output FOLDER] [--duration S]    (`make bags` makes all of them)

A simulated bag holds the same messages, byte for byte, each time it is made on one machine. The live one holds what the
graph said, stamped with the time of its recording; it is kept only if a replay gives the very estimates recorded in it.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import sys
import tempfile
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.cli import ArgumentParser, number, run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import DataError, ParameterError, listing
from mbaid_ros.replay import replay as replay_executable
from mbaid_ros.replay import simulate as simulate_executable
from mbaid_ros.replay.truth import TRUTH_FILE

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'config'
ESTIMATE = '/estimator/estimate'
ATTEMPTS = 5
WINDOW = EstimatorConfig().window

# What the sensors of a servicer may have: one standard deviation of a sample.
MID_NOISE = {
    'joint_position': 1e-4,  # rad
    'joint_velocity': 1e-3,  # rad/s
    'base_position': 1e-3,  # m
    'base_orientation': 1e-4,  # rad
    'base_linear_velocity': 1e-3,  # m/s
    'base_angular_velocity': 1e-4,  # rad/s
}


@dataclass(frozen=True)
class Recipe:
    """What a bag holds.

    Attributes
    ----------
    robot : name of its files in config/
    duration, rate : s, and messages a second on either topic
    noise : by channel; empty is none
    seed : of the noise
    pose_only : whether joint rates and the base's twist are left out
    live : whether it is recorded from a graph
    """

    robot: str
    duration: float
    rate: float
    noise: dict[str, float]
    seed: int = 0
    pose_only: bool = False
    live: bool = False

    @property
    def parameters(self) -> dict[str, object]:
        """What is different from the simulator's parameter file of this robot."""
        noise = {f'noise.{channel}': value for channel, value in self.noise.items()}
        rates = {'joint_rate': self.rate, 'odometry_rate': self.rate}
        return {'duration': self.duration, 'seed': self.seed, **rates, **noise}


RECIPES = {
    'table1_live': Recipe('table1', duration=30.0, rate=100.0, noise={}, live=True),
    'servicer7_clean': Recipe('servicer7', duration=60.0, rate=50.0, noise={}),
    'servicer7_mid': Recipe('servicer7', duration=60.0, rate=50.0, noise=MID_NOISE, seed=1),
    'ets7_pose_only': Recipe('ets7', duration=60.0, rate=50.0, noise=MID_NOISE, seed=1, pose_only=True),
}


def make(recipe: Recipe, bag: Path) -> None:
    """Make one bag, with its truth beside the data; what was there before is removed.

    Raises
    ------
    DataError
        A live recording failed.
    """
    shutil.rmtree(bag, ignore_errors=True)
    bag.parent.mkdir(parents=True, exist_ok=True)
    if recipe.live:
        record(recipe, bag)
    elif recipe.pose_only:
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / 'whole'
            simulate(recipe, whole)
            leave_rates_out(whole, bag)
            shutil.copy(whole / TRUTH_FILE, bag)
    else:
        simulate(recipe, bag)


def simulate(recipe: Recipe, bag: Path) -> None:
    """Simulate a run into a bag."""
    words = [word for name, value in recipe.parameters.items() for word in ('-p', f'{name}:={value}')]
    files = ('--model', f'{CONFIG}/{recipe.robot}.urdf', '--params', f'{CONFIG}/{recipe.robot}_simulator.yaml')
    _succeed(simulate_executable.main([*files, *words, '--output', str(bag)]), bag)
    truth = bag / TRUTH_FILE
    content = json.loads(truth.read_text(encoding='utf-8'))
    content['parameters']['robot_description_file'] = f'{CONFIG.name}/{recipe.robot}.urdf'  # the same on any machine
    truth.write_text(json.dumps(content, indent=2) + '\n', encoding='utf-8')


def leave_rates_out(source: Path, bag: Path) -> None:
    """Copy a bag without joint velocities and efforts and, as NaN, without the base's twist."""
    with BagReader(source) as reader, BagWriter(bag) as writer:
        for name, topic in reader.topics.items():
            writer.add_topic(name, topic.type, latched=topic.latched)
        for name, message, time in reader.read(list(reader.topics)):
            writer.write(name, without_rates(message), time)


def without_rates(message: Any) -> Any:
    """Return a JointState or an Odometry with poses only, and any other message as it is."""
    if hasattr(message, 'velocity'):
        return replace(message, velocity=np.zeros(0), effort=np.zeros(0))
    if hasattr(message, 'twist'):
        still = message.twist.twist
        nowhere = replace(still.linear, x=np.nan, y=np.nan, z=np.nan)
        twist = replace(message.twist, twist=replace(still, linear=nowhere, angular=nowhere))
        return replace(message, twist=twist)
    return message


def record(recipe: Recipe, bag: Path) -> None:
    """Record simulator and estimator on a graph, until live and replayed estimates are the same.

    Raises
    ------
    DataError
        They never were: the recorder missed messages that the estimator had.
    """
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        offline = Path(folder) / 'offline'
        simulate(recipe, offline)
        for attempt in range(ATTEMPTS):
            shutil.rmtree(bag, ignore_errors=True)
            work = Path(folder) / str(attempt)
            work.mkdir()
            run_graph(recipe, bag, work)
            if estimates(bag) == estimates(replayed(recipe, bag, work / 'replayed')):
                shutil.copy(offline / TRUTH_FILE, bag)
                return
    raise DataError(f'{bag}: in {ATTEMPTS} recordings the recorder missed what the estimator had')


def run_graph(recipe: Recipe, bag: Path, work: Path) -> None:
    """Run estimator, recorder and simulator as processes, in real time, until the run is over."""
    import rclpy  # noqa: PLC0415 - needed for a live recording only
    from nav_msgs.msg import Odometry  # noqa: PLC0415
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    from rclpy.utilities import try_shutdown  # noqa: PLC0415
    from sensor_msgs.msg import JointState  # noqa: PLC0415

    from demo_graph import Spectator, running  # noqa: PLC0415

    parameters = {'robot_description_file': f'{CONFIG}/{recipe.robot}.urdf', **recipe.parameters}
    words = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    with running(work) as processes:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        # Announced before there is data, both topics have their subscribers from the first message on.
        herald = rclpy.create_node('herald', start_parameter_services=False)
        herald.create_publisher(JointState, 'joint_states', 1)
        herald.create_publisher(Odometry, 'odom', 1)
        spectator = Spectator(processes)
        # With the robot description from the start: what comes before it is not used.
        processes.start(
            'estimator', '--ros-args', '--params-file', f'{CONFIG}/{recipe.robot}_estimator.yaml',
            '-p', f'robot_description_file:={CONFIG}/{recipe.robot}.urdf',
        )  # fmt: skip
        processes.start('recorder', '--ros-args', '-p', f'output:={bag}')
        recorded = ('/joint_states', '/odom', ESTIMATE)
        spectator.wait(lambda: all(map(spectator.recorded, recorded)), 'the recorder')
        simulator = processes.start(
            'simulator', '--ros-args', '--params-file', f'{CONFIG}/{recipe.robot}_simulator.yaml', *words,
            '-p', 'wait_for_subscribers:=2',
        )  # fmt: skip
        spectator.wait(lambda: simulator.poll() is not None, 'the end of the run', recipe.duration + 30.0)
        # On a busy machine the estimator is behind.
        whole = recipe.duration // WINDOW * WINDOW
        spectator.wait(lambda: spectator.estimates[-1].samples >= round(whole * recipe.rate), 'the last window')
        processes.stop('estimator')
        processes.stop('recorder')
        try_shutdown()


def replayed(recipe: Recipe, bag: Path, output: Path) -> Path:
    """Replay a bag as the estimator node was set, and return the bag of estimates."""
    files = ('--model', f'{CONFIG}/{recipe.robot}.urdf', '--params', f'{CONFIG}/{recipe.robot}_estimator.yaml')
    _succeed(replay_executable.main([str(bag), *files, '--output', str(output)]), bag)
    return output


def estimates(bag: Path) -> list[tuple[int, bytes, bytes]]:
    """Return samples, mass properties and covariance, to the last bit, of the estimates in a bag."""
    with BagReader(bag) as reader:
        messages = [message for _, message, _ in reader.read([ESTIMATE])]
    found = []
    for message in messages:
        if message.status != 'waiting':
            inertia, com = message.inertia, message.inertia.com
            moments = (inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz)
            body = np.array([inertia.m, com.x, com.y, com.z, *moments])
            found.append((int(message.samples), body.tobytes(), message.covariance.tobytes()))
    return found


def _succeed(code: int, bag: Path) -> None:
    if code != 0:
        raise DataError(f"bag '{bag}' was not made: exit code {code}")


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the arguments."""
    parser = ArgumentParser('make_bags.py', (__doc__ or '').split('\n', maxsplit=1)[0], 'make_bags.py servicer7_mid')
    parser.add_argument('names', nargs='*', metavar='NAME', help=f'of {", ".join(RECIPES)} (default: all)')
    parser.add_argument('--output', type=Path, default=ROOT / 'bags', metavar='FOLDER')
    parser.add_argument('--duration', type=number(0.0, 's', exclusive=True), metavar='S', help='a shorter run')
    return parser.parse(argv)


def main(argv: list[str]) -> int:
    """Make the bags that are named."""
    arguments = parse(argv)
    unknown = [name for name in arguments.names if name not in RECIPES]
    if unknown:
        raise ParameterError(f"there is no bag '{unknown[0]}'; accepted: {listing(RECIPES)}")
    for name in arguments.names or RECIPES:
        recipe = RECIPES[name]
        make(replace(recipe, duration=arguments.duration or recipe.duration), arguments.output / name)
    return 0


if __name__ == '__main__':
    sys.exit(run(main, name='make_bags'))
