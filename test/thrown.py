"""A thrown body with a flywheel and a gyro: what it is, what is recorded of it, what `calibrate` finds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.bags import BagWriter
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.replay.run import BAG_TYPES
from mbaid_ros.replay.start import calibrate
from mbaid_ros.simulated_run import SimulatedRun

_URDF = """<robot name="thrown">
  <link name="base_link"><inertial><origin xyz="0.001 -0.002 0.003"/><mass value="0.28"/>
    <inertia ixx="{}" iyy="{}" izz="{}" ixy="{}" ixz="{}" iyz="{}"/></inertial></link>
  <link name="wheel"><inertial><mass value="0.005"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1.687e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="spin" type="continuous"><parent link="base_link"/><child link="wheel"/>
    <origin xyz="0 0.01 0.02"/><axis xyz="0 0 1"/></joint>
</robot>"""
INERTIA = {'ixx': 2.2e-4, 'iyy': 3.1e-4, 'izz': 4e-4, 'ixy': 1e-5, 'ixz': -2e-5, 'iyz': 1.5e-5}  # kg m^2
_CALIBRATE = """calibrate:
  ros__parameters:
    imu: {alone: true, noise_density: 1.0e-4, bias_std: 3.0e-3, bias_walk: 1.0e-4, scale_std: 2.0e-3,
          orientation_std: 1.0e-3}
    noise: {joint_position: 1.0e-3, joint_velocity: 1.0}
    time_offset: {prior_std: 1.0e-3}
    known_links: {base_link: {mass_relative_std: 1.0e-3, com_std: 2.0e-3, inertia_relative_std: 0.2},
                  wheel: {mass_relative_std: 1.0e-3, com_std: 2.0e-3, inertia_relative_std: 0.2}}
    known_joints: {zero_std: 0.0, origin_std: 0.0, axis_std: 0.0}
"""
_SIMULATOR: dict[str, object] = {
    'joint_rate': 1000.0,
    'imu.noise_density': 1e-4,
    'initial.joint_positions': [-400.0],
    'motion.kind': 'sinusoids',
    'motion.amplitudes': [400.0],
    'motion.frequencies': [0.4],
    'motion.phases': [-0.5 * np.pi],
    'noise.joint_position': 1e-3,
}

AT_REST: dict[str, object] = {'motion.amplitudes': [0.0], 'initial.joint_positions': [0.0]}  # the wheel


def record(folder: Path, values: Mapping[str, object], seconds: float, name: str = 'throw') -> None:
    """Write the bag of a throw: the wheel's joint states and the gyro, no poses.

    Parameters
    ----------
    folder : of the bag
    values : parameters of the simulator beside those of every throw
    seconds : of free flight
    name : of the bag
    """
    run = SimulatedRun(build(SimulatorConfig, {**_SIMULATOR, **values}), _URDF.format(*INERTIA.values()), BAG_TYPES)
    with BagWriter(folder / name) as bag:
        bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        bag.add_topic('/imu', 'sensor_msgs/msg/Imu')
        for timed in run.read(seconds):
            if timed.topic != 'odom':
                bag.write(f'/{timed.topic}', timed.message, run.stamp(timed.time))


def calibrated(
    folder: Path, believed: Sequence[float], parameters: str = 'window: 0.02', bags: Sequence[str] = ('throw',)
) -> dict[str, Any] | None:
    """Return what `calibrate` finds of the throws in a folder, as its JSON; None where it finds nothing.

    Parameters
    ----------
    folder : as of `record`
    believed : kg m^2, elements of the body's inertia in the order of INERTIA, as the URDF has them
    parameters : a line of YAML, the rest of them
    bags : names, a throw each
    """
    (folder / 'drawn.urdf').write_text(_URDF.format(*believed), encoding='utf-8')
    (folder / 'calibrate.yaml').write_text(f'{_CALIBRATE}    {parameters}\n', encoding='utf-8')
    arguments = [
        *(folder / bag for bag in bags),
        '--model',
        folder / 'drawn.urdf',
        '--params',
        folder / 'calibrate.yaml',
    ]
    arguments += ['--unknown', 'base_link', '--json', folder / 'found.json']
    with redirect_stdout(StringIO()):
        if calibrate([str(each) for each in arguments]) != 0:
            return None
    found: dict[str, Any] = json.loads((folder / 'found.json').read_text(encoding='utf-8'))
    return found
