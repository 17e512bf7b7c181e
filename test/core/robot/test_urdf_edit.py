"""Identified and calibrated values go into the robot description, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.robot.urdf import Inertial, read_description
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from simulated import CONFIG

IDENTIFIED = np.array([157.25, 0.1, -0.2, 1 / 3, 30.1, 0.5, -0.25, 40.0, 1e-3, 50.0])
WRITTEN = Inertial(mass=157.25, xyz=(0.1, -0.2, 1 / 3), rpy=(0.0, 0.0, 0.0), inertia=tuple(IDENTIFIED[4:].tolist()))
FRAME = '<?xml version="1.0" encoding="latin-1"?>\n<robot name="r">\n  {link}\n  <!-- ünd -->\n</robot>\n'


@pytest.mark.parametrize('name', ['table1', 'ets7', 'servicer7'])
def test_every_link_of_the_robots_takes_the_identified_inertia(name: str) -> None:
    urdf = (CONFIG / f'{name}.urdf').read_text()
    for link in load_model(urdf).links:
        changed = replace_inertial(urdf, link.name, IDENTIFIED)
        assert read_description(changed).inertials == {**read_description(urdf).inertials, link.name: WRITTEN}


@pytest.mark.parametrize(
    'link',
    [
        '<link name="tool"/>',
        "<link name='tool' note='a > b'  />",
        '<link name="tool"></link>',
        '<link name="tool">\n    <visual/>\n  </link>',
        '<link name="tool"><inertial><mass value="1"/><inertia/></inertial></link>',
        '<link name="tool"><extension><inertial/></extension></link>',
        '<link name="tool"><!-- <inertial> --><inertial/></link>',
    ],
)
def test_any_way_to_write_a_link(link: str) -> None:
    changed = replace_inertial(FRAME.format(link=link), 'tool', IDENTIFIED)
    assert '<!-- ünd -->' in changed
    assert read_description(changed).inertials == {'tool': WRITTEN}
    assert replace_inertial(changed, 'tool', IDENTIFIED) == changed


@pytest.mark.parametrize('name', ['table1', 'ets7', 'servicer7'])
def test_every_link_reads_back(name: str) -> None:
    urdf = (CONFIG / f'{name}.urdf').read_text()
    changed = urdf
    model = load_model(urdf)
    for link in model.links:
        changed = replace_inertial(changed, link.name, 1.01 * physical(link.parameters))
    for link, before in zip(load_model(changed).links, model.links, strict=True):
        expected = 1.01 * physical(before.parameters)
        assert physical(link.parameters) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
