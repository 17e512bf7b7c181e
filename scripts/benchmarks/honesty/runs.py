"""Runs of a condition through a session in memory, and the verdict on them."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtri

from benchmarks.data import NOISE, history
from benchmarks.frame import PUBLISHED, Runs, declared
from benchmarks.honesty.disturbed import CATALOGUE
from benchmarks.honesty.readings import Readings, read
from benchmarks.honesty.worlds import World, float_freely, swing
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.method import FIRST_ESTIMATE
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.errors import MbaidError
from mbaid_ros.parameters import build
from mbaid_ros.replay.campaigns.statistics import QUANTILE, nees
from mbaid_ros.sensor_messages import Joints, Poses, joints_of, poses_of
from mbaid_ros.session.session import Session
from mbaid_ros.simulation.simulation import Truth

REFUSED = 'refused'
REPAIRED = 'trajectory with repair'  # in place of a method
FAR = 5.0  # standard deviations: an error beyond is wrong
_FEWEST_COVERED = 0.6  # of the parameters, over the seeds
_WORDS = 150  # characters of a cause
_TRUE_CAUSES = {condition.name: condition.cause for condition in CATALOGUE.values() if condition.cause}


@dataclass(frozen=True)
class Outcome(Runs):
    """One run, or many with a leading axis. Errors are largest ones over their deviations, over all estimates."""

    status: Any  # at the end; `refused` if robot or parameters are not accepted
    error: Array  # (10,) at the end; NaN where not published
    std: Array  # (10,)
    jointly: Any  # joint error of all parameters at the end, as deviations of a single one that is as unlikely
    named: Any  # first cause or warning
    causes: Any  # all causes, the likeliest first, a line each
    first: Any  # s, of the first estimate with a number; infinite for none
    worst: Any  # error of any estimate during the run, except first ones
    worst_at: Any  # s, its time
    young: Any  # error of estimates with the warning that they are first ones
    windows: Any  # number of estimates
    alarms: Any  # of inconsistent ones


@lru_cache(maxsize=4)
def _moved(name: str, seed: int) -> tuple[World, Truth]:
    world = CATALOGUE[name].world(seed)
    return world, swing(world) if world.springs else float_freely(world)


def run(row: tuple[str, str], seed: int) -> Outcome:
    """Return the outcome of one run of a row: name of a condition, and a method or REPAIRED."""
    name, method = row
    repair = method == REPAIRED
    method = 'trajectory' if repair else method
    condition = CATALOGUE[name]
    world, truth = _moved(name, seed if condition.varies else 0)
    robot = load_model(world.urdf)
    target = robot.link(condition.target or load_model(condition.believed(world.urdf)).last_link)
    sought = physical(target.parameters) if world.sought is None else world.sought
    noise = replace(NOISE, **{name: factor * getattr(NOISE, name) for name, factor in condition.declared.items()})
    seen = np.array([name not in world.unread for name in robot.joint_names])
    joints = {name: getattr(truth, name)[:, seen] for name in ('joint_position', 'joint_velocity', 'joint_effort')}
    clean = read(condition.view(replace(truth, **joints)), NOISE, seed)
    readings = condition.defect(clean, np.random.default_rng([seed, 3]))
    read_robot = replace(robot, joint_names=tuple(np.array(robot.joint_names)[seen].tolist()))
    values = {'method': method, 'target_link': condition.target, 'repair': repair, **declared(noise)}
    try:
        session = Session(build(EstimatorConfig, values), condition.believed(world.urdf))
        estimates = history(session, published(readings, read_robot, noise))
        if session.robot.target_link != target.name:  # by a repair
            sought = physical(robot.link(session.robot.target_link).parameters)
        return _outcome(estimates, sought, world.since)
    except MbaidError as error:
        return _silent(REFUSED, str(error)[:_WORDS])


def published(readings: Readings, robot: RobotModel, noise: SensorNoise) -> list[Poses | Joints]:
    """Return the readings as they are published, with a declared noise."""
    covariances = {'pose_covariance': noise.pose_covariance(), 'twist_covariance': noise.twist_covariance()}
    base = poses_of(replace(readings.base, **covariances), robot.base_link)
    return [base, joints_of(readings.joints, robot.joint_names)]


def _outcome(history: list[Estimate], sought: Array, since: float) -> Outcome:
    if not history:
        return _silent('waiting', '')
    last = history[-1]
    error, std = (np.array([getattr(each, name) for each in history]) for name in ('parameters', 'std'))
    error = error - sought
    published = np.array([each.status in PUBLISHED and each.time > since for each in history])
    given = published[:, None] & np.isfinite(error) & (std > 0.0)
    deviation = np.max(np.abs(np.divide(error, std, out=np.zeros(error.shape), where=given)), axis=1)
    young = np.array([FIRST_ESTIMATE in each.warnings for each in history])
    later = np.where(young, 0.0, deviation)
    time = np.array([each.time for each in history])
    causes, events = [cause for cause, _ in last.causes], [event.cause for event in last.events]
    return Outcome(
        status=last.status,
        error=error[-1],
        std=std[-1],
        jointly=jointly(last, sought),
        named=next(iter([*map(str, last.repairs), *causes, *events, *last.warnings]), '')[:_WORDS],
        causes='\n'.join(causes or events),
        first=float(np.min(time[np.any(given, axis=1)], initial=np.inf)),
        worst=float(np.max(later)),
        worst_at=float(time[np.argmax(later)]),
        young=float(np.max(deviation, where=young, initial=0.0)),
        windows=len(history),
        alarms=sum(each.status == 'inconsistent' for each in history),
    )


def _silent(status: str, named: str) -> Outcome:
    nothing = np.full(10, np.nan)
    return Outcome(status, nothing, nothing, np.nan, named, '', np.inf, 0.0, np.nan, 0.0, 0, 0)


def jointly(last: Estimate, sought: Array) -> float:
    """Return the joint error of all parameters, as standard deviations of a single one that is as unlikely."""
    freedom = int(np.sum(np.isfinite(last.std) & np.isfinite(last.parameters)))
    if not freedom:
        return np.nan
    chance = chdtrc(freedom, freedom * nees(last, sought))
    return float(-ndtri(0.5 * max(chance, np.finfo(float).tiny)))  # at most 37


def rank(condition: str, causes: Sequence[str]) -> int:
    """Return the place of the true cause of a condition among named ones, from 1 on; 0 if it is not there."""
    truth = re.compile(_TRUE_CAUSES[condition])
    return next((place for place, cause in enumerate(causes, start=1) if truth.search(cause)), 0)


@dataclass(frozen=True)
class Verdict:
    """The runs of a condition together; NaN without any that ends well."""

    statuses: Counter[str]  # at the end
    covered: float  # share of the 95 % intervals that hold the truth, of the runs that end well
    largest: float  # error of any of their parameters, standard deviations
    jointly: float  # the same of all parameters of a run together
    ever: float  # of any estimate during a run, except first ones
    ever_at: float  # s
    young: float  # of first ones
    windows: int  # estimates of all runs
    alarms: int  # inconsistent ones
    named: str  # cause or warning that most runs name first
    silently_wrong: bool  # a good status, and wrong
    # of the true cause in each run, 0 if missing; none for runs that are right and name nothing
    places: tuple[int, ...]


def judged(outcome: Outcome, condition: str = '') -> Verdict:
    """Return the verdict on the runs of a condition."""
    good = np.isin(outcome.status, PUBLISHED)[:, None]
    given = good & np.isfinite(outcome.error) & (outcome.std > 0.0)
    deviation = np.abs(outcome.error[given] / outcome.std[given])
    covered = float(np.mean(deviation < QUANTILE)) if len(deviation) else np.nan
    together = outcome.jointly[good[:, 0] & np.isfinite(outcome.jointly)]
    largest, joint = (float(np.max(values)) if len(values) else np.nan for values in (deviation, together))
    pairs = zip(outcome.status, outcome.causes, strict=True) if condition in _TRUE_CAUSES else ()
    return Verdict(
        statuses=Counter(outcome.status.tolist()),
        covered=covered,
        largest=largest,
        jointly=joint,
        ever=float(np.max(outcome.worst)),
        ever_at=float(outcome.worst_at[np.argmax(outcome.worst)]),
        young=float(np.max(outcome.young)),
        windows=int(np.sum(outcome.windows)),
        alarms=int(np.sum(outcome.alarms)),
        named=Counter(outcome.named.tolist()).most_common(1)[0][0],
        silently_wrong=bool(np.fmax(largest, joint) > FAR or covered < _FEWEST_COVERED),
        places=tuple(
            rank(condition, causes.split('\n'))
            for status, causes in pairs
            if causes or status not in (*PUBLISHED, REFUSED)
        ),
    )
