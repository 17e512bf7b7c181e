"""Send damaged bags through `replay`: each ends with 0, 2, 3 or 4, a line of error at most, soon, in little memory.

usage: fuzz_bags.py [COUNT] [SEED]    (default 2000 from seed 0; with `install/setup.bash` sourced)

The damage: bits flipped, the end cut off, parts of the file spliced into other places, lengths overwritten, schemas
that say something else than the messages hold.
"""

from __future__ import annotations

import contextlib
import io
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType

import numpy as np
from mcap.writer import CompressionType, Writer
from tqdm import tqdm

from mbaid_ros.bags.types import definition, serialize
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.replay.replay import main
from mbaid_ros.simulated_run import SimulatedRun

CONFIG = Path(__file__).resolve().parents[1] / 'config'
LONGEST = 10.0  # s, for one bag
METHODS = ('difference', 'paper_difference')
MEMORY = 1_000_000_000  # bytes, beyond what the process has at the start
TYPES = {'/joint_states': 'sensor_msgs/msg/JointState', '/odom': 'nav_msgs/msg/Odometry'}

Damage = Callable[[bytes, np.random.Generator], bytes]


class TooLongError(Exception):
    """A bag took longer than it may."""


def whole_bag(compression: CompressionType, lie: Callable[[str], str] = lambda text: text) -> bytes:
    """Return a small bag of the paper's case; `lie` changes the text of its schemas."""
    config = build(SimulatorConfig, load_parameter_file(CONFIG / 'table1_simulator.yaml', 'simulator'))
    config = replace(config, joint_rate=20.0, odometry_rate=20.0)
    run = SimulatedRun(config, (CONFIG / 'table1.urdf').read_text(encoding='utf-8'), BAG_TYPES)
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4_000, compression=compression)
    writer.start(profile='ros2')
    channels = {}
    for topic, kind in TYPES.items():
        schema = writer.register_schema(kind, 'ros2msg', lie(definition(kind)[0]).encode())
        channels[topic] = writer.register_channel(topic, 'cdr', schema)
    for count, timed in enumerate(run.read(8.0)):
        stamp, topic = run.stamp(timed.time), f'/{timed.topic}'
        writer.add_message(channels[topic], stamp, serialize(timed.message, TYPES[topic]), stamp, count)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def flipped(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with some bits flipped."""
    array = np.frombuffer(data, dtype=np.uint8).copy()
    for place in generator.integers(0, len(array), generator.integers(1, 20)):
        array[place] ^= 1 << int(generator.integers(0, 8))
    return array.tobytes()


def cut(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the beginning of the bytes."""
    return data[: int(generator.integers(0, len(data)))]


def spliced(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with one part put into another place, or taken out."""
    begin, end, place = sorted(int(x) for x in generator.integers(0, len(data), 3))
    if generator.random() < 0.5:
        return data[:begin] + data[end:]
    return data[:place] + data[begin:end] + data[place:]


def overwritten(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with a number written over them: lengths that ask for gigabytes, zeros, ones."""
    value = [0, 1, 2**31 - 1, 2**32 - 1, 2**40, 2**63, 2**64 - 1][int(generator.integers(0, 7))]
    size = int(generator.choice([4, 8]))
    place = int(generator.integers(0, len(data) - size))
    return data[:place] + (value % 2 ** (8 * size)).to_bytes(size, 'little') + data[place + size :]


def lies() -> list[Callable[[str], str]]:
    """Return changes of a schema's text."""
    return [
        lambda text: text.replace('float64[] position', 'float64[1000000000] position'),
        lambda text: text.replace('float64[] position', 'string position'),
        lambda text: text.replace('float64[36] covariance', 'float64[3600000] covariance'),
        lambda text: text.replace('float64[] velocity', ''),
        lambda text: text.replace('string[] name', 'string name'),
        lambda text: text.replace('std_msgs/Header header', 'uint8 header'),
        lambda text: text.replace('float64 x', 'x float64'),
        lambda _text: '',
        lambda text: text * 2,
        lambda text: text.replace('geometry_msgs/Point position', 'geometry_msgs/Pose position'),
    ]


def damaged(count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Yield a name and the content of so many bags."""
    plain = [whole_bag(CompressionType.NONE), whole_bag(CompressionType.ZSTD)]
    lying = [whole_bag(CompressionType.NONE, lie) for lie in lies()]
    ways: list[Damage] = [flipped, cut, spliced, overwritten]
    for number in range(count):
        generator = np.random.default_rng([seed, number])
        if number < len(lying):
            yield f'schema {number}', lying[number]
            continue
        bag = lying[number % len(lying)] if number % 10 == 0 else plain[number % 2]
        way = ways[int(generator.integers(0, len(ways)))]
        yield f'{way.__name__} {number}', way(bag, generator)


def replay(path: Path, method: str) -> tuple[int, str, float]:
    """Return exit code, what was written to stderr, and the time it took."""
    error, begin = io.StringIO(), time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    with contextlib.redirect_stderr(error), contextlib.redirect_stdout(io.StringIO()):
        code = main([str(path), '--model', str(CONFIG / 'table1.urdf'), '--method', method, '--json', '-'])
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    return code, error.getvalue(), time.monotonic() - begin


def _on_alarm(_number: int, _frame: FrameType | None) -> None:
    raise TooLongError(f'more than {LONGEST:g} s')


def fuzz(count: int, seed: int) -> tuple[Counter[int], float, list[str]]:
    """Return how often each exit code came, the longest time, and what went wrong."""
    before = signal.signal(signal.SIGALRM, _on_alarm)
    at_start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    codes: Counter[int] = Counter()
    longest, wrong = 0.0, []
    with tempfile.TemporaryDirectory() as folder:
        for name, content in tqdm(damaged(count, seed), total=count, unit=' bags', disable=None, leave=False):
            path = Path(folder) / 'bag.mcap'
            path.write_bytes(content)
            try:
                code, error, taken = replay(path, METHODS[sum(codes.values()) % len(METHODS)])
            except Exception as reason:  # noqa: BLE001 - that none comes out is what is tested
                wrong.append(f'{name}: {type(reason).__name__}: {reason}')
                continue
            codes[code] += 1
            longest = max(longest, taken)
            if code not in {0, 2, 3, 4} or error.count('\n') > (code == 2):
                wrong.append(f'{name}: exit code {code}, {error!r}')
    signal.signal(signal.SIGALRM, before)
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - at_start) * 1024
    if memory > MEMORY:
        wrong.append(f'{memory / 1e6:.0f} MB more memory than at the start')
    return codes, longest, wrong


if __name__ == '__main__':
    asked = [int(argument) for argument in sys.argv[1:]]
    found, slowest, failures = fuzz(*(asked + [2000, 0][len(asked) :]))
    print(', '.join(f'{number} bags: exit code {code}' for code, number in sorted(found.items())))
    print(f'slowest {slowest:.2f} s, {len(failures)} failures')
    print('\n'.join(failures[:20]))
    sys.exit(bool(failures))
