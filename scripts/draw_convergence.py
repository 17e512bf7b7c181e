"""Draw docs/convergence.svg: how the estimate of a shipped bag converges, with its 95 % band, against the truth.

usage: draw_convergence.py [--output FILE]    (with `install/setup.bash` sourced; .svg, .png or .pdf)
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import BAND
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.run import replay_bag

ROOT = Path(__file__).resolve().parents[1]
BAG = ROOT / 'bags' / 'servicer7_mid'
ROBOT = ROOT / 'config' / 'servicer7.urdf'
PARAMETERS = ROOT / 'config' / 'servicer7_estimator.yaml'

# Blue and orange of Okabe and Ito, which every kind of colour vision tells apart.
COLOURS = {'difference': '#e69f00', 'trajectory': '#0072b2'}
# Panel by panel: index among the ten parameters, name, unit.
PANELS = (
    (0, 'mass', 'kg'), (1, 'com x', 'm'), (2, 'com y', 'm'), (3, 'com z', 'm'), (4, 'Ixx', 'kg m\N{SUPERSCRIPT TWO}'),
    (7, 'Iyy', 'kg m\N{SUPERSCRIPT TWO}'), (9, 'Izz', 'kg m\N{SUPERSCRIPT TWO}'), (5, 'Ixy', 'kg m\N{SUPERSCRIPT TWO}'),
    (6, 'Ixz', 'kg m\N{SUPERSCRIPT TWO}'), (8, 'Iyz', 'kg m\N{SUPERSCRIPT TWO}'),
)  # fmt: skip
FITS_FROM = 15.0  # s, from which on all bands fit into the panels


def replayed(method: str) -> Run:
    """Return what a method makes of the bag."""
    values = {**load_parameter_file(PARAMETERS, 'estimator'), 'method': method}
    return replay_bag(str(BAG), build(EstimatorConfig, values), read_robot_description(ROBOT), Inputs())


def true_parameters() -> Array:
    """Return the (10,) parameters that the bag was simulated with."""
    truth = json.loads((BAG / 'truth.json').read_text(encoding='utf-8'))
    return np.array([truth['mass'], *truth['com'], *truth['inertia'].values()])


def figure(runs: dict[str, Run], truth: Array) -> Figure:
    """Return the picture: a panel for each parameter."""
    drawing = Figure(figsize=(11.0, 4.8), layout='constrained', facecolor='white')
    axes = drawing.subplots(2, 5, sharex=True)
    for axis, (index, name, unit) in zip(axes.flat, PANELS, strict=True):
        panel(axis, runs, index, truth[index])
        axis.set_title(f'{name} [{unit}]', fontsize=9, loc='left')
    for axis in axes[-1]:
        axis.set_xlabel('time [s]', fontsize=8)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc='outside upper center', ncols=len(labels), fontsize=9, frameon=False)
    return drawing


def panel(axis: Axes, runs: dict[str, Run], index: int, truth: float) -> None:
    """Draw the course of one parameter: each method's estimate with its band, and the truth."""
    reach = 0.0
    for method, result in runs.items():
        time = np.array([estimate.time for estimate in result.history])
        value = np.array([estimate.parameters[index] for estimate in result.history])
        width = BAND * np.array([estimate.std[index] for estimate in result.history])
        axis.fill_between(time, value - width, value + width, color=COLOURS[method], alpha=0.3, linewidth=0.0)
        axis.plot(time, value, color=COLOURS[method], linewidth=1.3, label=f'{method} (95 % band)')
        late = time > FITS_FROM
        reach = max(reach, float(np.nanmax(np.abs(value - truth)[late] + width[late])))
    axis.axhline(truth, color='black', linewidth=0.9, linestyle=(0, (4, 3)), label='truth')
    axis.set_ylim(truth - 1.1 * reach, truth + 1.1 * reach)
    axis.set_xlim(0.0, math.ceil(runs['difference'].final.time))
    axis.tick_params(labelsize=8)
    axis.locator_params(nbins=5)
    axis.spines[['top', 'right']].set_visible(False)
    axis.ticklabel_format(useOffset=False)


def shorter(svg: str) -> str:
    """Return an SVG with the points of its curves to a hundredth, which is finer than any screen shows."""

    def rounded(path: re.Match[str]) -> str:
        return re.sub(r'-?\d+\.\d{3,}', lambda found: f'{float(found[0]):.2f}', path[0])

    return re.sub(r' d="M [^"]*"', rounded, re.sub(r' +\n', '\n', svg))


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the arguments."""
    head = (__doc__ or '').split('\n', maxsplit=1)[0]
    parser = ArgumentParser('draw_convergence.py', head, 'scripts/draw_convergence.py --output convergence.png')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'convergence.svg', metavar='FILE')
    return parser.parse(argv)


def main(argv: list[str]) -> int:
    """Draw the picture."""
    output: Path = parse(argv).output
    runs = {method: replayed(method) for method in COLOURS}
    with mpl.rc_context({'svg.hashsalt': 'mbaid_ros', 'path.simplify': False}):
        metadata = {'Date': None} if output.suffix == '.svg' else None
        figure(runs, true_parameters()).savefig(output, dpi=110, metadata=metadata)
    if output.suffix == '.svg':
        output.write_text(shorter(output.read_text(encoding='utf-8')), encoding='utf-8')
    sys.stdout.write(f'{output}\n')
    return 0


if __name__ == '__main__':
    sys.exit(run(main, name='draw_convergence'))
