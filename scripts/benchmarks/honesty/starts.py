"""Hard starts without errors: every seed has a motion of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.honesty import paths, robots
from benchmarks.honesty.conditions import AXES, Condition, drawn_start
from benchmarks.honesty.paths import DEGREE, Path, after, moves, pick_and_place, stuck
from benchmarks.honesty.robots import BASE
from benchmarks.honesty.worlds import World


def _starting(name: str, path: Callable[[int], Path], seconds: float) -> tuple[Condition, Condition]:
    """Return servicer7 with a motion, once tumbling slowly and once at rest at first."""

    def world(seed: int, *spin: float) -> World:
        return World(robots.servicer(), path(seed), seconds, spin=spin or World.spin)  # type: ignore[arg-type]

    return (
        Condition('starts', f'start: {name}', world, varies=True),
        Condition('starts', f'start: {name}, from rest', lambda seed: world(seed, 0.0, 0.0, 0.0), varies=True),
    )


def _other(name: str, urdf: Callable[[], str], joints: int, slides: tuple[int, ...] = ()) -> Condition:
    """Return another robot with slow sinusoids."""
    start = drawn_start(joints, slides)
    return Condition('starts', f'start: {name}', lambda seed: World(urdf(), paths.drawn(start, seed)), varies=True)


def _single(seed: int) -> Path:
    """Return a single joint, another one for every seed, that moves by trapezoids."""
    rng, count = np.random.default_rng([seed, 5]), len(paths.servicer().start)
    speed = DEGREE * rng.choice([-1.0, 1.0]) * np.eye(count)[seed % count]
    return moves([(length, speed * (-1.0) ** leg) for leg, length in enumerate(rng.uniform(8.0, 16.0, 12))], 2.0)


def _slow(seed: int) -> Path:
    return paths.drawn(paths.servicer().start, seed)


def _with_base(mass: float) -> str:
    return robots.scaled(robots.servicer(), BASE, mass / 560.0)


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
    *(_other(f'a base of {mass:g} kg', partial(_with_base, mass), 7) for mass in (1e-6, 1.0, 1e6)),
)
