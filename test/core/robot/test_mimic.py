"""Joints that follow others: where they are, and what of their motion reaches an estimate."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf import Mimic, transmission
from random_robots import random_urdf

JOINTS = ('a', 'left', 'right', 'b', 'tip')
MIMICS = {'left': Mimic('right', -1.0, 0.1), 'tip': Mimic('left', 2.0, 0.5)}


def test_followers_are_where_their_driver_puts_them() -> None:
    moved = transmission(JOINTS, MIMICS)
    assert [JOINTS[place] for place in moved.independent] == ['a', 'right', 'b']
    a, right, b = positions = np.array([0.3, -0.7, 1.1])
    left = -right + 0.1
    assert moved.positions(positions) == pytest.approx([a, left, right, b, 2.0 * left + 0.5], abs=1e-15)
    step = 1e-3
    change = (moved.positions(positions + step) - moved.positions(positions)) / step
    assert moved.rates(np.ones(3)) == pytest.approx(change, abs=1e-9)
    assert not moved.direct


def test_joints_that_follow_none_stay_the_very_same() -> None:
    values = np.array([0.1, 0.2])
    assert transmission(('a', 'b'), {}).positions(values) is values


@pytest.mark.parametrize(
    ('mimics', 'named'),
    [
        ({'left': Mimic('nobody', 1.0, 0.0)}, "'left' mimics 'nobody', which is no joint that moves"),
        ({'left': Mimic('right', 1.0, 0.0), 'right': Mimic('left', 1.0, 0.0)}, 'mimics joints that mimic it'),
    ],
)
def test_what_moves_nothing_is_refused(mimics: dict[str, Mimic], named: str) -> None:
    with pytest.raises(ModelError, match=named):
        transmission(JOINTS, mimics)


def test_positions_by_name_need_the_drivers_only() -> None:
    urdf = random_urdf(np.random.default_rng(3), joints=4, chain=True)
    free = load_model(urdf)
    first, last = free.joint_names[0], free.joint_names[-1]
    place = urdf.index('</joint>', urdf.index(f'<joint name="{last}"'))
    model = load_model(f'{urdf[:place]}<mimic joint="{first}" multiplier="0.5"/>{urdf[place:]}')
    known = {name: 0.2 * index for index, name in enumerate(model.independent_joints, start=1)}
    found = model.positions_from({**known, last: 9.0})  # what a follower says of itself does not count
    assert found[-1] == 0.5 * known[first]
    del known[first]
    assert np.isnan(model.positions_from(known)[[0, -1]]).all()
