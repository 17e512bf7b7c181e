"""Every test of the nodes gets an empty ROS 2 graph of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from graph import Graph, graph


@pytest.fixture(name='graph')
def empty_graph(tmp_path: Path) -> Iterator[Graph]:
    with graph(tmp_path) as made:
        yield made
