"""Paths of joints: positions and rates at any instants."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np

from benchmarks.data import model, simulator_config
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.simulated_robot import make_motion
from mbaid_ros.simulation.motion import Sinusoids

# (N,) instants, s -> (N, n) positions, rates: rad, rad/s (m, m/s)
Path = Callable[[Array], tuple[Array, Array]]
DEGREE = np.pi / 180.0
ROBOT = 'servicer7'
_DWELL, _LEG = 2.0, 18.0  # s: of rest between poses, and of a joint that moves alone
_RAMP = 0.5  # s, to full speed and back


def following(motion: Sinusoids) -> Path:
    """Return sinusoids as a path."""

    def path(time: Array) -> tuple[Array, Array]:
        rate = 2.0 * np.pi * motion.frequency
        angle = rate * time[:, None, None] + motion.phase
        lifted = np.sin(angle) - np.sin(motion.phase)
        position = motion.start + np.sum(motion.amplitude * lifted, axis=2)
        return position, np.sum(motion.amplitude * rate * np.cos(angle), axis=2)

    return path


@cache
def servicer() -> Sinusoids:
    """Return the sinusoids of config/servicer7_simulator.yaml."""
    motion = make_motion(simulator_config(ROBOT), model(ROBOT))
    assert isinstance(motion, Sinusoids), 'the servicer moves by sinusoids'
    return motion


def sinusoids(amplitude: float = 1.0, pace: float = 1.0, only: Sequence[int] = ()) -> Path:
    """Return servicer7's sinusoids, larger and faster by factors; of some joints only if they are given."""
    motion = servicer()
    moving = np.isin(np.arange(len(motion.start)), only) if only else np.ones(len(motion.start), dtype=bool)
    size = amplitude * motion.amplitude * moving[:, None]
    return following(Sinusoids(motion.start, size, pace * motion.frequency, motion.phase))


def drawn(start: Array, seed: int, amplitude: float = 0.4) -> Path:
    """Return two slow sinusoids a joint for a robot of any number of joints (n,)."""
    rng = np.random.default_rng([seed, 77])
    shape = (len(start), 2)
    frequency = rng.uniform([0.025, 0.06], [0.04, 0.09], shape)
    size = amplitude * rng.uniform([0.7, 0.2], [1.0, 0.35], shape)
    return following(Sinusoids(start, size, frequency, rng.uniform(-np.pi, np.pi, shape)))


def by_rates(start: Array, knots: Array, rates: Array) -> Path:
    """Return joints whose rates (K, n) are linear between knots (K,), and constant outside."""
    length = np.diff(knots)[:, None]
    reached = np.concatenate((start[None], start + np.cumsum(0.5 * length * (rates[1:] + rates[:-1]), axis=0)))
    slope = np.concatenate(((rates[1:] - rates[:-1]) / length, np.zeros((1, rates.shape[1]))))

    def path(time: Array) -> tuple[Array, Array]:
        place = np.maximum(np.searchsorted(knots, time, side='right') - 1, 0)
        since = (time - knots[place])[:, None]
        return reached[place] + since * (rates[place] + 0.5 * since * slope[place]), rates[place] + since * slope[place]

    return path


def moves(legs: Sequence[tuple[float, Array]], dwell: float, rest: float = 0.0) -> Path:
    """Return trapezoids: legs of s and (n,) rad/s at full speed, s of rest after each, s before the first."""
    start = servicer().start
    still = np.zeros(len(start))
    knots, time = [-1.0], rest  # one before the first leg, even if it begins at once
    rates: list[Array] = [still]
    for length, speed in legs:
        knots += [time, time + _RAMP, time + length - _RAMP, time + length]
        rates += [still, speed, speed, still]
        time += length + dwell
    return by_rates(start, np.array(knots), np.array(rates))


def pick_and_place(seed: int, seconds: float, speed: float = DEGREE, rest: float = 0.0) -> Path:
    """Return all joints moving together between random poses with stops, the fastest of them at a speed (rad/s)."""
    rng = np.random.default_rng([seed, 11])
    legs, time, away = [], rest, np.zeros(len(servicer().start))
    while time < seconds:
        length = round(rng.uniform(6.0, 12.0), 1)
        share = rng.uniform(0.3, 1.0, len(away)) * rng.choice([-1.0, 1.0], len(away))
        share = np.where(np.abs(away) > 0.5, -np.sign(away) * np.abs(share), share)  # back from the limits
        legs.append((length, speed * share / np.max(np.abs(share))))
        away = away + (length - _RAMP) * legs[-1][1]
        time += length + _DWELL
    return moves(legs, _DWELL, rest)


def one_at_a_time(seconds: float, rest: float = 0.0) -> Path:
    """Return joints that move one at a time, forth and, the next time round, back."""
    count = len(servicer().start)
    number = int((seconds - rest) / (_LEG + 1.0)) + 1
    legs = [(_LEG, DEGREE * (-1.0) ** (leg // count) * np.eye(count)[leg % count]) for leg in range(number)]
    return moves(legs, 1.0, rest)


def after(rest: float, path: Path, ramp: float = 2.0) -> Path:
    """Return a path after some rest (s), which comes to full pace over a ramp (s)."""

    def late(time: Array) -> tuple[Array, Array]:
        since = np.maximum(time - rest, 0.0)
        share = np.minimum(since / ramp, 1.0)
        own = ramp * (share**3 - 0.5 * share**4) + np.maximum(since - ramp, 0.0)
        position, rate = path(own)
        return position, rate * (share**2 * (3.0 - 2.0 * share))[:, None]

    return late


def stuck(joint: int, path: Path) -> Path:
    """Return a path on which one joint does not move."""

    def held(time: Array) -> tuple[Array, Array]:
        position, rate = path(time)
        position[:, joint], rate[:, joint] = position[0, joint], 0.0
        return position, rate

    return held


def together(robot: RobotModel, arm: Path, others: Mapping[str, Path]) -> Path:
    """Return the arm's joints with others beside it, (N, 1) each, in the order of a robot's joints."""
    names = [name for name in robot.joint_names if name not in others]

    def path(time: Array) -> tuple[Array, Array]:
        parts = dict(zip(names, zip(*(np.moveaxis(values, 1, 0) for values in arm(time)), strict=True), strict=True))
        for name, other in others.items():
            position, rate = other(time)
            parts[name] = (position[:, 0], rate[:, 0])
        position, rate = (np.column_stack([parts[name][kind] for name in robot.joint_names]) for kind in (0, 1))
        return position, rate

    return path
