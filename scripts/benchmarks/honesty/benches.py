"""Conditions in which several things are a little off at once, as on a bench: nothing of it alone would be noticed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.data import LEVELS, drawn
from benchmarks.honesty import readings, robots, views
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.disturbed_worlds import PULSE
from benchmarks.honesty.floating import World, Wrench
from benchmarks.honesty.paths import DEGREE, ROBOT, Path, pick_and_place, sinusoids
from benchmarks.honesty.readings import Defect, Readings
from benchmarks.model_errors.variant import DEFAULT, LEVEL
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import true_robot

GROUP = 'benches'
_ZERO = 1e-3  # rad, of joint4
_PLACE, _TURN = np.array([2e-3, -1e-3, 1.5e-3]), np.array([1.5e-3, -1e-3, 2e-3])  # m, rad, of the odometry's mount
_BIAS = 3e-5  # rad/s


def _robot(seed: int, path: Path, wrench: Wrench | None = None) -> World:
    """Return servicer7 with links, origins and axes off by what the estimator's defaults say, the target exact."""
    nominal = load_model(robots.servicer())
    urdf = true_robot(nominal, drawn(ROBOT, DEFAULT, seed), (nominal.last_link,)).urdf
    return World(urdf, path, wrench=wrench)


def _mounted(truth: Truth) -> Truth:
    """Return the motion as encoders and odometry see it that are off."""
    return views.mounted(_PLACE, _TURN, views.zero_off(3, _ZERO, truth))


def _all(*defects: Defect) -> Defect:
    """Return one defect after the other."""

    def spoilt(found: Readings, rng: np.random.Generator) -> Readings:
        for defect in defects:
            found = defect(found, rng)
        return found

    return spoilt


def _bench(name: str, world: Callable[[int], World], *defects: Defect, declared: float = 1.0) -> Condition:
    """Return such a robot whose noise is declared so many times as large as it is."""
    channels = dict.fromkeys(vars(LEVELS[LEVEL]), declared)
    return Condition(
        GROUP, name, world, lambda _urdf: robots.servicer(), _mounted, _all(*defects), channels, varies=True
    )


def _swinging(seed: int) -> World:
    return _robot(seed, sinusoids())


def _working(seed: int) -> World:
    return _robot(seed, pick_and_place(seed, 60.0, 5.0 * DEGREE))


def _pushed(seed: int) -> World:
    return _robot(seed, sinusoids(), PULSE)


BENCHES = (
    _bench('a bench: all of the model off by its default', _swinging),
    _bench(
        'a bench: encoders of 14 bits, joints 8 ms late, poses at 33 Hz, 0.5 % outliers',
        _swinging,
        partial(readings.quantised, 2.0 * np.pi / 2**14),
        partial(readings.joints_late, 8e-3, 0.0),
        partial(readings.outliers, 0.005),
        partial(readings.thinned, 3),
    ),
    _bench(
        'a bench: stops at 5 deg/s, poses correlated over 0.1 s, gyro bias, 2 s without poses',
        _working,
        partial(readings.correlated, 0.1),
        partial(readings.gyro_biased, _BIAS),
        partial(readings.dropout, 25.0, 27.0),
    ),
    _bench(
        'a bench: poses repeated, clocks 50 ppm apart, noise declared twice as small',
        _working,
        partial(readings.joints_late, 2e-3, 5e-5),
        partial(readings.repeated, 3),
        declared=0.5,
    ),
    _bench(
        'a bench: encoders of 12 bits, not declared, and a thrust pulse',
        _pushed,
        partial(readings.quantised, 2.0 * np.pi / 2**12),
    ),
)
