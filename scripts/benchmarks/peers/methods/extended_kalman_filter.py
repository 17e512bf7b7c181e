"""An extended Kalman filter: base pose, constant total momentum and constant standard parameters, one step a sample.

The base's twist follows from the momentum and the measured joint motion, and moves the pose, which is measured. Joint
positions count as exact, joint velocities as inputs with white noise. The measured twist sets the start alone: as a
measurement it shares its errors with the inputs, and the filter diverges with the worst encoders.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.peers.recording import Answer, Known, Recording, read
from mbaid_ros.core.geometry import Array, exp, log, rotate_back, skew
from mbaid_ros.core.links import relative_factor
from mbaid_ros.core.samples import SensorNoise

NEEDS = 'sensor noise, a start (the URDF)'
TUNED = 'prior: 30 % about the URDF, momentum of .1 m/s and .1 rad/s'
_PRIOR, _MOMENTUM = 0.3, 0.1
# Columns of the errors: position, orientation (fixed axes), linear and angular momentum, standard parameters.
_ROTATION, _LINEAR, _ANGULAR, _BODY, _SIZE = slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 22), 22


def identify(bag: Path, urdf: str, known: Known) -> Answer:
    """Return mass, centre of mass and inertia of the target link."""
    recording = read(bag, urdf, known)
    samples, motion = recording.samples, _Motion.of(recording)
    state = _State.first(recording, motion)
    step = float(samples.time[-1]) / (len(samples) - 1)
    for index in range(len(samples)):
        state.update(samples.base_position[index], samples.base_rotation[index], known.noise)
        if index < len(samples) - 1:
            state.predict(motion, index, step, known.noise.joint_velocity)
    return Answer.standard(state.body, state.covariance[_BODY, _BODY])


@dataclass(frozen=True)
class _Motion:
    """Momentum about the base's origin in its axes, by unit velocities, midway between samples."""

    known: Array  # (N - 1, 6, 6 + n) of the known bodies, by unit twists of the base and unit joint rates
    target: Array  # (N - 1, 6 + n, 6, 10) of the target, by these and standard parameters
    rate: Array  # (N - 1, n) measured
    start: Array  # (6,) measured twist at the begin, base axes

    @staticmethod
    def of(recording: Recording) -> '_Motion':
        samples, kernel = recording.samples, recording.kernel
        count, joints = samples.joint_position.shape
        still, known, target = np.broadcast_to(np.eye(3), (count, 3, 3)), [], []
        for unit in np.eye(6 + joints):
            twist, rate = (np.broadcast_to(part, (count, len(part))) for part in (unit[:6], unit[6:]))
            states = kernel.states_of(still, samples.joint_position, rate, twist)
            known.append(states.known_momentum)
            target.append(states.regressor)
        velocities = (samples.base_linear_velocity[:1], samples.base_angular_velocity[:1])
        start = np.concatenate([rotate_back(samples.base_rotation[:1], each) for each in velocities], axis=1)[0]
        parts: list[Array] = [np.stack(known, axis=-1), np.stack(target, axis=1), samples.joint_velocity]
        middle = [0.5 * (part[1:] + part[:-1]) for part in parts]
        return _Motion(middle[0], middle[1], middle[2], start)


@dataclass
class _State:
    position: Array
    rotation: Array
    momentum: Array  # (6,) about the odometry origin
    body: Array
    covariance: Array

    @staticmethod
    def first(recording: Recording, motion: _Motion) -> '_State':
        samples, body = recording.samples, recording.kernel.target.parameters
        moving = np.concatenate((motion.start, motion.rate[0]))
        own = (motion.known[0] + np.einsum('kip,p->ik', motion.target[0], body)) @ moving
        position, rotation = samples.base_position[0], samples.base_rotation[0]
        linear, angular = rotation @ own[:3], rotation @ own[3:]
        covariance = np.zeros((_SIZE, _SIZE))
        covariance[:6, :6] = samples.pose_covariance[0] * 100.0  # the first update has the measurement itself
        covariance[6:12, 6:12] = np.diag((_MOMENTUM * recording.scale[10:]) ** 2)
        factor = relative_factor(body, _PRIOR)
        covariance[_BODY, _BODY] = factor @ factor.T
        return _State(
            position, rotation, np.concatenate((linear, angular + np.cross(position, linear))), body, covariance
        )

    def _twist(self, motion: _Motion, index: int, rotation: Array) -> tuple[Array, Array, Array]:
        """Return the base's twist (6,) in its axes, its derivatives by the errors (6, 22) and by joint rates (6, n)."""
        matrix = motion.known[index] + np.einsum('kip,p->ik', motion.target[index], self.body)
        linear = self.momentum[:3]
        about_base = self.momentum[3:] - np.cross(self.position, linear)
        back = rotation.T
        own = np.concatenate((back @ linear, back @ about_base))
        inverse = np.linalg.inv(matrix[:, :6])
        twist = inverse @ (own - matrix[:, 6:] @ motion.rate[index])
        moving = np.concatenate((twist, motion.rate[index]))
        change = np.zeros((6, _SIZE))
        change[:3, _ROTATION], change[3:, _ROTATION] = back @ skew(linear), back @ skew(about_base)
        change[:3, _LINEAR], change[3:, _ANGULAR] = back, back
        change[3:, :3], change[3:, _LINEAR] = back @ skew(linear), -back @ skew(self.position)
        change[:, _BODY] = -np.einsum('k,kip->ip', moving, motion.target[index])
        return twist, inverse @ change, -inverse @ matrix[:, 6:]

    def predict(self, motion: _Motion, index: int, step: float, rate_noise: float) -> None:
        """Move the pose by one step."""
        middle = self.rotation @ exp(0.5 * step * self._twist(motion, index, self.rotation)[0][3:])
        twist, by_error, by_rate = self._twist(motion, index, middle)
        axes = np.kron(np.eye(2), middle) * step
        transition = np.eye(_SIZE)
        transition[:6] += axes @ by_error
        transition[:3, _ROTATION] -= skew(middle @ twist[:3]) * step
        noise = axes @ by_rate * rate_noise
        self.covariance = transition @ self.covariance @ transition.T
        self.covariance[:6, :6] += noise @ noise.T
        self.position = self.position + step * middle @ twist[:3]
        self.rotation = self.rotation @ exp(step * twist[3:])

    def update(self, position: Array, rotation: Array, noise: SensorNoise) -> None:
        """Correct by a measured pose."""
        innovation = np.concatenate((position - self.position, log(rotation @ self.rotation.T)))
        size = noise.pose_covariance()
        gain = np.linalg.solve(self.covariance[:6, :6] + size, self.covariance[:6]).T
        change = gain @ innovation
        keep = np.eye(_SIZE)
        keep[:, :6] -= gain
        self.covariance = keep @ self.covariance @ keep.T + gain @ size @ gain.T
        self.position = self.position + change[:3]
        self.rotation = exp(change[_ROTATION]) @ self.rotation
        self.momentum = self.momentum + change[6:12]
        self.body = self.body + change[_BODY]
