"""Draw docs/images/convergence.svg: estimates of a shipped bag with their 95 % bands, against the truth."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file, read_robot_description
from mbaid_ros.config.parameters import build
from mbaid_ros.core.results.parameters import BAND
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.run import replay_bag

ROOT = Path(__file__).resolve().parents[1]
BAG, ROBOT = ROOT / 'bags' / 'servicer7_mid', ROOT / 'config' / 'servicer7'
OUTPUT = ROOT / 'docs' / 'images' / 'convergence.svg'
# Blue and orange of Okabe and Ito, distinguishable by every kind of colour vision.
COLOURS = {'difference': '#e69f00', 'trajectory': '#0072b2'}
# Panel by panel: index among the ten parameters, name, unit.
PANELS = (
    (0, 'mass', 'kg'), (1, 'com x', 'm'), (2, 'com y', 'm'), (3, 'com z', 'm'), (4, 'Ixx', 'kg m²'),
    (7, 'Iyy', 'kg m²'), (9, 'Izz', 'kg m²'), (5, 'Ixy', 'kg m²'), (6, 'Ixz', 'kg m²'), (8, 'Iyz', 'kg m²'),
)  # fmt: skip
FITS_FROM = 15.0  # s, after which all bands fit into the panels


def replayed(method: str) -> Run:
    """Return the replay of the bag by a method."""
    values = {**load_parameter_file(Path(f'{ROBOT}_estimator.yaml'), 'estimator'), 'method': method}
    return replay_bag(str(BAG), build(EstimatorConfig, values), read_robot_description(f'{ROBOT}.urdf'), Inputs())


def panel(axis: Axes, runs: dict[str, Run], index: int, truth: float) -> None:
    """Draw one parameter: each method's estimate with its band, and the truth."""
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


def main() -> None:
    """Draw the picture."""
    runs = {method: replayed(method) for method in COLOURS}
    content = json.loads((BAG / 'truth.json').read_text(encoding='utf-8'))
    truth = [content['mass'], *content['com'], *content['inertia'].values()]
    with mpl.rc_context({'svg.hashsalt': 'mbaid_ros', 'path.simplify': False}):
        drawing = Figure(figsize=(11.0, 4.8), layout='constrained', facecolor='white')
        axes = drawing.subplots(2, 5, sharex=True)
        for axis, (index, name, unit) in zip(axes.flat, PANELS, strict=True):
            panel(axis, runs, index, truth[index])
            axis.set_title(f'{name} [{unit}]', fontsize=9, loc='left')
        for axis in axes[-1]:
            axis.set_xlabel('time [s]', fontsize=8)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        drawing.legend(handles, labels, loc='outside upper center', ncols=len(labels), fontsize=9, frameon=False)
        drawing.savefig(OUTPUT, dpi=110, metadata={'Date': None})
    # Points of curves to a hundredth, finer than any screen shows.
    svg = re.sub(r' +\n', '\n', OUTPUT.read_text(encoding='utf-8'))

    def rounded(path: re.Match[str]) -> str:
        return re.sub(r'-?\d+\.\d{3,}', lambda found: f'{float(found[0]):.2f}', path[0])

    OUTPUT.write_text(re.sub(r' d="M [^"]*"', rounded, svg), encoding='utf-8')


if __name__ == '__main__':
    main()
