"""Conditions that are hard to start in, nothing of which is wrong: every seed has a motion of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.honesty import robots
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.floating import World
from benchmarks.honesty.paths import DEGREE, Path, after, drawn, moves, one_at_a_time, pick_and_place, servicer
from benchmarks.honesty.undisturbed import AXES
from mbaid_ros.core.geometry import Array

GROUP = 'starts'
_STILL = (0.0, 0.0, 0.0)


def _moving(name: str, path: Callable[[int], Path], seconds: float) -> tuple[Condition, Condition]:
    """Return servicer7 with a motion, once tumbling slowly and once at rest at first."""
    return (
        Condition(GROUP, name, lambda seed: World(robots.servicer(), path(seed), seconds), varies=True),
        Condition(
            GROUP,
            f'{name}, from rest',
            lambda seed: World(robots.servicer(), path(seed), seconds, spin=_STILL),
            varies=True,
        ),
    )


def _of(
    name: str, urdf: Callable[[], str], joints: int, slides: tuple[int, ...] = (), seconds: float = 60.0
) -> Condition:
    """Return another robot with slow sinusoids."""
    start = np.where(np.isin(np.arange(joints), slides), 0.1, 0.3 * np.cos(np.arange(joints)))
    return Condition(GROUP, name, lambda seed: World(urdf(), drawn(start, seed), seconds), varies=True)


def _single(seed: int) -> Path:
    """Return a single joint, another one for every seed, that moves by trapezoids."""
    rng, count = np.random.default_rng([seed, 5]), len(servicer().start)
    speed = DEGREE * rng.choice([-1.0, 1.0]) * np.eye(count)[seed % count]
    return moves([(length, speed * (-1.0) ** leg) for leg, length in enumerate(rng.uniform(8.0, 16.0, 12))], 2.0)


def _sinusoids(seed: int) -> Path:
    return drawn(servicer().start, seed)


def _one_stuck(seed: int) -> Path:
    """Return slow sinusoids of all joints but one."""
    path, stuck = _sinusoids(seed), seed % len(servicer().start)

    def held(time: Array) -> tuple[Array, Array]:
        position, rate = path(time)
        position[:, stuck], rate[:, stuck] = position[0, stuck], 0.0
        return position, rate

    return held


def _with_base(mass: float) -> str:
    return robots.scaled(robots.servicer(), robots.BASE, mass / 560.0)


STARTS = (
    *_moving('start: sinusoids', _sinusoids, 60.0),
    *_moving('start: trapezoids of 60 s', lambda seed: pick_and_place(seed, 60.0), 60.0),
    *_moving('start: trapezoids of 120 s', lambda seed: pick_and_place(seed, 120.0), 120.0),
    *_moving('start: one joint at a time, 270 s', lambda seed: one_at_a_time(270.0, rest=0.1 * seed), 270.0),
    *_moving('start: a single joint', _single, 120.0),
    *_moving('start: a minute at rest first, then sinusoids', lambda seed: after(60.0, _sinusoids(seed)), 120.0),
    *_moving(
        'start: a minute at rest first, then trapezoids', lambda seed: pick_and_place(seed, 180.0, rest=60.0), 180.0
    ),
    *_moving('start: 5 s of data', _sinusoids, 5.0),
    *_moving('start: 300 s at 0.5 deg/s', lambda seed: pick_and_place(seed, 300.0, 0.5 * DEGREE), 300.0),
    *_moving('start: one joint stuck', _one_stuck, 60.0),
    _of('start: all axes parallel', lambda: robots.chain(((0, 0, 1),) * 5), 5),
    _of('start: all axes collinear', lambda: robots.chain(((0, 0, 1),) * 4, folded=True), 4),
    _of('start: one prismatic joint', lambda: robots.chain(((1, 0, 0),), (0,)), 1, (0,)),
    _of('start: 20 joints', lambda: robots.chain((AXES * 4)[:20]), 20),
    _of('start: 40 joints', lambda: robots.chain((AXES * 7)[:40]), 40),
    *(
        _of(
            f'start: a base of {mass:g} kg',
            partial(_with_base, mass),
            7,
        )
        for mass in (1e-6, 1.0, 1e6)
    ),
)
