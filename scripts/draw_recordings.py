"""Draw what bags of recorded hardware hold, as PNG: the base, the joints, and thrust or gyro where there is one.

usage: draw_recordings.py BAG [BAG ...] --output FOLDER    (with `install/setup.bash` sourced)
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mbaid_ros.bags import BagReader
from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.core.geometry import Array, log, rotation_from_quaternion

# Okabe and Ito: every kind of colour vision tells them apart.
_COLOURS = ('#0072b2', '#e69f00', '#009e73', '#cc79a7')
_TOPICS = ('/odom', '/imu', '/joint_states', '/thrust')
Lines = tuple[Array, Array, tuple[str, ...]]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(_draw, argv, 'draw_recordings')


def _draw(argv: list[str]) -> int:
    parser = ArgumentParser('draw_recordings', 'Draw what bags hold.', 'draw_recordings.py run --output docs/images')
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    parser.add_argument('--output', type=Path, default=Path(), metavar='FOLDER')
    arguments = parser.parse(argv)
    for bag in arguments.bags:
        path = arguments.output / f'recording_{bag.name}.png'
        picture(bag).savefig(path, dpi=80)
        print(path)
    return 0


def picture(bag: Path) -> Figure:
    """Return a panel for each kind of reading."""
    messages = read(bag)
    panels = [(title, lines) for title, lines in _panels(messages) if lines is not None]
    drawing = Figure(figsize=(9.0, 1.9 * len(panels)), layout='constrained', facecolor='white')
    for axis, (title, lines) in zip(np.atleast_1d(drawing.subplots(len(panels), sharex=True)), panels, strict=True):
        _panel(axis, title, lines)
    axis.set_xlabel("time [s], of the log's own", fontsize=8)
    return drawing


def read(bag: Path) -> dict[str, list[tuple[float, object]]]:
    """Return the messages of the topics drawn, each with its stamp, s."""
    found: dict[str, list[tuple[float, object]]] = {topic: [] for topic in _TOPICS}
    with BagReader(bag) as reader:
        for topic, message, _ in reader.read([topic for topic in _TOPICS if topic in reader.topics]):
            stamp = message.header.stamp
            found[topic].append((stamp.sec + 1e-9 * stamp.nanosec, message))
    return found


def _panels(messages: dict[str, list[tuple[float, object]]]) -> list[tuple[str, Lines | None]]:
    def lines(topic: str, values: object, names: tuple[str, ...]) -> Lines | None:
        entries = messages[topic]
        if not entries or not callable(values):
            return None
        table = np.array([values(message) for _, message in entries], dtype=float)
        return np.array([time for time, _ in entries]), table, names

    def joints(message: object) -> Array:
        # Wheels turn too far for their angles to be looked at.
        return np.asarray(message.velocity if len(message.name) == 1 else message.position)  # type: ignore[attr-defined]

    first = messages['/joint_states'][0][1] if messages['/joint_states'] else None
    names = tuple(first.name) if first is not None else ()  # type: ignore[attr-defined]
    place = lines('/odom', lambda message: _xyz(message.pose.pose.position), ('x', 'y', 'z'))
    if place is not None:
        place = place[0], place[1] - place[1].mean(axis=0), place[2]
    turn = lines('/odom', _quaternion, ('about x', 'about y', 'about z'))
    if turn is not None:
        turn = turn[0], _unwound(turn[1]), turn[2]
    return [
        ('place of the base, less its mean [m]', place),
        ('attitude of the base [rad]', turn),
        ('joints [rad]' if len(names) > 1 else 'flywheel [rad/s]', lines('/joint_states', joints, names)),
        ('gyro [rad/s]', lines('/imu', lambda message: _xyz(message.angular_velocity), ('x', 'y', 'z'))),
        ('accelerometer [m/s²]', lines('/imu', lambda message: _xyz(message.linear_acceleration), ('x', 'y', 'z'))),
        ('commanded force [N]', lines('/thrust', lambda message: _xyz(message.wrench.force), ('x', 'y', 'z'))),
    ]  # fmt: skip


def _xyz(vector: object) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z  # type: ignore[attr-defined]


def _quaternion(message: object) -> tuple[float, float, float, float]:
    turn = message.pose.pose.orientation  # type: ignore[attr-defined]
    return turn.x, turn.y, turn.z, turn.w


def _unwound(quaternions: Array) -> Array:
    """Return how far the base has turned since the begin about its own axes, (N, 3) rad: rates added up."""
    rotation = rotation_from_quaternion(quaternions)
    steps = log(np.swapaxes(rotation[:-1], 1, 2) @ rotation[1:])
    return np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))


def _panel(axis: Axes, title: str, lines: Lines) -> None:
    time, table, names = lines
    moving = [column for column in range(table.shape[1]) if np.ptp(table[:, column]) > 1e-9]
    for colour, column in zip(_COLOURS, moving, strict=False):
        axis.plot(time, table[:, column], color=colour, linewidth=0.9, label=names[column])
    axis.set_title(title, fontsize=9, loc='left')
    axis.tick_params(labelsize=8)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, frameon=False, loc='center left', bbox_to_anchor=(1.0, 0.5))


if __name__ == '__main__':
    sys.exit(main())
