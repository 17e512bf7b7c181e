"""What joints bear, and what a window says of joints that do not go with their encoders."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio
import pytest

from floating import float_freely
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import parse
from mbaid_ros.core.unknowns.declaration import JointMotion
from mbaid_ros.core.unknowns.joints import FlexibleJoints, flexible_joints
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
from observed import MID, observe
from windowed import START as BEGIN
from windowed import residuals, window_model, window_of

SPACING, SECONDS, STEP = 0.05, 6.0, 0.01  # s
JOINT, SIZE, LAG = 3, 0.01, 0.002  # rad, s


@pytest.fixture(scope='module')
def truth(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> Truth:
    """Return a servicer that is as its URDF says, as it tumbles and drifts."""
    return float_freely(servicer7, joints, start, SECONDS)


@dataclass(frozen=True, eq=False)
class Listening(FlexibleJoints):
    """Flexible joints that keep what they are told."""

    told: list[JointMotion] = field(default_factory=list)

    def deflections(self, motion: JointMotion) -> tuple[Array, Array]:
        """Keep it."""
        self.told.append(motion)
        return super().deflections(motion)


def state(robot: MomentumKernel, start: Array, numbers: Array) -> Array:
    return np.concatenate((np.zeros(6), start, robot.target.parameters, numbers))


def test_the_torques_are_those_of_inverse_dynamics(servicer7: MomentumKernel, truth: Truth, start: Array) -> None:
    nearly = flexible_joints(servicer7.model.joint_names)
    unknown = Listening(nearly.factor, nearly.labels)
    layout = Layout.of(servicer7, (unknown,))
    here = layout.point(state(servicer7, start, np.zeros(unknown.count)))
    window_model(layout, window_of(observe(truth, MID), SPACING), here)
    (motion,) = unknown.told
    robot = parse(servicer7.model.urdf)
    robot.gravity.setZero()
    data = robot.createData()
    velocity = np.column_stack((truth.base_linear_velocity, truth.base_angular_velocity, truth.joint_velocity))
    acceleration = np.gradient(velocity, STEP, axis=0)
    place = np.column_stack((truth.base_position, truth.base_orientation, truth.joint_position))
    torque = np.array(
        [pinocchio.rnea(robot, data, *each)[6:] for each in zip(place, velocity, acceleration, strict=True)]
    )
    # The window's own intervals are inside; one more before and after them.
    first = BEGIN + SPACING / 2.0 + (np.arange(len(motion.torque)) - 0.5) * SPACING
    expected = np.column_stack([np.interp(first, truth.time, one) for one in torque.T])
    assert motion.torque[1:-1] == pytest.approx(expected[1:-1], abs=0.01 * np.abs(torque).max())


def test_joints_that_lag_and_swing_leave_nothing_in_a_window(
    servicer7: MomentumKernel, truth: Truth, start: Array
) -> None:
    own = np.eye(servicer7.model.joints)[JOINT]
    angle = truth.joint_position[:, JOINT, None]
    off = SIZE * np.sin(angle) + LAG * truth.joint_velocity[:, JOINT, None]
    window = window_of(observe(replace(truth, joint_position=truth.joint_position - off * own), MID), SPACING)
    unknown = flexible_joints(servicer7.model.joint_names)
    layout = Layout.of(servicer7, (unknown,))
    numbers = np.zeros((servicer7.model.joints, 4))
    nothing, numbers[JOINT] = numbers.ravel().copy(), (0.0, LAG, SIZE, 0.0)
    found = []
    for each in (nothing, numbers.ravel()):
        here = layout.point(state(servicer7, start, nothing))
        x = state(servicer7, start, np.linalg.solve(unknown.factor, each))
        model = window_model(layout, window, here)
        x[:6] = np.linalg.solve(model.pose_rows[:, :6], residuals(model, x)[0])
        found.append(np.abs(residuals(model, x)[1]).max())
    assert found[1] < 0.05 * found[0]
    assert len(state(servicer7, start, nothing)) == layout.size == BODY.stop + 4 * servicer7.model.joints


def test_a_part_is_one_joint() -> None:
    part = flexible_joints(('elbow', 'wrist')).part('flexible:wrist')
    assert part.count == 4
    assert set(part.causes) == {'flexible:wrist'}
