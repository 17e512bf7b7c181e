"""mujoco.sysid: rollouts whose joints are servoed along the measured path, matched to the measured poses of the base.

Unknown are the target's ten parameters, as the toolbox parametrises them, and the base's first pose and twist.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid
from scipy.interpolate import BSpline, make_lsq_spline

from benchmarks.peers.recording import Answer, Known, Recording
from mbaid_ros.core.geometry import Array, exp, log, quaternion_from_rotation, rotate_back, rotation_from_quaternion
from mbaid_ros.core.samples import Samples, SensorNoise

if not hasattr(sysid, 'optimize'):
    raise ModuleNotFoundError(f"mujoco.sysid is not installed: pip install 'mujoco[sysid]=={mujoco.__version__}'")

_STEP = 0.01  # s, of a Runge-Kutta method of order 4: one a sample
_SERVO = 15.0  # rad/s, critically damped
_ROTOR = 1e7  # kg m^2
_KNOT, _ORDER = 1.0, 5  # s; of the splines that smooth the encoders
_ITERATIONS = 8  # at most; later ones change no digit of the table
_BEGIN = 'begin'
_ELEMENTS = [0, 3, 4, 1, 5, 2]  # of MuJoCo's inertia (xx, yy, zz, xy, xz, yz), in the order of this package


def identified(recording: Recording, urdf: str, known: Known, factor: float) -> Answer:
    """Return the fit from a start whose mass and inertia are those of the URDF times a factor."""
    problem = _Problem.of(recording, urdf, known, factor)
    found, result = sysid.optimize(
        problem.parameters,
        problem.residual,
        optimizer='mujoco',
        verbose=False,
        check_conditioning=False,
        max_iters=_ITERATIONS,
    )
    residuals, _, _ = problem.residual(result.x, found)
    covariance, _ = sysid.calculate_intervals(residuals, np.asarray(result.jac))
    theta = result.x[:10]
    step = 1e-6 * np.maximum(np.abs(theta), 1e-3)
    slopes = [(problem.body(theta + move) - problem.body(theta - move)) for move in np.diag(step)]
    jacobian = np.stack(slopes, axis=1) / (2.0 * step)
    return Answer(problem.body(theta), jacobian @ covariance[:10, :10] @ jacobian.T)


@dataclass(frozen=True)
class _Problem:
    spec: mujoco.MjSpec
    target: str
    parameters: Any  # sysid.ParameterDict
    residual: Callable[..., Any]

    @staticmethod
    def of(recording: Recording, urdf: str, known: Known, factor: float) -> '_Problem':
        model, samples, target = recording.kernel.model, recording.samples, known.target_link
        spec = mujoco.MjSpec.from_string(urdf)
        spec.body(model.base_link).add_freejoint()
        spec.option.gravity, spec.option.timestep = np.zeros(3), _STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        body = spec.body(target)
        body.mass, body.inertia, body.fullinertia = factor * body.mass, factor * body.inertia, factor * body.fullinertia
        for name, kind in (('position', mujoco.mjtSensor.mjSENS_FRAMEPOS), ('turn', mujoco.mjtSensor.mjSENS_FRAMEQUAT)):
            spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_BODY, objname=model.base_link)
        path = _path(recording)
        _add_servos(spec, model.joint_names)
        compiled = spec.compile()
        first = _first(recording, compiled, path)
        quaternion = np.roll(quaternion_from_rotation(samples.base_rotation), 1, axis=1)
        poses = sysid.TimeSeries(
            samples.time,
            np.concatenate((samples.base_position, quaternion), axis=1),
            sysid.TimeSeries.compute_all_sensor_mapping(compiled),
        )
        control = sysid.TimeSeries(samples.time, _control(path, samples.time))
        parameters = sysid.ParameterDict()
        body_parameters = {'inertia_type': sysid.InertiaType.Pseudo, 'modifier': partial(_put_body, target)}
        parameters.add(sysid.body_inertia_param(spec, compiled, target, **body_parameters))
        parameters.add(sysid.Parameter(_BEGIN, np.zeros(12), np.full(12, -1e3), np.full(12, 1e3)))
        residual = sysid.build_residual_fn(
            models_sequences=[sysid.ModelSequences('robot', spec, 'run', first, control, poses)],
            modify_residual=partial(_whitened, samples, known.noise),
            custom_rollout=partial(_rollout, samples),
            n_threads=1,
            resample_true=False,
        )
        return _Problem(spec, target, parameters, residual)

    def body(self, theta: Array) -> Array:
        """Return (10,) physical parameters of the toolbox's own."""
        parameters = self.parameters.copy()
        parameters.update_from_vector(np.concatenate((theta, np.zeros(12))))
        spec = self.spec.copy()
        sysid.apply_param_modifiers_spec(parameters, spec)
        body = spec.body(self.target)
        return np.concatenate(([body.mass], body.ipos, np.array(body.fullinertia)[_ELEMENTS]))


def _put_body(target: str, spec: mujoco.MjSpec, parameter: Any) -> None:
    """Modify a body as the toolbox does, without the NaN that MuJoCo 3.17 does not compile."""
    sysid.apply_body_inertia(spec, target, parameter)
    spec.body(target).iquat = [1.0, 0.0, 0.0, 0.0]


def _path(recording: Recording) -> BSpline:
    """Return the joints' path as splines of the encoders' readings."""
    time = recording.samples.time
    inner = np.linspace(0.0, time[-1], max(round(float(time[-1]) / _KNOT), 1) + 1)
    knots = np.concatenate((np.full(_ORDER, inner[0]), inner, np.full(_ORDER, inner[-1])))
    return make_lsq_spline(time, recording.samples.joint_position, knots, _ORDER)


def _add_servos(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    """Add a servo of each joint, whose rotor is so heavy that the joint follows under any load.

    A rotor's inertia (armature) acts between the two links alone: the momentum of the robot has no part of it.
    """
    for name in joints:
        spec.joint(name).armature, spec.joint(name).actfrclimited = _ROTOR, mujoco.mjtLimited.mjLIMITED_FALSE
        actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = _ROTOR * _SERVO**2
        actuator.biasprm[:3] = 0.0, -_ROTOR * _SERVO**2, -2.0 * _ROTOR * _SERVO


def _control(path: BSpline, time: Array) -> Array:
    """Return the servos' set points (N, n), which lead by the servos' lag."""
    middle = np.minimum(time + 0.5 * _STEP, time[-1])  # one is held for a step
    return np.asarray(path(middle) + 2.0 / _SERVO * path(middle, 1) + path(middle, 2) / _SERVO**2)


def _first(recording: Recording, model: mujoco.MjModel, path: BSpline) -> Array:
    samples, joints = recording.samples, recording.kernel.model.joint_names
    position, velocity = np.zeros(model.nq), np.zeros(model.nv)
    rotation = samples.base_rotation[0]
    position[:3], position[3:7] = samples.base_position[0], np.roll(quaternion_from_rotation(rotation), 1)
    velocity[:3] = samples.base_linear_velocity[0]
    velocity[3:6] = rotate_back(rotation, samples.base_angular_velocity[0])
    position[[model.joint(name).qposadr[0] for name in joints]] = path(0.0)
    velocity[[model.joint(name).dofadr[0] for name in joints]] = path(0.0, 1)
    return np.asarray(sysid.create_initial_state(model, position, velocity))


def _rollout(samples: Samples, models: Any, initial_states: Any, param_dicts: Any, **given: Any) -> Any:
    """Return rollouts from the first state of the parameters: offsets in units of the sensors' noise."""
    size = np.sqrt(np.concatenate([np.diag(each[0]) for each in (samples.pose_covariance, samples.twist_covariance)]))
    states = []
    for state, parameters in zip(initial_states, param_dicts, strict=True):
        move, moved, speed = size * parameters[_BEGIN].value, state.copy(), 1 + models[0].nq
        moved[1:4] += move[:3]
        rotation = exp(move[3:6]) @ rotation_from_quaternion(np.roll(state[4:8], -1))
        moved[4:8] = np.roll(quaternion_from_rotation(rotation), 1)
        moved[speed : speed + 6] += move[6:]
        states.append(moved)
    return sysid.sysid_rollout(models=models, initial_states=states, **given)


def _whitened(
    samples: Samples, noise: SensorNoise, _p: Any, _predicted: Any, measured: Any, *_given: Any, state: Array
) -> Any:
    """Return the residuals of the poses over their noise."""
    rotation = rotation_from_quaternion(np.roll(state[:, 4:8], -1, axis=1))
    far = state[:, 1:4] - samples.base_position[1:]
    turn = log(rotation @ np.swapaxes(samples.base_rotation[1:], 1, 2))
    return np.concatenate((far / noise.base_position, turn / noise.base_orientation), axis=1), measured, measured
