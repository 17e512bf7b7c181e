"""A condition, those in which nothing is wrong, and hard starts without errors: a motion of its own for every seed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from benchmarks.honesty import paths, robots
from benchmarks.honesty.paths import DEGREE, Path, after, moves, pick_and_place, sinusoids, stuck
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


def _start(joints: int, slides: tuple[int, ...]) -> Array:
    return np.where(np.isin(np.arange(joints), slides), 0.1, 0.3 * np.cos(np.arange(joints)))


def _shaped(
    name: str, axes: tuple[tuple[int, int, int], ...], slides: tuple[int, ...] = (), *, folded: bool = False
) -> Condition:
    urdf, path = robots.chain(axes, slides, folded=folded), paths.drawn(_start(len(axes), slides), 1)
    return Condition('undisturbed', name, lambda _: World(urdf, path))


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


def _starting(name: str, path: Callable[[int], Path], seconds: float) -> tuple[Condition, Condition]:
    """Return servicer7 with a motion, once tumbling slowly and once at rest at first."""

    def world(seed: int, *spin: float) -> World:
        return World(robots.servicer(), path(seed), seconds, spin=spin or World.spin)  # type: ignore[arg-type]

    return (
        Condition('starts', f'start: {name}', world, varies=True),
        Condition('starts', f'start: {name}, from rest', lambda seed: world(seed, 0.0, 0.0, 0.0), varies=True),
    )


def _other(name: str, urdf: Callable[[], str], joints: int, slides: tuple[int, ...] = ()) -> Condition:
    start = _start(joints, slides)
    return Condition('starts', f'start: {name}', lambda seed: World(urdf(), paths.drawn(start, seed)), varies=True)


def _single(seed: int) -> Path:
    """Return a single joint, another one for every seed, that moves by trapezoids."""
    rng, count = np.random.default_rng([seed, 5]), len(paths.servicer().start)
    speed = DEGREE * rng.choice([-1.0, 1.0]) * np.eye(count)[seed % count]
    return moves([(length, speed * (-1.0) ** leg) for leg, length in enumerate(rng.uniform(8.0, 16.0, 12))], 2.0)


def _slow(seed: int) -> Path:
    return paths.drawn(paths.servicer().start, seed)


STARTS = (
    *_starting('sinusoids', _slow, 60.0),
    *_starting('trapezoids of 60 s', lambda seed: pick_and_place(seed, 60.0), 60.0),
    *_starting('trapezoids of 120 s', lambda seed: pick_and_place(seed, 120.0), 120.0),
    *_starting('one joint at a time, 270 s', lambda seed: paths.one_at_a_time(270.0, rest=0.1 * seed), 270.0),
    *_starting('a single joint', _single, 120.0),
    *_starting('a minute at rest first, then sinusoids', lambda seed: after(60.0, _slow(seed)), 120.0),
    *_starting('a minute at rest first, then trapezoids', lambda seed: pick_and_place(seed, 180.0, rest=60.0), 180.0),
    *_starting('5 s of data', _slow, 5.0),
    *_starting('300 s at 0.5 deg/s', lambda seed: pick_and_place(seed, 300.0, 0.5 * DEGREE), 300.0),
    *_starting('one joint stuck', lambda seed: stuck(seed % 7, _slow(seed)), 60.0),
    _other('all axes parallel', lambda: robots.chain(((0, 0, 1),) * 5), 5),
    _other('all axes collinear', lambda: robots.chain(((0, 0, 1),) * 4, folded=True), 4),
    _other('one prismatic joint', lambda: robots.chain(((1, 0, 0),), (0,)), 1, (0,)),
    _other('20 joints', lambda: robots.chain((AXES * 4)[:20]), 20),
    _other('40 joints', lambda: robots.chain((AXES * 7)[:40]), 40),
    *(
        _other(f'a base of {mass:g} kg', partial(robots.scaled, robots.servicer(), BASE, mass / 560.0), 7)
        for mass in (1e-6, 1.0, 1e6)
    ),
)
