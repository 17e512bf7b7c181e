"""The International Space Station: public flight telemetry as ISS-Mimic has recorded it, a text file a channel."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.geometry import (
    Array,
    exp,
    log,
    quaternion_from_rotation,
    rotate,
    rotate_back,
    rotation_from_quaternion,
)
from mbaid_ros.errors import DataError
from mbaid_ros.files import read_text
from mbaid_ros.recordings.recording import Recording, resource
from mbaid_ros.sensor_messages import Imu, Joints, StoredMomentum

JOINTS = ('sarj_port', 'sarj_starboard')
_ANGLES = ('S0000003', 'S0000004')
_TORQUE, _MAGNITUDE = ('USLAB000006', 'USLAB000007', 'USLAB000008'), 'USLAB000009'
_ATTITUDE = ('USLAB000018', 'USLAB000019', 'USLAB000020', 'USLAB000021')  # body to LVLH, scalar first
_RATES = ('USLAB000025', 'USLAB000026', 'USLAB000027')  # deg/s, inertial
_POSITION, _VELOCITY = ('USLAB000032', 'USLAB000033', 'USLAB000034'), ('USLAB000035', 'USLAB000036', 'USLAB000037')
_HOUR = 3600.0  # s
_LONG = 5.0  # s without a reading that the gyro or the torque did not change: a loss of signal
_ITERATIONS, _CLOSE = 20, 1e-6  # of the momentum at the start; N m s
_FINE = 1e-5  # rad: residuals below it count alike
_THRUSTERS = 300.0  # N m s: 10 times the misfit of hours without thrusters
_HELD = 1.0  # s: a joint that stands is sent once, and is read as often as the rates


def read_iss(folder: Path, begin: float, end: float) -> Recording:
    """Return a part of a day's telemetry; `begin`, `end` in hours as the files count (day of the year x 24 + UTC).

    Raises
    ------
    DataError
        A channel is missing or is none, or holds no readings between these hours.
    """
    span = begin * _HOUR, end * _HOUR
    rates = [_channel(folder, name, span) for name in _RATES]
    time = rates[0][0]
    rate = np.radians(np.column_stack([_held(each, time) for each in rates]))
    scalar_first = np.column_stack([_held(_channel(folder, name, span), time) for name in _ATTITUDE])
    quaternion = np.roll(scalar_first, -1, axis=1)
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    angles = [_channel(folder, name, span) for name in _ANGLES]
    # The joints turn on in a loss of signal, too: between readings, straight on; standing, they are sent once.
    joints = np.column_stack([_between_readings(each, time) for each in angles])
    orbit, lvlh, plane = _orbit(folder, span, time)
    body = rotation_from_quaternion(quaternion)
    inertial, relative = lvlh @ body, np.swapaxes(plane, -1, -2) @ lvlh @ body
    drift = rotate(np.swapaxes(plane, -1, -2), log(plane[-1] @ plane[0].T) / (time[-1] - time[0]))
    rate -= rotate_back(relative, drift)
    torque = np.column_stack([_held(_channel(folder, name, span), time) for name in _TORQUE])
    stored, misfit = stored_momentum(time, inertial, torque, _held(_channel(folder, _MAGNITUDE, span), time))
    if misfit > _THRUSTERS:
        raise DataError(
            f"log '{folder}': the integrated torque misses the magnitude of the gyros' momentum by {misfit:.3g} N m s "
            f'from {begin:g} to {end:g} h; accepted: up to {_THRUSTERS:g}, without thrusters and loss of signal'
        )
    return Recording(
        Joints(JOINTS, time, joints),
        imu=Imu(time, rate, np.zeros_like(rate), orientation=quaternion_from_rotation(relative)),
        stored=StoredMomentum(time, stored),
        robot=resource('iss.urdf'),
        parameters=resource('iss.yaml').format(**orbit),
        notes=(
            f'the momentum of the gyros is the integrated torque; its magnitude is off by {misfit:.3g} N m s (RMS)',
            'no tensor of this month is published: there is no truth.json',
        ),
    )


def orbit_axes(position: Array, velocity: Array) -> Array:
    """Return the rotations (N, 3, 3) from LVLH to the axes of (N, 3) positions and velocities: z down, y -normal."""
    down, across = -_unit(position), -_unit(np.cross(position, velocity))
    return np.stack((np.cross(across, down), across, down), axis=-1)


def _orbit(folder: Path, span: tuple[float, float], time: Array) -> tuple[dict[str, float], Array, Array]:
    """Return the orbit's parameters, and at times (N,) the rotations (N, 3, 3) from LVLH and from its plane to J2000.

    LVLH does not turn evenly: the orbit is no circle, and the flattened Earth turns its plane by some 1e-6 rad/s. An
    inclination of 1 mrad to the plane is 0.4 N m of gravity gradient, so the axes follow the plane. Positions come
    every 10 s, some with stamps that are seconds late; their turn beyond a circle is a drift and two harmonics
    of the orbit, fitted to least absolute deviations.
    """
    track = [_channel(folder, name, span) for name in (*_POSITION, *_VELOCITY)]
    own = track[0][0]
    position, velocity = np.split(np.column_stack([_held(each, own) for each in track]), [3], axis=1)
    position = 1e3 * position  # km
    moment = np.linalg.norm(np.cross(position, velocity), axis=1)
    motion = float(np.mean(moment / np.sum(position**2, axis=1)))
    axes = orbit_axes(position, velocity)
    first = axes[0]
    further = log(first.T @ axes @ np.swapaxes(_turned_with_orbit(own - time[0], motion), -1, -2))
    known, wanted = (_harmonics(motion * (each - time[0])) for each in (own, time))
    found = np.column_stack([_least_absolute(known, each) for each in further.T])
    # Along the orbit 2 e sin(M + n t) about -y: an ellipse, whose phase counts from its begin.
    eccentric = -found[2:4, 1]
    plane = found[:2].copy()
    plane[0, 1] -= eccentric[0]
    parameters = {
        'mean_motion': motion,
        'eccentricity': 0.5 * float(np.linalg.norm(eccentric)),
        'true_anomaly': float(np.arctan2(*eccentric)),
    }
    turned = exp(wanted @ found) @ _turned_with_orbit(time - time[0], motion)
    return parameters, first @ turned, first @ exp(wanted[:, :2] @ plane)


def _harmonics(angle: Array) -> Array:
    """Return 1, the angle (N,) and its first two harmonics, (N, 6)."""
    waves = (wave(order * angle) for order in (1, 2) for wave in (np.cos, np.sin))
    return np.column_stack((np.ones_like(angle), angle, *waves))


def _least_absolute(rows: Array, values: Array) -> Array:
    """Return the coefficients of rows (N, k) with the least sum of absolute residuals, by reweighted least squares."""
    weight = np.ones(len(rows))
    for _ in range(_ITERATIONS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(rows * root[:, None], values * root, rcond=None)[0]
        weight = 1.0 / np.maximum(np.abs(values - rows @ found), _FINE)
    return np.asarray(found)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector, axis=1, keepdims=True))


def stored_momentum(time: Array, rotation: Array, torque: Array, magnitude: Array) -> tuple[Array, float]:
    """Return the momentum of the gyros in body axes, (N, 3), and how far off its magnitude is, N m s (RMS).

    Torque on the body takes momentum from the gyros, h = h_0 - integral of C tau; h_0 is by least squares on |h|.

    Parameters
    ----------
    time : (N,) s
    rotation : (N, 3, 3) C, body to inertial axes
    torque : (N, 3) N m, on the body in its axes
    magnitude : (N,) N m s, as sent
    """
    acting = rotate(rotation, torque)
    steps = 0.5 * np.diff(time)[:, None] * (acting[1:] + acting[:-1])
    gone = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    found, least = np.zeros(3), np.inf
    size = float(magnitude[0])
    for start in size * np.concatenate((np.eye(3), -np.eye(3))):  # the magnitude has other minima
        first = start
        for _ in range(_ITERATIONS):
            momentum = first - gone
            length = np.linalg.norm(momentum, axis=1)
            step = np.linalg.lstsq(momentum / length[:, None], magnitude - length, rcond=None)[0]
            first = first + step
            if np.linalg.norm(step) < _CLOSE:
                break
        misfit = float(np.sqrt(np.mean((np.linalg.norm(first - gone, axis=1) - magnitude) ** 2)))
        if misfit < least:
            found, least = first, misfit
    return rotate_back(rotation, found - gone), least


def _turned_with_orbit(time: Array, motion: float) -> Array:
    """Return the rotations (N, 3, 3) from LVLH to inertial axes: about -y, which is the orbit's normal."""
    half = 0.5 * motion * time
    zero = np.zeros_like(half)
    return rotation_from_quaternion(np.column_stack((zero, -np.sin(half), zero, np.cos(half))))


def _channel(folder: Path, name: str, span: tuple[float, float]) -> tuple[Array, Array]:
    """Return times (N,) s and values (N,) of a channel, the last before the span first, as it holds on."""
    path = folder / f'{name}.txt'
    try:
        table = np.array([line.split() for line in read_text(path, 'log', limits.LOG_BYTES).splitlines()], dtype=float)
    except ValueError as error:
        raise DataError(f"log '{path}' has a line that is not two numbers; accepted: hours and a value") from error
    if table.ndim != 2 or table.shape[1] != 2:
        raise DataError(f"log '{path}' has lines that are not two numbers; accepted: hours and a value")
    time, value = table[:, 0] * _HOUR, table[:, 1]
    order = np.argsort(time, kind='stable')
    time, value = time[order], value[order]
    first, last = np.searchsorted(time, span)
    first = max(int(first) - 1, 0)
    if last - first < 2:
        raise DataError(f"log '{path}' has no readings from {span[0] / _HOUR:g} to {span[1] / _HOUR:g} h")
    return time[first:last], value[first:last]


def _held(channel: tuple[Array, Array], time: Array) -> Array:
    """Return values at times (N,) s: channels are sent on change."""
    own, value = channel
    return value[np.maximum(np.searchsorted(own, time + 0.5 * _HELD, side='right') - 1, 0)]


def _between_readings(channel: tuple[Array, Array], time: Array) -> Array:
    """Return an angle at times (N,), rad, which stands where readings are far apart and hardly differ."""
    own, value = channel
    angle = np.unwrap(np.radians(value))
    # Two readings that are far apart and near each other: the joint stood until just before the second.
    stood = np.flatnonzero((np.diff(own) > _LONG) & (np.abs(np.diff(angle)) < 1e-3))
    own = np.insert(own, stood + 1, own[stood + 1] - _HELD)
    angle = np.insert(angle, stood + 1, angle[stood])
    return np.interp(time, own, angle)
