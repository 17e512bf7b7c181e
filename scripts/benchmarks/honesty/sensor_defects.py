"""Conditions in which the sensors are not as declared."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.honesty import readings, robots, views
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.floating import World
from benchmarks.honesty.paths import drawn, sinusoids
from benchmarks.honesty.undisturbed import AXES

GROUP = 'sensors'
_ODOMETRY = ('base_position', 'base_orientation', 'base_linear_velocity', 'base_angular_velocity')
_JOINTS = ('joint_position', 'joint_velocity')
_GYRO_BIAS = np.deg2rad(10.0) / 3600.0  # rad/s


def _servicer(_seed: int) -> World:
    return World(robots.servicer(), sinusoids())


def _fast(_seed: int) -> World:
    return World(robots.servicer(), sinusoids(), seconds=30.0, rate=500.0)


def _sliding(_seed: int) -> World:
    return World(robots.chain(AXES, (2,)), drawn(np.full(len(AXES), 0.2), 1))


def _spoilt(name: str, defect: readings.Defect) -> Condition:
    return Condition(GROUP, name, _servicer, defect=defect)


def _declared(name: str, channels: tuple[str, ...], factor: float) -> Condition:
    return Condition(GROUP, name, _servicer, declared=dict.fromkeys(channels, factor))


def _viewed(name: str, view: views.View) -> Condition:
    return Condition(GROUP, name, _servicer, view=view)


SENSORS = (
    _spoilt('odometry noise correlated over 0.3 s', partial(readings.correlated, 0.3)),
    _spoilt('odometry noise correlated over 3 s', partial(readings.correlated, 3.0)),
    _spoilt('1 % outliers', partial(readings.outliers, 0.01)),
    _spoilt('5 % outliers', partial(readings.outliers, 0.05)),
    _spoilt('one outlier', readings.one_outlier),
    Condition(GROUP, 'odometry at 10 Hz beside joints at 500 Hz', _fast, defect=partial(readings.thinned, 50)),
    _spoilt('gyro bias of 10 deg/h', partial(readings.gyro_biased, _GYRO_BIAS)),
    _spoilt('the last pose repeated, one in five new', partial(readings.repeated, 5)),
    _spoilt('clocks 100 ppm apart', partial(readings.joints_late, 0.0, 1e-4)),
    _viewed('twist 50 ms late', partial(views.twist_late, 0.05)),
    *(
        _spoilt(f'joints {delay:g} ms late', partial(readings.joints_late, 1e-3 * delay, 0.0))
        for delay in (5.0, 20.0, 200.0)
    ),
    _declared('all noise declared 3 x too small', (*_JOINTS, *_ODOMETRY), 1.0 / 3.0),
    _declared('all noise declared 10 x too small', (*_JOINTS, *_ODOMETRY), 0.1),
    _declared('all noise declared 3 x too large', (*_JOINTS, *_ODOMETRY), 3.0),
    _declared('noise of the odometry declared 3 x too small', _ODOMETRY, 1.0 / 3.0),
    _declared('noise of the joints declared 10 x too small', _JOINTS, 0.1),
    _spoilt('encoders of 14 bits', partial(readings.quantised, 2.0 * np.pi / 2**14)),
    Condition(
        GROUP,
        'encoders of 12 bits, declared',
        _servicer,
        defect=partial(readings.quantised, 2.0 * np.pi / 2**12),
        declared={'joint_position': 4.4},
    ),
    _spoilt('no odometry for 3 s', partial(readings.dropout, 30.0, 33.0)),
    _viewed('odometry 1 % too long', partial(views.scaled, 1.01)),
    _spoilt('odometry wanders by 1 mm / sqrt(s)', partial(readings.wandering, 1e-3)),
    *(
        _viewed(f'a joint read {size:g} % too large', partial(views.misgeared, 2, 1.0 + 1e-2 * size))
        for size in (0.3, 1.0, 3.0)
    ),
    _viewed('twist in the axes of the odometry frame', views.twist_in_odometry_axes),
    _viewed('twist in degrees a second', views.twist_in_degrees),
    _viewed('twist of a point 0.3 m away', partial(views.twist_of_point, np.array([0.3, 0.0, 0.0]))),
    _viewed('twist in axes turned by 90 degrees', partial(views.twist_turned, np.array([0.0, 0.0, 0.5 * np.pi]))),
    _spoilt('a twist of zeros', readings.without_twist),
    _viewed('joints in degrees', views.in_degrees),
    Condition(GROUP, 'a prismatic joint in millimetres', _sliding, view=partial(views.misgeared, 2, 1e3)),
    _viewed('positions in millimetres', views.in_millimetres),
    _viewed('orientation turned round', views.turned_round),
    _viewed('quaternions with w first', views.scalar_first),
    _spoilt('a third of the odometry lost', partial(readings.lossy, 1.0 / 3.0)),
    _spoilt('odometry stamped up to 5 ms early or late', partial(readings.jittering, 5e-3)),
    _spoilt('an encoder that slips by 10 mrad', partial(readings.slipped, 1, 1e-2, 30.0)),
    _spoilt("a joint's reading frozen for 15 s", partial(readings.frozen, 1, 20.0, 35.0)),
)
