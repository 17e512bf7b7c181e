"""What a calibration makes of what is uncertain."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.unknowns.base import OdometryMount
from mbaid_ros.core.unknowns.calibrated import CalibratedSide
from mbaid_ros.core.unknowns.catalogue import Uncertainty, catalogue
from mbaid_ros.core.unknowns.sensors import GyroErrors
from observed import kernel


@pytest.mark.parametrize('alone', [False, True])
def test_an_imu_alone_has_no_odometry_mount(alone: bool) -> None:
    """Of the rest it is told the same."""
    robot = kernel('servicer7')
    joints, rng = robot.model.joints, np.random.default_rng(1)
    factor = 1e-3 * rng.normal(size=(16 + 6 * joints, 16 + 6 * joints))
    side = CalibratedSide((robot.model.links[0],), np.full(joints, 1e-3), np.full(6, 0.01), factor @ factor.T)
    known, uncertainty = side.known_to(robot, Uncertainty(gyro=GyroErrors(bias=1e-3, alone=alone)))
    unknowns = catalogue(known, uncertainty)
    assert any(isinstance(unknown, OdometryMount) for unknown in unknowns) is not alone
    assert uncertainty.carried is not None
    assert len(uncertainty.carried.mean) == sum(unknown.count for unknown in unknowns)
    kept = uncertainty.carried.factor[: 10 + 6 * joints]
    scale = np.concatenate([np.linalg.norm(unknown.factor, axis=0) for unknown in unknowns])[: len(kept)]
    covariance = kept @ kept.T * scale * scale[:, None]
    assert np.diag(covariance)[10:] == pytest.approx(np.diag(factor @ factor.T)[10:-6], rel=1e-6)
