"""A platform on an air cushion that fans and a wheel move, by its published logs: forces as commanded, wheel unknown.

Columns are those of Codes/PC/C++/src/data_storage.cpp in its repository.
"""

from pathlib import Path

import numpy as np

from mbaid_ros.recordings.recording import Recording, turned_about_z
from mbaid_ros.sensor_messages import Joints, Poses, Thrust

MASS = 1.22024  # kg, weighed
_TIME, _HEADING, _PLACE, _FORCE = 1, 9, slice(10, 12), slice(42, 44)  # s, deg, m and N in axes of the camera
_ROBOT = """<robot name="platform">
  <link name="base_link">
    <inertial>
      <mass value="1"/>
      <inertia ixx="0.005" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.01"/>
    </inertial>
  </link>
</robot>
"""
_PARAMETERS = """/**:
  ros__parameters:
    target_link: base_link
    window: 1.0                       # s: 8 rows
    maximum_gap: 0.5                  # s
    disturbance: {axes: inertial, force_std: 0.03, force_time: 5.0, torque_std: 0.01, torque_time: 1.0}  # N, s, N m
    target_prior: {mass: 2.0, mass_std: 2.0, com: [0.0, 0.0, 0.0], com_std: 0.01}   # kg, m
    thrust: {scale_std: 0.2, direction_std: 0.1, delay_std: 0.2}   # rad, s: fans lag
"""


def read_fan_platform(path: Path) -> Recording:
    """Return the run of a ``control_data_*.csv``."""
    table = np.genfromtxt(path, delimiter=',')
    time, heading = table[:, _TIME], np.unwrap(np.radians(table[:, _HEADING]))
    cos, sin, (x, y) = np.cos(heading), np.sin(heading), table[:, _FORCE].T
    wrench = np.zeros((len(time), 6))
    wrench[:, 0], wrench[:, 1] = cos * x + sin * y, cos * y - sin * x
    position = np.column_stack((table[:, _PLACE], np.zeros(len(time))))
    return Recording(
        Joints((), time, np.zeros((len(time), 0))),
        Poses(time, position, turned_about_z(heading), np.full((len(time), 6), np.nan)),
        Thrust(time, wrench, 'base_link'),
        robot=_ROBOT,
        parameters=_PARAMETERS,
    )
