"""TU Delft's thrown bodies: a device with a flywheel, alone, with a proof body, or with a holder of steel blocks."""

from __future__ import annotations

import contextlib
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.files import require_regular
from mbaid_ros.recordings.recording import Recording, resource
from mbaid_ros.recordings.table_files import read_table
from mbaid_ros.sensor_messages import Imu, Joints, Poses

_DEVICE = 0.10067  # kg, with the flywheel
_SPIN_INERTIA = 1.687e-6  # kg m^2, of the flywheel
# The holder, and a block on it: kg, m, kg m^2. Origin at the middle of the holder's bottom, z down.
_HOLDER, _HOLDER_COM = 0.1785, np.array([0.0, 0.0, -18.9e-3])
_HOLDER_INERTIA = np.diag([2.994e-1, 1.004e-1, 3.506e-1]) * _HOLDER / 145.2
_BLOCK, _BLOCK_SIZE = 0.0701, np.array([15e-3, 15e-3, 40e-3])
_PROOF, _PROOF_SIZE = 0.346, np.array([60.0e-3, 70.0e-3, 30.2e-3])
# Start of the fit: the thrown body's centre of mass in the device's frame, and the device's own moments.
_BELOW, _OWN = np.array([0.0, 0.0, 0.048]), np.diag([7.6e-5, 2.2e-5, 8.9e-5])
_PITCH, _BLOCK_HEIGHT = 18e-3, -22e-3


@dataclass(frozen=True)
class Thrown:
    """The body that is bolted to the device and thrown with it."""

    BASE: ClassVar[str] = 'device'
    JOINT: ClassVar[str] = 'flywheel'

    name: str  # in words
    mass: float  # kg
    inertia: Array  # (3, 3) about its own centre of mass, kg m^2

    @property
    def moments(self) -> Array:
        """Principal moments of inertia, (3,) kg m^2, the smallest first."""
        return np.asarray(np.linalg.eigvalsh(self.inertia))

    def combined_body(self) -> tuple[float, Array, Array]:
        """Return nominal values of device and body: mass, centre of mass (3,) in the device's frame, inertia (3, 3)."""
        mass = _DEVICE + self.mass
        com = self.mass / mass * _BELOW
        return mass, com, self.inertia + _OWN + _parallel_axis(_DEVICE * self.mass / mass, _BELOW)


def _cuboid(mass: float, size: Array) -> Array:
    return np.asarray(mass / 12.0 * np.diag(np.sum(size**2) - size**2))


def _parallel_axis(mass: float, offset: Array) -> Array:
    return np.asarray(mass * (offset @ offset * np.eye(3) - np.outer(offset, offset)))


def _with_blocks(name: str, rows: str) -> Thrown:
    """Return the holder with blocks on four rows of eight places, each an x."""
    places = [(i, j) for i, row in enumerate(rows.split()) for j, place in enumerate(row) if place == 'x']
    centres = [np.array([_PITCH * (i - 1.5), _PITCH * (j - 3.5), _BLOCK_HEIGHT]) for i, j in places]
    mass = _HOLDER + _BLOCK * len(centres)
    com = (_HOLDER * _HOLDER_COM + _BLOCK * np.sum([np.zeros(3), *centres], axis=0)) / mass
    inertia = _HOLDER_INERTIA + _parallel_axis(_HOLDER, _HOLDER_COM - com)
    for centre in centres:
        inertia = inertia + _cuboid(_BLOCK, _BLOCK_SIZE) + _parallel_axis(_BLOCK, centre - com)
    return Thrown(name, mass, inertia)


OBJECTS = {
    'device-only': Thrown('nothing: the device alone', 0.0, np.zeros((3, 3))),
    'proof-body': Thrown('a steel cuboid', _PROOF, _cuboid(_PROOF, _PROOF_SIZE)),
    'empty': _with_blocks('the holder', '........ ........ ........ ........'),
    'a': _with_blocks('the holder with 4 blocks', '........ x......x x......x ........'),
    'b': _with_blocks('the holder with 8 blocks', '..x..x.. ...xx... ...xx... ..x..x..'),
    'c': _with_blocks('the holder with 16 blocks', 'x.x..x.x .x.xx.x. .x.xx.x. x.x..x.x'),
}


def throw_urdf(thrown: Thrown) -> str:
    """Return the robot description of the device with the body that it is bolted to."""
    mass, com, inertia = thrown.combined_body()
    return resource('throw.urdf').format(
        name=thrown.name,
        device=_DEVICE,
        mass=thrown.mass,
        moments=', '.join(f'{moment:.4g}' for moment in thrown.moments),
        below=1e3 * _BELOW[2],
        com=com[2],
        total=mass,
        **dict(zip(('ixx', 'iyy', 'izz'), np.diag(inertia), strict=True)),
        spin=_SPIN_INERTIA,
        half=_SPIN_INERTIA / 2.0,
        base=Thrown.BASE,
        joint=Thrown.JOINT,
    )


def throw_parameters(thrown: Thrown) -> str:
    """Return the parameters for it."""
    total = thrown.combined_body()[0]
    return resource('throw.yaml').format(base=thrown.BASE, joint=thrown.JOINT, total=total, mass_std=1e-3 * total)


_GYRO = tuple(f'gyroADC[{axis}]' for axis in range(3))
_ACCELEROMETER = tuple(f'accSmooth[{axis}]' for axis in range(3))
_COLUMNS = ('time', *_GYRO, *_ACCELEROMETER, 'erpm[0]')
# Units of the raw numbers: 16.384 of the gyro are a degree a second, 2048 of the accelerometer are g; 14 poles.
_RADIANS, _G, _SPEED = math.pi / 180.0 / 16.384, 9.81 / 2048.0, 100.0 / 7.0 * 2.0 * math.pi / 60.0
_TURNING = 10.0  # rad/s of the flywheel: the flight has begun
_AFTER, _BEFORE_END, _AT_REST = 300, 50, 2000  # samples, as the authors have the first two
_FEWEST = 100  # samples of a flight


def read_tudelft_throw(path: Path, thrown: str = '', *, dead_reckoned: bool = False) -> Recording:
    """Return the throw in a blackbox log or CSV.

    Raises DataError: It is no such log, there is no flight in it, or orangebox is missing.
    Raises ParameterError: The thrown body is not known.

    Parameters
    ----------
    thrown : which of OBJECTS the device was bolted to; empty takes it from the log's folder
    dead_reckoned : also make poses of the integrated gyro and accelerometer, in a frame that falls along
    """
    table = _read(path)
    time = (table[:, 0] - table[0, 0]) * 1e-6
    # The board is turned by 90 degrees on the device: its axes are those of the IMU turned back.
    gyro, acceleration = (_mapped(table[:, part] * unit) for part, unit in ((slice(1, 4), _RADIANS), (slice(4, 7), _G)))
    wheel = -table[:, 7] * _SPEED
    moving = np.flatnonzero(np.abs(wheel) > _TURNING)
    if not len(moving) or len(time) - moving[0] < _AFTER + _BEFORE_END + _FEWEST or moving[0] < _AT_REST:
        raise DataError(
            f"log '{path}' has no flight: the flywheel starts after {_AT_REST} samples and turns to the end in one"
        )
    bias = gyro[:_AT_REST].mean(axis=0)
    flight = slice(moving[0] + _AFTER, len(time) - _BEFORE_END)
    time, gyro, acceleration, wheel = time[flight], gyro[flight] - bias, acceleration[flight], wheel[flight]
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (wheel[1:] + wheel[:-1]) * np.diff(time))))
    what = OBJECTS[_which(path, thrown)]
    return Recording(
        Joints((Thrown.JOINT,), time, angle[:, None], wheel[:, None]),
        _dead_reckoned(time, gyro, acceleration) if dead_reckoned else None,
        imu=Imu(time, gyro, acceleration, Thrown.BASE),
        robot=throw_urdf(what),
        parameters=throw_parameters(what),
        notes=('the bias of the gyro at rest is taken off: ' + ', '.join(f'{value:.4f}' for value in bias) + ' rad/s',),
    )


def _mapped(values: Array) -> Array:
    """Return x = -raw y, y = raw x, z = raw z."""
    return np.stack((-values[:, 1], values[:, 0], values[:, 2]), axis=1)


def _which(path: Path, thrown: str) -> str:
    if not thrown:
        folder = path.resolve().parent.name
        thrown = folder.removeprefix('config_').replace('_', '-')
        if thrown not in OBJECTS:
            raise ParameterError(
                f"folder '{folder}' does not name the thrown object; accepted: --object {', '.join(OBJECTS)}"
            )
    if thrown not in OBJECTS:
        raise ParameterError(f"--object is '{thrown}'; accepted: {', '.join(OBJECTS)}")
    return thrown


def _read(path: Path) -> Array:
    """Return the rows of the columns that are needed, (N, 8)."""
    if path.suffix.lower() == '.csv':
        table = read_table(path, header=True)
        names, values = table.names, table.values
    else:
        names, values = _blackbox(path)
    missing = [name for name in _COLUMNS if name not in names]
    if missing:
        raise DataError(f"log '{path}' lacks the column '{missing[0]}'; accepted: {', '.join(_COLUMNS)}")
    rows = values[:, [names.index(name) for name in _COLUMNS]]
    rows = rows[np.all(np.isfinite(rows), axis=1)]
    rows = rows[np.concatenate(([True], np.diff(rows[:, 0]) > 0.0))[: len(rows)]]
    if len(rows) < _AT_REST:
        raise DataError(f"log '{path}' has {len(rows)} rows; accepted: {_AT_REST} or more")
    return np.asarray(rows)


def _blackbox(path: Path) -> tuple[tuple[str, ...], Array]:
    """Return names and values of a blackbox log's columns; other text becomes NaN."""
    try:
        from orangebox import Parser  # noqa: PLC0415 - optional
    except ModuleNotFoundError:
        raise DataError(f"'{path}' is a blackbox log, which needs orangebox: pip install orangebox==0.3.1") from None
    require_regular(path, 'log')
    if path.stat().st_size > limits.LOG_BYTES:
        raise DataError(f"log '{path}' has {path.stat().st_size} bytes; at most {limits.LOG_BYTES} are accepted")
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            parser = Parser.load(str(path))
            names = tuple(parser.field_names)
            places = [names.index(name) for name in _COLUMNS if name in names]
            rows = [[_number(frame.data[place]) for place in places] for frame in parser.frames()]
    except Exception as error:  # of others, of bytes that may be anything
        raise DataError(f"'{path}' is no blackbox log that can be read: {type(error).__name__}: {error}") from error
    return tuple(names[place] for place in places), np.array(rows, dtype=float).reshape(-1, len(places))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def _dead_reckoned(time: Array, gyro: Array, acceleration: Array) -> Poses:
    """Return poses of the IMU in a frame that falls along, which it has at the begin, at rest there."""
    step = np.diff(time)[:, None]
    turns = exp(0.5 * (gyro[1:] + gyro[:-1]) * step)
    rotation = np.empty((len(time), 3, 3))
    rotation[0] = np.eye(3)
    for index, turn in enumerate(turns):
        rotation[index + 1] = rotation[index] @ turn
    falling = (rotation @ acceleration[..., None])[..., 0]
    velocity = np.zeros_like(gyro)
    velocity[1:] = np.cumsum(0.5 * (falling[1:] + falling[:-1]) * step, axis=0)
    position = np.zeros_like(gyro)
    position[1:] = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * step, axis=0)
    nothing = np.full((len(time), 6), np.nan)  # the rates are in the poses already
    return Poses(time, position, quaternion_from_rotation(rotation), nothing, Thrown.BASE)
