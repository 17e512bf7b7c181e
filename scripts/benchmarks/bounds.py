"""Cramér-Rao bounds: the accuracy that no unbiased estimator can surpass.

`bound` is of the per-sample model: each sample gives momentum equations with the noise of its own sensors in all terms;
unknown are body and total momentum. `trajectory_bound` is of the whole trajectory: unknown are also the first pose and
the path of every joint, a cubic spline with a knot each second. Errors propagate to first order from knot to knot:

    xi' = F xi + G dx + A dq' + C dq        xi = (theta, rho): of the pose, dx: of body and momentum, dq: of the path
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from benchmarks.data import Case, exact_samples, kernel, momentum_of
from mbaid_ros.core.difference import Subspace, subspace, window_rows
from mbaid_ros.core.difference_solver import maximum_likelihood
from mbaid_ros.core.filter.linearise import predict
from mbaid_ros.core.geometry import Array, Flags, cross
from mbaid_ros.core.joints.model import joint_gains
from mbaid_ros.core.robot.body import physical_jacobian
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import POSE, Layout
from mbaid_ros.core.windows import ANGULAR_FIRST, Midpoints
from mbaid_ros.simulation.simulation import Truth

_BATCH = 500  # samples
STRIDE = 4  # samples from knot to knot
_KNOT = 1.0  # s, of the splines
_ORDER = 3


@dataclass(frozen=True)
class Problem:
    """An exact motion, and the space of the unknowns that it determines."""

    samples: Samples  # without noise, with the covariances of noisy ones
    momentum: Array  # (6,) true total, about the first position of the base
    space: Subspace  # equations that hold, and a basis of body and momentum
    jacobian: Array  # (10, v) of the physical parameters by the coordinates of the basis
    known: Flags  # (10,) parameters in the span of the basis

    @staticmethod
    def of(case: Case, truth: Truth) -> 'Problem':
        """Return that of a case's motion."""
        robot = kernel(case.robot)
        samples = exact_samples(truth, case.noise)
        detector = PlaneDetector(robot.model)
        detector.update(samples)
        space = subspace(detector, robot)
        momentum = momentum_of(case.robot, truth)
        momentum[3:] -= cross(truth.base_position[0], momentum[:3])
        full = physical_jacobian(robot.target.parameters)
        jacobian = full @ space.basis[:10]
        known = np.all(np.abs(full - jacobian @ space.basis[:10].T) < 1e-9, axis=1)
        return Problem(samples, momentum, space, jacobian, known)

    def deviations(self, information: Array) -> Array:
        """Return the (10,) standard deviations by information whose last rows are of the basis."""
        size = 1.0 / np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information * size * size[:, None]) * size * size[:, None]
        count = self.jacobian.shape[1]
        variance = np.diag(self.jacobian @ inverse[-count:, -count:] @ self.jacobian.T)
        return np.where(self.known, np.sqrt(np.maximum(variance, 0.0)), np.nan)


def bound(case: Case, truth: Truth, times: tuple[float, ...]) -> Array:
    """Return the (len(times), 10) bounds of the per-sample model; NaN for what the motion leaves open."""
    robot = kernel(case.robot)
    problem = Problem.of(case, truth)
    samples, origin = problem.samples, truth.base_position[0]
    unknowns = problem.space.basis.T @ np.concatenate((robot.target.parameters, problem.momentum))
    result, done = np.full((len(times), 10), np.nan), 0
    information: Array = np.zeros((len(unknowns), len(unknowns)))
    for row, time in enumerate(times):
        end = int(np.searchsorted(samples.time, time - 1e-9))
        for start in range(done, end, _BATCH):
            chosen = range(start, min(start + _BATCH, end))
            blocks = window_rows(robot, [samples[k : k + 1] for k in chosen], case.noise, origin)
            information = information + maximum_likelihood(problem.space.restricted(blocks), unknowns).information
        done = end
        result[row] = problem.deviations(information)
    return result


def trajectory_bound(case: Case, truth: Truth, times: tuple[float, ...]) -> Array:
    """Return the (len(times), 10) bounds of the whole trajectory; NaN for what the motion leaves open."""
    problem = Problem.of(case, truth)
    ends = np.searchsorted(problem.samples.time, np.array(times) - 1e-9).tolist()
    parts = [_information(case, problem.samples[:end], problem.momentum, problem.space.basis) for end in ends]
    return np.array([problem.deviations(information) for information in parts])


@dataclass(frozen=True)
class Path:
    """How pose errors (theta, rho) at knots follow from (paths of the joints, first pose, body and momentum)."""

    step: float  # s
    xi: Array  # (T, 6, c)
    slope: Array  # (T - 1, 6, 6) change of the twist's error by pose errors
    forced: Array  # (T - 1, 6, c) by all else
    joints: int  # columns of the paths

    @staticmethod
    def of(robot: MomentumKernel, samples: Samples, momentum: Array, basis: Array) -> 'Path':
        """Return that of exact samples of a robot, about a total momentum, in a basis of body and momentum."""
        between = slice(STRIDE // 2, None, STRIDE)
        step = float(samples.time[STRIDE] - samples.time[0])
        count = len(samples.time[between])
        middle = samples[between]
        twist = np.concatenate((middle.base_linear_velocity, middle.base_angular_velocity), axis=1)
        midpoints = Midpoints(
            joint_position=middle.joint_position,
            joint_velocity=middle.joint_velocity,
            base_rotation=middle.base_rotation,
            base_position=middle.base_position - middle.base_position[0],
            base_twist=twist,
            turn=step * twist[:, 3:],
            step=step * twist[:, :3],
            impulse=middle.impulse,
        )
        layout = Layout.from_unknowns(robot, ())
        state = np.concatenate((np.zeros(POSE.stop), momentum, robot.target.parameters))
        prediction, bodies = predict(layout, midpoints, layout.point(state))
        by_rate, by_position = joint_gains(robot, bodies)
        value, rate = splines(samples.time[between], float(samples.time[-1]))
        # A spline's own columns: the k-th spline of the j-th joint is column k n + j.
        path = np.einsum('tk,tij->tikj', rate, by_rate) + np.einsum('tk,tij->tikj', value, by_position)
        path = path.reshape(count, 6, -1)
        by_parameters = prediction.by_parameters
        parameters = np.concatenate((by_parameters[..., 6:], by_parameters[..., :6]), axis=-1) @ basis
        forced = np.concatenate((path, np.zeros((count, 6, 6)), parameters), axis=-1)
        turned = prediction.error_slope
        xi = np.zeros((count + 1, *forced.shape[1:]))
        xi[0, :, path.shape[-1] : path.shape[-1] + 6] = np.eye(6)
        for k in range(count):
            half = 0.5 * step * turned[k]
            right = (np.eye(6) + half) @ xi[k] + step * forced[k, ANGULAR_FIRST]
            xi[k + 1] = np.linalg.solve(np.eye(6) - half, right)
        return Path(step, xi, prediction.by_pose_error[:, ANGULAR_FIRST], forced, path.shape[-1])


def _information(case: Case, samples: Samples, momentum: Array, basis: Array) -> Array:
    """Return the information about (paths of the joints, first pose, body and momentum in a basis)."""
    robot, noise = kernel(case.robot), case.noise
    path = Path.of(robot, samples, momentum, basis)
    xi, step, joints = path.xi, path.step, path.joints
    pose = np.repeat([noise.base_orientation, noise.base_position], 3)
    # Rows of poses at knots, relative to the noise of one: independent, or an autoregression of them.
    poses, keep = xi / pose[:, None], np.exp(-step / case.correlated) if case.correlated else 0.0
    parts = [poses[:1], (poses[1:] - keep * poses[:-1]) / np.sqrt(1.0 - keep**2)]
    rows = [part.reshape(-1, xi.shape[-1]) for part in (parts if keep else [poses * np.sqrt(STRIDE / case.every)])]
    if case.sensors == 'all':
        seldom = np.sqrt(case.every / STRIDE)
        twist = np.repeat([noise.base_angular_velocity, noise.base_linear_velocity], 3) * seldom
        change = path.slope @ (0.5 * (xi[1:] + xi[:-1])) + path.forced[:, ANGULAR_FIRST]
        rows.append((change / twist[:, None]).reshape(-1, xi.shape[-1]))
    information = sum((part.T @ part for part in rows), np.zeros((xi.shape[-1],) * 2))
    value, rate = splines(samples.time[::STRIDE], float(samples.time[-1]))
    seen = STRIDE * value.T @ value / noise.joint_position**2
    if case.sensors == 'all':
        seen += STRIDE * rate.T @ rate / noise.joint_velocity**2
    information[:joints, :joints] += np.kron(seen, np.eye(robot.model.joints))
    return np.asarray(information)


def splines(time: Array, end: float) -> tuple[Array, Array]:
    """Return values and rates (T, K) of the cubic splines of a run."""
    inner = np.linspace(0.0, end, max(round(end / _KNOT), 1) + 1)
    knots = np.concatenate((np.full(_ORDER, inner[0]), inner, np.full(_ORDER, inner[-1])))
    basis = BSpline(knots, np.eye(len(inner) + _ORDER - 1), _ORDER)
    return basis(time), basis.derivative()(time)
