"""Conditions in which the sensors are not as declared; and benches, on which several small errors come together."""

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.data import NOISE, drawn, true_model
from benchmarks.honesty import paths, readings, robots
from benchmarks.honesty.conditions import AXES, JOINT, Condition, seen, servicer
from benchmarks.honesty.paths import DEGREE, ROBOT, Path, pick_and_place, sinusoids
from benchmarks.honesty.readings import Defect, Readings, View, changed
from benchmarks.honesty.worlds import World, Wrench
from benchmarks.model_errors import DEFAULT
from mbaid_ros.core.geometry import Array
from mbaid_ros.simulation.quaternions import conjugate
from mbaid_ros.simulation.simulation import Truth

_JOINTS = ('joint_position', 'joint_velocity')
_ODOMETRY = tuple(name for name in vars(NOISE) if name.startswith('base'))
_NOISE = r'noise\.(joint|base)|noise (of|set for) the odometry'
_GYRO_BIAS = np.deg2rad(10.0) / 3600.0  # rad/s
_TURN = np.array([0.0, 0.0, 0.5 * np.pi])


def _spoilt(name: str, defect: Defect, cause: str = '') -> Condition:
    return Condition('sensors', name, servicer, defect=defect, cause=cause)


def _declared(name: str, channels: tuple[str, ...], factor: float, cause: str = '') -> Condition:
    return Condition('sensors', name, servicer, declared=dict.fromkeys(channels, factor), cause=cause)


def _viewed(name: str, view: View, cause: str = '') -> Condition:
    return seen(name, view, cause, 'sensors')


def _fast(_seed: int) -> World:
    return World(robots.servicer(), sinusoids(), seconds=30.0, rate=500.0)


def _w_first(quaternion: Array) -> Array:
    return np.roll(quaternion, 1, axis=-1)


def _late(milliseconds: float) -> Defect:
    return partial(readings.joints_late, 1e-3 * milliseconds, 0.0)


def _bits(count: int) -> Defect:
    return partial(readings.quantised, 2.0 * np.pi / 2**count)


SENSORS = (
    _spoilt('odometry noise correlated over 0.3 s', partial(readings.correlated, 0.3), 'correlated'),
    _spoilt('odometry noise correlated over 3 s', partial(readings.correlated, 3.0), 'correlated|drift'),
    _spoilt('1 % outliers', partial(readings.outliers, 0.01), 'outlier'),
    _spoilt('5 % outliers', partial(readings.outliers, 0.05), 'outlier'),
    _spoilt('one outlier', readings.one_outlier),
    Condition('sensors', 'odometry at 10 Hz beside joints at 500 Hz', _fast, defect=partial(readings.thinned, 50)),
    _spoilt('gyro bias of 10 deg/h', partial(readings.gyro_biased, _GYRO_BIAS), 'bias|base_angular_velocity'),
    _spoilt('the last pose repeated, one in five new', partial(readings.repeated, 5), 'repeat'),
    _spoilt('clocks 100 ppm apart', partial(readings.joints_late, 0.0, 1e-4), 'clock'),
    _viewed('twist 50 ms late', partial(readings.twist_late, 0.05), 'twist'),
    _spoilt('joints 5 ms late', _late(5.0)),
    _spoilt('joints 20 ms late', _late(20.0)),
    _spoilt('joints 200 ms late', _late(200.0), 'late|time offset'),
    _declared('all noise declared 3 x too small', (*_JOINTS, *_ODOMETRY), 1.0 / 3.0, _NOISE),
    _declared('all noise declared 10 x too small', (*_JOINTS, *_ODOMETRY), 0.1, _NOISE),
    _declared('all noise declared 3 x too large', (*_JOINTS, *_ODOMETRY), 3.0),
    _declared(
        'noise of the odometry declared 3 x too small',
        _ODOMETRY,
        1.0 / 3.0,
        r'noise\.base|noise (of|set for) the odometry',
    ),
    _declared('noise of the joints declared 10 x too small', _JOINTS, 0.1, r'noise\.joint'),
    _spoilt('encoders of 14 bits', _bits(14)),
    Condition('sensors', 'encoders of 12 bits, declared', servicer, defect=_bits(12), declared={'joint_position': 4.4}),
    _spoilt('no odometry for 3 s', partial(readings.dropout, 30.0, 33.0)),
    _viewed('odometry 1 % too long', partial(readings.scaled, 1.01), 'odometry.*(scale|too long)'),
    _spoilt('odometry wanders by 1 mm / sqrt(s)', partial(readings.wandering, 1e-3), 'odometry.*drift'),
    _viewed('a joint read 0.3 % too large', partial(readings.misgeared, 2, 1.003)),
    _viewed('a joint read 1 % too large', partial(readings.misgeared, 2, 1.01), r'joint3\b'),
    _viewed('a joint read 3 % too large', partial(readings.misgeared, 2, 1.03), r'joint3\b'),
    _viewed('twist in the axes of the odometry frame', readings.twist_in_odometry_axes, 'twist_frame'),
    _viewed('twist in degrees a second', partial(changed, 'base_angular_velocity', np.rad2deg), 'degrees a second'),
    _viewed(
        'twist of a point 0.3 m away', partial(readings.twist_of_point, np.array([0.3, 0.0, 0.0])), 'twist.* point'
    ),
    _viewed('twist in axes turned by 90 degrees', partial(readings.twist_turned, _TURN), 'axes of the twist'),
    _spoilt('a twist of zeros', readings.without_twist, 'twist.* zero'),
    _viewed(
        'joints in degrees',
        partial(readings.joints_scaled, np.rad2deg(1.0)),
        'in degrees:|far beyond its limits.*degrees',
    ),
    Condition(
        'sensors',
        'a prismatic joint in millimetres',
        lambda _: World(robots.chain(AXES, (2,)), paths.drawn(np.full(len(AXES), 0.2), 1)),
        view=partial(readings.misgeared, 2, 1e3),
        cause='prismatic joints are in millimetres|far beyond its limits.*encoder ticks, not m',
    ),
    _viewed(
        'positions in millimetres',
        partial(changed, 'base_position', partial(np.multiply, 1e3)),
        'position of the odometry is in millimetres',
    ),
    _viewed('orientation turned round', partial(changed, 'base_orientation', conjugate), 'inverse'),
    _viewed('quaternions with w first', partial(changed, 'base_orientation', _w_first), 'w first'),
    _spoilt('a third of the odometry lost', partial(readings.lossy, 1.0 / 3.0)),
    _spoilt('odometry stamped up to 5 ms early or late', partial(readings.jittering, 5e-3), r'noise\.base|stamp'),
    _spoilt(
        'an encoder that slips by 10 mrad', partial(readings.slipped, 1, 1e-2, 30.0), 'the reading of joint2 jumps'
    ),
    _spoilt("a joint's reading frozen for 15 s", partial(readings.frozen, 1, 20.0, 35.0), r'the reading of joint2\b'),
)


# -- several small errors at once, as on a bench: each alone would pass unnoticed
_PLACE, _MOUNT = np.array([2e-3, -1e-3, 1.5e-3]), np.array([1.5e-3, -1e-3, 2e-3])  # m, rad, of the odometry's mount


def _bench(
    name: str,
    *defects: Defect,
    path: Callable[[int], Path] = lambda _: sinusoids(),
    wrench: Wrench | None = None,
    declared: float = 1.0,
) -> Condition:
    """Return servicer7 drawn from the default priors, its noise declared so many times as large as it is."""

    def world(seed: int) -> World:
        return World(true_model(ROBOT, drawn(ROBOT, DEFAULT, seed)).urdf, path(seed), wrench=wrench)

    def spoilt(found: Readings, rng: np.random.Generator) -> Readings:
        for defect in defects:
            found = defect(found, rng)
        return found

    def view(truth: Truth) -> Truth:
        return readings.mounted(_PLACE, _MOUNT, readings.zero_off(JOINT, 1e-3, truth))

    channels = dict.fromkeys(vars(NOISE), declared)
    return Condition(
        'benches', f'a bench: {name}', world, lambda _: robots.servicer(), view, spoilt, channels, varies=True
    )


def benches(pulse: Wrench) -> tuple[Condition, ...]:
    """Return all benches, one of which a thrust pulse pushes."""
    return (
        _bench('all of the model off by its default'),
        _bench(
            'encoders of 14 bits, joints 8 ms late, poses at 33 Hz, 0.5 % outliers',
            _bits(14),
            _late(8.0),
            partial(readings.outliers, 0.005),
            partial(readings.thinned, 3),
        ),
        _bench(
            'stops at 5 deg/s, poses correlated over 0.1 s, gyro bias, 2 s without poses',
            partial(readings.correlated, 0.1),
            partial(readings.gyro_biased, 3e-5),
            partial(readings.dropout, 25.0, 27.0),
            path=lambda seed: pick_and_place(seed, 60.0, 5.0 * DEGREE),
        ),
        _bench(
            'poses repeated, clocks 50 ppm apart, noise declared twice as small',
            partial(readings.joints_late, 2e-3, 5e-5),
            partial(readings.repeated, 3),
            declared=0.5,
        ),
        _bench('encoders of 12 bits, not declared, and a thrust pulse', _bits(12), wrench=pulse),
    )
