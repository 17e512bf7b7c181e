"""The container's and pixi's recipes: what package.xml asks for is in them, and what they name is there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
# What rosdep's keys are called on conda-forge and PyPI.
CONDA = {
    'python3-numpy': 'numpy',
    'python3-scipy': 'scipy',
    'python3-yaml': 'pyyaml',
    'python3-matplotlib': 'matplotlib',
    'python3-tqdm': 'tqdm',
    'python3-rosbags-pip': 'rosbags',
}
# Packages that ros-base brings.
OF_ROS_BASE = {
    *('ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs', 'rcl_interfaces'),
    *('rclpy', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs'),
}


def needed() -> set[str]:
    found = {element.text or '' for element in ET.parse(ROOT / 'package.xml').getroot().findall('exec_depend')}
    return found - {'mbaid_msgs'} - OF_ROS_BASE


@pytest.mark.skipif(sys.version_info < (3, 11), reason='tomllib came with Python 3.11')
def test_pixi_brings_what_the_package_needs() -> None:
    import tomllib  # noqa: PLC0415 - not there in Python 3.10

    recipe = tomllib.loads((ROOT / 'pixi.toml').read_text())
    given = {*recipe['dependencies'], *recipe['pypi-dependencies']}
    assert {CONDA.get(key, f'ros-jazzy-{key.replace("_", "-")}') for key in needed()} <= given
    assert 'mcap' in given
    for script in recipe['activation']['scripts']:
        assert subprocess.run(['sh', '-n', ROOT / script], check=False).returncode == 0


def test_the_container_copies_what_there_is_and_starts_what_there_is() -> None:
    text = (ROOT / 'Dockerfile').read_text()
    for source in re.findall(r'^COPY (\S+) \S+$', text, re.MULTILINE):
        assert (ROOT / source).exists()
    assert re.search(r'^CMD \["ros2", "run", "mbaid_ros", "estimator"\]$', text, re.MULTILINE)
    entry = re.search(r"printf '(.*?)' >", text)
    assert entry
    script = entry[1].encode().decode('unicode_escape')
    assert subprocess.run(['bash', '-n'], input=script, text=True, check=False).returncode == 0
    ignored = (ROOT / '.dockerignore').read_text().split()
    assert not [name for name in ignored if name in {'msg_defs', 'config', 'resource', 'setup.py', 'mbaid_ros'}]


def test_the_versions_agree() -> None:
    version = ET.parse(ROOT / 'package.xml').getroot().findtext('version')
    assert ET.parse(ROOT / 'msg_defs' / 'package.xml').getroot().findtext('version') == version
    assert f"version='{version}'" in (ROOT / 'setup.py').read_text()
    assert yaml.safe_load((ROOT / 'CITATION.cff').read_text())['version'] == version
    assert f'\n{version} (' in (ROOT / 'CHANGELOG.rst').read_text()
