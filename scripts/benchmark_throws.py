"""Calibrate throws of TU Delft, of a clone that you have made, and compare them with the geometry of what was thrown.

    git clone https://github.com/tudelft/inertiaEstimation
    python scripts/benchmark_throws.py inertiaEstimation [--bags FOLDER]

Needs orangebox. For each object: how many throws have a solution, principal moments of device and object together, by
how much they scatter from throw to throw, how wide their intervals are; then those of the object alone. Device and
offset are taken off as the authors do it, the device as its own throws say, with centres of mass by least squares from
the accelerometer.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from mbaid_ros.core.geometry import Array, unvec
from mbaid_ros.core.robot.momentum import physical_jacobian
from mbaid_ros.recordings.convert import main as convert
from mbaid_ros.recordings.throws import OBJECTS, read_tudelft_throw
from mbaid_ros.replay.calibrate import main as calibrate

THROWN = {
    'device-only': 'final_calibration/device_only',
    **{name: f'final_tests/config_{name}' for name in ('empty', 'a', 'b', 'c')},
}
_SMOOTH = 41  # samples, 10 ms, over which gyro and accelerometer are averaged


@dataclass(frozen=True)
class Throw:
    """What a throw has come to.

    Attributes
    ----------
    log : name
    inertia : (3, 3) kg m^2, of all about its centre of mass
    moments, std : (3,) kg m^2, principal ones, and one standard deviation of each
    com : (3,) m, in the device's frame, by the accelerometer
    residual : 1 is as noisy as declared
    """

    log: str
    inertia: Array
    moments: Array
    std: Array
    com: Array
    residual: float


def thrown(log: Path, name: str, folder: Path) -> Throw | None:
    """Return what a throw has come to; None where there is no solution."""
    bag, result = folder / log.stem, folder / f'{log.stem}.json'
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        if not bag.exists():
            convert(['tudelft-throw', str(log), '--object', name, '--output', str(bag)])
        arguments = [bag, '--model', bag / 'robot.urdf', '--params', bag / 'estimator.yaml']
        if calibrate([str(each) for each in (*arguments, '--json', result)]) != 0:
            return None
    found = json.loads(result.read_text(encoding='utf-8'))
    standard, covariance = (np.array(found['covariance'][key]) for key in ('values', 'matrix'))
    jacobian = physical_jacobian(standard[:10])[4:]
    elements = found['links']['device']['estimate']['inertia']
    inertia = unvec(np.array([elements[key] for key in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')]))
    moments, axes = np.linalg.eigh(inertia)
    x, y, z = axes
    along = np.stack((x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z), axis=1) @ jacobian
    std = np.sqrt(np.diag(along @ covariance[:10, :10] @ along.T))
    return Throw(log.stem, inertia, moments, std, centre(log, name), found['residual'])


def centre(log: Path, name: str) -> Array:
    """Return the centre of mass in the device's frame, (3,) m, by least squares from gyro and accelerometer.

    What falls freely is felt where it is not: a = w' x r + w x (w x r) at r from the centre of mass, and a bias.
    """
    imu = read_tudelft_throw(log, name).imu
    assert imu is not None, 'there is an IMU'
    box = np.ones(_SMOOTH) / _SMOOTH
    rate, felt = (
        np.stack([np.convolve(each, box, 'valid') for each in values.T], axis=1)
        for values in (imu.angular_velocity, imu.linear_acceleration)
    )
    turning = np.gradient(rate, float(np.median(np.diff(imu.time))), axis=0)
    cross = [np.cross(turning, axis) + np.cross(rate, np.cross(rate, axis)) for axis in np.eye(3)]
    columns = np.concatenate((np.stack(cross, axis=-1), np.tile(np.eye(3), (len(rate), 1, 1))), axis=2)
    found = np.linalg.lstsq(columns.reshape(-1, 6), felt.ravel(), rcond=None)[0]
    return -np.asarray(found[:3])


def alone(throw: Throw, device: Sequence[Throw], mass: float) -> Array:
    """Return the principal moments (3,) of what was thrown with the device, kg m^2, of a mass in kg."""
    whole = OBJECTS['device-only'].whole()[0] + mass
    of_device, own = np.mean([each.com for each in device], axis=0), np.mean([each.inertia for each in device], axis=0)
    offset = whole / mass * (throw.com - of_device)  # of its centre of mass from the device's
    apart = (whole - mass) * mass / whole * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return np.asarray(np.linalg.eigvalsh(throw.inertia - own - apart))


def shown(values: Array, scale: float = 1.0, digits: int = 1) -> str:
    """Return numbers in a few words."""
    return ', '.join(f'{each:.{digits}f}' for each in scale * values)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('clone', type=Path)
    parser.add_argument('--bags', type=Path, help='folder to keep the bags in')
    parser.add_argument('--thrown', nargs='*', default=list(THROWN), choices=list(THROWN))
    arguments = parser.parse_args()
    found: dict[str, list[Throw]] = {}
    print('| thrown | solved | residual | principal moments, kg mm² | scatter, % | std, % | CoM, mm |')
    print('|---|---|---|---|---|---|---|')
    with TemporaryDirectory() as temporary:
        for name in arguments.thrown:
            folder = (arguments.bags or Path(temporary)) / name
            folder.mkdir(parents=True, exist_ok=True)
            logs = sorted((arguments.clone / 'input' / THROWN[name]).glob('*.BFL'))
            found[name] = [each for each in (thrown(log, name, folder) for log in logs) if each is not None]
            moments, std = (np.array([getattr(each, key) for each in found[name]]) for key in ('moments', 'std'))
            mean = np.mean(moments, axis=0)
            parts = shown(np.std(moments, axis=0, ddof=1) / mean, 100.0), shown(np.median(std, axis=0) / mean, 100.0)
            residuals = [each.residual for each in found[name]]
            solved = f'{len(found[name])} of {len(logs)} | {min(residuals):.2f} to {max(residuals):.2f}'
            com = shown(np.std([each.com for each in found[name]], axis=0, ddof=1), 1e3, 2)
            print(f'| {name} | {solved} | {shown(mean, 1e6)} | {parts[0]} | {parts[1]} | {com} |', flush=True)
    print('\n| object alone | geometry, kg mm² | mean error, % | scatter, % | median of all, % | within 95 % |')
    print('|---|---|---|---|---|---|')
    for name in (each for each in arguments.thrown if each != 'device-only'):
        truth, mass = OBJECTS[name].moments, OBJECTS[name].mass
        errors = np.array([alone(each, found['device-only'], mass) / truth - 1.0 for each in found[name]])
        columns = shown(np.mean(errors, axis=0), 100.0), shown(np.std(errors, axis=0, ddof=1), 100.0)
        median = 100.0 * float(np.median(np.abs(errors)))
        bands = 1.96 * np.array([each.std for each in found[name]]) / truth  # those of all that flies
        held = f'{100.0 * float(np.mean(np.abs(errors) < bands)):.0f} % of {errors.size}'
        print(f'| {name} | {shown(truth, 1e6, 0)} | {columns[0]} | {columns[1]} | {median:.1f} | {held} |', flush=True)


if __name__ == '__main__':
    main()
