"""Conditions in which nothing is wrong: robots and motions of all kinds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.honesty.condition import Condition
from benchmarks.honesty.floating import World
from benchmarks.honesty.paths import DEGREE, Path, after, drawn, one_at_a_time, pick_and_place, servicer, sinusoids
from benchmarks.honesty.robots import BASE, LINK, chain, scaled
from benchmarks.honesty.robots import servicer as urdf

GROUP = 'undisturbed'
AXES = ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0))


def _moving(name: str, path: Callable[[int], Path], seconds: float = 60.0, *, varies: bool = False) -> Condition:
    """Return servicer7 with another motion."""
    return Condition(GROUP, name, lambda seed: World(urdf(), path(seed), seconds), varies=varies)


def _of_weight(name: str, link: str, factor: float) -> Condition:
    """Return servicer7 with a link of another weight."""
    return Condition(GROUP, name, lambda _: World(scaled(urdf(), link, factor), sinusoids()))


def _shaped(
    name: str, axes: tuple[tuple[int, int, int], ...], slides: tuple[int, ...] = (), *, folded: bool = False
) -> Condition:
    """Return a chain of another shape."""
    start = np.where(np.isin(np.arange(len(axes)), slides), 0.1, 0.3 * np.cos(np.arange(len(axes))))
    return Condition(GROUP, name, lambda _: World(chain(axes, slides, folded=folded), drawn(start, 1)))


def _one_stuck(_seed: int) -> Path:
    return sinusoids(only=[joint for joint in range(len(servicer().start)) if joint != 3])


UNDISTURBED = (
    _moving('sinusoids of the shipped robot', lambda _: sinusoids()),
    _moving('fast sinusoids', lambda _: sinusoids(pace=4.0)),
    _moving('small sinusoids, a tenth', lambda _: sinusoids(amplitude=0.1)),
    _moving('trapezoids of 1 deg/s with stops', lambda seed: pick_and_place(seed, 60.0), varies=True),
    _moving('trapezoids of 1 deg/s with stops, 120 s', lambda seed: pick_and_place(seed, 120.0), 120.0, varies=True),
    _moving('one joint at a time', lambda _: one_at_a_time(135.0), 135.0),
    _moving('a single joint', lambda _: sinusoids(only=[3])),
    _moving('a minute at rest first', lambda _: after(60.0, sinusoids()), 120.0),
    _moving('5 s of data', lambda _: sinusoids(), 5.0),
    _moving('300 s at 0.5 deg/s', lambda seed: pick_and_place(seed, 300.0, 0.5 * DEGREE), 300.0),
    _moving('one joint stuck', _one_stuck),
    _shaped('all axes parallel', ((0, 0, 1),) * 5),
    _shaped('all axes collinear', ((0, 0, 1),) * 4, folded=True),
    _shaped('a single prismatic joint', ((1, 0, 0),), (0,)),
    _shaped('a prismatic joint among six', AXES, (2,)),
    _shaped('20 joints', (AXES * 4)[:20]),
    _of_weight('a light base, a tenth', BASE, 0.1),
    _of_weight('a heavy base, a hundredfold', BASE, 100.0),
    _of_weight('a target of 1.6 kg', LINK, 0.01),
    _of_weight('a target of 16,200 kg', LINK, 100.0),
    Condition(GROUP, 'tumbling at 20 deg/s', lambda _: World(urdf(), sinusoids(), spin=(0.2, -0.15, 0.24))),
)
