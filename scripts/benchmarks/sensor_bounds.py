"""The Cramér-Rao bound of gyros and poses by name beside encoders, with the priors of their errors."""

from collections.abc import Sequence

import numpy as np

from benchmarks.bounds import STRIDE, Path, Problem, splines
from benchmarks.data import Case, kernel
from benchmarks.sensors import Drawn
from mbaid_ros.core.geometry import Array, Integers, skew
from mbaid_ros.core.poses import NamedPoseConfig
from mbaid_ros.core.robot.model import Configuration
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth

_FAR = 1e3  # m and rad, N s and N m s: a prior of numbers that a run may leave undetermined
_WALK = 1.0  # s, between the changes of a bias
_JOINTS_LATE = 0.02  # s, prior of the joints' time offset
_WORLD = (0.05, 0.3)  # rad, m: prior of a sensor's own world
_ROWS = {'orientation': slice(3), 'position': slice(3, 6), 'both': slice(6)}
# Rows (R, c) by what all sensors depend on, by the sensor's own errors (R, e), relative to the noise; their priors.
Rows = tuple[Array, Array, Array]


def sensors_bound(case: Case, truth: Truth, sensors: Sequence[Drawn], odometry_rate: float = 0.0) -> Array:
    """Return the (10,) bounds of body parameters by some sensors, and poses of the odometry at a rate (Hz)."""
    robot, noise = kernel(case.robot), case.noise
    problem = Problem.of(case, truth)
    samples = problem.samples
    path = Path.of(robot, samples, problem.momentum, problem.space.basis)
    knots = samples[::STRIDE][: len(path.xi)]
    placed = robot.kinematics.configure(knots.base_rotation, knots.joint_position)
    value, rate = splines(knots.time, float(samples.time[-1]))
    n, columns = robot.model.joints, path.xi.shape[-1]
    parts: list[Rows] = []
    if odometry_rate:
        at = _instants(knots, odometry_rate)
        pose = np.repeat([noise.base_orientation, noise.base_position], 3)
        rows = (path.xi[at] / pose[:, None]).reshape(-1, columns)
        parts.append((rows * _density(knots, odometry_rate), np.zeros((len(rows), 0)), np.zeros(0)))
    for sensor in sensors:
        located, turned, away = _link_error(path, placed, sensor, case.robot, value)
        kind = _of_gyro if 'noise_density' in sensor.used else _of_pose
        parts.append(kind(sensor, knots, located, turned, away))
    own = sum(part[1].shape[1] for part in parts) + 1
    information = np.zeros((own + columns, own + columns))
    done = 1
    for rows, extra, prior in parts:
        mine = np.zeros((len(rows), own))
        mine[:, done : done + extra.shape[1]] = extra
        whole = np.concatenate((mine, rows), axis=1)
        information += whole.T @ whole
        information[range(done, done + len(prior)), range(done, done + len(prior))] += prior**-2.0
        done += extra.shape[1]
    # Encoders: positions and velocities along the paths, all of them late by one number, the first.
    slope = np.gradient(knots.joint_velocity, knots.time, axis=0)
    for basis, size, late in (
        (value, noise.joint_position, knots.joint_velocity),
        (rate, noise.joint_velocity, slope),
    ):
        weight = STRIDE / size**2
        paths = slice(own, own + path.joints)
        information[paths, paths] += np.kron(weight * basis.T @ basis, np.eye(n))
        cross = -weight * (basis.T @ late).ravel()
        information[0, paths] += cross
        information[paths, 0] += cross
        information[0, 0] += weight * np.sum(late**2)
    information[0, 0] += _JOINTS_LATE**-2.0
    first = slice(own + path.joints, own + path.joints + 6)
    information[first, first] += _FAR**-2.0 * np.eye(6)
    momentum = problem.space.basis[10:]
    information[-momentum.shape[1] :, -momentum.shape[1] :] += _FAR**-2.0 * momentum.T @ momentum
    return problem.deviations(information)


def _instants(knots: Samples, rate: float) -> Integers:
    """Return the knots nearest to readings at a rate (Hz); all of them where these come more often."""
    spacing = float(knots.time[1])
    if rate * spacing >= 1.0:
        return np.arange(len(knots))
    count = int(knots.time[-1] * rate) + 1
    return np.minimum(np.round(np.arange(count) / rate / spacing).astype(int), len(knots) - 1)


def _density(knots: Samples, rate: float) -> float:
    """Return the square root of how many readings stand for each instant."""
    return float(np.sqrt(max(rate * float(knots.time[1]), 1.0)))


def _link_error(
    path: Path, placed: Configuration, sensor: Drawn, robot: str, value: Array
) -> tuple[Array, Array, Array]:
    """Return the pose error (T, 6, c) of a sensor's link, its orientation, and its place from the base's origin, m."""
    link = kernel(robot).model.link(str(sensor.made['link'] or 'base_link'))
    turned, away = placed.link_pose(link)
    moved = kernel(robot).kinematics.ancestors[link.body][:, None]
    located = path.xi.copy()
    located[:, 3:] -= skew(away) @ located[:, :3]
    linear, angular = np.split(placed.joint_twist, 2, axis=-1)
    along = np.concatenate((angular, linear + np.cross(angular, away[:, None])), axis=-1) * moved
    by_path = np.einsum('tk,tjr->trkj', value, along)
    located[:, :, : path.joints] += by_path.reshape(len(located), 6, -1)
    return located, turned, away


def _of_gyro(sensor: Drawn, knots: Samples, located: Array, turned: Array, _away: Array) -> Rows:
    """Return the rows of a gyro: mean rates between knots, in its axes."""
    used, step = sensor.used, float(knots.time[1])
    middle, time = 0.5 * (turned[1:] + turned[:-1]), 0.5 * (knots.time[1:] + knots.time[:-1])
    back = np.swapaxes(middle, -1, -2)
    rows = back @ np.diff(located[:, :3], axis=0) / step
    rate = _rates(turned, step)
    slope = np.gradient(rate, time, axis=0)
    starts = np.arange(0.0, time[-1], _WALK)
    walk = np.clip((time[:, None] - starts) / _WALK, 0.0, 1.0)
    each = np.eye(3)
    extra = np.concatenate(
        (
            np.tile(each, (len(time), 1, 1)),
            rate[:, :, None] * each,
            skew(rate),
            -slope[:, :, None],
            np.einsum('tw,ij->tiwj', walk, each).reshape(len(time), 3, -1),
        ),
        axis=-1,
    )
    sizes = [float(str(used[name])) for name in ('bias_std', 'scale_std', 'orientation_std')]
    walking = np.full(3 * len(starts), 2e-5 * np.sqrt(_WALK))
    prior = np.concatenate((np.repeat(sizes, 3), [5e-3], walking))
    noise = float(str(used['noise_density'])) / np.sqrt(step)
    return rows.reshape(-1, rows.shape[-1]) / noise, extra.reshape(-1, extra.shape[-1]) / noise, prior


def _rates(turned: Array, step: float) -> Array:
    """Return the angular velocity (T - 1, 3) between orientations (T, 3, 3), in their own axes."""
    relative = np.swapaxes(turned[:-1], -1, -2) @ turned[1:]
    away = 0.5 * (relative - np.swapaxes(relative, -1, -2))
    return np.stack((away[:, 2, 1], away[:, 0, 2], away[:, 1, 0]), axis=-1) / step


def _of_pose(sensor: Drawn, knots: Samples, located: Array, turned: Array, away: Array) -> Rows:
    """Return the rows of a sensor of poses at its readings."""
    used, declared, rows = sensor.used, NamedPoseConfig(), _ROWS[str(sensor.used['measures'])]
    frequency, step = float(str(sensor.made['rate'])), float(knots.time[1])
    at = _instants(knots, frequency)
    place = (knots.base_position - knots.base_position[0] + away)[at]
    rate = np.einsum('tij,tj->ti', turned[:-1], _rates(turned, step))
    motion = np.concatenate((rate, np.diff(knots.base_position + away, axis=0) / step), axis=1)[
        np.minimum(at, len(rate) - 1)
    ]
    extra = np.zeros((len(at), 6, 17))
    extra[:, :3, :3] = extra[:, 3:, 3:6] = turned[at]
    extra[:, :3, 6:9] = extra[:, 3:, 9:12] = np.eye(3)
    extra[:, 3:, 6:9] = -skew(place)
    extra[:, :, 12], extra[:, 3:, 13] = -motion, place
    extra[:, :, 14:17] = knots.time[at, None, None] * extra[:, :, 6:9]
    world = (1e-9, 1e-9) if used['same_world'] else _WORLD
    sizes = (declared.mount_orientation_std, declared.mount_position_std, *world)
    prior = np.concatenate(
        (np.repeat(sizes, 3), [declared.time_offset_std, declared.scale_std], np.full(3, declared.turning_std))
    )
    noise = np.repeat([float(str(used['orientation_std'])), float(str(used['position_std']))], 3)
    weight = (_density(knots, frequency) / noise)[rows, None]
    own = (extra[:, rows] * weight).reshape(-1, 17)
    return (located[at][:, rows] * weight).reshape(-1, located.shape[-1]), own, prior
