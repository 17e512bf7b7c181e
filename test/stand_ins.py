"""Programs in place of those that pip cannot install, or that would change the machine: they check what they are given.

What each of them does instead of the real one stands in its function.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

import yaml
from catkin_pkg.packages import find_packages

ROOT = Path(__file__).resolve().parents[1]
RECORDING = 4.0  # s, after which somebody at the keyboard would press Ctrl-C


def put_on_path(folder: Path, *programs: str) -> str:
    """Write programs into a folder, and return the shell command that makes them the first to be found."""
    folder.mkdir()
    for program in programs:
        path = folder / program
        path.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{__file__}" {program} "$@"\n')
        path.chmod(0o755)
    return f'export PATH={folder}:"$PATH"\n'


def rosdep(words: list[str]) -> None:
    """Print the keys that `rosdep install` would install, from the manifests that it would read."""
    parser = argparse.ArgumentParser('rosdep')
    parser.add_argument('verb', choices=['install'])
    parser.add_argument('--from-paths', nargs='+', required=True)
    parser.add_argument('--ignore-src', action='store_true')
    parser.add_argument('-y', action='store_true')
    arguments = parser.parse_args(words)
    packages = [package for path in arguments.from_paths for package in find_packages(path).values()]
    assert len(packages) == len(arguments.from_paths), 'a folder without a package'
    keys = {key.name for package in packages for key in (*package.exec_depends, *package.buildtool_depends)}
    left = keys - {package.name for package in packages} if arguments.ignore_src else keys
    sys.stdout.write(' '.join(sorted(left)) + '\n')


def pip(words: list[str]) -> None:
    """See with the real pip that nothing is left to install."""
    assert words[0] == 'install'
    offline = ['--dry-run', '--no-index', '--disable-pip-version-check']
    subprocess.run([sys.executable, '-m', 'pip', 'install', *offline, *words[1:]], check=True)


def colcon(words: list[str]) -> None:
    """List with the real colcon what it would build, and give what it has built in the project's folder."""
    assert words[0] == 'build'
    real = Path(sys.executable).with_name('colcon')
    subprocess.run([str(real), '--log-base', os.devnull, 'list', *words[1:]], check=True)
    Path('install').symlink_to(ROOT / 'install')


def ros2(words: list[str]) -> None:
    """Start an executable for `ros2 run`, and the recorder for `ros2 bag record`."""
    parser = argparse.ArgumentParser('ros2')
    commands = parser.add_subparsers(dest='command', required=True)
    run = commands.add_parser('run', add_help=False)
    run.add_argument('package', choices=['mbaid_ros'])
    run.add_argument('executable')
    run.add_argument('arguments', nargs=argparse.REMAINDER)
    record = commands.add_parser('bag').add_subparsers(required=True).add_parser('record')
    record.add_argument('-s', '--storage', choices=['mcap'], required=True)
    record.add_argument('-o', '--output', required=True)
    record.add_argument('--topics', nargs='+', required=True)
    chosen = parser.parse_args(words)
    if chosen.command == 'bag':
        parameters = [f'output:={chosen.output}', f'topics:=[{",".join(chosen.topics)}]', f'duration:={RECORDING}']
        chosen.executable = 'recorder'
        chosen.arguments = ['--ros-args', *(word for parameter in parameters for word in ('-p', parameter))]
    program = str(ROOT / 'install' / 'mbaid_ros' / 'lib' / 'mbaid_ros' / chosen.executable)
    os.execv(program, [program, *chosen.arguments])


def rviz2(words: list[str]) -> None:
    """Read the layout, of which test_layouts.py checks what it shows."""
    parser = argparse.ArgumentParser('rviz2')
    parser.add_argument('-d', '--display-config', type=Path, required=True)
    parser.add_argument('-f', '--fixed-frame', required=True)
    layout = yaml.safe_load(parser.parse_args(words).display_config.read_text(encoding='utf-8'))
    assert layout['Visualization Manager']['Displays']


if __name__ == '__main__':
    {each.__name__: each for each in (rosdep, pip, colcon, ros2, rviz2)}[sys.argv[1]](sys.argv[2:])
