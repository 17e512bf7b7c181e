"""Make the bags of bags/ anew: three by simulation, seeded, and one recorded from a live ROS 2 graph.

A simulated bag holds the same messages, byte for byte, each time it is made on one machine. The live one is stamped
with the time of its recording; it is kept only if a replay gives the very estimates recorded in it.
"""

import io
import json
import shutil
import sys
import tempfile
from contextlib import redirect_stdout
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.data import CONFIG, NOISE
from benchmarks.frame import declared
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.cli import ArgumentParser, number, run
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.errors import DataError, ParameterError, listing
from mbaid_ros.replay.arguments import replay as replay_executable
from mbaid_ros.replay.arguments import simulate as simulate_executable
from mbaid_ros.replay.read_back import TRUTH_FILE

ROOT = Path(__file__).resolve().parents[1]
ESTIMATE = '/estimator/estimate'
ATTEMPTS = 5


@dataclass(frozen=True)
class Recipe:
    """The content of a bag."""

    robot: str  # name of its files in config/
    duration: float  # s
    rate: float  # messages a second on either topic
    noise: dict[str, object] = field(default_factory=dict)
    seed: int = 0
    pose_only: bool = False  # without joint rates and the base's twist
    live: bool = False  # recorded from a graph

    @property
    def parameters(self) -> list[str]:
        """Parameters beside the simulator's parameter file, as words of a command line."""
        rates = {'joint_rate': self.rate, 'odometry_rate': self.rate}
        given = {'duration': self.duration, 'seed': self.seed, **rates, **self.noise}
        return [word for name, value in given.items() for word in ('-p', f'{name}:={value}')]

    def file(self, name: str) -> str:
        """Return a file of config/."""
        return f'{CONFIG}/{self.robot}{name}'


RECIPES = {
    'table1_live': Recipe('table1', duration=30.0, rate=100.0, live=True),
    'servicer7_clean': Recipe('servicer7', duration=60.0, rate=50.0),
    'servicer7_mid': Recipe('servicer7', duration=60.0, rate=50.0, noise=declared(NOISE), seed=1),
    'ets7_pose_only': Recipe('ets7', duration=60.0, rate=50.0, noise=declared(NOISE), seed=1, pose_only=True),
}


def make(recipe: Recipe, bag: Path) -> None:
    """Make one bag, with its truth beside the data, in place of an older one."""
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
    files = ('--model', recipe.file('.urdf'), '--params', recipe.file('_simulator.yaml'))
    _succeed(simulate_executable([*files, *recipe.parameters, '--output', str(bag)]), bag)
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
            if hasattr(message, 'velocity'):
                message.velocity = message.effort = np.zeros(0)
            if hasattr(message, 'twist'):
                for part in (message.twist.twist.linear, message.twist.twist.angular):
                    part.x = part.y = part.z = np.nan
            writer.write(name, message, time)


def record(recipe: Recipe, bag: Path) -> None:
    """Record simulator and estimator on a graph, until live and replayed estimates are the same."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        offline = Path(folder) / 'offline'
        simulate(recipe, offline)
        for attempt in range(ATTEMPTS):
            shutil.rmtree(bag, ignore_errors=True)
            work = Path(folder) / str(attempt)
            work.mkdir()
            run_graph(recipe, bag)
            files = ('--model', recipe.file('.urdf'), '--params', recipe.file('_estimator.yaml'))
            _succeed(replay_executable([str(bag), *files, '--output', str(work / 'replayed')]), bag)
            if estimates(bag) == estimates(work / 'replayed'):
                shutil.copy(offline / TRUTH_FILE, bag)
                return
    raise DataError(f'{bag}: in {ATTEMPTS} recordings the recorder missed messages that the estimator had')


def run_graph(recipe: Recipe, bag: Path) -> None:
    """Run estimator, recorder and simulator as processes, in real time, until the run is over."""
    from nav_msgs.msg import Odometry  # noqa: PLC0415 - needed for a live recording only
    from sensor_msgs.msg import JointState  # noqa: PLC0415

    from demo_graph import Demo, running  # noqa: PLC0415

    described = ('-p', f'robot_description_file:={recipe.file(".urdf")}')
    with running() as made:
        # Announced before there is data, both topics have their subscribers from the first message on.
        made.node.create_publisher(JointState, 'joint_states', 1)
        made.node.create_publisher(Odometry, 'odom', 1)
        demo = Demo(made)
        # With the robot description from the start: earlier messages would not be used.
        estimator = demo.start('estimator', '--params-file', recipe.file('_estimator.yaml'), *described)
        recorder = demo.start('recorder', '-p', f'output:={bag}')
        recorded = ('/joint_states', '/odom', ESTIMATE)
        demo.wait(lambda: all(map(demo.recorded, recorded)), 'the recorder')
        words = (*described, *recipe.parameters, '-p', 'wait_for_subscribers:=2')
        simulator = demo.start('simulator', '--params-file', recipe.file('_simulator.yaml'), *words)
        demo.ended(simulator, recipe.duration + 30.0)
        # On a busy machine the estimator is behind.
        window = EstimatorConfig().window
        samples = round(recipe.duration // window * window * recipe.rate)
        demo.wait(lambda: demo.estimates[-1].samples >= samples, 'the last window')
        demo.stop(estimator, recorder)


def estimates(bag: Path) -> list[tuple[int, bytes, bytes]]:
    """Return samples, mass properties and covariance, to the last bit, of the estimates in a bag."""
    found = []
    with BagReader(bag) as reader:
        for _, message, _ in reader.read([ESTIMATE]):
            inertia, com = message.inertia, message.inertia.com
            moments = (inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz)
            body = np.array([inertia.m, com.x, com.y, com.z, *moments])
            if message.status != 'waiting':
                found.append((int(message.samples), body.tobytes(), message.covariance.tobytes()))
    return found


def _succeed(code: int, bag: Path) -> None:
    if code != 0:
        raise DataError(f"bag '{bag}' was not made: exit code {code}")


def main(argv: list[str]) -> int:
    """Make the named bags."""
    parser = ArgumentParser('make_bags.py', (__doc__ or '').split('\n', maxsplit=1)[0], 'make_bags.py servicer7_mid')
    parser.add_argument('names', nargs='*', metavar='NAME', help=f'of {", ".join(RECIPES)} (default: all)')
    parser.add_argument('--output', type=Path, default=ROOT / 'bags', metavar='FOLDER')
    parser.add_argument('--duration', type=number(0.0, 's', exclusive=True), metavar='S', help='a shorter run')
    arguments = parser.parse(argv)
    unknown = [name for name in arguments.names if name not in RECIPES]
    if unknown:
        raise ParameterError(f"there is no bag '{unknown[0]}'; accepted: {listing(RECIPES)}")
    for name in arguments.names or RECIPES:
        recipe = RECIPES[name]
        make(replace(recipe, duration=arguments.duration or recipe.duration), arguments.output / name)
    return 0


if __name__ == '__main__':
    sys.exit(run(main, name='make_bags'))
