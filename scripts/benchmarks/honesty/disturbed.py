"""Conditions in which the robot is not as described, is pushed, or has undeclared parts; and the catalogue of all."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.honesty import paths, readings, robots
from benchmarks.honesty.conditions import JOINT, STARTS, UNDISTURBED, Condition, seen, servicer
from benchmarks.honesty.paths import by_rates, sinusoids, together
from benchmarks.honesty.robots import BASE, DIRECTION, Vector, box
from benchmarks.honesty.worlds import Spring, World, Wrench
from benchmarks.honesty.wrong_sensors import SENSORS, benches
from benchmarks.precapture import BARE_LINK7
from mbaid_ros.core.geometry import Array, skew, unvec, vec
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth

_ARM = 'second'  # links of another arm


def _believed(name: str, believed: Callable[[str], str], cause: str, target: str = '') -> Condition:
    return Condition('wrong model', name, servicer, believed, target=target, cause=cause)


def _steps(
    name: str,
    cause: str,
    of: Callable[[str, Callable[..., Any], str], Condition],
    make: Callable[..., object],
    sizes: tuple[float, ...] = (0.3, 3.0, 30.0),
) -> list[Condition]:
    """Return conditions with errors of some sizes, in thousandths; the last one has a cause to be named."""
    return [of(name.format(size), partial(make, 1e-3 * size), cause if size == sizes[-1] else '') for size in sizes]


def _heavier(thousandths: float, urdf: str) -> str:
    return robots.scaled(urdf, 'link3', 1.0 + 10.0 * thousandths)


def _mounted_beside(distance: float, truth: Truth) -> Truth:
    return readings.mounted(distance * DIRECTION, np.zeros(3), truth)


def _mounted_askew(angle: float, truth: Truth) -> Truth:
    return readings.mounted(np.zeros(3), angle * DIRECTION, truth)


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
    urdf = robots.with_parts(robots.servicer(), parts)
    one, others = np.ones((1, 1)), {}
    for index in range(3):
        swing = Sinusoids(np.array([0.2]), 0.5 * one, (0.02 + 0.01 * index) * one, 0.0 * one)
        others[f'{_ARM}{index}_joint'] = paths.following(swing)
    return World(urdf, paths.together(load_model(urdf), sinusoids(), others), unread=tuple(others))


UNREAD = r'unreported'
FLEXIBLE = r'joint4 is flexible'
WRONG_MODELS = (
    *_steps("a link's mass {:g} % off", r'link3\b', _believed, _heavier, (1.0, 10.0, 50.0)),
    *_steps("the base's CoM {:g} mm off", r'base_link\b', _believed, robots.off_centre, (1.0, 10.0, 100.0)),
    *_steps("a joint's zero {:g} mrad off", r'zero of joint4\b', seen, partial(readings.zero_off, JOINT)),
    *_steps('a joint {:g} mm off', r'origin of joint4\b', _believed, partial(robots.misplaced, 'joint4')),
    *_steps("a joint's axis {:g} mrad off", r'axis of joint4\b', _believed, partial(robots.tilted, 'joint4')),
    *_steps('odometry mounted {:g} mm off', r'\bmount\b', seen, _mounted_beside),
    *_steps('odometry mounted {:g} mrad off', r'\bmount\b', seen, _mounted_askew),
    *_steps('a gear {:g} mrad off with the angle', FLEXIBLE, seen, partial(readings.geared, JOINT)),
    seen("a joint's sign flipped", partial(readings.misgeared, 2, -1.0), r'sign of joint3\b'),
    seen('two joints swapped', partial(readings.swapped, 2, 4), r'joint3 and joint5\b'),
    Condition('wrong model', 'an arm is missing', _second_arm, lambda _: robots.servicer(), cause=UNREAD),
    _believed("a link's mass in grams", partial(_in_grams, links=range(3, 4)), r'link3\b'),
    _believed("the arm's masses in grams", _in_grams, r'link[1-6]\b'),
    _believed('the wrong target link', robots.bare, r'link7\b', 'link6'),
    _believed('the base a third too light', partial(robots.scaled, link=BASE, factor=2.0 / 3.0), r'base_link\b'),
    _believed("two links' inertials exchanged", partial(robots.exchanged, one='link2', other='link5'), r'link[25]\b'),
    _believed("a joint's axis reversed", partial(robots.reversed_axis, joint='joint3'), r'sign of joint3\b'),
    _believed('every length in millimetres', robots.in_millimetres, 'millimetres'),
)
# Twelve descriptions of one robot, each with a large error in the file.
WRONG_FILES = tuple(one.name for one in WRONG_MODELS if one.believed is not str and one.cause)


_FORCE, _TORQUE = np.array([2.0, -2.0, 1.0]) / 3.0, np.array([1.0, 2.0, -2.0]) / 3.0
_MEAN_MOTION = 1.13e-3  # rad/s, at 400 km
AXES = ((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1))  # of four wheels
_GRASP = (0.0, 0.0, 0.3)  # m


def _on_base(size: Callable[[float], float], force: float, torque: float) -> Wrench:
    """Return a force and torque on the base's origin, in odometry axes, times a function of time."""

    def wrench(time: float, _rotation: Array, position: Array, _whole: Array) -> Array:
        push = size(time) * force * _FORCE
        return np.concatenate((push, np.cross(position, push) + size(time) * torque * _TORQUE))

    return wrench


def _pulses(time: float) -> float:
    return float(np.sign(np.sin(1.7 * (time // 4.0)))) if time % 4.0 < 0.1 else 0.0


def _gravity_gradient(_time: float, rotation: Array, _position: Array, whole: Array) -> Array:
    """Return the torque 3 n^2 u x (I u) about the centre of mass, u towards the Earth along -z."""
    centre = whole[1:4] / whole[0]
    inertia = unvec(whole[4:]) + whole[0] * skew(centre) @ skew(centre)
    down = -rotation[2]
    return np.concatenate((np.zeros(3), rotation @ (3.0 * _MEAN_MOTION**2 * np.cross(down, inertia @ down))))


def _grasp(angle: float, _seed: int) -> World:
    """Return a target that turns in the hand at 30 s, within half a second."""
    urdf = robots.held_apart(_GRASP)
    knots = np.array([0.0, 30.0, 30.25, 30.5])
    turning = by_rates(np.zeros(1), knots, angle / 0.25 * np.array([[0.0], [0.0], [1.0], [0.0]]))
    path = together(load_model(urdf), sinusoids(), {'held_joint': turning})
    return World(urdf, path, unread=('held_joint',), sought=robots.slipped(_GRASP, angle), since=30.5)


def _lost(_seed: int) -> World:
    """Return a hand that releases its target at 30 s."""
    empty = robots.bare(robots.servicer())
    return World(robots.servicer(), sinusoids(), sought=BARE_LINK7, since=30.5, lost=(30.0, empty))


def wheeled(*places: Vector) -> str:
    """Return the servicer with a pyramid of wheels of 5 kg at places on the base."""
    parts = []
    for index, (axis, place) in enumerate(zip(AXES, places, strict=True)):
        inertia = vec(0.03 * np.eye(3) + 0.02 / 3.0 * np.outer(axis, axis))
        body = np.concatenate(([5.0], np.zeros(3), inertia))
        parts.append(robots.part(f'wheel{index}', BASE, place, axis, body, 'continuous'))
    return robots.with_parts(robots.servicer(), parts)


def _wheels(_seed: int) -> World:
    """Return four wheels that spin up to 20 rad/s within the run."""
    urdf, knots, others = wheeled(*[(-0.2, 0.0, 0.1)] * len(AXES)), np.array([0.0, 10.0, 50.0]), {}
    for index in range(len(AXES)):
        speed = 20.0 * (index + 1) / 4.0
        others[f'wheel{index}_joint'] = by_rates(np.zeros(1), knots, np.array([[0.0], [0.0], [speed]]))
    return World(urdf, together(load_model(urdf), sinusoids(), others), unread=tuple(others))


def _on_springs(urdf: str, springs: dict[str, Spring]) -> World:
    return World(urdf, sinusoids(), unread=tuple(springs), springs=springs)


def _panel(_seed: int) -> World:
    """Return a panel on a hinge of 0.3 Hz that oscillates from the start."""
    return _on_springs(robots.with_panel(robots.servicer()), {'panel_joint': Spring(0.3, 0.005, 0.01)})


def _slosh(_seed: int) -> World:
    """Return 60 kg of fuel as a pendulum of 0.3 m and 0.1 Hz in two directions."""
    yoke, fuel = box(0.1, (0.1, 0.1, 0.1)), box(60.0, (0.2, 0.2, 0.2), (0.0, 0.0, -0.3))
    parts = [
        robots.part('yoke', BASE, (-0.1, 0.0, 0.2), (1, 0, 0), yoke, 'revolute'),
        robots.part('fuel', 'yoke', (0.0, 0.0, 0.0), (0, 1, 0), fuel, 'revolute'),
    ]
    springs = {'yoke_joint': Spring(0.1, 0.02, 0.1), 'fuel_joint': Spring(0.1, 0.02, -0.05)}
    return _on_springs(robots.with_parts(robots.servicer(), parts), springs)


def _flexible(frequency: float, damping: float, _seed: int) -> World:
    """Return joint4 with a spring behind its encoder."""
    urdf = robots.with_flexible_joint(robots.servicer(), 'joint4')
    return _on_springs(urdf, {'flexible_joint': Spring(frequency, damping, 0.002)})


def _pushed(name: str, wrench: Wrench, cause: str = '') -> Condition:
    return Condition('world', name, lambda _: World(robots.servicer(), sinusoids(), wrench=wrench), cause=cause)


def _moved(name: str, world: Callable[[int], World], cause: str, *locked: str) -> Condition:
    """Return a world of which the estimator knows the usual description, or one whose links of some names are fixed."""

    def believed(urdf: str) -> str:
        return robots.locked(urdf, *locked) if locked else robots.servicer()

    return Condition('world', name, world, believed, cause=cause)


_FORCED, _DRIFTS = r'\bforce\b|thrust', r'\bforce\b|thrust|momentum drifts'
_PULSE = _on_base(lambda time: 1.0 if 30.0 <= time < 30.1 else 0.0, 10.0, 5.0)
DISTURBED = (
    _pushed('a constant force of 10 mN, 10 mN m', _on_base(lambda _: 1.0, 0.01, 0.01), _FORCED),
    _pushed(
        'a slow sinusoidal force of 10 mN, 10 mN m',
        _on_base(lambda time: float(np.sin(2.0 * np.pi * time / 40.0)), 0.01, 0.01),
        _DRIFTS,
    ),
    _pushed('a thrust pulse of 1 N s, 0.5 N m s', _PULSE, 'thrust'),
    _pushed('a pulse of 0.1 N s every 4 s', _on_base(_pulses, 1.0, 0.5), _DRIFTS),
    _pushed('gravity gradient at 400 km', _gravity_gradient),
    _moved('the body slips in the grasp by 5 deg', partial(_grasp, np.deg2rad(5.0)), 'grasp'),
    _moved('the body slips in the grasp by 30 deg', partial(_grasp, np.deg2rad(30.0)), 'grasp'),
    Condition('world', 'the hand loses the body', _lost, cause='another body|lost'),
    _moved('unreported wheels spin up', _wheels, UNREAD, 'wheel0', 'wheel1', 'wheel2', 'wheel3'),
    _moved('a flexible panel of 0.3 Hz', _panel, r'\bHz\b', 'panel'),
    _moved('fuel that sloshes at 0.1 Hz', _slosh, r'\bHz\b|fuel', 'yoke', 'fuel'),
    _moved('a flexible joint of 2 Hz', partial(_flexible, 2.0, 0.01), FLEXIBLE),
    _moved('a flexible joint of 1 Hz', partial(_flexible, 1.0, 0.3), FLEXIBLE),
    Condition(
        'world',
        'odometry in an orbit-fixed frame',
        servicer,
        view=partial(readings.in_orbit_frame, _MEAN_MOTION),
        cause='orbit-fixed frame',
    ),
)


def _base_off(seed: int) -> World:
    """Return a base that is 3 to 10 % heavier or lighter than described."""
    rng = np.random.default_rng([seed, 4])
    factor = 1.0 + rng.uniform(0.03, 0.1) * rng.choice([-1.0, 1.0])
    return World(robots.scaled(robots.servicer(), BASE, factor), sinusoids())


# Errors between the specified size and one that is always named: intervals contain the truth, or the error is named.
DRAWN = (
    Condition('drawn', 'a length scale of 0.9 to 1.1', servicer, defect=partial(readings.of_another_length, 0.1)),
    Condition('drawn', 'the base 3 to 10 % off', _base_off, lambda _: robots.servicer(), varies=True),
    Condition('drawn', 'one joint 5 to 80 ms late', servicer, defect=partial(readings.one_late, 5e-3, 80e-3)),
)
CONDITIONS: tuple[Condition, ...] = (*UNDISTURBED, *WRONG_MODELS, *SENSORS, *DISTURBED, *benches(_PULSE), *DRAWN)
CATALOGUE = {condition.name: condition for condition in (*CONDITIONS, *STARTS)}
