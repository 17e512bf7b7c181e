"""Weigh the space station from a clone of its telemetry, draw docs/images/iss.svg, and test the intervals on twins.

A twin moves as the telemetry says, with its stamps, gaps, rates and joints. Its bodies are drawn, and its gyros store
what conservation of momentum then leaves them, with gravity gradient and a torque that varies as declared. Prints
tables for docs/measured/hardware.md; writes nothing of the telemetry but the picture.
"""

from __future__ import annotations

import argparse
import json
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib as mpl
import numpy as np
import yaml
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter1d

from mbaid_ros.core.geometry import (
    Array,
    exp,
    quaternion_from_rotation,
    rotate,
    rotate_back,
    rotation_from_quaternion,
)
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link, RobotModel, express, load_model
from mbaid_ros.core.robot.model_errors import BodyDeviations
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.robot.orbit import Orbit
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum
from mbaid_ros.recordings.iss import read_iss
from mbaid_ros.recordings.recording import Recording, write_recording
from mbaid_ros.replay import start

PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'images' / 'iss.svg'
WINDOW = (6861.75, 6863.005)
NAMES = ('base_link', 'array_port', 'array_starboard')
NEEDED = 'the telemetry has it'
MOMENTS, BAND = [4, 7, 9], 1.96
SMOOTH, LAG = 10, 2.0  # samples of smoothing of the twin's motion; s, largest delay of its joints
TRUE = BodyDeviations(0.02, 0.5, 0.15)  # of the twins' bodies about the robot description


def total(parameters: Array, links: list[Link]) -> Array:
    """Return the moments (3,) of all bodies about their common centre, of (30,) parameters, the arrays at zero."""
    each = zip(parameters.reshape(-1, 10), links, strict=True)
    place = {'array_port': -33.0, 'array_starboard': 33.0}
    parts = [express(one, np.eye(3), np.array([0.0, place.get(link.name, 0.0), 0.0])) for one, link in each]
    return np.asarray(physical(np.sum(parts, axis=0))[MOMENTS])


def weighed(recording: Recording, folder: Path) -> tuple[Array, Array, float] | None:
    """Return the moments of all bodies, their standard deviations and the residual; None where nothing is published."""
    bag, out = folder / 'bag', folder / 'out.json'
    folder.mkdir(exist_ok=True)
    write_recording(recording, bag)
    model, parameters = bag / 'robot.urdf', bag / 'estimator.yaml'
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        code = start.calibrate([str(bag), '--model', str(model), '--params', str(parameters), '--json', str(out)])
    if code != 0:
        return None
    result = json.loads(out.read_text())
    values, covariance = (np.array(result['covariance'][name]) for name in ('values', 'matrix'))
    links = [load_model(model.read_text()).link(name) for name in NAMES]
    values, covariance = values[:30], covariance[:30, :30]
    steps = np.maximum(np.abs(values), 1.0) * 1e-6
    jacobian = np.array(
        [(total(values + e * s, links) - total(values, links)) / s for e, s in zip(np.eye(30), steps, strict=True)]
    )
    return total(values, links), np.sqrt(np.diag(jacobian.T @ covariance @ jacobian)), result['residual']


def twin(flown: Recording, seed: int) -> tuple[Recording, Array]:
    """Return readings of a station whose bodies are drawn, and its true moments (3,)."""
    assert flown.imu, NEEDED
    assert flown.imu.orientation is not None, NEEDED
    assert flown.joints, NEEDED
    assert flown.stored, NEEDED
    rng, model = np.random.default_rng(seed), load_model(flown.robot)
    told = yaml.safe_load(flown.parameters)['/**']['ros__parameters']
    links = [model.link(name) for name in NAMES]
    factors = [TRUE.factor(link.parameters) for link in links]
    bodies = np.array(
        [link.parameters + f @ rng.normal(size=f.shape[1]) for link, f in zip(links, factors, strict=True)]
    )
    time, imu, noise = flown.imu.time, told['imu'], told['noise']
    rate = gaussian_filter1d(flown.imu.angular_velocity, SMOOTH, axis=0)
    rotation = [rotation_from_quaternion(flown.imu.orientation[0])]
    for step in exp(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None]):
        rotation.append(rotation[-1] @ step)
    turned, joints = np.array(rotation), gaussian_filter1d(flown.joints.position, SMOOTH, axis=0)
    torque = varying(time, told['disturbance']['torque_std'], told['disturbance']['torque_time'], rng)
    begin = rotate(turned[:1], flown.stored.momentum[:1])[0]
    stored = stored_in(model, bodies, (time, turned, rate, joints), (orbit_of(told['orbit']), torque, begin))
    read = rate + imu['bias_std'] * rng.normal(size=3) + imu['noise_density'] * rng.normal(size=rate.shape)
    error = varying(time, noise['base_orientation'], noise['base_correlation_time'], rng)
    late = LAG * rng.uniform(-1.0, 1.0)
    shown = np.column_stack([np.interp(time - late, time, each) for each in joints.T])
    stored += told['wheels']['momentum_std'] * rng.normal(size=stored.shape)
    return (
        replace(
            flown,
            imu=replace(flown.imu, angular_velocity=read, orientation=quaternion_from_rotation(turned @ exp(error))),
            joints=replace(flown.joints, position=shown),
            stored=replace(flown.stored, momentum=stored),
        ),
        total(bodies.ravel(), links),
    )


def orbit_of(told: dict[str, float]) -> Orbit:
    """Return the orbit that `convert` has put into the parameters."""
    circle = Orbit.inertial(told['mean_motion'], np.array(told['nadir']), np.array(told['normal']))
    return circle.eccentric(told['eccentricity'], told['true_anomaly'])


def varying(time: Array, std: float, constant: float, rng: np.random.Generator) -> Array:
    """Return a Gauss-Markov process (N, 3)."""
    values = [std * rng.normal(size=3)]
    for kept in np.exp(-np.diff(time) / constant):
        values.append(kept * values[-1] + np.sqrt(1.0 - kept**2) * std * rng.normal(size=3))
    return np.array(values)


def stored_in(
    model: RobotModel, bodies: Array, motion: tuple[Array, Array, Array, Array], acting: tuple[Orbit, Array, Array]
) -> Array:
    """Return the momentum (N, 3) of the gyros, base axes, that conservation leaves them.

    Parameters
    ----------
    model, bodies : of the station, and its (3, 10) true bodies
    motion : times, rotations, rates in base axes, joint angles
    acting : orbit, torque from outside (N, 3) in inertial axes, and the gyros' momentum at the begin (3,)
    """
    (time, rotation, rate, joints), (orbit, torque, begin) = motion, acting
    kinematics = MomentumKernel(model, NAMES[0]).kinematics
    placed = kinematics.configure(rotation, joints)
    speed = np.gradient(joints, time, axis=0)
    at_rest = kinematics.body_twists(placed, speed, np.zeros((len(time), 6)))
    mobility, moving = mobility_and_momentum(bodies, placed, at_rest)
    # V = M^-1 (h - b) with no linear momentum, as in `angular_momentum` of the filter.
    rest = (mobility @ moving[..., None])[..., 0]
    own = np.linalg.solve(mobility[:, 3:, 3:], (rotate(rotation, rate) + rest[:, 3:])[..., None])[..., 0]
    central = np.linalg.inv(mobility[:, 3:, 3:])
    up = orbit.upward(time - time[0])
    torque = torque + 3.0 * orbit.strength(time - time[0])[:, None] * np.cross(up, rotate(central, up))
    steps = 0.5 * (torque[1:] + torque[:-1]) * np.diff(time)[:, None]
    pushed = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    return rotate_back(rotation, begin + own[0] + pushed - own)


def draw(flown: Recording) -> None:
    """Draw the window: rates, momentum of the gyros, rates of the array joints."""
    assert flown.imu, NEEDED
    assert flown.joints, NEEDED
    assert flown.stored, NEEDED
    mpl.rcParams.update({'svg.fonttype': 'none', 'svg.hashsalt': 'iss', 'font.size': 8})
    figure = Figure(figsize=(6.4, 4.2), layout='constrained')
    minutes, every = (flown.imu.time - flown.imu.time[0]) / 60.0, slice(None, None, 20)
    speed = np.degrees(np.gradient(gaussian_filter1d(flown.joints.position, SMOOTH, axis=0), flown.imu.time, axis=0))
    parts = (
        ('rates, 1e-3 deg/s', 1e3 * np.degrees(flown.imu.angular_velocity), 'xyz'),
        ('gyros, kN m s', 1e-3 * flown.stored.momentum, 'xyz'),
        ('array joints, deg/s', speed, ('port', 'starboard')),
    )
    for axes, (title, values, names) in zip(figure.subplots(3, 1, sharex=True), parts, strict=True):
        axes.plot(minutes[every], gaussian_filter1d(values, SMOOTH, axis=0)[every], label=list(names), linewidth=0.9)
        axes.set_ylabel(title)
        axes.legend(loc='right', frameon=False)
    axes.set_xlabel('minutes')
    figure.savefig(PICTURE, metadata={'Date': None})


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('archive', type=Path, help='Pi/RecordedData/Data/Archive of a clone of ISS-Mimic at 41955ae')
    parser.add_argument('--seeds', type=int, default=40, help='twins')
    arguments = parser.parse_args()
    flown = read_iss(arguments.archive, *WINDOW)
    draw(flown)
    inside, normalised = 0, []
    with TemporaryDirectory() as folder:
        print('window A', weighed(flown, Path(folder)))
        for seed in range(arguments.seeds):
            readings, truth = twin(flown, seed)
            found = weighed(readings, Path(folder) / str(seed))
            if found is None:
                print(seed, 'nothing published')
                continue
            normalised.append((found[0] - truth) / found[1])
            inside += int(np.sum(np.abs(normalised[-1]) < BAND))
            print(seed, truth / 1e6, found[0] / 1e6, found[1] / 1e6, f'residual {found[2]:.2f}', flush=True)
    print(
        f'{inside} of {3 * len(normalised)} moments within 95 %, {len(normalised)} of {arguments.seeds} twins published'
    )


if __name__ == '__main__':
    main()
