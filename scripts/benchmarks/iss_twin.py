"""Twins of the space station's telemetry: its stamps, gaps, rates and joints, other bodies, and their true moments."""

from dataclasses import replace

import numpy as np
import yaml
from scipy.ndimage import gaussian_filter1d

from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.core.links import BodyDeviations
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.body import are_physical
from mbaid_ros.core.robot.model import express, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel, inverse_inertia_and_momentum
from mbaid_ros.recordings.recording import Recording

NAMES = ('base_link', 'array_port', 'array_starboard')
_NEEDED = 'the telemetry has it'
_GRID, _SMOOTH = 0.5, 10.0  # s, of the simulated motion; of its smoothing
_LATE = 2.0  # s, largest delay of its joints
_BODIES = BodyDeviations(0.02, 0.5, 0.15)  # of the twins' bodies about the robot description


def twin(flown: Recording, seed: int) -> tuple[Recording, Array]:
    """Return the readings of a twin, and its true bodies (3, 10), standard parameters.

    Its motion is that of the telemetry. Its gyros store the momentum that conservation leaves, with gravity gradient
    and a torque that varies as declared. All readings have the noise that the parameters declare.
    """
    assert flown.imu, _NEEDED
    assert flown.imu.orientation is not None, _NEEDED
    assert flown.joints, _NEEDED
    assert flown.stored, _NEEDED
    rng = np.random.default_rng(seed)
    declared = yaml.safe_load(flown.parameters)['/**']['ros__parameters']
    bodies = _drawn(flown.robot, rng)
    stamps = flown.imu.time
    time = stamps[0] + _GRID * np.arange(round((stamps[-1] - stamps[0]) / _GRID) + 1)
    place = np.round((stamps - stamps[0]) / _GRID).astype(int)
    rate, joints = (_smooth(stamps, each, time) for each in (flown.imu.angular_velocity, flown.joints.position))
    rotation = [rotation_from_quaternion(flown.imu.orientation[0])]
    for step in exp(0.5 * (rate[1:] + rate[:-1]) * _GRID):
        rotation.append(rotation[-1] @ step)
    turned, imu, noise = np.array(rotation), declared['imu'], declared['noise']
    drift = declared['disturbance']
    torque = rotate(turned, _varying(time, drift['torque_std'], drift['torque_time'], rng))
    begin = rotate(turned[:1], flown.stored.momentum[:1])[0]
    circle = declared['orbit']
    orbit = Orbit.inertial(circle['mean_motion'], np.array(circle['nadir']), np.array(circle['normal']))
    orbit = orbit.with_eccentricity(circle['eccentricity'], circle['true_anomaly'])
    stored = _stored(flown.robot, bodies, (time, turned, rate, joints), orbit, torque, begin)[place]
    read = rate[place] + imu['bias_std'] * rng.normal(size=3) + imu['noise_density'] * rng.normal(size=(len(place), 3))
    error = _varying(stamps, noise['base_orientation'], noise['base_correlation_time'], rng)
    late = _LATE * rng.uniform(-1.0, 1.0)
    shown = np.column_stack([np.interp(stamps - late, time, each) for each in joints.T])
    shown += noise['joint_position'] * rng.normal(size=shown.shape)
    stored += declared['wheels']['momentum_std'] * rng.normal(size=stored.shape)
    orientation = quaternion_from_rotation(turned[place] @ exp(error))
    return replace(
        flown,
        imu=replace(flown.imu, angular_velocity=read, orientation=orientation),
        joints=replace(flown.joints, position=shown),
        stored=replace(flown.stored, momentum=stored),
    ), bodies


def _drawn(urdf: str, rng: np.random.Generator) -> Array:
    """Return bodies that can exist, about those of a robot description."""
    links = [load_model(urdf).link(name) for name in NAMES]
    factors = [_BODIES.factor(link.parameters) for link in links]
    while True:
        drawn = [link.parameters + f @ rng.normal(size=f.shape[1]) for link, f in zip(links, factors, strict=True)]
        if are_physical(np.array(drawn)).all():
            return np.array(drawn)


def _smooth(stamps: Array, values: Array, time: Array) -> Array:
    each = np.column_stack([np.interp(time, stamps, column) for column in values.T])
    return np.asarray(gaussian_filter1d(each, _SMOOTH / _GRID, axis=0))


def _varying(time: Array, std: float, constant: float, rng: np.random.Generator) -> Array:
    """Return a Gauss-Markov process (N, 3)."""
    values = [std * rng.normal(size=3)]
    for kept in np.exp(-np.diff(time) / constant):
        values.append(kept * values[-1] + np.sqrt(1.0 - kept**2) * std * rng.normal(size=3))
    return np.array(values)


def _stored(
    urdf: str, bodies: Array, motion: tuple[Array, Array, Array, Array], orbit: Orbit, torque: Array, begin: Array
) -> Array:
    """Return the momentum (N, 3) of the gyros, base axes, by (3, 10) true bodies and the momentum at the begin (3,).

    The motion has times, rotations, rates in base axes and joint angles; the torque from outside has inertial axes.
    """
    time, rotation, rate, joints = motion
    kinematics = MomentumKernel(load_model(urdf), NAMES[0]).kinematics
    placed = kinematics.configure(rotation, joints)
    at_rest = kinematics.body_twists(placed, np.gradient(joints, time, axis=0), np.zeros((len(time), 6)))
    inverse_inertia, moving = inverse_inertia_and_momentum(express(bodies, placed.rotation, placed.position), at_rest)
    # V = M^-1 (h - b) with no linear momentum, as in `angular_momentum` of the filter.
    rest = (inverse_inertia @ moving[..., None])[..., 0]
    own = np.linalg.solve(inverse_inertia[:, 3:, 3:], (rotate(rotation, rate) + rest[:, 3:])[..., None])[..., 0]
    central = np.linalg.inv(inverse_inertia[:, 3:, 3:])
    up = orbit.zenith_at(time - time[0])
    torque = torque + 3.0 * orbit.gradient_strength(time - time[0])[:, None] * np.cross(up, rotate(central, up))
    steps = 0.5 * (torque[1:] + torque[:-1]) * np.diff(time)[:, None]
    pushed = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    return rotate_back(rotation, begin + own[0] + pushed - own)
