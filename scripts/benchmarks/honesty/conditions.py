"""A condition, and those in which nothing is wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.honesty import paths, robots
from benchmarks.honesty.paths import DEGREE, Path, after, pick_and_place, sinusoids
from benchmarks.honesty.readings import Defect, View
from benchmarks.honesty.robots import BASE, LINK
from benchmarks.honesty.worlds import World
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True, eq=False)
class Condition:
    """A true robot, its sensors, and the declarations; everything else is the default."""

    group: str
    name: str
    world: Callable[[int], World]  # by the seed if `varies`
    believed: Callable[[str], str] = str  # URDF of the estimator, from that of the world
    view: View = lambda truth: truth
    defect: Defect = lambda found, _rng: found
    declared: Mapping[str, float] = field(default_factory=dict)  # noise as declared, over the true one
    target: str = ''  # link; the last one if empty
    varies: bool = False  # whether every seed has a world of its own
    cause: str = ''  # regular expression of the true cause, where one error is larger than declared


AXES = ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0))
JOINT = 3  # number of joint4 among the joints


def servicer(_seed: int) -> World:
    """Return the shipped robot with its sinusoids."""
    return World(robots.servicer(), sinusoids())


def seen(name: str, view: View, cause: str, group: str = 'wrong model') -> Condition:
    """Return the shipped robot, whose readings are other ones."""
    return Condition(group, name, servicer, view=view, cause=cause)


def _moving(name: str, path: Callable[[int], Path], seconds: float = 60.0, *, varies: bool = False) -> Condition:
    return Condition('undisturbed', name, lambda seed: World(robots.servicer(), path(seed), seconds), varies=varies)


def _of_weight(name: str, link: str, factor: float) -> Condition:
    return Condition('undisturbed', name, lambda _: World(robots.scaled(robots.servicer(), link, factor), sinusoids()))


def drawn_start(joints: int, slides: tuple[int, ...] = ()) -> Array:
    """Return where so many joints begin, some of which slide."""
    return np.where(np.isin(np.arange(joints), slides), 0.1, 0.3 * np.cos(np.arange(joints)))


def _shaped(
    name: str, axes: tuple[tuple[int, int, int], ...], slides: tuple[int, ...] = (), *, folded: bool = False
) -> Condition:
    def world(_seed: int) -> World:
        return World(robots.chain(axes, slides, folded=folded), paths.drawn(drawn_start(len(axes), slides), 1))

    return Condition('undisturbed', name, world)


UNDISTURBED = (
    _moving('sinusoids of the shipped robot', lambda _: sinusoids()),
    _moving('fast sinusoids', lambda _: sinusoids(pace=4.0)),
    _moving('small sinusoids, a tenth', lambda _: sinusoids(amplitude=0.1)),
    _moving('trapezoids of 1 deg/s with stops', lambda seed: pick_and_place(seed, 60.0), varies=True),
    _moving('trapezoids of 1 deg/s with stops, 120 s', lambda seed: pick_and_place(seed, 120.0), 120.0, varies=True),
    _moving('one joint at a time', lambda _: paths.one_at_a_time(135.0), 135.0),
    _moving('a single joint', lambda _: sinusoids(only=[3])),
    _moving('a minute at rest first', lambda _: after(60.0, sinusoids()), 120.0),
    _moving('5 s of data', lambda _: sinusoids(), 5.0),
    _moving('300 s at 0.5 deg/s', lambda seed: pick_and_place(seed, 300.0, 0.5 * DEGREE), 300.0),
    _moving('one joint stuck', lambda _: sinusoids(only=[0, 1, 2, 4, 5, 6])),
    _shaped('all axes parallel', ((0, 0, 1),) * 5),
    _shaped('all axes collinear', ((0, 0, 1),) * 4, folded=True),
    _shaped('a single prismatic joint', ((1, 0, 0),), (0,)),
    _shaped('a prismatic joint among six', AXES, (2,)),
    _shaped('20 joints', (AXES * 4)[:20]),
    _of_weight('a light base, a tenth', BASE, 0.1),
    _of_weight('a heavy base, a hundredfold', BASE, 100.0),
    _of_weight('a target of 1.6 kg', LINK, 0.01),
    _of_weight('a target of 16,200 kg', LINK, 100.0),
    Condition(
        'undisturbed', 'tumbling at 20 deg/s', lambda _: World(robots.servicer(), sinusoids(), spin=(0.2, -0.15, 0.24))
    ),
)
