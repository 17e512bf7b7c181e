"""Least squares on joint torques by pinocchio's regressor, in the manner of FIGAROH and FloBaRoID.

Positions, velocities and the base's pose are filtered forwards and backwards by a Butterworth filter and differentiated
once; the inverse dynamics of the free-floating robot then are linear in the target's standard parameters. No force acts
on the base, so that its six rows have the right side zero. Rows are weighted by their own residuals, as there.
"""

from pathlib import Path

import numpy as np
import pinocchio
from scipy.signal import butter, sosfiltfilt

from benchmarks.peers.recording import Answer, Known, Recording, least_squares, read
from mbaid_ros.core.geometry import Array, quaternion_from_rotation, rotate_back
from mbaid_ros.core.robot.model import express, load_model, parse

NEEDS = 'joint torques'
TUNED = 'cut-off of the filter: .5 Hz, the best of .2 to 2 Hz by the truth of four runs'
_CUT_OFF = 0.5  # Hz
_ORDER = 4
_EDGE, _EVERY = 100, 5  # samples: left out where the filter begins and ends; of the others one in so many
_ORDER_OF_PINOCCHIO = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]  # its inertia is xx, xy, yy, xz, yz, zz
_WEIGHTINGS = 3


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    recording = read(bag, urdf, known)
    matrix, right_side = _equations(recording, urdf)
    weight = np.ones(matrix.shape[1])
    scale = recording.scale[:10]
    for _ in range(_WEIGHTINGS):
        weighted, wanted = matrix * weight[:, None], right_side * weight
        solution, covariance = least_squares(weighted.reshape(-1, 10), wanted.ravel(), scale)
        weight = 1.0 / np.maximum(np.std(right_side - matrix @ solution, axis=0), 1e-9)
    return Answer.standard(solution, covariance)


def _equations(recording: Recording, urdf: str) -> tuple[Array, Array]:
    """Return the inverse dynamics (K, 6 + n, 10), (K, 6 + n) of the target's standard parameters."""
    kernel, model = recording.kernel, parse(load_model(urdf))
    data, body = model.createData(), kernel.target.body
    configuration, velocity, acceleration = _motion(recording, model)
    known = kernel.known[:, _ORDER_OF_PINOCCHIO].ravel()
    to_body = express(np.eye(10), kernel.target.rotation, kernel.target.position)[:, _ORDER_OF_PINOCCHIO].T
    chosen = range(_EDGE, len(velocity) - _EDGE, _EVERY)
    matrix, right_side = np.empty((len(chosen), model.nv, 10)), np.zeros((len(chosen), model.nv))
    right_side[:, 6:] = recording.effort[chosen]
    for row, sample in enumerate(chosen):
        whole = pinocchio.computeJointTorqueRegressor(
            model, data, configuration[sample], velocity[sample], acceleration[sample]
        )
        matrix[row] = whole[:, 10 * body : 10 * body + 10] @ to_body
        right_side[row] -= whole @ known
    return matrix, right_side


def _motion(recording: Recording, model: pinocchio.Model) -> tuple[Array, Array, Array]:
    """Return configurations (N, nq), velocities and accelerations (N, 6 + n), filtered, base twist in base axes."""
    samples = recording.samples
    step = float(samples.time[-1]) / (len(samples) - 1)
    rotation = samples.base_rotation
    sections = butter(_ORDER, _CUT_OFF, fs=1.0 / step, output='sos')
    twist = [rotate_back(rotation, each) for each in (samples.base_linear_velocity, samples.base_angular_velocity)]
    velocity = sosfiltfilt(sections, np.concatenate((*twist, samples.joint_velocity), axis=1), axis=0)
    angle = sosfiltfilt(sections, samples.joint_position, axis=0)
    configuration = np.empty((len(samples), model.nq))
    configuration[:, :3], configuration[:, 3:7] = samples.base_position, quaternion_from_rotation(rotation)
    for joint, values in zip(list(model.joints)[2:], angle.T, strict=True):
        turned = (values,) if joint.nq == 1 else (np.cos(values), np.sin(values))
        configuration[:, joint.idx_q : joint.idx_q + joint.nq] = np.stack(turned, axis=1)
    return configuration, velocity, np.gradient(velocity, step, axis=0)
