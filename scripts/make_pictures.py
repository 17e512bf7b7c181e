"""Make the pictures of README and pages: what the commands above them give, and the drawings.

`make pictures` runs it. The numbers that the captions name are in docs/images/numbers.json; a test makes them anew.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib as mpl
import numpy as np
import pinocchio
from matplotlib import pyplot as plt
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Ellipse, FancyBboxPatch, Rectangle
from PIL import Image, ImageSequence

from mbaid_ros.bags import BagReader
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import BAND
from mbaid_ros.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.one_bag import replay_bag
from mbaid_ros.replay.read_back import read_truth
from mbaid_ros.replay.whole_run import Run

ROOT = Path(__file__).resolve().parents[1]
# What the commands of pages find in the project's folder; not what they wrote there when a reader followed a page.
PROJECT = ('Makefile', 'bags', 'config', 'docs', 'install', 'mbaid_ros', 'msg_defs', 'package.xml', 'scripts', 'test')
IMAGES = ROOT / 'docs' / 'images'
STYLE = ROOT / 'docs' / 'pictures.mplstyle'
BAG, URDF = ROOT / 'bags' / 'servicer7_mid', ROOT / 'config' / 'servicer7.urdf'
PARAMETERS = ROOT / 'config' / 'servicer7_estimator.yaml'
BLUE, ORANGE, GREEN, GREY = '#0072B2', '#D55E00', '#009E73', '#666666'  # apart for colour-blind eyes, too
FRAMES, FRAME_TIME, COLOURS = 20, 0.3, 32  # of the animation; s between two


def readme_run() -> Run:
    """Return the run of the README's command on the shipped bag."""
    config = build(EstimatorConfig, load_parameter_file(PARAMETERS, 'estimator'))
    return replay_bag(str(BAG), config, URDF.read_text(encoding='utf-8'), Inputs())


def numbers(run: Run) -> dict[str, Any]:
    """Return the numbers that captions name: mass (kg) with its 95 % band, and the status."""
    final = run.final
    return {'mass': float(final.parameters[0]), 'band': float(BAND * final.std[0]), 'status': final.status}


def configurations() -> tuple[Array, Array]:
    """Return the times (N,) s and configurations (N, 14) of base and joints in the bag, as pinocchio has them."""
    with BagReader(BAG) as bag:
        joints = [message for _, message, _ in bag.read(['/joint_states'])]
        poses = [message.pose.pose for _, message, _ in bag.read(['/odom'])]
    time = np.array([each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in joints])
    base = [
        (*(getattr(each.position, axis) for axis in 'xyz'), *(getattr(each.orientation, axis) for axis in 'xyzw'))
        for each in poses
    ]
    return time, np.hstack((base, [each.position for each in joints]))


def demo(run: Run, path: Path) -> None:
    """Draw the robot of a run as it moves, beside the mass as it converges."""
    time, every = configurations()
    model = pinocchio.buildModelFromUrdf(str(URDF), pinocchio.JointModelFreeFlyer())
    data = model.createData()
    history, truth = run.history, read_truth(BAG / 'truth.json').parameters[0]
    when = np.array([each.time for each in history])
    mass, band = (np.array(each) for each in zip(*((e.parameters[0], BAND * e.std[0]) for e in history), strict=True))
    chart = plt.figure(figsize=(7.2, 3.0))
    view = chart.add_axes((0.0, 0.0, 0.5, 1.0), projection='3d')
    axes = chart.add_axes((0.58, 0.17, 0.40, 0.70))

    def draw(frame: int) -> None:
        now = 60.0 * (frame + 1) / FRAMES
        robot(view, model, data, every[min(int(np.searchsorted(time, now)), len(time) - 1)])
        curve(axes, when, mass, band, truth, now)

    FuncAnimation(chart, draw, frames=FRAMES).save(path, PillowWriter(fps=round(1.0 / FRAME_TIME)), dpi=100)  # type: ignore[arg-type]
    plt.close(chart)
    with Image.open(path) as drawn:  # with few colours that all frames share, a quarter of the size
        frames = [each.convert('RGB') for each in ImageSequence.Iterator(drawn)]
    palette = frames[-1].quantize(COLOURS)
    first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in frames)
    first.save(path, save_all=True, append_images=others, duration=round(1e3 * FRAME_TIME), loop=0, optimize=True)


def robot(view: Any, model: Any, data: Any, configuration: Array) -> None:
    """Draw base, arm and captured body in a configuration."""
    view.clear()
    pinocchio.forwardKinematics(model, data, configuration)
    places = np.array([each.translation for each in data.oMi[1:]])
    base, hand = data.oMi[1], data.oMi[-1]
    corners = 0.5 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    for one in range(8):
        for other in range(one):
            if np.count_nonzero(corners[one] != corners[other]) == 1:
                edge = np.array([base.act(corners[one]), base.act(corners[other])])
                view.plot(*edge.T, color=GREY, linewidth=1.2, linestyle='-')
    view.plot(*places.T, color=BLUE, linewidth=3.0, linestyle='-', marker='o', markersize=4.0)
    com = hand.act(model.inertias[model.njoints - 1].lever)
    view.plot(*np.array([places[-1], com]).T, color=ORANGE, linewidth=2.0, linestyle='-')
    view.scatter(*com, s=1500, color=ORANGE, alpha=0.6)
    view.text2D(0.08, 0.05, 'floating base', color=GREY, transform=view.transAxes)
    view.text2D(0.45, 0.05, 'arm', color=BLUE, transform=view.transAxes)
    view.text2D(0.59, 0.05, 'captured body', color=ORANGE, transform=view.transAxes)
    for limits, middle in zip((view.set_xlim, view.set_ylim, view.set_zlim), 0.5 * (places[0] + com), strict=True):
        limits(middle - 1.8, middle + 1.8)
    view.set_axis_off()
    view.view_init(elev=20, azim=-65)


def curve(axes: Axes, when: Array, mass: Array, band: Array, truth: float, now: float) -> None:
    """Draw the mass up to now, with its band."""
    axes.clear()
    seen = when <= now
    axes.axhline(truth, color=ORANGE, linestyle='--', label='truth')
    axes.fill_between(when[seen], (mass - band)[seen], (mass + band)[seen], color=BLUE, alpha=0.3)
    axes.plot(when[seen], mass[seen], color=BLUE, label='estimate, 95 % band')
    known = np.flatnonzero(seen & np.isfinite(mass))
    title = 'waiting for motion'
    if len(known):
        title = f'{mass[known[-1]]:.2f} ± {band[known[-1]]:.2f} kg after {now:.0f} s'
    axes.set(xlim=(0.0, 60.0), ylim=(truth - 2.0, truth + 2.0), xlabel='time [s]', ylabel='mass [kg]', title=title)
    axes.legend(loc='lower right')


# -- Drawings


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, **style: Any) -> None:
    """Draw an arrow."""
    axes.annotate('', end, start, arrowprops={'arrowstyle': '-|>', 'color': colour, 'linewidth': 1.6, **style})


def frame(axes: Axes, origin: tuple[float, float], turn: float, name: str, colour: str) -> None:
    """Draw the axes of a frame, turned by an angle (rad), with its name."""
    for angle in (turn, turn + 0.5 * np.pi):
        end = origin[0] + 0.75 * np.cos(angle), origin[1] + 0.75 * np.sin(angle)
        arrow(axes, origin, end, colour)
    axes.text(origin[0] - 0.1, origin[1] - 0.4, name, color=colour, ha='center')


def frames(path: Path) -> None:
    """Draw robot, frames, centre of mass and the vectors of the equations."""
    chart, axes = plt.subplots(figsize=(7.2, 3.6), layout='constrained')
    axes.add_patch(Rectangle((2.4, 0.9), 1.8, 1.5, angle=8.0, fill=False, color=GREY, linewidth=2.0))
    joints = np.array([(4.05, 2.3), (5.0, 3.3), (6.3, 3.1), (7.0, 2.3)])
    axes.plot(*joints.T, color=GREY, linewidth=5.0, solid_capstyle='round', alpha=0.5)
    for joint in joints[:-1]:
        axes.add_patch(Circle(tuple(joint), 0.12, color='white', ec=GREY, zorder=3, linewidth=1.5))
    axes.add_patch(Ellipse((8.1, 1.7), 2.4, 1.7, angle=-20.0, fill=False, color=ORANGE, linewidth=2.0))
    frame(axes, (0.5, 0.6), 0.0, 'odometry frame', GREY)
    frame(axes, (3.2, 1.6), 0.14, 'base link', BLUE)
    frame(axes, (7.0, 2.3), -0.7, '', GREEN)
    axes.text(7.9, 2.95, 'target link', color=GREEN, ha='center')
    arrow(axes, (0.5, 0.6), (3.2, 1.6), GREY, linestyle='--')
    axes.text(0.1, 1.75, 'pose of the base\n(measured)', color=GREY)
    arrow(axes, (3.2, 1.6), (7.0, 2.3), BLUE, linestyle='--')
    axes.text(5.7, 1.55, r'$p$, $R$: URDF, joints', color=BLUE, ha='center')
    arrow(axes, (7.0, 2.3), (8.3, 1.55), ORANGE)
    axes.plot(8.3, 1.55, marker='o', color=ORANGE, markersize=9)
    axes.text(9.5, 2.1, r'$r_c$: centre of mass', color=ORANGE, va='center')
    axes.text(9.5, 1.7, r'mass $m$, inertia $I_c$', color=ORANGE, va='center')
    axes.text(4.6, 4.1, r'$P_0$, $L_0$: total momentum, constant while nothing acts from outside', ha='center')
    axes.set(xlim=(-0.2, 12.0), ylim=(0.0, 4.4), aspect='equal')
    axes.set_axis_off()
    chart.savefig(path, metadata={'Date': None})
    plt.close(chart)


BOXES = (
    ('sensors', 'JointState\nOdometry or pose'),
    ('windows', 'samples of 0.5 s\non common stamps'),
    ('prediction', 'base motion from\nconserved momentum'),
    ('filter', 'compare with poses;\nupdate all unknowns'),
    ('result', 'mass, CoM, inertia,\nintervals, status'),
)


def data_flow(path: Path) -> None:
    """Draw the way of the data in five boxes."""
    chart, axes = plt.subplots(figsize=(7.2, 1.6), layout='constrained')
    for place, (name, words) in enumerate(BOXES):
        left = 2.2 * place
        axes.add_patch(
            FancyBboxPatch((left, 0.0), 1.75, 1.2, boxstyle='round,pad=0.05', fill=False, color=BLUE, lw=1.5)
        )
        axes.text(left + 0.87, 0.95, name, ha='center', va='center', weight='bold')
        axes.text(left + 0.87, 0.42, words, ha='center', va='center', fontsize=7.5)
        if place:
            arrow(axes, (left - 0.42, 0.6), (left - 0.03, 0.6), GREY)
    axes.set(xlim=(-0.15, 10.75), ylim=(-0.15, 1.35))
    axes.set_axis_off()
    chart.savefig(path, metadata={'Date': None})
    plt.close(chart)


def table_from_above(path: Path) -> None:
    """Draw an air-bearing bench from above."""
    chart, axes = plt.subplots(figsize=(7.2, 4.0), layout='constrained')
    axes.add_patch(Rectangle((0.0, 0.0), 11.0, 5.4, fill=False, color=GREY, linewidth=2.0))
    axes.text(10.8, 0.2, 'flat, level table', color=GREY, ha='right')
    frame(axes, (1.4, 0.8), 0.0, 'odometry frame', GREY)
    for corner, name in (((0.5, 4.9), 'camera'), ((10.5, 4.9), 'camera')):
        axes.add_patch(Rectangle((corner[0] - 0.22, corner[1] - 0.15), 0.44, 0.3, color=GREY))
        axes.text(corner[0], corner[1] - 0.55, name, color=GREY, ha='center')
    axes.add_patch(Circle((3.4, 2.9), 1.15, fill=False, color=BLUE, linewidth=2.0))
    for angle in (0.6, 2.2, 3.4, 5.0):
        axes.plot(3.4 + 0.85 * np.cos(angle), 2.9 + 0.85 * np.sin(angle), marker='o', color=GREY, markersize=5)
    frame(axes, (3.4, 2.9), 0.35, '', BLUE)
    axes.text(4.2, 1.15, 'base on air bearings, with markers\n(pose at 120 Hz)', color=BLUE, ha='center', va='center')
    joints = np.array([(4.48, 3.3), (6.0, 4.4), (7.7, 3.7)])
    axes.plot(*joints.T, color=GREY, linewidth=6.0, solid_capstyle='round', alpha=0.5)
    for joint, name in zip(joints, ('shoulder', 'elbow', 'hand'), strict=True):
        axes.add_patch(Circle(tuple(joint), 0.16, color='white', ec=GREY, zorder=3, linewidth=1.5))
        axes.text(joint[0] + 0.25, joint[1] + (0.25 if name != 'shoulder' else -0.3), name, color=GREY)
    axes.text(6.8, 2.7, 'joint positions\nat 50 Hz', color=GREY, ha='center', va='center')
    axes.add_patch(Ellipse((8.7, 3.1), 1.6, 1.1, angle=-30.0, fill=False, color=ORANGE, linewidth=2.0))
    arrow(axes, (7.7, 3.7), (8.85, 3.0), ORANGE)
    axes.plot(8.85, 3.0, marker='o', color=ORANGE, markersize=8)
    axes.text(9.0, 1.75, 'payload: mass, centre of\nmass (x, y), izz', color=ORANGE, ha='center', va='center')
    axes.set(xlim=(-0.1, 11.1), ylim=(-0.1, 5.5), aspect='equal')
    axes.set_axis_off()
    chart.savefig(path, metadata={'Date': None})
    plt.close(chart)


def box(axes: Axes, place: tuple[float, float], size: tuple[float, float], words: str, colour: str) -> None:
    """Draw a box with words, by its lower left corner."""
    axes.add_patch(FancyBboxPatch(place, *size, boxstyle='round,pad=0.05', fill=False, color=colour, lw=1.5))
    axes.text(place[0] + 0.5 * size[0], place[1] + 0.5 * size[1], words, ha='center', va='center', color=colour)


INPUTS = (
    ('joint_states', 'JointState'),
    ('odom or pose', 'Odometry or PoseStamped'),
    ('robot_description', 'URDF'),
    ('imu, thrust, stored_momentum', 'if there are any'),
)
OUTPUTS = (
    ('~/estimate, ~/inertia', 'numbers, intervals, status'),
    ('~/robot_description', 'URDF with the result'),
    ('/diagnostics', 'missing topics, faults'),
)


def topics(path: Path) -> None:
    """Draw the nodes and the topics between them."""
    chart, axes = plt.subplots(figsize=(7.2, 3.2), layout='constrained')
    box(axes, (0.0, 0.4), (1.5, 2.6), 'robot,\nsimulator\nor player', GREY)
    box(axes, (5.3, 0.4), (1.6, 2.6), 'estimator', BLUE)
    box(axes, (10.7, 1.9), (1.7, 1.1), 'controller,\nwatch', ORANGE)
    box(axes, (10.7, 0.4), (1.7, 1.1), 'recorder,\nRViz', ORANGE)
    for (left, right), rows in (((1.6, 5.2), INPUTS), ((7.0, 10.6), OUTPUTS)):
        for place, (name, words) in enumerate(rows):
            height = 2.65 - place * 2.1 / (len(rows) - 1)
            arrow(axes, (left, height), (right, height), GREY)
            axes.text(0.5 * (left + right), height + 0.08, name, ha='center', va='bottom', fontsize=9)
            axes.text(0.5 * (left + right), height - 0.08, words, ha='center', va='top', fontsize=8, color=GREY)
    axes.set(xlim=(-0.15, 12.55), ylim=(0.1, 3.2))
    axes.set_axis_off()
    chart.savefig(path, metadata={'Date': None})
    plt.close(chart)


DRAWINGS = {'frames.svg': frames, 'data-flow.svg': data_flow, 'bench.svg': table_from_above, 'topics.svg': topics}


# -- Reports


@dataclass(frozen=True)
class ReportPicture:
    """A picture of a page: the curves of a report that the page's commands write."""

    page: str  # in docs/
    report: str  # file that they write
    picture: str  # file in docs/images

    @property
    def commands(self) -> str:
        """The commands of the page that are run."""
        text = (ROOT / 'docs' / self.page).read_text(encoding='utf-8')
        return ''.join(re.findall(r'<!-- run -->\n```sh\n(.*?)^```$', text, re.DOTALL | re.MULTILINE))

    @property
    def sha256(self) -> str:
        """The commands' hash."""
        return hashlib.sha256(self.commands.encode()).hexdigest()


REPORTS = (
    ReportPicture('tutorials/first-verdict.md', 'tutorial/report.html', 'report_good.svg'),
    ReportPicture('tutorials/capture.md', 'capture.html', 'report_capture.svg'),
    ReportPicture('tutorials/air-bearing.md', 'bench/hand.html', 'report_bench.svg'),
)


def curves(report: str) -> str:
    """Return the curves of the parameters in a report as a picture by itself, in its colours on a page of its own."""
    (drawing,) = re.findall(r'<svg [^>]*aria-label="Estimate of each parameter.*?</svg>', report, re.DOTALL)
    rules = re.search(r':root \{.*?\}.*?\} \}', report, re.DOTALL)
    assert rules is not None, 'the report has no colours'
    page = '<rect width="100%" height="100%" style="fill: var(--page)"/>'
    head, body = drawing.split('>', 1)
    return f'{head}>\n<style>{rules[0]} text {{ fill: var(--ink); }}</style>{page}{body}\n'


def report_pictures() -> None:
    """Run the commands of the pages, and save the curves of their reports."""
    path = f'{os.environ["PATH"]}:{ROOT / "scripts"}'
    for each in REPORTS:
        with TemporaryDirectory() as folder:
            for name in PROJECT:
                (Path(folder) / name).symlink_to(ROOT / name)
            subprocess.run(['bash', '-ec', each.commands], cwd=folder, env={**os.environ, 'PATH': path}, check=True)
            report = (Path(folder) / each.report).read_text(encoding='utf-8')
        (IMAGES / each.picture).write_text(curves(report), encoding='utf-8')


def page_picture() -> None:
    """Run the code of the page on Python, which saves its plot."""
    page = (ROOT / 'docs' / 'how-to' / 'python.md').read_text(encoding='utf-8')
    code = '\n'.join(re.findall(r'^```python\n(.*?)^```$', page, re.DOTALL | re.MULTILINE))
    code = code.replace("result.report('report.html')", '').replace(
        "python.svg')", "python.svg', metadata={'Date': None})"
    )
    exec(compile(code, 'python.md', 'exec'), {})  # the code of our own page


def main() -> int:
    """Make all pictures."""
    mpl.use('svg')
    plt.style.use(STYLE)
    run = readme_run()
    commands = {each.page: each.sha256 for each in REPORTS}
    text = json.dumps({'readme': numbers(run), 'commands': commands}, indent=2)
    (IMAGES / 'numbers.json').write_text(f'{text}\n', encoding='utf-8')
    demo(run, IMAGES / 'demo.gif')
    for name, draw in DRAWINGS.items():
        draw(IMAGES / name)
    page_picture()
    report_pictures()
    return 0


if __name__ == '__main__':
    sys.exit(main())
