"""Print the tables of measured/throws.md, beside the geometry of the thrown objects.

    git clone https://github.com/tudelft/inertiaEstimation
    python scripts/benchmark_throws.py inertiaEstimation

Needs orangebox. Device and offset are subtracted as by the authors: the device by its own throws, centres of mass by
least squares from the accelerometer.
"""

import json
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.frame import table
from mbaid_ros.core.geometry import Array, unvec
from mbaid_ros.core.robot.body import physical_jacobian
from mbaid_ros.recordings.convert import main as convert
from mbaid_ros.recordings.throws import OBJECTS, read_tudelft_throw
from mbaid_ros.replay.arguments import calibrate

DEVICE = 'device-only'
THROWN = {
    DEVICE: 'final_calibration/device_only',
    **{name: f'final_tests/config_{name}' for name in ('empty', 'a', 'b', 'c')},
}
_SMOOTH = 41  # samples, 10 ms, over which gyro and accelerometer are averaged


@dataclass(frozen=True)
class Throw:
    """The result of a throw."""

    inertia: Array  # (3, 3) kg m^2, of device and object about their centre of mass
    moments: Array  # (3,) kg m^2, principal ones
    std: Array  # (3,) kg m^2
    com: Array  # (3,) m, in the device's frame, by the accelerometer
    residual: float  # 1 is as noisy as declared


def thrown(log: Path, name: str, folder: Path) -> Throw | None:
    """Return the result of a throw; None without a solution."""
    bag, result = folder / log.stem, folder / f'{log.stem}.json'
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        convert(['tudelft-throw', str(log), '--object', name, '--output', str(bag)])
        arguments = [bag, '--model', bag / 'robot.urdf', '--params', bag / 'estimator.yaml', '--json', result]
        if calibrate([str(each) for each in arguments]) != 0:
            return None
    found = json.loads(result.read_text(encoding='utf-8'))
    standard, covariance = (np.array(found['covariance'][key]) for key in ('values', 'matrix'))
    jacobian = physical_jacobian(standard[:10])[4:]
    elements = found['links']['device']['estimate']['inertia']
    inertia = unvec(np.array([elements[key] for key in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')]))
    moments, (x, y, z) = np.linalg.eigh(inertia)
    along = np.stack((x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z), axis=1) @ jacobian
    std = np.sqrt(np.diag(along @ covariance[:10, :10] @ along.T))
    return Throw(inertia, moments, std, centre(log, name), found['residual'])


def centre(log: Path, name: str) -> Array:
    """Return the centre of mass in the device's frame, (3,) m, by least squares from gyro and accelerometer.

    In free fall the accelerometer measures a = w' x r + w x (w x r) at r from the centre of mass, and a bias.
    """
    imu = read_tudelft_throw(log, name).imu
    assert imu is not None, 'there is an IMU'
    box = np.ones(_SMOOTH) / _SMOOTH
    rate, measured = (
        np.stack([np.convolve(each, box, 'valid') for each in values.T], axis=1)
        for values in (imu.angular_velocity, imu.linear_acceleration)
    )
    turning = np.gradient(rate, float(np.median(np.diff(imu.time))), axis=0)
    cross = [np.cross(turning, axis) + np.cross(rate, np.cross(rate, axis)) for axis in np.eye(3)]
    columns = np.concatenate((np.stack(cross, axis=-1), np.tile(np.eye(3), (len(rate), 1, 1))), axis=2)
    return -np.asarray(np.linalg.lstsq(columns.reshape(-1, 6), measured.ravel(), rcond=None)[0][:3])


def alone(throw: Throw, device: Sequence[Throw], mass: float) -> Array:
    """Return the principal moments (3,) of an object of a mass (kg) without the device, kg m^2."""
    whole = OBJECTS[DEVICE].combined_body()[0] + mass
    of_device, own = np.mean([each.com for each in device], axis=0), np.mean([each.inertia for each in device], axis=0)
    offset = whole / mass * (throw.com - of_device)  # of its centre of mass from the device's
    apart = (whole - mass) * mass / whole * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return np.asarray(np.linalg.eigvalsh(throw.inertia - own - apart))


def _shown(values: Array, scale: float = 1.0, digits: int = 1) -> str:
    return ', '.join(f'{each:.{digits}f}' for each in scale * values)


def main(clone: Path) -> None:
    """Print the tables."""
    found, rows = dict[str, list[Throw]](), []
    for name, place in THROWN.items():
        logs = sorted((clone / 'input' / place).glob('*.BFL'))
        with TemporaryDirectory() as folder:
            found[name] = [each for log in logs if (each := thrown(log, name, Path(folder))) is not None]
        moments, std, com = (
            np.array([getattr(each, key) for each in found[name]]) for key in ('moments', 'std', 'com')
        )
        mean, residuals = np.mean(moments, axis=0), [each.residual for each in found[name]]
        scatter = _shown(np.std(moments, axis=0, ddof=1) / mean, 100.0)
        solved = [f'{len(found[name])} of {len(logs)}', f'{min(residuals):.2f} to {max(residuals):.2f}']
        deviation = _shown(np.median(std, axis=0) / mean, 100.0)
        rows.append([name, *solved, _shown(mean, 1e6), scatter, deviation, _shown(np.std(com, axis=0, ddof=1), 1e3, 2)])
    header = ['thrown', 'solved', 'residual', 'principal moments, kg mm²', 'scatter, %', 'std, %', 'CoM, mm']
    print(table(header, rows, words=True))
    rows = []
    for name in [name for name in THROWN if name != DEVICE]:
        truth, mass = OBJECTS[name].moments, OBJECTS[name].mass
        errors = np.array([alone(each, found[DEVICE], mass) / truth - 1.0 for each in found[name]])
        bands = 1.96 * np.array([each.std for each in found[name]]) / truth  # of device and object
        held = f'{100.0 * float(np.mean(np.abs(errors) < bands)):.0f} % of {errors.size}'
        spread = _shown(np.mean(errors, axis=0), 100.0), _shown(np.std(errors, axis=0, ddof=1), 100.0)
        rows.append([name, _shown(truth, 1e6, 0), *spread, f'{100.0 * float(np.median(np.abs(errors))):.1f}', held])
    header = ['object alone', 'geometry, kg mm²', 'mean error, %', 'scatter, %', 'median of all, %', 'within 95 %']
    print(f'\n{table(header, rows, words=True)}')


if __name__ == '__main__':
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
