"""Weigh the space station from a clone of its telemetry and draw docs/images/iss.svg, or weigh twins of it."""

import argparse
import json
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter1d

from benchmarks.iss_twin import NAMES, twin
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import Link, express, load_model
from mbaid_ros.recordings.iss import read_iss
from mbaid_ros.recordings.recording import Recording, write_recording
from mbaid_ros.replay import arguments as start

PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'images' / 'iss.svg'
NEEDED = 'the telemetry has it'
WINDOW = 6861.75, 6863.005  # h, as the files count: window A, whose picture is drawn
MOMENTS, BAND = [4, 7, 9], 1.96
SMOOTH = 10  # samples, of the curves


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


def weigh_twins(flown: Recording, seeds: range) -> None:
    """Print the errors of twins' moments in standard deviations, and how many lie within 95 %."""
    errors: list[Array] = []
    for seed in seeds:
        readings, bodies = twin(flown, seed)
        with TemporaryDirectory() as folder:
            found = weighed(readings, Path(folder))
        if found is None:
            print(f'{seed}: nothing is published', flush=True)
            continue
        links = [load_model(flown.robot).link(name) for name in NAMES]
        errors.append((found[0] - total(bodies.ravel(), links)) / found[1])
        print(f'{seed}: {errors[-1].round(2)}, residual {found[2]:.2f}', flush=True)
    inside, size = np.sum(np.abs(errors) < BAND), np.array(errors)
    print(f'{inside} of {size.size} moments within 95 %, {len(size)} of {len(seeds)} twins published')
    print(f'RMS {np.sqrt(np.mean(size**2, axis=0)).round(2)}, mean {np.mean(size, axis=0).round(2)}')


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('archive', type=Path, help='Pi/RecordedData/Data/Archive of a clone of ISS-Mimic at 41955ae')
    add('--start', type=float, default=WINDOW[0], help='h')
    add('--end', type=float, default=WINDOW[1], help='h')
    add('--twins', type=int, nargs=2, metavar=('FIRST', 'LAST'), help='weigh twins with these seeds instead')
    arguments = parser.parse_args()
    flown = read_iss(arguments.archive, arguments.start, arguments.end)
    if arguments.twins:
        weigh_twins(flown, range(arguments.twins[0], arguments.twins[1] + 1))
        return
    if (arguments.start, arguments.end) == WINDOW:
        draw(flown)
    with TemporaryDirectory() as folder:
        found = weighed(flown, Path(folder))
    if found is None:
        print('nothing is published')
        return
    for name, value, std in zip(('Ixx', 'Iyy', 'Izz'), found[0] / 1e6, found[1] / 1e6, strict=True):
        print(f'{name} {value:.1f} ± {BAND * std:.1f} e6 kg m^2 (95 %)')
    print(f'residual {found[2]:.2f}')


if __name__ == '__main__':
    main()
