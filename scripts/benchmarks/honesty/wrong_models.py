"""Conditions in which the robot is not as its description says."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.data import model
from benchmarks.honesty import robots, views
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.floating import World
from benchmarks.honesty.paths import ROBOT, Path, following, sinusoids, together
from benchmarks.honesty.robots import BARE, BASE, DIRECTION, LINK, box
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf_edit import change_inertial
from mbaid_ros.simulation.motion import Sinusoids

GROUP = 'wrong model'
_JOINT = 3  # number of joint4
_MILLI = (0.3, 3.0, 30.0)
_ARM = 'second'


def _servicer(_seed: int) -> World:
    return World(robots.servicer(), sinusoids())


def _believed(name: str, believed: Callable[[str], str], target: str = '') -> Condition:
    return Condition(GROUP, name, _servicer, believed, target=target)


def _seen(name: str, view: views.View) -> Condition:
    return Condition(GROUP, name, _servicer, view=view)


def _all_in_grams(urdf: str) -> str:
    """Return a robot whose arm's links are given in grams."""
    for index in range(1, 7):
        urdf = robots.scaled(urdf, f'link{index}', 1e3)
    return urdf


def _wrong_target(urdf: str) -> str:
    """Return the robot as its maker has it: nothing in its hand."""
    return change_inertial(urdf, LINK, BARE)


def _second_arm(_seed: int) -> World:
    """Return servicer7 with another arm of three moving links, which nobody has told the estimator of."""
    axes, place, parent, parts = ((0, 0, 1), (0, 1, 0), (0, 1, 0)), (0.5, -0.4, -0.3), BASE, []
    for index, axis in enumerate(axes):
        body = box(25.0, (0.8, 0.15, 0.15), (0.4, 0.0, 0.0))
        parts.append(robots.part(f'{_ARM}{index}', parent, place, axis, body, 'continuous'))
        parent, place = f'{_ARM}{index}', (0.8, 0.0, 0.0)
    urdf = robots.with_parts(robots.servicer(), parts)
    names = tuple(f'{_ARM}{index}_joint' for index in range(3))
    others = {name: _swinging(0.02 + 0.01 * index) for index, name in enumerate(names)}
    return World(urdf, together(load_model(urdf), sinusoids(), others), unread=names)


def _swinging(frequency: float) -> Path:
    one = np.ones((1, 1))
    return following(Sinusoids(np.array([0.2]), 0.5 * one, frequency * one, 0.0 * one))


def _without_second_arm(_urdf: str) -> str:
    return model(ROBOT).urdf


WRONG_MODELS = (
    *(
        _believed(f"a link's mass {share:g} % off", partial(robots.scaled, link='link3', factor=1.0 + 0.01 * share))
        for share in (1.0, 10.0, 50.0)
    ),
    *(
        _believed(f"the base's CoM {size:g} mm off", partial(robots.off_centre, distance=1e-3 * size))
        for size in (1.0, 10.0, 100.0)
    ),
    *(_seen(f"a joint's zero {size:g} mrad off", partial(views.zero_off, _JOINT, 1e-3 * size)) for size in _MILLI),
    *(
        _believed(f'a joint {size:g} mm off', partial(robots.misplaced, joint='joint4', distance=1e-3 * size))
        for size in _MILLI
    ),
    *(
        _believed(f"a joint's axis {size:g} mrad off", partial(robots.tilted, joint='joint4', angle=1e-3 * size))
        for size in _MILLI
    ),
    *(
        _seen(f'odometry mounted {size:g} mm off', partial(views.mounted, 1e-3 * size * DIRECTION, np.zeros(3)))
        for size in _MILLI
    ),
    *(
        _seen(f'odometry mounted {size:g} mrad off', partial(views.mounted, np.zeros(3), 1e-3 * size * DIRECTION))
        for size in _MILLI
    ),
    *(_seen(f'a gear {size:g} mrad off with the angle', partial(views.geared, _JOINT, 1e-3 * size)) for size in _MILLI),
    _seen("a joint's sign flipped", partial(views.sign_flipped, 2)),
    _seen('two joints swapped', partial(views.swapped, 2, 4)),
    Condition(GROUP, 'an arm is missing', _second_arm, _without_second_arm),
    _believed("a link's mass in grams", partial(robots.scaled, link='link3', factor=1e3)),
    _believed("the arm's masses in grams", _all_in_grams),
    _believed('the wrong target link', _wrong_target, 'link6'),
    _believed('the base a third too light', partial(robots.scaled, link=BASE, factor=2.0 / 3.0)),
    _believed("two links' inertials exchanged", partial(robots.exchanged, one='link2', other='link5')),
    _believed("a joint's axis reversed", partial(robots.reversed_axis, joint='joint3')),
    _believed('every length in millimetres', robots.in_millimetres),
)
# Twelve descriptions of one robot, each with something wrong in the file.
WRONG_FILES = (
    "a link's mass 50 % off",
    'the base a third too light',
    "the base's CoM 100 mm off",
    "two links' inertials exchanged",
    'a joint 30 mm off',
    "a joint's axis 30 mrad off",
    "a joint's axis reversed",
    'an arm is missing',
    'the wrong target link',
    "a link's mass in grams",
    "the arm's masses in grams",
    'every length in millimetres',
)
