"""Robot descriptions beyond what is accepted: one line each, before anything large is made."""

from __future__ import annotations

import re

import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.robot.model import load_model
from simulated import CONFIG

SERVICER = (CONFIG / 'servicer7.urdf').read_text()
BODY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def chain(joints: int) -> str:
    """Return a robot of so many joints in a row."""
    links = ''.join(f'<link name="l{place}">{BODY}</link>' for place in range(joints + 1))
    return f'<robot name="chain">{links}' + ''.join(
        f'<joint name="j{place}" type="continuous"><parent link="l{place}"/><child link="l{place + 1}"/></joint>'
        for place in range(joints)
    ) + '</robot>'  # fmt: skip


@pytest.mark.parametrize('count', [1, 8])
def test_masses_that_are_almost_zero_are_refused(count: int) -> None:
    text = re.sub(r'<mass value="[^"]*"/>', '<mass value="1e-300"/>', SERVICER, count=count)
    with pytest.raises(ModelError, match=r'has mass 1e-300 kg; 0 or at least 1e-12 kg is accepted') as refused:
        load_model(text)
    assert str(refused.value).count('1e-300') == count


def test_robots_of_too_many_joints_are_refused() -> None:
    with pytest.raises(ModelError, match='has 999 joints that move; at most 300 are accepted'):
        load_model(chain(999))
    assert load_model(chain(5)).joints == 5
