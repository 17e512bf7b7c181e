"""Simulated twins of benches with published logs: their rates, noise, defects and formats."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import savemat

from benchmarks.data import last_state
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import Kinematics, RobotModel, express, load_model
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.recordings.air_bearing import FORCES, LATE
from mbaid_ros.recordings.recording import resource
from mbaid_ros.recordings.spot import BASE, COMMANDS_FILE
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import BodyWrench
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Simulation, Truth
from mbaid_ros.simulation.true_robot import ErrorStds, draw, generator, true_robot

_ENCODER = 1.5e-3  # rad, one step
_COMMAND = 10  # rows of the log of 2023 that a command lasts
_THRUST = np.array([0.14, 0.14, 0.0, 0.0, 0.0, 0.006])  # N, N m
_ARM = 42.0  # s, when the arm begins to move in the logs of 2021
_TRACKING, _LAG = 2.0, 0.2  # s, time constants of the joints' deviation from their commands, and of their lag
_TURN, _STEPS = 0.06, 12  # s of a turn of the control loop of a table with thrusters; steps of the simulation in it
_BEFORE = 200  # steps of that, until it is stationary


@dataclass(frozen=True)
class Twin:
    """A simulated run of a bench."""

    log: Path  # in the format of the bench
    truth: Array  # (10,) mass, CoM, inertia about it of the target link
    lag: float = 0.0  # s, of the arm behind its commands
    slope: float = 0.0  # m/s^2, of the table


def spot_2021(folder: Path, seed: int, duration: float = 32.0, tracking: float = 0.02) -> Twin:
    """Write a log of the bench of 2021, of a robot near the described one.

    The useful part lasts `duration` s; the joints deviate from their commands by `tracking` rad, a standard deviation.
    """
    rng = np.random.default_rng(seed)
    described = load_model(resource('spot_2021.urdf'))
    base = physical(described.link(BASE).parameters)
    # The base is the target: it differs from the nominal one.
    base[[0, 1, 2, 9]] = (
        base[0] * rng.uniform(0.85, 1.1), *rng.uniform(-0.01, 0.01, 2), base[9] * rng.uniform(0.7, 1.1)
    )  # fmt: skip
    base[[4, 7]] = base[9] / 2.0
    true = load_model(replace_inertial(described.urdf, BASE, base))
    sizes = ErrorStds(links_relative_std=0.02, zero_std=0.05, origin_std=0.01)
    errors = draw(true, BASE, sizes, generator(seed))
    robot, lag = true_robot(true, errors, (BASE,)), rng.uniform(0.2, 0.35)
    motion = _arm(rng)
    slope = rng.uniform(-6e-4, 6e-4, 2)
    logged = _ARM + 0.4 + np.arange(0.0, duration, 0.1)
    updated = np.floor(logged / 0.2 + 1e-9) * 0.2  # stamp of the pose
    seen = _pulled(robot, motion, slope).advance(updated - _ARM - lag)
    noise = rng.normal(size=(len(logged), 3))[np.round((updated - updated[0]) / 0.2).astype(int)] * (5e-4, 5e-4, 2e-3)
    table = np.zeros((len(logged), 65))
    table[:, 0] = logged
    table[:, 4:6] = seen.base_position[:, :2] + noise[:, :2]
    heading = 2.0 * np.arctan2(seen.base_orientation[:, 2], seen.base_orientation[:, 3]) + noise[:, 2]
    table[:, 6] = np.arctan2(np.sin(heading), np.cos(heading))
    savemat(folder / 'run__stitched.mat', {'rt_tout': logged[:, None], 'rt_dataPacket': table})
    commanded = np.linspace(0.0, duration, 400)
    states = np.zeros((12, len(commanded)))
    states[3:6] = np.transpose([motion.reference(time)[0] for time in commanded]) - errors.zeros[:, None]
    states[3:6] -= tracking * _wandering(np.random.default_rng([seed, 1]), commanded)
    savemat(folder / COMMANDS_FILE, {'primal': {'time': commanded, 'states': states}})
    return Twin(folder / 'run__stitched.mat', base, lag, float(np.linalg.norm(slope)))


def _arm(rng: np.random.Generator) -> Sinusoids:
    amplitude = rng.uniform(0.5, 1.0, (3, 1)) * rng.choice((-1.0, 1.0), (3, 1)) * np.array([[0.4], [0.9], [0.6]])
    start = np.array([np.pi / 2.0, 0.0, 0.0]) - amplitude[:, 0]
    return Sinusoids(start, amplitude, 1.0 / rng.uniform(12.0, 25.0, (3, 1)), np.full((3, 1), -np.pi / 2.0))


def _wandering(rng: np.random.Generator, time: Array) -> Array:
    """Return (3, N) errors of three joints at even times: a first-order process behind a lag, variance 1."""
    kept, passed = np.exp(-(time[1] - time[0]) / np.array([_TRACKING, _LAG]))
    off, lagging = np.zeros((2, 3, len(time) + _BEFORE))
    for index in range(1, off.shape[1]):
        off[:, index] = kept * off[:, index - 1] + np.sqrt(1.0 - kept**2) * rng.normal(size=3)
        lagging[:, index] = passed * lagging[:, index - 1] + (1.0 - passed) * off[:, index]
    return np.asarray(lagging[:, _BEFORE:] * np.sqrt(1.0 + _LAG / _TRACKING))


def _at_rest(robot: RobotModel, motion: Sinusoids) -> State:
    return State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), motion.start, np.zeros(6 + robot.joints))


def _pulled(robot: RobotModel, motion: Sinusoids, slope: Array) -> Simulation:
    """Return a robot that slides down a table, from rest: gravity acts at the common centre of mass."""
    placed = Kinematics(robot).configure(np.eye(3)[None], motion.start[None])
    bodies = express(robot.body_parameters(), placed.rotation[0], placed.position[0])
    mass, first = bodies[:, 0].sum(), bodies[:, 1:4].sum(axis=0)
    force = np.append(mass * slope, 0.0)
    wrench = np.concatenate((force, np.cross(first / mass, force)))
    return Simulation(robot, motion, _at_rest(robot, motion), BodyWrench.on_link(None, wrench))


def spot_2023(folder: Path, seed: int, duration: float = 60.0, links: float = 0.01) -> Twin:
    """Write a log of the bench of 2023, whose arm holds a satellite firmly and whose thrusters obey their commands.

    The useful part lasts `duration` s; `links` is the relative standard deviation of the known bodies.
    """
    rng = np.random.default_rng(seed)
    described = load_model(resource('spot_2023.urdf'))
    body = np.array([10.8, rng.uniform(0.25, 0.35), rng.uniform(-0.05, 0.05), 0.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.2])
    true = load_model(replace_inertial(described.urdf, 'hand', body))
    errors = draw(true, 'hand', ErrorStds(links_relative_std=links, zero_std=2e-3, origin_std=5e-4), generator(seed))
    robot, motion = true_robot(true, errors, ('hand',)), _arm(rng)
    scale = rng.uniform(0.7, 1.1)
    time = np.arange(0.0, duration, 0.05)
    commands = rng.choice((-1.0, 1.0), (1 + len(time) // _COMMAND, 6)) * _THRUST  # always on, one way or the other
    wrench = commands[np.arange(len(time)) // _COMMAND]
    seen = _pushed(robot, motion, time, scale * commands)
    new = np.floor(time * 16.0 + 1e-9).astype(int)  # the motion capture's frames
    first = np.concatenate(([True], np.diff(new) > 0))
    held = np.maximum.accumulate(np.where(first, np.arange(len(time)), 0))
    noise = rng.normal(size=(len(time), 3))[held] * (1e-4, 1e-4, 3e-4)
    heading = 2.0 * np.arctan2(seen.base_orientation[held, 2], seen.base_orientation[held, 3])
    read = seen.joint_position - errors.zeros + rng.normal(size=(len(time), 3)) * 3e-4
    table = np.zeros((len(time), 81))
    table[:, 0] = time + 165.0
    cos, sin = np.cos(heading), np.sin(heading)
    table[:, 1], table[:, 2] = cos * wrench[:, 0] - sin * wrench[:, 1], sin * wrench[:, 0] + cos * wrench[:, 1]
    table[:, 3], heading = wrench[:, 5], heading + noise[:, 2]
    table[:, 4:6] = 1.5 + seen.base_position[held, :2] + noise[:, :2]
    table[:, 6] = np.arctan2(np.sin(heading), np.cos(heading))
    table[:, 64:67] = np.round(read / _ENCODER) * _ENCODER
    table[:, 67:70] = seen.joint_velocity + rng.normal(size=(len(time), 3)) * 1e-2
    np.savetxt(folder / 'ExpLog', table, fmt='%.10g', delimiter=',')
    return Twin(folder / 'ExpLog', body)


def _pushed(robot: RobotModel, motion: Sinusoids, time: Array, wrenches: Array) -> Truth:
    """Return the motion of a robot from rest, with one wrench after the other on its base, in its axes."""
    state = _at_rest(robot, motion)
    parts, base = [], robot.link(BASE)
    for begin, wrench in zip(range(0, len(time), _COMMAND), wrenches, strict=False):
        instants = time[begin : begin + _COMMAND + 1]
        run = Simulation(robot, motion.from_time(float(instants[0])), state, BodyWrench.on_link(base, wrench))
        # The last one is where the next wrench begins.
        instants = np.append(instants, instants[-1] + time[1]) if len(instants) <= _COMMAND else instants
        part = run.advance(instants - instants[0])
        state = last_state(part)
        parts.append(part[: len(part) - 1])
    return Truth.concatenate(parts)


@dataclass(frozen=True)
class Thrusters:
    """Standard deviations of the eight thrusters of a body on a table, and of the table's force."""

    scale: tuple[float, ...] = (0.1,) * len(FORCES)  # of each, relative
    direction: float = 0.0  # rad
    delay: float = 0.0  # s
    force: float = 0.0  # N, along each axis of the table
    torque: float = 0.0  # N m

    @property
    def declared(self) -> tuple[tuple[str, object], ...]:
        """Return the parameters that declare them."""
        return (
            ('thrust.direction_std', self.direction),
            ('thrust.delay_std', self.delay),
            ('disturbance.force_std', self.force),
            ('disturbance.torque_std', self.torque),
            *((f'thrust.thruster{place + 1}.scale_std', scale) for place, scale in enumerate(self.scale)),
        )


def air_bearing(folder: Path, seed: int, stds: Thrusters, duration: float = 20.0) -> Twin:
    """Write a log of a body that eight thrusters move, each weaker or stronger, askew and late by numbers of its own.

    Commands change every fourth turn of the loop; noise and forces are as the parameters of `convert` declare them.
    """
    rng = np.random.default_rng(seed)
    mass, moment = np.clip(rng.normal(23.4, 5.0), 13.0, 34.0), rng.uniform(0.35, 0.6)
    centre = np.array([0.002, 0.002]) + rng.normal(0.0, 0.005, 2)
    on = np.repeat(rng.integers(0, 2, (round(duration / _TURN / 4), len(FORCES))), 4, axis=0).astype(float)
    steps = np.arange(len(on) * _STEPS + 1) * (_TURN / _STEPS)
    total = np.vstack((np.zeros(len(FORCES)), np.cumsum(on, axis=0) * _TURN))  # s that each was commanded until a turn
    late = LATE + rng.normal(0.0, stds.delay, len(FORCES))
    turns = np.arange(len(on) + 1) * _TURN
    share = np.column_stack(
        [np.diff(np.interp(steps - each, turns, part)) for each, part in zip(late, total.T, strict=True)]
    )
    wrench = share / steps[1] @ _planar(rng, stds, centre)
    slope = _first_order(rng, len(wrench), steps[1], 0.7) * (stds.force, stds.force, stds.torque)
    pose = _glided(wrench, slope, np.array([mass, moment]), centre, steps[1])[::_STEPS]
    noise = _first_order(rng, len(pose), _TURN, 0.06) * (5e-4, 5e-4, 1e-3)
    read = (pose + noise) * (1e3, 1e3, np.degrees(1.0))
    with (folder / 'run.csv').open('w', encoding='utf-8', newline='') as file:
        table = csv.writer(file)
        table.writerow(('Control_Time', 'Telemetry_X_mm', 'Telemetry_Z_mm', 'Telemetry_Yaw_deg', 'Command_Vector'))
        for time, (x, y, heading), commands in zip(turns, read, on.astype(int).tolist(), strict=False):
            table.writerow((f'{time:.2f}', f'{x:.6f}', f'{y:.6f}', f'{heading:.6f}', str(commands)))
    truth = np.array([mass, *centre, 0.0, moment / 2.0, 0.0, 0.0, moment / 2.0, 0.0, moment])
    return Twin(folder / 'run.csv', truth)


def _planar(rng: np.random.Generator, stds: Thrusters, centre: Array) -> Array:
    """Return force x, y and torque about the centre of mass (8, 3) of the thrusters as they are."""
    robot = load_model(resource('air_bearing_thrusters.urdf'))
    rows = []
    for place, (force, scale) in enumerate(zip(FORCES, stds.scale, strict=True)):
        link = robot.link(f'thruster{place + 1}')
        turn = quaternions.exp(rng.normal(0.0, stds.direction, 3))
        pushed = (
            force * (1.0 + rng.normal(0.0, scale)) * link.rotation @ quaternions.rotate(turn, np.array([1.0, 0.0, 0.0]))
        )
        rows.append((pushed[0], pushed[1], np.cross(link.position - np.append(centre, 0.0), pushed)[2]))
    return np.array(rows)


def _first_order(rng: np.random.Generator, count: int, step: float, time: float) -> Array:
    """Return (N, 3) values of first-order processes of variance 1 with a time constant, s."""
    kept, drawn = np.exp(-step / time), rng.normal(size=(count, 3))
    for index in range(1, count):
        drawn[index] = kept * drawn[index - 1] + np.sqrt(1.0 - kept**2) * drawn[index]
    return drawn


def _glided(wrench: Array, outside: Array, body: Array, centre: Array, step: float) -> Array:
    """Return x, y and heading (N + 1, 3) of the base, from wrenches in its axes and forces in those of the table."""
    place, speed, poses = np.zeros(3), np.array([0.02, -0.03, 0.05]), []
    inertia = body[[0, 0, 1]]
    for own, other in zip(wrench, outside, strict=True):
        poses.append(place.copy())
        rate = (_turned(place[2] + 0.5 * step * speed[2], own) + other) / inertia
        place, speed = place + step * speed + 0.5 * step**2 * rate, speed + step * rate
    found = np.array([*poses, place])
    return found - np.array([_turned(heading, np.append(centre, 0.0)) for heading in found[:, 2]])


def _turned(heading: float, values: Array) -> Array:
    """Return values (3,) whose first two are turned by a heading."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([cos * values[0] - sin * values[1], sin * values[0] + cos * values[1], values[2]])
