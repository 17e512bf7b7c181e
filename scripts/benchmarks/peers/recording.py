"""Input and output of a method, and a recording as arrays."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.data import JOINTS, ODOMETRY
from mbaid_ros.bags import BagReader
from mbaid_ros.core.geometry import Array, rotate, rotation_from_quaternion, skew
from mbaid_ros.core.robot.body import physical, physical_jacobian
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel, unknown_scale
from mbaid_ros.core.samples import Samples, SensorNoise


@dataclass(frozen=True)
class Known:
    """The knowledge of a method beside the bag and the URDF, whose inertial of the target link is 10 % off."""

    target_link: str  # name
    noise: SensorNoise  # one standard deviation of each sensor channel
    declared: dict[str, Any]  # the estimator's parameters of deviations from the URDF, orbit and passive joints
    momentum: Array  # (6,) true total (P, L) about the odometry origin; only for a method that has it in NEEDS
    passive_urdf: str  # robot description with joints that swing, which no message has and the URDF fixes; empty: none

    @staticmethod
    def read(file: Path) -> 'Known':
        """Return the contents of known.json of a run."""
        values = json.loads(file.read_text(encoding='utf-8'))
        noise, momentum = SensorNoise(**values['noise']), np.array(values['momentum'])
        return Known(values['target_link'], noise, values['declared'], momentum, values['passive_urdf'])


@dataclass(frozen=True)
class Answer:
    """The answer of a method.

    Parameters are mass, centre of mass (link frame) and inertia about it (xx, xy, xz, yy, yz, zz; link axes).
    """

    parameters: Array  # (10,) kg, m, kg m^2; NaN where the method gives none
    covariance: Array | None = None  # (10, 10) of these; None if the method has none
    doubt: str = ''  # why the method itself does not trust them; empty if it does

    @staticmethod
    def standard(parameters: Array, covariance: Array | None = None) -> 'Answer':
        """Return it from (10,) standard parameters (m, m r_c, inertia about the link's origin) and their covariance."""
        jacobian = physical_jacobian(parameters)
        own = None if covariance is None else jacobian @ covariance @ jacobian.T
        return Answer(physical(parameters), own)


@dataclass(frozen=True)
class Recording:
    """A recording as arrays of N samples."""

    kernel: MomentumKernel  # the robot's momentum, by its URDF, with the target link unknown
    samples: Samples  # positions, velocities, base pose and twist (odometry axes)
    effort: Array  # (N, n) N m

    def equations(self) -> tuple[Array, Array]:
        """Return the momentum equations A x = b, (N, 6, 16) and (N, 6), of x = (m, m r_c, I_o, P, L).

        P and L are total linear and angular momentum about the odometry origin. Rows are linear, then angular momentum
        about the base's origin, in odometry axes.
        """
        states = self.kernel.states(self.samples)
        place = self.samples.base_position
        matrix = np.zeros((len(place), 6, 16))
        matrix[..., :10] = states.regressor
        matrix[..., 10:] = -np.eye(6)
        matrix[:, 3:, 10:13] = skew(place)
        return matrix, -states.known_momentum

    @property
    def scale(self) -> Array:
        """Typical sizes of the 16 unknowns, by which columns are scaled before anything is solved."""
        return unknown_scale(self.kernel)


def read(bag: Path, urdf: str, known: Known) -> Recording:
    """Return a recording whose joint states and odometry have the same stamps."""
    with BagReader(bag) as reader:
        messages = list(reader.read([JOINTS, ODOMETRY]))
    joints = [message for topic, message, _ in messages if topic == JOINTS]
    base = [message for topic, message, _ in messages if topic == ODOMETRY]
    model = load_model(urdf)
    order = [joints[0].name.index(name) for name in model.joint_names]
    kinds = ('position', 'velocity', 'effort')
    position, velocity, effort = (np.array([getattr(each, kind) for each in joints])[:, order] for kind in kinds)
    stamp = np.array([each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in joints])
    pose, twist = ([getattr(each, kind) for each in base] for kind in ('pose', 'twist'))
    orientation = np.array([[getattr(each.pose.orientation, axis) for axis in 'xyzw'] for each in pose])
    rotation = rotation_from_quaternion(orientation)
    linear, angular = (_vectors([getattr(each.twist, kind) for each in twist]) for kind in ('linear', 'angular'))
    shape = (len(stamp), 6, 6)
    samples = Samples(
        time=stamp - stamp[0],
        joint_position=position,
        joint_velocity=velocity,
        base_position=_vectors([each.pose.position for each in pose]),
        base_rotation=rotation,
        base_linear_velocity=rotate(rotation, linear),
        base_angular_velocity=rotate(rotation, angular),
        pose_covariance=np.broadcast_to(known.noise.pose_covariance(), shape),
        twist_covariance=np.broadcast_to(known.noise.twist_covariance(), shape),
    )
    return Recording(MomentumKernel(model, known.target_link), samples, effort)


def least_squares(matrix: Array, right_side: Array, scale: Array) -> tuple[Array, Array]:
    """Return the solution of A x = b, (R, u) and (R,), and its covariance from the size of the residuals."""
    scaled = matrix * scale
    solution, _, rank, _ = np.linalg.lstsq(scaled, right_side, rcond=None)
    residual = right_side - scaled @ solution
    variance = residual @ residual / max(len(residual) - int(rank), 1)
    return solution * scale, variance * np.linalg.pinv(scaled.T @ scaled, hermitian=True) * np.outer(scale, scale)


def _vectors(values: list[Any]) -> Array:
    return np.array([[each.x, each.y, each.z] for each in values])
