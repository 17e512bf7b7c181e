"""Conditions in which something acts on the robot, or moves that nobody reads."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.honesty import robots, views
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.floating import Spring, World, Wrench
from benchmarks.honesty.paths import Path, by_rates, sinusoids, together
from benchmarks.honesty.robots import BASE, box
from mbaid_ros.core.geometry import Array, skew, unvec
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf_edit import change_inertial

GROUP = 'world'
_FORCE = np.array([2.0, -2.0, 1.0]) / 3.0
_TORQUE = np.array([1.0, 2.0, -2.0]) / 3.0
_MEAN_MOTION = 1.13e-3  # rad/s, at 400 km
_WHEELS = ((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1))


def _on_base(size: Callable[[float], float], force: float, torque: float) -> Wrench:
    """Return a force and torque on the base's origin, in odometry axes, times a function of time."""

    def wrench(time: float, _rotation: Array, position: Array, _whole: Array) -> Array:
        push = size(time) * force * _FORCE
        return np.concatenate((push, np.cross(position, push) + size(time) * torque * _TORQUE))

    return wrench


def _constant(_time: float) -> float:
    return 1.0


def _slow(time: float) -> float:
    return float(np.sin(2.0 * np.pi * time / 40.0))


def _pulse(time: float) -> float:
    return 1.0 if 30.0 <= time < 30.1 else 0.0


def _pulses(time: float) -> float:
    return float(np.sign(np.sin(1.7 * (time // 4.0)))) if time % 4.0 < 0.1 else 0.0


def _gravity_gradient(_time: float, rotation: Array, _position: Array, whole: Array) -> Array:
    """Return the torque 3 n^2 u x (I u) about the centre of mass, u towards the Earth along -z."""
    centre = whole[1:4] / whole[0]
    inertia = unvec(whole[4:]) + whole[0] * skew(centre) @ skew(centre)
    down = -rotation[2]
    return np.concatenate((np.zeros(3), rotation @ (3.0 * _MEAN_MOTION**2 * np.cross(down, inertia @ down))))


def _pushed(name: str, wrench: Wrench) -> Condition:
    return Condition(GROUP, name, lambda _: World(robots.servicer(), sinusoids(), wrench=wrench))


def _grasp(place: tuple[float, float, float], angle: float, _seed: int) -> World:
    """Return a body that turns in the hand at 30 s, within half a second."""
    urdf = robots.held_apart(place)
    knots = np.array([0.0, 30.0, 30.25, 30.5])
    turning = by_rates(np.zeros(1), knots, angle / 0.25 * np.array([[0.0], [0.0], [1.0], [0.0]]))
    path = together(load_model(urdf), sinusoids(), {'held_joint': turning})
    return World(urdf, path, unread=('held_joint',), sought=robots.slipped(place, angle), since=30.5)


def _lost(_seed: int) -> World:
    """Return a hand that lets go of what it holds at 30 s."""
    empty = change_inertial(robots.servicer(), robots.LINK, robots.BARE)
    return World(robots.servicer(), sinusoids(), sought=robots.BARE, since=30.5, lost=(30.0, empty))


def _plain(_urdf: str) -> str:
    return robots.servicer()


def _wheel_names() -> list[str]:
    return [f'wheel{index}' for index in range(len(_WHEELS))]


def _wheels(_seed: int) -> World:
    """Return four wheels that spin up to 20 rad/s within the run."""
    parts = [
        robots.part(f'wheel{index}', BASE, (-0.2, 0.0, 0.1), axis, _wheel(np.array(axis) / np.sqrt(3.0)), 'continuous')
        for index, axis in enumerate(_WHEELS)
    ]
    urdf = robots.with_parts(robots.servicer(), parts)
    names = tuple(f'wheel{index}_joint' for index in range(len(_WHEELS)))
    others = {name: _spinning_up(20.0 * (index + 1) / 4.0) for index, name in enumerate(names)}
    return World(urdf, together(load_model(urdf), sinusoids(), others), unread=names)


def _wheel(axis: Array) -> Array:
    body = box(5.0, (0.25, 0.25, 0.25))
    inertia = 0.03 * np.eye(3) + 0.02 * np.outer(axis, axis)
    body[4:] = inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    return body


def _spinning_up(speed: float) -> Path:
    return by_rates(np.zeros(1), np.array([0.0, 10.0, 50.0]), np.array([[0.0], [0.0], [speed]]))


def _fixed(*arguments: str) -> str:
    """Return a URDF, the last argument, whose links of the given names are fixed."""
    return robots.locked(arguments[-1], *arguments[:-1])


def _panel(_seed: int) -> World:
    """Return a panel of 20 kg and 2.2 m on a hinge of 0.3 Hz that still rings."""
    panel = box(20.0, (0.9, 2.2, 0.03), (0.0, 1.1, 0.0))
    urdf = robots.with_parts(
        robots.servicer(), [robots.part('panel', BASE, (-0.1, 0.6, 0.0), (1, 0, 0), panel, 'revolute')]
    )
    return World(urdf, sinusoids(), unread=('panel_joint',), springs={'panel_joint': Spring(0.3, 0.005, 0.01)})


def _slosh(_seed: int) -> World:
    """Return 60 kg of fuel as a pendulum of 0.3 m and 0.1 Hz in two directions."""
    yoke, fuel = box(0.1, (0.1, 0.1, 0.1)), box(60.0, (0.2, 0.2, 0.2), (0.0, 0.0, -0.3))
    parts = [
        robots.part('yoke', BASE, (-0.1, 0.0, 0.2), (1, 0, 0), yoke, 'revolute'),
        robots.part('fuel', 'yoke', (0.0, 0.0, 0.0), (0, 1, 0), fuel, 'revolute'),
    ]
    springs = {'yoke_joint': Spring(0.1, 0.02, 0.1), 'fuel_joint': Spring(0.1, 0.02, -0.05)}
    return World(robots.with_parts(robots.servicer(), parts), sinusoids(), unread=tuple(springs), springs=springs)


def _flexible(frequency: float, damping: float, _seed: int) -> World:
    """Return joint4 with a spring behind its encoder."""
    urdf = robots.with_flexible_joint(robots.servicer(), 'joint4')
    spring = Spring(frequency, damping, 0.002)
    return World(urdf, sinusoids(), unread=('flexible_joint',), springs={'flexible_joint': spring})


PULSE = _on_base(_pulse, 10.0, 5.0)

DISTURBED = (
    _pushed('a constant force of 10 mN, 10 mN m', _on_base(_constant, 0.01, 0.01)),
    _pushed('a slow sinusoidal force of 10 mN, 10 mN m', _on_base(_slow, 0.01, 0.01)),
    _pushed('a thrust pulse of 1 N s, 0.5 N m s', PULSE),
    _pushed('a pulse of 0.1 N s every 4 s', _on_base(_pulses, 1.0, 0.5)),
    _pushed('gravity gradient at 400 km', _gravity_gradient),
    Condition(GROUP, 'the body slips in the grasp by 5 deg', partial(_grasp, (0.0, 0.0, 0.3), np.deg2rad(5.0)), _plain),
    Condition(
        GROUP,
        'the body slips in the grasp by 30 deg',
        partial(_grasp, (0.0, 0.0, 0.3), np.deg2rad(30.0)),
        _plain,
    ),
    Condition(GROUP, 'the hand loses the body', _lost),
    Condition(GROUP, 'wheels that nobody reads spin up', _wheels, partial(_fixed, *_wheel_names())),
    Condition(GROUP, 'a flexible panel of 0.3 Hz', _panel, partial(_fixed, 'panel')),
    Condition(GROUP, 'fuel that sloshes at 0.1 Hz', _slosh, partial(_fixed, 'yoke', 'fuel')),
    Condition(GROUP, 'a flexible joint of 2 Hz', partial(_flexible, 2.0, 0.01), _plain),
    Condition(GROUP, 'a flexible joint of 1 Hz', partial(_flexible, 1.0, 0.3), _plain),
    Condition(
        GROUP,
        'odometry in an orbit-fixed frame',
        lambda _: World(robots.servicer(), sinusoids()),
        view=partial(views.in_orbit_frame, _MEAN_MOTION),
    ),
)
