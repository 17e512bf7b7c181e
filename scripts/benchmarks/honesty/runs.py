"""One run of a condition through a session in memory, and what many of them come to."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtri

from benchmarks.data import LEVELS
from benchmarks.honesty.catalogue import CATALOGUE
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.floating import World, float_freely
from benchmarks.honesty.readings import Readings, read
from benchmarks.honesty.springs import swing
from benchmarks.speed_bag import START
from benchmarks.store import Runs
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.two_stage import YOUNG
from mbaid_ros.outgoing import SensorMessages
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.replay.campaigns.monte_carlo import nees
from mbaid_ros.session import Session
from mbaid_ros.simulation.simulation import Truth

PUBLISHED = ('estimating', 'converged')
REFUSED = 'refused'
_MESSAGES_AT_ONCE = 2_000  # as in `replay`
_WORDS = 150  # characters kept of what is named
_NOISE = LEVELS['mid']


@dataclass(frozen=True)
class Told:
    """What a run said.

    Attributes
    ----------
    status : at its end; `refused` where it took neither robot nor parameters
    error, std : (10,) at its end; NaN where not published
    jointly : how far off all parameters at its end are together in the metric of their covariance: the standard
        deviations that a single one would be off by, to be as unlikely; NaN where not published
    named : the first cause or warning that it named
    causes : all causes that it named, the likeliest first, a line each
    first : s, of the first estimate with a number; infinite where there is none
    worst : largest error of any parameter over its standard deviation in any estimate published during the run, but for
        those that say that they are first ones
    worst_at : s, when that was
    young : the same of those
    windows, alarms : number of estimates, and of those that are inconsistent
    """

    status: str
    error: Array
    std: Array
    jointly: float
    named: str
    causes: str
    first: float
    worst: float
    worst_at: float
    young: float
    windows: int
    alarms: int


@dataclass(frozen=True)
class Outcome(Runs):
    """What the runs of a condition said: as in Told, with a leading axis."""

    status: Array
    error: Array
    std: Array
    jointly: Array
    named: Array
    causes: Array
    first: Array
    worst: Array
    worst_at: Array
    young: Array
    windows: Array
    alarms: Array


@lru_cache(maxsize=4)
def _moved(name: str, seed: int) -> tuple[World, Truth]:
    world = CATALOGUE[name].world(seed)
    return world, swing(world) if world.springs else float_freely(world)


def run(work: tuple[str, str, int]) -> Told:
    """Return what a method says of one run: name of a condition, method, seed."""
    name, method, seed = work
    condition = CATALOGUE[name]
    world, truth = _moved(name, seed if condition.varies else 0)
    robot = load_model(world.urdf)
    target = robot.link(condition.target or load_model(condition.believed(world.urdf)).last_link)
    sought = physical(target.parameters) if world.sought is None else world.sought
    noise = replace(_NOISE, **{name: factor * getattr(_NOISE, name) for name, factor in condition.declared.items()})
    readings = condition.defect(_read(world, condition, truth, robot, seed), np.random.default_rng([seed, 3]))
    values: dict[str, object] = {'method': method, 'target_link': condition.target}
    values |= {f'noise.{name}': value for name, value in vars(noise).items()}
    try:
        session = Session(build(EstimatorConfig, values), condition.believed(world.urdf))
        return _told(
            history(session, messages(session, readings, _read_joints(world, robot), noise)), sought, world.since
        )
    except MbaidError as error:
        return _silent(REFUSED, str(error)[:_WORDS])


def _read(world: World, condition: Condition, truth: Truth, robot: RobotModel, seed: int) -> Readings:
    """Return what the sensors read, without the joints that have none."""
    seen = np.array([name not in world.unread for name in robot.joint_names])
    read_alone = {name: getattr(truth, name)[:, seen] for name in ('joint_position', 'joint_velocity', 'joint_effort')}
    return read(condition.view(replace(truth, **read_alone)), _NOISE, seed)


def _read_joints(world: World, robot: RobotModel) -> RobotModel:
    return replace(robot, joint_names=tuple(name for name in robot.joint_names if name not in world.unread))


def history(session: Session, messages: Iterator[tuple[Callable[[Any], Any], Any]]) -> list[Estimate]:
    """Return all estimates of a session that is given messages."""
    found: list[Estimate] = []
    for number, (take, message) in enumerate(messages, start=1):
        take(message)
        if number % _MESSAGES_AT_ONCE == 0:
            found += session.process()
    return found + session.process()


def messages(
    session: Session, readings: Readings, robot: RobotModel, noise: SensorNoise
) -> Iterator[tuple[Callable[[Any], Any], Any]]:
    """Yield the messages of a run in the order of their stamps, each with what takes it."""
    made = SensorMessages(BAG_TYPES, robot, 'odom')
    declared = {'pose_covariance': noise.pose_covariance(), 'twist_covariance': noise.twist_covariance()}
    joints, base = readings.joints, replace(readings.base, **declared)
    stamps = [np.round(part.time * 1e9).astype(np.int64) for part in (base, joints)]
    kind = np.repeat([0, 1], [len(part) for part in stamps])
    row = np.concatenate([np.arange(len(part)) for part in stamps])
    stamp = np.concatenate(stamps)
    for place in np.argsort(stamp, kind='stable'):
        index, at = int(row[place]), START + int(stamp[place])
        if kind[place]:
            yield session.add_joint_state, made.joint_state(joints, index, at)
        else:
            yield session.add_odometry, made.odometry(base, index, at)


def _told(history: list[Estimate], sought: Array, since: float = 0.0) -> Told:
    if not history:
        return _silent('waiting', '')
    last = history[-1]
    error, std = (np.array([getattr(each, name) for each in history]) for name in ('parameters', 'std'))
    error = error - sought
    published = np.array([each.status in PUBLISHED and each.time > since for each in history])
    given = published[:, None] & np.isfinite(error) & (std > 0.0)
    deviation = np.max(np.abs(np.divide(error, std, out=np.zeros(error.shape), where=given)), axis=1)
    young = np.array([YOUNG in each.warnings for each in history])
    later = np.where(young, 0.0, deviation)
    time = np.array([each.time for each in history])
    return Told(
        status=last.status,
        error=error[-1],
        std=std[-1],
        jointly=jointly(last, sought),
        named=_named(last),
        causes='\n'.join(cause for cause, _ in last.causes) or '\n'.join(event.cause for event in last.events),
        first=float(np.min(time[np.any(given, axis=1)], initial=np.inf)),
        worst=float(np.max(later)),
        worst_at=float(time[np.argmax(later)]),
        young=float(np.max(deviation, where=young, initial=0.0)),
        windows=len(history),
        alarms=sum(each.status == 'inconsistent' for each in history),
    )


def _silent(status: str, named: str) -> Told:
    nothing = np.full(10, np.nan)
    return Told(status, nothing, nothing, np.nan, named, '', np.inf, 0.0, np.nan, 0.0, 0, 0)


def jointly(last: Estimate, sought: Array) -> float:
    """Return how far all parameters of an estimate are off together, in standard deviations of a single one."""
    freedom = int(np.sum(np.isfinite(last.std) & np.isfinite(last.parameters)))
    if not freedom:
        return np.nan
    chance = chdtrc(freedom, freedom * nees(last, sought))
    return float(-ndtri(0.5 * max(chance, np.finfo(float).tiny)))  # as far as there are numbers for it: 37


def _named(last: Estimate) -> str:
    """Return the first cause that an estimate names, or else its first warning."""
    told = [*(cause for cause, _ in last.causes), *(event.cause for event in last.events), *last.warnings]
    return told[0][:_WORDS] if told else ''


def run_file(store: Path, name: str, method: str) -> Path:
    """Return the file that keeps the runs of a condition."""
    return store / f'{method}-{re.sub(r"[^0-9A-Za-z+-]+", "_", name)}.npz'
