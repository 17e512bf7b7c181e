"""All conditions: motions and robots without errors, wrong models, wrong sensors, benches, hard starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.data import NOISE, drawn
from benchmarks.honesty import paths, readings, robots
from benchmarks.honesty.paths import DEGREE, ROBOT, Path, after, moves, pick_and_place, sinusoids, stuck
from benchmarks.honesty.readings import Defect, Readings, View
from benchmarks.honesty.robots import BASE, DIRECTION, LINK, box
from benchmarks.honesty.worlds import World, Wrench
from benchmarks.model_errors.variant import DEFAULT
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.quaternions import conjugate
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import true_robot


@dataclass(frozen=True, eq=False)
class Condition:
    """A true robot, its sensors, and the declarations; everything else is the default."""

    group: str
    name: str
    world: Callable[[int], World]  # by the seed if `varies`
    believed: Callable[[str], str] = str  # URDF of the estimator, from that of the world
    view: View = lambda truth: truth
    defect: Defect = lambda found, _rng: found
    declared: Mapping[str, float] = field(default_factory=dict)  # noise as declared, over the true one
    target: str = ''  # link; the last one if empty
    varies: bool = False  # whether every seed has a world of its own
    cause: str = ''  # regular expression of the true cause, where one error is larger than declared


AXES = ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0))
_URDF = robots.servicer


def servicer(_seed: int) -> World:
    """Return the shipped robot with its sinusoids."""
    return World(_URDF(), sinusoids())


# -- nothing is wrong


def _moving(name: str, path: Callable[[int], Path], seconds: float = 60.0, *, varies: bool = False) -> Condition:
    return Condition('undisturbed', name, lambda seed: World(_URDF(), path(seed), seconds), varies=varies)


def _of_weight(name: str, link: str, factor: float) -> Condition:
    return Condition('undisturbed', name, lambda _: World(robots.scaled(_URDF(), link, factor), sinusoids()))


def _start(joints: int, slides: tuple[int, ...] = ()) -> Array:
    return np.where(np.isin(np.arange(joints), slides), 0.1, 0.3 * np.cos(np.arange(joints)))


def _shaped(
    name: str, axes: tuple[tuple[int, int, int], ...], slides: tuple[int, ...] = (), *, folded: bool = False
) -> Condition:
    def world(_seed: int) -> World:
        return World(robots.chain(axes, slides, folded=folded), paths.drawn(_start(len(axes), slides), 1))

    return Condition('undisturbed', name, world)


UNDISTURBED = (
    _moving('sinusoids of the shipped robot', lambda _: sinusoids()),
    _moving('fast sinusoids', lambda _: sinusoids(pace=4.0)),
    _moving('small sinusoids, a tenth', lambda _: sinusoids(amplitude=0.1)),
    _moving('trapezoids of 1 deg/s with stops', lambda seed: pick_and_place(seed, 60.0), varies=True),
    _moving('trapezoids of 1 deg/s with stops, 120 s', lambda seed: pick_and_place(seed, 120.0), 120.0, varies=True),
    _moving('one joint at a time', lambda _: paths.one_at_a_time(135.0), 135.0),
    _moving('a single joint', lambda _: sinusoids(only=[3])),
    _moving('a minute at rest first', lambda _: after(60.0, sinusoids()), 120.0),
    _moving('5 s of data', lambda _: sinusoids(), 5.0),
    _moving('300 s at 0.5 deg/s', lambda seed: pick_and_place(seed, 300.0, 0.5 * DEGREE), 300.0),
    _moving('one joint stuck', lambda _: sinusoids(only=[0, 1, 2, 4, 5, 6])),
    _shaped('all axes parallel', ((0, 0, 1),) * 5),
    _shaped('all axes collinear', ((0, 0, 1),) * 4, folded=True),
    _shaped('a single prismatic joint', ((1, 0, 0),), (0,)),
    _shaped('a prismatic joint among six', AXES, (2,)),
    _shaped('20 joints', (AXES * 4)[:20]),
    _of_weight('a light base, a tenth', BASE, 0.1),
    _of_weight('a heavy base, a hundredfold', BASE, 100.0),
    _of_weight('a target of 1.6 kg', LINK, 0.01),
    _of_weight('a target of 16,200 kg', LINK, 100.0),
    Condition('undisturbed', 'tumbling at 20 deg/s', lambda _: World(_URDF(), sinusoids(), spin=(0.2, -0.15, 0.24))),
)

# -- the robot is not as described
_JOINT, _ARM = 3, 'second'  # number of joint4; links of another arm


def _believed(name: str, believed: Callable[[str], str], cause: str, target: str = '') -> Condition:
    return Condition('wrong model', name, servicer, believed, target=target, cause=cause)


def _seen(name: str, view: View, cause: str, group: str = 'wrong model') -> Condition:
    return Condition(group, name, servicer, view=view, cause=cause)


def _steps(
    name: str,
    cause: str,
    of: Callable[[str, Callable[..., Any], str], Condition],
    make: Callable[..., object],
    sizes: tuple[float, ...] = (0.3, 3.0, 30.0),
) -> list[Condition]:
    """Return conditions with errors of some sizes; the last one has a cause to be named."""
    return [of(name.format(size), partial(make, size), cause if size == sizes[-1] else '') for size in sizes]


def _in_grams(urdf: str, links: range = range(1, 7)) -> str:
    for index in links:
        urdf = robots.scaled(urdf, f'link{index}', 1e3)
    return urdf


def _second_arm(_seed: int) -> World:
    """Return servicer7 with another, undeclared arm of three moving links."""
    axes, place, parent, parts = ((0, 0, 1), (0, 1, 0), (0, 1, 0)), (0.5, -0.4, -0.3), BASE, []
    for index, axis in enumerate(axes):
        body = box(25.0, (0.8, 0.15, 0.15), (0.4, 0.0, 0.0))
        parts.append(robots.part(f'{_ARM}{index}', parent, place, axis, body, 'continuous'))
        parent, place = f'{_ARM}{index}', (0.8, 0.0, 0.0)
    urdf = robots.with_parts(_URDF(), parts)
    names = tuple(f'{_ARM}{index}_joint' for index in range(3))
    others = {name: _swinging(0.02 + 0.01 * index) for index, name in enumerate(names)}
    return World(urdf, paths.together(load_model(urdf), sinusoids(), others), unread=names)


def _swinging(frequency: float) -> Path:
    one = np.ones((1, 1))
    return paths.following(Sinusoids(np.array([0.2]), 0.5 * one, frequency * one, 0.0 * one))


UNREAD = r'unreported'
FLEXIBLE = r'joint4 is flexible'
WRONG_MODELS = (
    *_steps(
        "a link's mass {:g} % off",
        r'link3\b',
        _believed,
        lambda size, urdf: robots.scaled(urdf, 'link3', 1.0 + 0.01 * size),
        (1.0, 10.0, 50.0),
    ),
    *_steps(
        "the base's CoM {:g} mm off",
        r'base_link\b',
        _believed,
        lambda size, urdf: robots.off_centre(urdf, 1e-3 * size),
        (1.0, 10.0, 100.0),
    ),
    *_steps(
        "a joint's zero {:g} mrad off",
        r'zero of joint4\b',
        _seen,
        lambda size, truth: readings.zero_off(_JOINT, 1e-3 * size, truth),
    ),
    *_steps(
        'a joint {:g} mm off',
        r'origin of joint4\b',
        _believed,
        lambda size, urdf: robots.misplaced(urdf, 'joint4', 1e-3 * size),
    ),
    *_steps(
        "a joint's axis {:g} mrad off",
        r'axis of joint4\b',
        _believed,
        lambda size, urdf: robots.tilted(urdf, 'joint4', 1e-3 * size),
    ),
    *_steps(
        'odometry mounted {:g} mm off',
        r'\bmount\b',
        _seen,
        lambda size, truth: readings.mounted(1e-3 * size * DIRECTION, np.zeros(3), truth),
    ),
    *_steps(
        'odometry mounted {:g} mrad off',
        r'\bmount\b',
        _seen,
        lambda size, truth: readings.mounted(np.zeros(3), 1e-3 * size * DIRECTION, truth),
    ),
    *_steps(
        'a gear {:g} mrad off with the angle',
        FLEXIBLE,
        _seen,
        lambda size, truth: readings.geared(_JOINT, 1e-3 * size, truth),
    ),
    _seen("a joint's sign flipped", partial(readings.misgeared, 2, -1.0), r'sign of joint3\b'),
    _seen('two joints swapped', partial(readings.swapped, 2, 4), r'joint3 and joint5\b'),
    Condition('wrong model', 'an arm is missing', _second_arm, lambda _: _URDF(), cause=UNREAD),
    _believed("a link's mass in grams", partial(_in_grams, links=range(3, 4)), r'link3\b'),
    _believed("the arm's masses in grams", _in_grams, r'link[1-6]\b'),
    _believed('the wrong target link', robots.bare, r'link7\b', 'link6'),
    _believed('the base a third too light', partial(robots.scaled, link=BASE, factor=2.0 / 3.0), r'base_link\b'),
    _believed("two links' inertials exchanged", partial(robots.exchanged, one='link2', other='link5'), r'link[25]\b'),
    _believed("a joint's axis reversed", partial(robots.reversed_axis, joint='joint3'), r'sign of joint3\b'),
    _believed('every length in millimetres', robots.in_millimetres, ''),
)
_LENGTHS = 'every length in millimetres'
# Twelve descriptions of one robot, each with a large error in the file.
WRONG_FILES = tuple(one.name for one in WRONG_MODELS if one.believed is not str and (one.cause or one.name == _LENGTHS))

# -- the sensors are not as declared
_JOINTS = ('joint_position', 'joint_velocity')
_ODOMETRY = tuple(name for name in vars(NOISE) if name.startswith('base'))
_NOISE = r'noise\.(joint|base)|noise of the odometry'
_GYRO_BIAS = np.deg2rad(10.0) / 3600.0  # rad/s
_TURN = np.array([0.0, 0.0, 0.5 * np.pi])


def _spoilt(name: str, defect: Defect, cause: str = '') -> Condition:
    return Condition('sensors', name, servicer, defect=defect, cause=cause)


def _declared(name: str, channels: tuple[str, ...], factor: float, cause: str = '') -> Condition:
    return Condition('sensors', name, servicer, declared=dict.fromkeys(channels, factor), cause=cause)


def _viewed(name: str, view: View, cause: str = '') -> Condition:
    return _seen(name, view, cause, 'sensors')


def _fast(_seed: int) -> World:
    return World(_URDF(), sinusoids(), seconds=30.0, rate=500.0)


def _sliding(_seed: int) -> World:
    return World(robots.chain(AXES, (2,)), paths.drawn(np.full(len(AXES), 0.2), 1))


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
        'noise of the odometry declared 3 x too small', _ODOMETRY, 1.0 / 3.0, r'noise\.base|noise of the odometry'
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
    _viewed(
        'twist in degrees a second',
        lambda truth: replace(truth, base_angular_velocity=np.rad2deg(truth.base_angular_velocity)),
        'degrees a second',
    ),
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
        _sliding,
        view=partial(readings.misgeared, 2, 1e3),
        cause='prismatic joints are in millimetres|far beyond its limits.*encoder ticks, not m',
    ),
    _viewed(
        'positions in millimetres',
        lambda truth: replace(truth, base_position=1e3 * truth.base_position),
        'position of the odometry is in millimetres',
    ),
    _viewed(
        'orientation turned round',
        lambda truth: replace(truth, base_orientation=conjugate(truth.base_orientation)),
        'inverse',
    ),
    _viewed(
        'quaternions with w first',
        lambda truth: replace(truth, base_orientation=np.roll(truth.base_orientation, 1, axis=-1)),
        'w first',
    ),
    _spoilt('a third of the odometry lost', partial(readings.lossy, 1.0 / 3.0)),
    _spoilt('odometry stamped up to 5 ms early or late', partial(readings.jittering, 5e-3), r'noise\.base|stamp'),
    _spoilt(
        'an encoder that slips by 10 mrad', partial(readings.slipped, 1, 1e-2, 30.0), 'the reading of joint2 jumps'
    ),
    _spoilt("a joint's reading frozen for 15 s", partial(readings.frozen, 1, 20.0, 35.0), r'the reading of joint2\b'),
)

# -- several small errors at once, as on a bench: each alone would pass unnoticed
_PLACE, _MOUNT = np.array([2e-3, -1e-3, 1.5e-3]), np.array([1.5e-3, -1e-3, 2e-3])  # m, rad, of the odometry's mount


def _off_as_declared(seed: int, path: Path, wrench: Wrench | None = None) -> World:
    """Return servicer7 with links, origins and axes drawn from the default priors, the target exact."""
    nominal = load_model(_URDF())
    return World(true_robot(nominal, drawn(ROBOT, DEFAULT, seed), (nominal.last_link,)).urdf, path, wrench=wrench)


def _mounted(truth: Truth) -> Truth:
    return readings.mounted(_PLACE, _MOUNT, readings.zero_off(_JOINT, 1e-3, truth))


def bench(name: str, world: Callable[[int], World], *defects: Defect, declared: float = 1.0) -> Condition:
    """Return such a robot, its noise declared so many times as large as it is."""

    def spoilt(found: Readings, rng: np.random.Generator) -> Readings:
        for defect in defects:
            found = defect(found, rng)
        return found

    channels = dict.fromkeys(vars(NOISE), declared)
    return Condition('benches', f'a bench: {name}', world, lambda _: _URDF(), _mounted, spoilt, channels, varies=True)


def _swinging_bench(seed: int) -> World:
    return _off_as_declared(seed, sinusoids())


def benches(pulse: Wrench) -> tuple[Condition, ...]:
    """Return all benches, one of which a thrust pulse pushes."""
    return (
        bench('all of the model off by its default', _swinging_bench),
        bench(
            'encoders of 14 bits, joints 8 ms late, poses at 33 Hz, 0.5 % outliers',
            _swinging_bench,
            _bits(14),
            _late(8.0),
            partial(readings.outliers, 0.005),
            partial(readings.thinned, 3),
        ),
        bench(
            'stops at 5 deg/s, poses correlated over 0.1 s, gyro bias, 2 s without poses',
            lambda seed: _off_as_declared(seed, pick_and_place(seed, 60.0, 5.0 * DEGREE)),
            partial(readings.correlated, 0.1),
            partial(readings.gyro_biased, 3e-5),
            partial(readings.dropout, 25.0, 27.0),
        ),
        bench(
            'poses repeated, clocks 50 ppm apart, noise declared twice as small',
            _swinging_bench,
            partial(readings.joints_late, 2e-3, 5e-5),
            partial(readings.repeated, 3),
            declared=0.5,
        ),
        bench(
            'encoders of 12 bits, not declared, and a thrust pulse',
            lambda seed: _off_as_declared(seed, sinusoids(), pulse),
            _bits(12),
        ),
    )


# -- hard starts without errors: every seed has a motion of its own


def _starting(name: str, path: Callable[[int], Path], seconds: float) -> tuple[Condition, Condition]:
    """Return servicer7 with a motion, once tumbling slowly and once at rest at first."""

    def world(seed: int, *spin: float) -> World:
        return World(_URDF(), path(seed), seconds, spin=spin or World.spin)  # type: ignore[arg-type]

    return (
        Condition('starts', f'start: {name}', world, varies=True),
        Condition('starts', f'start: {name}, from rest', lambda seed: world(seed, 0.0, 0.0, 0.0), varies=True),
    )


def _other(name: str, urdf: Callable[[], str], joints: int, slides: tuple[int, ...] = ()) -> Condition:
    """Return another robot with slow sinusoids."""
    start = _start(joints, slides)
    return Condition('starts', f'start: {name}', lambda seed: World(urdf(), paths.drawn(start, seed)), varies=True)


def _single(seed: int) -> Path:
    """Return a single joint, another one for every seed, that moves by trapezoids."""
    rng, count = np.random.default_rng([seed, 5]), len(paths.servicer().start)
    speed = DEGREE * rng.choice([-1.0, 1.0]) * np.eye(count)[seed % count]
    return moves([(length, speed * (-1.0) ** leg) for leg, length in enumerate(rng.uniform(8.0, 16.0, 12))], 2.0)


def _slow(seed: int) -> Path:
    return paths.drawn(paths.servicer().start, seed)


def _with_base(mass: float) -> str:
    return robots.scaled(_URDF(), BASE, mass / 560.0)


STARTS = (
    *_starting('sinusoids', _slow, 60.0),
    *_starting('trapezoids of 60 s', lambda seed: pick_and_place(seed, 60.0), 60.0),
    *_starting('trapezoids of 120 s', lambda seed: pick_and_place(seed, 120.0), 120.0),
    *_starting('one joint at a time, 270 s', lambda seed: paths.one_at_a_time(270.0, rest=0.1 * seed), 270.0),
    *_starting('a single joint', _single, 120.0),
    *_starting('a minute at rest first, then sinusoids', lambda seed: after(60.0, _slow(seed)), 120.0),
    *_starting('a minute at rest first, then trapezoids', lambda seed: pick_and_place(seed, 180.0, rest=60.0), 180.0),
    *_starting('5 s of data', _slow, 5.0),
    *_starting('300 s at 0.5 deg/s', lambda seed: pick_and_place(seed, 300.0, 0.5 * DEGREE), 300.0),
    *_starting('one joint stuck', lambda seed: stuck(seed % 7, _slow(seed)), 60.0),
    _other('all axes parallel', lambda: robots.chain(((0, 0, 1),) * 5), 5),
    _other('all axes collinear', lambda: robots.chain(((0, 0, 1),) * 4, folded=True), 4),
    _other('one prismatic joint', lambda: robots.chain(((1, 0, 0),), (0,)), 1, (0,)),
    _other('20 joints', lambda: robots.chain((AXES * 4)[:20]), 20),
    _other('40 joints', lambda: robots.chain((AXES * 7)[:40]), 40),
    *(_other(f'a base of {mass:g} kg', partial(_with_base, mass), 7) for mass in (1e-6, 1.0, 1e6)),
)
