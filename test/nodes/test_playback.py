"""A bag played into the live estimator gives what `replay` makes of it, to the last bit."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from mbaid_msgs.msg import InertiaEstimate
from rclpy.serialization import serialize_message

from graph import Graph
from mbaid_ros.bags import BagReader, deserialize, serialize
from mbaid_ros.replay.replay import main as replay
from recorded import papers_case
from simulated import CONFIG
from streams import TABLE1_MOMENTUM, methods

WINDOW = 500_000_000  # ns
TYPE = 'mbaid_msgs/msg/InertiaEstimate'
PARAMETERS = f"""\
/**:
  ros__parameters:
    method: {{method}}
    paper.total_angular_momentum: {list(TABLE1_MOMENTUM)}
"""


@pytest.fixture(scope='module', name='bag')
def twenty_seconds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return papers_case(tmp_path_factory.mktemp('played') / 'bag', duration=20.0, rate=100.0)


def comparable(data: bytes) -> bytes:
    """Return a serialised estimate free of what serialisers pad with, and of the run's own warnings."""
    estimate = deserialize(data, TYPE)
    estimate.warnings.clear()
    return serialize(estimate, TYPE)


def by_window(data: Iterable[bytes]) -> dict[int, bytes]:
    """Return the last estimate of each window: of several a window, as the paper's methods give, that one is live."""
    spans = [(deserialize(estimate, TYPE).span, estimate) for estimate in data]
    return {(span.sec * 1_000_000_000 + span.nanosec + 1) // WINDOW: estimate for span, estimate in spans}


# Two of the four stand for the others, which take as long.
@pytest.mark.parametrize(
    'method',
    [
        each if each in {'trajectory', 'paper_main'} else pytest.param(each, marks=pytest.mark.long)
        for each in methods()
    ],
)
def test_a_played_bag_gives_the_estimates_of_its_replay(graph: Graph, bag: Path, tmp_path: Path, method: str) -> None:
    parameters = tmp_path / 'estimator.yaml'
    parameters.write_text(PARAMETERS.format(method=method))
    model = CONFIG / 'table1.urdf'
    arguments = ['--params-file', parameters, '-p', f'robot_description_file:={model}']
    node = graph.start('estimator', '--ros-args', *arguments)
    published: list[Any] = graph.collect('/estimator/estimate', InertiaEstimate)
    graph.wait(lambda: published, 'what the estimator waits for')
    player = graph.start('player', bag, '--rate', '20', '--wait-for-subscribers', '30')

    output = tmp_path / 'estimates'
    assert replay([str(bag), '--model', str(model), '--params', str(parameters), '--output', str(output)]) == 0
    with BagReader(output) as recorded:
        replayed = by_window(comparable(data) for _, data, _ in recorded.raw(['/estimator/estimate']))
    assert len(replayed) >= 39

    graph.wait(lambda: sum(bool(estimate.samples) for estimate in published) >= len(replayed), 'every estimate')
    assert player.wait() == 0
    live = [comparable(serialize_message(estimate)) for estimate in published if estimate.samples]
    assert live == list(replayed.values())
    assert node.stop() == 0
