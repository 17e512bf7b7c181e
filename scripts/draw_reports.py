"""Draw the pictures of reports in docs/images anew: a good run, a planar one, a push, a capture, none, a contradiction.

usage: draw_reports.py [--output FOLDER]    (with `install/setup.bash` sourced; needs Chromium, minutes)
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
from PIL import Image, ImageChops

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))

import recorded  # noqa: E402 - from the tests, which are no package
from captured import CHASER, capture, sensed, servicer_motion, with_bare_link  # noqa: E402
from chromium import Chromium  # noqa: E402
from floating import float_freely  # noqa: E402
from mbaid_ros.cli import ArgumentParser, run  # noqa: E402
from mbaid_ros.core.robot.model import load_model  # noqa: E402
from mbaid_ros.core.robot.momentum import physical  # noqa: E402
from mbaid_ros.core.robot.urdf_edit import change_inertial  # noqa: E402
from mbaid_ros.replay import replay, simulate  # noqa: E402
from mbaid_ros.simulation.simulation import Truth  # noqa: E402
from observed import kernel  # noqa: E402

CONFIG, BAGS = ROOT / 'config', ROOT / 'bags'
WIDTH = 800  # pixels
TALLEST = 5600  # pixels of a page
PUSH = (20.0, np.array([0.6, -0.6, 0.5, 0.3, 0.25, -0.3]))  # s; N s, N m s
# The page's colours, and what its bands make of them on white: few enough for small files.
INKS = ('1d2330', '0072b2', 'd55e00', '009e73', 'c1121f')
PLAIN = (
    *('ffffff', *INKS, '5b6474', '9aa3b2', 'dfe3ea', 'f5f7fa', 'fdecec', 'c6c6a8', 'a8c6b8'),
    *('e69f00', 'cc79a7', '56b4e9'),
)
OPACITIES = (0.18, 0.45, 0.7)


def palette() -> Image.Image:
    """Return an image whose palette has the colours of the page."""
    plain = [tuple(bytes.fromhex(colour)) for colour in PLAIN]
    mixed = [
        tuple(round(255 + (value - 255) * opacity) for value in bytes.fromhex(ink))
        for ink in INKS
        for opacity in OPACITIES
    ]
    values = [value for colour in (*plain, *mixed) for value in colour]
    image = Image.new('P', (1, 1))
    image.putpalette(values + [255] * (768 - len(values)))
    return image


def reports(folder: Path) -> dict[str, Path]:
    """Return the pages by the names of their pictures."""
    pushed = float_freely(kernel('servicer7'), servicer_motion(), 3.0 * CHASER, 40.0, pulse=PUSH)
    caught = capture(15.0, 35.0, np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015])).truth
    bare = folder / 'bare.urdf'
    bare.write_text(with_bare_link(), encoding='utf-8')
    servicer, table = str(CONFIG / 'servicer7.urdf'), str(CONFIG / 'table1.urdf')
    follow = ['--method', 'trajectory']
    of_table = ['--params', str(CONFIG / 'table1_estimator.yaml')]
    rest = ['--duration', '10', '-p', 'joint_rate:=20.0', '-p', 'odometry_rate:=20.0']
    with redirect_stdout(io.StringIO()):
        simulate.main(['--model', servicer, *rest, '--output', str(folder / 'at_rest')])
    return {
        'report_good': page(folder, 'good', BAGS / 'servicer7_mid', servicer, *follow),
        'report_planar': page(folder, 'planar', BAGS / 'table1_live', table, *of_table),
        'report_event': page(folder, 'event', bag(folder / 'pushed', servicer, pushed), servicer, *follow),
        'report_capture': page(folder, 'capture', bag(folder / 'caught', str(bare), caught), str(bare), *told(folder)),
        'report_no_estimate': page(folder, 'nothing', folder / 'at_rest', servicer),
        'report_contradiction': page(folder, 'wrong', BAGS / 'servicer7_mid', heavier(folder)),
    }


def heavier(folder: Path) -> str:
    """Return the servicer as somebody may believe it to be: its base weighs 40 % more."""
    model = load_model((CONFIG / 'servicer7.urdf').read_text(encoding='utf-8'))
    base = physical(model.link(model.base_link).parameters)
    file = folder / 'heavier.urdf'
    file.write_text(change_inertial(model.urdf, model.base_link, base * np.array([1.4, *[1.0] * 9])), encoding='utf-8')
    return str(file)


def told(folder: Path) -> Sequence[str]:
    """Return the arguments that tell of the capture."""
    file = folder / 'capture.yaml'
    capture_time = 'capture.time: 15.0, debris: {report: true, frame: grasp}'
    file.write_text(f'estimator: {{ros__parameters: {{method: trajectory, target_link: link7, {capture_time}}}}}')
    return '--params', str(file)


def bag(path: Path, urdf: str, truth: Truth) -> Path:
    """Write what sensors make of a motion."""
    model = load_model(Path(urdf).read_text(encoding='utf-8'))
    return recorded.write(path, model, sensed(truth, 4))


def page(folder: Path, name: str, recording: Path, urdf: str, *arguments: str) -> Path:
    """Return the report of a replay."""
    report = folder / f'{name}.html'
    with redirect_stdout(io.StringIO()):
        replay.main([str(recording), '--model', urdf, '--report', str(report), *arguments])
    # Where it was drawn is nobody's business.
    text = report.read_text(encoding='utf-8')
    for place in (recording.parent, folder, ROOT):
        text = text.replace(f'{place}/', '')
    report.write_text(text, encoding='utf-8')
    return report


def small(picture: Path) -> Image.Image:
    """Return a screenshot without the empty end, in few colours."""
    image = Image.open(picture).convert('RGB')
    ground = Image.new('RGB', image.size, image.getpixel((0, image.height - 1)))
    bottom = (ImageChops.difference(image, ground).getbbox() or (0, 0, 0, image.height))[3]
    cut = image.crop((0, 0, image.width, min(bottom + 30, image.height)))
    sized = cut.resize((WIDTH, round(cut.height * WIDTH / cut.width)), Image.Resampling.LANCZOS)
    return sized.quantize(palette=palette(), dither=Image.Dither.NONE)


def main(argv: list[str]) -> int:
    """Run the script."""
    parser = ArgumentParser('draw_reports.py', (__doc__ or '').split('\n', maxsplit=1)[0], 'scripts/draw_reports.py')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'images', metavar='FOLDER')
    output: Path = parser.parse(argv).output
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        browser = Chromium(folder)
        for picture, report in reports(folder).items():
            shot = folder / f'{picture}.png'
            browser.screenshot(report, shot, height=TALLEST)
            small(shot).save(output / shot.name, optimize=True)
            print(output / shot.name)
    return 0


if __name__ == '__main__':
    sys.exit(run(main, name='draw_reports'))
