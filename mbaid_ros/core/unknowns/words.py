"""What may be wrong in words: the thing, the value, what to do; one line each."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.orbit import orbit_fixed_frame
from mbaid_ros.core.unknowns.base import SCALE, SPEEDS, TURNS
from mbaid_ros.core.unknowns.environment import GRAVITY, SHAPE, TORQUE, rate_of
from mbaid_ros.core.unknowns.joints import FLEXIBLE, TRACKING
from mbaid_ros.core.unknowns.sensors import CLOCK
from mbaid_ros.core.unknowns.suspects import LATE, TURNING

# By kind of cause, all of it, and where that is declared.
_KINDS = {
    'link': 'the links',
    'zero': "the joints' zeros",
    'origin': "the joints' origins",
    'axis': "the joints' axes",
    TRACKING: 'how far joints are from where they are read to be',
    'mount': 'position and orientation of the odometry mount',
    SHAPE: 'eccentricity and mean motion of the orbit',
    TORQUE: 'torques from outside',
}
_DECLARED_BY = {
    'link': 'known_links.relative_std',
    'mass': 'known_links.relative_std',
    'zero': 'known_joints.zero_std',
    'origin': 'known_joints.origin_std',
    'axis': 'known_joints.axis_std',
    TRACKING: 'known_joints.tracking_std',
    'mount': 'odometry_mount.position_std, .orientation_std',
    TORQUE: 'disturbance.torque_std',
    SHAPE: 'orbit.undeclared_eccentricity, or set orbit.eccentricity and orbit.true_anomaly',
}
_LARGEST_SIZE = 10.0  # that is tried (docs/trajectory.md, eq. 8): beyond it, how many times is not known


def of_change(time: float, *, exchanged: bool) -> str:
    """Return that the body moved in the grasp at a time, s, or was exchanged for another."""
    if exchanged:
        return f'another body is in the grasp since {time:.1f} s, caught or lost: identify it from then on'
    return f'the body moved in the grasp at {time:.1f} s: identify it again from then on'


def of_line(frequency: float) -> str:
    """Return that something swings at a frequency, Hz."""
    return f'something swings at {frequency:.2g} Hz: a panel, fuel or a flexible part, not rigid'


def of_swinging(joint: str, size: float) -> str:
    """Return that what a joint carries swings against its encoder by a size, rad or m."""
    return (
        f'{joint} is flexible or has play: what it carries swings against its encoder by about {1e3 * size:.1g} mrad '
        '(mm), as a spring does or a loose encoder'
    )


def of_size(cause: str, size: float, declared: Mapping[str, str] | None = None) -> str:
    """Return that a thing, or all of a kind, is so many times as far off as declared.

    Parameters
    ----------
    cause : of the error budget, 'link:arm', or a kind of them, 'link'
    size : how many times
    declared : by kind, parameters other than a run's
    """
    kind, _, name = cause.partition(':')
    parameter = {**_DECLARED_BY, **(declared or {})}.get(kind, 'its standard deviation')
    looks = 'looks' if name else 'look'
    times = f'{size:.1f}' if size < 0.95 * _LARGEST_SIZE else f'{_LARGEST_SIZE:g} or more'
    return f'{all_of(cause)} {looks} {times} times as far off as declared: intervals allow for that; raise {parameter}'


@lru_cache(maxsize=1024)  # asked for at each window
def all_of(cause: str) -> str:
    """Return a cause of the error budget, or a kind of them, in words: 'zero' is the joints' zeros."""
    return _KINDS.get(cause, named(cause))


def named(cause: str) -> str:
    """Return a cause of the error budget in words: 'link:arm' is link arm, 'zero:elbow' the zero of elbow."""
    kind, _, name = cause.partition(':')
    return f'{kind} {name}' if kind == 'link' else f'the {kind} of {name}' if name else kind


def of_suspect(cause: str, value: Array) -> str:
    """Return what an unknown would have to be.

    Parameters
    ----------
    cause : label of it
    value : its numbers, SI units
    """
    size = float(np.linalg.norm(value))
    kind, _, name = cause.partition(':')
    if kind == 'link':
        heavier = 'heavier' if value[0] > 0.0 else 'lighter'
        moment = ', '.join(f'{part:+.2g}' for part in value[1:4])
        return (
            f'link {name} is not as described: it looks {abs(value[0]):.3g} kg {heavier}, its first moment ({moment}) '
            'kg m off; check its inertial, or raise known_links.relative_std'
        )
    if kind == FLEXIBLE:
        load, lag, swing = (f'{1e3 * part:.2g}' for part in (value[0], value[1], float(np.hypot(*value[2:]))))
        return (
            f'{name} is flexible or geared: against its encoder it gives by {load} mrad/(N m), lags by {lag} ms and is '
            f'off by {swing} mrad (mm) with its own angle'
        )
    told = {
        'zero': f'the zero of {name} is off by {1e3 * float(np.sum(value)):+.3g} mrad (mm): measure it',
        TRACKING: f'{name} is {1e3 * float(np.sum(value)):+.3g} mrad (mm) from where it is read to be: log encoders, '
        'or raise known_joints.tracking_std',
        'origin': f'the origin of {name} is off by {1e3 * size:.3g} mm: check the URDF',
        'axis': f'the axis of {name} is off by {1e3 * size:.3g} mrad: check the URDF',
        'time offset': f'the joints are stamped {1e3 * float(np.sum(value)):+.3g} ms late: check the stamps',
        SCALE: f'the scale of the odometry is off: lengths {1e2 * float(np.sum(value)):+.2g} % too long; '
        'calibrate it, or raise odometry.scale_std',
        TURNING: orbit_fixed_frame(size),
        TORQUE: f'a torque of {size:.2g} N m acts from outside: find what pushes, or raise disturbance.torque_std',
        GRAVITY: f'a gravity gradient acts as at {rate_of(value):.2g} rad/s: set orbit.mean_motion',
        SHAPE: 'the orbit is no circle, or orbit.mean_motion is off: set orbit.eccentricity and orbit.true_anomaly',
        CLOCK: f'the clocks drift apart by {1e6 * float(np.sum(value)):+.3g} ppm: synchronise them, or raise '
        'time_offset.drift_std',
        LATE: f'the twist is {1e3 * float(np.sum(value)):+.3g} ms late against the pose: leave it out',
        TURNS: f'the angular velocity of the twist has a bias of {size:.2g} rad/s: leave the twist out, or raise '
        'odometry.angular_velocity_bias_std',
        SPEEDS: f'the velocity of the twist has a bias of {size:.2g} m/s: leave the twist out',
    }
    if kind == 'mount':
        return (
            f'the odometry is mounted {1e3 * np.linalg.norm(value[3:]):.3g} mm and '
            f'{1e3 * np.linalg.norm(value[:3]):.3g} mrad off: measure the mount'
        )
    return told.get(cause) or told.get(kind) or f'{cause} is off by {size:.3g}'
