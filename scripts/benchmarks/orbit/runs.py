"""Runs of the servicer in orbit: what they come to, a line a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks.data import LEVELS, model
from benchmarks.honesty.floating import World, float_freely
from benchmarks.honesty.paths import ROBOT, sinusoids
from benchmarks.honesty.readings import read
from benchmarks.honesty.runs import history, messages
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array, unvec
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.robot.orbit import Orbit
from mbaid_ros.session import Session
from mbaid_ros.simulation.simulation import Truth, seen_from_orbit

MEAN_MOTION = 1.1308e-3  # rad/s, at 400 km
NADIR, NORMAL = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
ANOMALY = np.pi / 3.0  # rad, at the begin of an orbit that is no circle
PLACES = {'at': np.zeros(3), 'away': np.array([12.0, -10.0, 13.0])}  # m from the frame's origin: 0 and 20
PACES = {'fast': 8.0, 'slow': 0.25}  # times the sinusoids of config/: up to 20 to 40 deg/s, and 0.6 to 1.3
FRAMES = ('inertial', 'lvlh', 'hill')
NOISE = LEVELS['mid']
# Eccentricity of an orbit that is declared without, and whether it is taken for a circle for sure.
CIRCLES = ((0.0, True), (0.0, False), (0.001, True), (0.001, False), (0.002, False))
DURATIONS = (60.0, 300.0)  # s: a shorter run is the begin of the longer one
RATE = 20.0  # Hz

Kept = set[tuple[Any, ...]]  # what need not be run again


def orbit_of(frame: str, eccentricity: float = 0.0) -> Orbit:
    """Return the orbit as seen in a frame of the odometry."""
    if frame == 'inertial':
        circle = Orbit.inertial(MEAN_MOTION, NADIR, NORMAL)
    else:
        circle = Orbit.turning_with(MEAN_MOTION, 'lvlh' if frame == 'lvlh' else 'hill')
    return circle.eccentric(eccentricity, ANOMALY)


@cache
def moved(pace: str, frame: str, place: str, seconds: float, eccentricity: float = 0.0) -> Truth:
    """Return the motion as the odometry's frame sees it; of no frame in empty space."""
    world = World(model(ROBOT).urdf, sinusoids(pace=PACES[pace]), seconds=seconds, rate=RATE)
    if not frame:
        return float_freely(world)
    around, away = orbit_of(frame, eccentricity), PLACES[place]

    def tide(now: float, rotation: Array, position: Array, whole: Array) -> Array:
        """Return what gravity does to the whole robot, by the integrals of x and x x^T over its mass."""
        gradient = around.gradient(np.array([now]))[0]
        first, inertia = rotation @ whole[1:4], rotation @ unvec(whole[4:]) @ rotation.T
        second = 0.5 * np.trace(inertia) * np.eye(3) - inertia  # about the base
        mean = position + away
        force = gradient @ (whole[0] * mean + first)
        weighed = (second + np.outer(first, mean) + np.outer(position, whole[0] * mean + first)) @ gradient
        couple = weighed[[1, 2, 0], [2, 0, 1]] - weighed[[2, 0, 1], [1, 2, 0]]
        return np.concatenate((force, couple))

    truth = float_freely(replace(world, wrench=tide))
    truth = replace(truth, base_position=truth.base_position + away)
    return seen_from_orbit(around, truth, relative_twist=True) if around.turning else truth


def declared(frame: str) -> dict[str, object]:
    """Return the parameters of an orbit."""
    given = {'orbit.nadir': NADIR.tolist(), 'orbit.normal': NORMAL.tolist()} if frame == 'inertial' else {}
    return {'orbit.mean_motion': MEAN_MOTION, 'orbit.frame': frame, **given} if frame else {}


def estimates(truth: Truth, seed: int, parameters: Mapping[str, object]) -> list[Estimate]:
    """Return what is estimated of a motion that sensors read."""
    session = Session(build(EstimatorConfig, {**sensors(), **parameters}), model(ROBOT).urdf)
    return history(session, messages(session, read(truth, NOISE, seed), model(ROBOT), NOISE))


def sensors() -> dict[str, object]:
    """Return the parameters of what is sought, and of the sensors."""
    return {'target_link': 'link7', **{f'noise.{name}': value for name, value in vars(NOISE).items()}}


def told(found: Sequence[Estimate], seconds: float) -> dict[str, Any]:
    """Return what a run says at a time."""
    last = [each for each in found if each.time < seconds + 1e-6][-1]
    sought = physical(model(ROBOT).link('link7').parameters)
    error = last.parameters - sought
    known = np.isfinite(error).all()
    nees = float(error @ np.linalg.solve(last.covariance, error)) if known else None
    named = [cause for cause, _ in last.causes] + [event.cause for event in last.events]
    return {
        'seconds': seconds,
        'status': last.status,
        'error': error.tolist() if known else None,
        'std': last.std.tolist() if known else None,
        'nees': nees,
        'named': named[:3],
    }


def grid(seed: int, kept: Kept, durations: Sequence[float] = DURATIONS) -> Iterator[dict[str, Any]]:
    """Yield what comes of every motion in every frame, and in no orbit."""
    for pace in PACES:
        for frame, place in (('', 'at'), *((frame, place) for frame in FRAMES for place in PLACES)):
            if ('grid', pace, frame, place, seed) not in kept:
                truth = moved(pace, frame, place, durations[-1])
                found = estimates(truth, seed, {**EXACT, **declared(frame)})
                for seconds in durations:
                    yield {'pace': pace, 'frame': frame, 'place': place, **told(found, seconds)}


def undeclared(seed: int, kept: Kept, durations: Sequence[float] = DURATIONS) -> Iterator[dict[str, Any]]:
    """Yield the same where nobody has said that there is an orbit."""
    exact = {name: value for name, value in EXACT.items() if not name.startswith('orbit')}
    for pace in PACES:
        for frame in FRAMES:
            for place in PLACES:
                if ('undeclared', pace, frame, place, seed) not in kept:
                    found = estimates(moved(pace, frame, place, durations[-1]), seed, exact)
                    for seconds in durations:
                        yield {'pace': pace, 'frame': frame, 'place': place, **told(found, seconds)}


def circle(seed: int, kept: Kept) -> Iterator[dict[str, Any]]:
    """Yield what comes of an orbit that is a little eccentric where its mean motion alone is said."""
    exact = {name: value for name, value in EXACT.items() if not name.startswith('orbit')}
    for frame in FRAMES[:2]:
        for pace in PACES:
            for place in PLACES:
                for eccentricity, believed in CIRCLES:
                    where = circle_at(place, (eccentricity, believed))
                    if ('circle', pace, frame, where, seed) not in kept:
                        truth = moved(pace, frame, place, DURATIONS[-1], eccentricity)
                        given = {**exact, **declared(frame)}
                        if believed:
                            given['orbit.undeclared_eccentricity'] = 0.0
                        found = estimates(truth, seed, given)
                        for seconds in DURATIONS:
                            yield {'pace': pace, 'frame': frame, 'place': where, **told(found, seconds)}


def circle_at(place: str, case: tuple[float, bool]) -> str:
    """Return where a run of `circle` is, how eccentric, and whether it is taken for a circle for sure."""
    eccentricity, believed = case
    return f'{place}, e = {eccentricity:g}, {"taken for" if believed else "may be no"} circle'
