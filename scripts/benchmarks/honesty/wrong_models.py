"""Conditions in which the robot is not as described."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.honesty import paths, readings, robots
from benchmarks.honesty.conditions import JOINT, Condition, seen, servicer
from benchmarks.honesty.paths import Path, sinusoids
from benchmarks.honesty.robots import BASE, DIRECTION, box
from benchmarks.honesty.worlds import World
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.motion import Sinusoids

_ARM = 'second'  # links of another arm


def _believed(name: str, believed: Callable[[str], str], cause: str, target: str = '') -> Condition:
    return Condition('wrong model', name, servicer, believed, target=target, cause=cause)


def _steps(
    name: str,
    cause: str,
    of: Callable[[str, Callable[..., Any], str], Condition],
    make: Callable[..., object],
    sizes: tuple[float, ...] = (0.3, 3.0, 30.0),
) -> list[Condition]:
    """Return conditions with errors of some sizes; the last one has a cause to be named."""
    return [of(name.format(size), partial(make, size), cause if size == sizes[-1] else '') for size in sizes]


def _in_grams(urdf: str, links: range = range(1, 7)) -> str:
    for index in links:
        urdf = robots.scaled(urdf, f'link{index}', 1e3)
    return urdf


def _second_arm(_seed: int) -> World:
    """Return servicer7 with another, undeclared arm of three moving links."""
    axes, place, parent, parts = ((0, 0, 1), (0, 1, 0), (0, 1, 0)), (0.5, -0.4, -0.3), BASE, []
    for index, axis in enumerate(axes):
        body = box(25.0, (0.8, 0.15, 0.15), (0.4, 0.0, 0.0))
        parts.append(robots.part(f'{_ARM}{index}', parent, place, axis, body, 'continuous'))
        parent, place = f'{_ARM}{index}', (0.8, 0.0, 0.0)
    urdf = robots.with_parts(robots.servicer(), parts)
    names = tuple(f'{_ARM}{index}_joint' for index in range(3))
    others = {name: _swinging(0.02 + 0.01 * index) for index, name in enumerate(names)}
    return World(urdf, paths.together(load_model(urdf), sinusoids(), others), unread=names)


def _swinging(frequency: float) -> Path:
    one = np.ones((1, 1))
    return paths.following(Sinusoids(np.array([0.2]), 0.5 * one, frequency * one, 0.0 * one))


UNREAD = r'unreported'
FLEXIBLE = r'joint4 is flexible'
WRONG_MODELS = (
    *_steps(
        "a link's mass {:g} % off",
        r'link3\b',
        _believed,
        lambda size, urdf: robots.scaled(urdf, 'link3', 1.0 + 0.01 * size),
        (1.0, 10.0, 50.0),
    ),
    *_steps(
        "the base's CoM {:g} mm off",
        r'base_link\b',
        _believed,
        lambda size, urdf: robots.off_centre(urdf, 1e-3 * size),
        (1.0, 10.0, 100.0),
    ),
    *_steps(
        "a joint's zero {:g} mrad off",
        r'zero of joint4\b',
        seen,
        lambda size, truth: readings.zero_off(JOINT, 1e-3 * size, truth),
    ),
    *_steps(
        'a joint {:g} mm off',
        r'origin of joint4\b',
        _believed,
        lambda size, urdf: robots.misplaced(urdf, 'joint4', 1e-3 * size),
    ),
    *_steps(
        "a joint's axis {:g} mrad off",
        r'axis of joint4\b',
        _believed,
        lambda size, urdf: robots.tilted(urdf, 'joint4', 1e-3 * size),
    ),
    *_steps(
        'odometry mounted {:g} mm off',
        r'\bmount\b',
        seen,
        lambda size, truth: readings.mounted(1e-3 * size * DIRECTION, np.zeros(3), truth),
    ),
    *_steps(
        'odometry mounted {:g} mrad off',
        r'\bmount\b',
        seen,
        lambda size, truth: readings.mounted(np.zeros(3), 1e-3 * size * DIRECTION, truth),
    ),
    *_steps(
        'a gear {:g} mrad off with the angle',
        FLEXIBLE,
        seen,
        lambda size, truth: readings.geared(JOINT, 1e-3 * size, truth),
    ),
    seen("a joint's sign flipped", partial(readings.misgeared, 2, -1.0), r'sign of joint3\b'),
    seen('two joints swapped', partial(readings.swapped, 2, 4), r'joint3 and joint5\b'),
    Condition('wrong model', 'an arm is missing', _second_arm, lambda _: robots.servicer(), cause=UNREAD),
    _believed("a link's mass in grams", partial(_in_grams, links=range(3, 4)), r'link3\b'),
    _believed("the arm's masses in grams", _in_grams, r'link[1-6]\b'),
    _believed('the wrong target link', robots.bare, r'link7\b', 'link6'),
    _believed('the base a third too light', partial(robots.scaled, link=BASE, factor=2.0 / 3.0), r'base_link\b'),
    _believed("two links' inertials exchanged", partial(robots.exchanged, one='link2', other='link5'), r'link[25]\b'),
    _believed("a joint's axis reversed", partial(robots.reversed_axis, joint='joint3'), r'sign of joint3\b'),
    _believed('every length in millimetres', robots.in_millimetres, ''),
)
_LENGTHS = 'every length in millimetres'
# Twelve descriptions of one robot, each with a large error in the file.
WRONG_FILES = tuple(one.name for one in WRONG_MODELS if one.believed is not str and (one.cause or one.name == _LENGTHS))
