"""An empty ROS 2 graph for a test of the nodes, or a domain of its own for nodes of this process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from graph import LOCAL, Graph, graph, reserved_domain


@pytest.fixture(name='graph')
def empty_graph(tmp_path: Path) -> Iterator[Graph]:
    with graph(tmp_path) as made:
        yield made


@pytest.fixture(name='_domain')
def own_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with reserved_domain() as (domain, _):
        for name, value in {**LOCAL, 'ROS_DOMAIN_ID': str(domain)}.items():
            monkeypatch.setenv(name, value)
        yield
