"""The windows of a motion whose momentum varies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.precapture import free_model
from mbaid_ros.calibration.iteration import Motion, _linearised, _point
from mbaid_ros.core.filter.state import LINEAR
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.unknowns.bodies import KnownTarget
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.environment import Pushing
from observed import MID, observe, windows
from servicing import free_motion


def test_windows_at_a_momentum_of_their_own_are_those_of_a_point_with_that_momentum() -> None:
    robot_kernel = MomentumKernel(free_model(), 'link7')
    body = robot_kernel.target.parameters
    uncertainty = Uncertainty(target=KnownTarget(body, np.diag(0.1 * np.ones(10))), torque=Pushing(0.3, 30.0))
    run = windows(observe(free_motion(1, 3.0), MID, 0))
    motion = Motion.of(run, robot_kernel, PlaneDetector(robot_kernel.model), uncertainty, (MID, 0.5, 0.0, True))
    assert motion.pushed
    common = np.concatenate((body, np.zeros(motion.layout.size - LINEAR.start - 6 - len(body))))
    momentum, step = np.array([0.3, -0.2, 0.1, 0.5, -0.4, 0.2]), np.array([0.1, 0.2, -0.3, 0.2, 0.1, -0.1])
    here, there = (_point(motion.layout, common, each, np.zeros(len(common))) for each in (momentum, momentum + step))
    course = np.tile(momentum + step, (len(motion.windows), 1))
    expected = list(_linearised(motion, there))
    found = list(_linearised(replace(motion, course=course), here))
    assert len(found) == len(expected) > 3
    for (_, one), (_, other) in zip(found, expected, strict=True):
        for name in ('value', 'rows', 'transition', 'drift', 'brought'):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-7, atol=1e-7)
