"""The lists of all that takes part."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.gyro import gyro_sensor
from mbaid_ros.core.links import KnownBodies
from mbaid_ros.core.poses import PoseSensor
from mbaid_ros.session.catalogue import suspects
from observed import kernel


def test_suspects_widen_nothing_by_themselves() -> None:
    """Each is tried with a prior of a thousandth of a plausible value: some per mille, milliradians, ms, mm/s."""
    robot = kernel('servicer7')
    sensors = gyro_sensor('gyros.hand', 1e-4, robot.model), PoseSensor('poses.mocap', 'both', slice(0, 50))
    bodies, densities, *others = suspects(robot, sensors)
    sizes: list[float] = []
    for links in (bodies, densities):
        assert isinstance(links, KnownBodies)
        sizes += (np.linalg.norm(links.factor[::10], axis=1) / robot.known[list(links.bodies), 0]).tolist()
    sizes += [float(np.max(np.abs(each.factor))) for each in others]
    assert max(sizes) <= 1e-3
    assert min(sizes) > 0.0
    assert {'gyro drift:hand', 'pose drift:mocap', 'poses late'} <= {each.labels[-1] for each in others} | {
        each.labels[0] for each in others
    }
