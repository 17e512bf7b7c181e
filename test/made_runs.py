"""Replays made up of numbers, for the tests of what shows and exports them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.results.estimate import SENSOR_NOISE, ErrorBudget, Estimate, Event
from mbaid_ros.parameters import values_of
from mbaid_ros.replay.whole_run import Run, TopicStatistics
from simulated import CONFIG

# A body that can exist: mass, centre of mass, inertia about it.
BODY = np.array([162.0, 0.33, -0.21, 0.75, 27.6, -2.9, 1.3, 37.3, -1.0, 30.2])
STD = np.array([0.03, 1e-4, 1e-4, 2e-4, *[0.05] * 6])

PLAIN = '<script>document.title="stolen"</script>'
TERMINAL = '\x1b[2J\x1b]0;owned\x07'
HOSTILE = f'{PLAIN}"\'&$x_1$ {TERMINAL}\u202e'


def estimate(**changes: Any) -> Estimate:
    """Return an estimate of BODY."""
    values: dict[str, Any] = {
        'method': 'difference',
        'status': 'converged',
        'time': 10.0,
        'stamp': 1_700_000_010_000_000_000,
        'parameters': BODY,
        'covariance': np.diag(STD**2),
        'identifiable': np.ones(10, dtype=bool),
        'momentum': np.array([0.0, 0.1, 0.2, 29.0, -12.0, 196.0]),
        'momentum_covariance': 1e-4 * np.eye(6),
        'residual': 1.0,
        'samples': 1000,
        **changes,
    }
    return Estimate(**values)


def budget(link: str = 'base_link') -> ErrorBudget:
    """Return one of ten causes, of which a link and a joint's zero make most."""
    causes = (SENSOR_NOISE, f'link:{link}', 'zero:joint6', *(f'origin:joint{place}' for place in range(1, 7)), 'mount')
    shares = np.full((10, 10), 0.02)
    shares[0, 1], shares[1:4, 2], shares[4:, 0] = 0.71, 0.6, 0.8
    shares[:, 9] = 0.0
    shares[:, 9] = 1.0 - shares.sum(axis=1)
    return ErrorBudget(causes, shares)


def planar() -> Estimate:
    """Return an estimate of which only mass, two coordinates of the CoM and one moment are known."""
    known = np.isin(np.arange(10), [0, 1, 2, 9])
    covariance = np.diag(STD**2)
    covariance[~known] = covariance[:, ~known] = np.nan
    return estimate(parameters=np.where(known, BODY, np.nan), covariance=covariance, identifiable=known)


def history(final: Estimate, count: int = 30) -> tuple[Estimate, ...]:
    """Return estimates that converge to the last one."""
    entries = []
    for index in range(count):
        left = 1.0 - index / (count - 1)
        changes = {'time': final.time * (index + 1) / count, 'parameters': final.parameters * (1.0 + 0.1 * left)}
        status = 'estimating' if left > 0.5 else final.status
        entries.append(Estimate(**{**vars(final), **changes, 'status': status}))
    return (*entries[:-1], final)


def run(final: Estimate | None = None, **changes: Any) -> Run:
    """Return a replay of the seven-joint servicer."""
    end = estimate() if final is None else final
    values: dict[str, Any] = {
        'bag': 'a/bag',
        'target_link': 'link7',
        'final': end,
        'history': history(end),
        'topics': (
            TopicStatistics('/joint_states', 'sensor_msgs/msg/JointState', 1000, 100.0),
            TopicStatistics('/odom', 'nav_msgs/msg/Odometry', 1000, 100.0),
        ),
        'used': 990,
        'dropped': {'NaN or infinite value': 3},
        'warnings': ('3 messages not used: NaN or infinite value',),
        'urdf': (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8'),
        'settings': values_of(EstimatorConfig()),
        **changes,
    }
    return Run(**values)


def event() -> Event:
    """Return a push."""
    return Event(5.0, 'step', np.array([1.0, 0.0, np.nan]), np.array([0.0, 2.0, 0.0]), 'a push from outside')


def hostile_urdf(joint: str = HOSTILE, link: str = HOSTILE) -> str:
    """Return the paper's robot with names that try to break out of wherever they are shown."""
    text = (CONFIG / 'table1.urdf').read_text(encoding='utf-8')
    for old, new in (('link4', link), ('joint4', joint)):
        text = text.replace(f'"{old}"', f'"{xml(new)}"')
    return text


def xml(name: str) -> str:
    """Return a name as XML takes it in an attribute; characters that XML does not have are left out."""
    kept = ''.join(char for char in name if char.isprintable() or char == '\u202e')
    for char, entity in (('&', '&amp;'), ('<', '&lt;'), ('>', '&gt;'), ('"', '&quot;')):
        kept = kept.replace(char, entity)
    return kept
