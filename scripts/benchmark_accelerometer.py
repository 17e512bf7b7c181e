"""What an accelerometer could add at most to what poses or a gyro tell of the ten parameters.

    python scripts/benchmark_accelerometer.py

In free fall it feels the acceleration of its place alone, which conservation predicts. Its information about the body
is added to what a run knows: with the momentum known, its axes and place exact, its bias constant, and no other force.
A real one adds less. Printed is by how much the standard deviations would shrink.
"""

from __future__ import annotations

import numpy as np

from benchmark_imu import ALONE, CONDITIONS, CONFIG, GYRO, run_of
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.geometry import Array, cross, rotate, rotation_from_quaternion
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import physical_jacobian
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulation.simulation import total_momentum

PLACE = np.array([0.3, 0.2, -0.3])  # m, on the base
STEP = 0.05  # s, over which velocity changes are added up
# Density of the noise, m/s^2/sqrt(Hz), and standard deviation of the bias, m/s^2.
GRADES = {'MEMS, 100 µg/√Hz, 2 mg': (1e-3, 2e-2), '10 µg/√Hz, 0.1 mg': (1e-4, 1e-3), '1 µg/√Hz, 0.01 mg': (1e-5, 1e-4)}
RUNS = (('ets7', 20.0), ('servicer7', 40.0))
WITH = ('pose and twist, 100 Hz', 'pose, 10 Hz, and gyro', 'gyro alone', 'orientation of 1 mrad and gyro')


def information(name: str, duration: float, density: float, bias: float) -> Array:
    """Return the (10, 10) information about mass, centre of mass and inertia of the target of a robot's run."""
    values = load_parameter_file(CONFIG / f'{name}_simulator.yaml', 'simulator')
    model = load_model((CONFIG / f'{name}.urdf').read_text(encoding='utf-8'))
    kernel = MomentumKernel(model, model.last_link)
    truth = make_simulation(build(SimulatorConfig, values), model).advance(np.arange(0.0, duration, STEP))
    rotation, total = rotation_from_quaternion(truth.base_orientation), total_momentum(model, truth)
    total[:, 3:] -= cross(truth.base_position, total[:, :3])
    placed = kernel.kinematics.configure(rotation, truth.joint_position)
    joints = kernel.kinematics.body_twists(placed, truth.joint_velocity, np.zeros((len(rotation), 6)))

    def velocity(parameters: Array) -> Array:
        mobility, moving = mobility_and_momentum(kernel.with_target(parameters), placed, joints)
        twist = (mobility @ (total - moving)[..., None])[..., 0]
        return np.asarray(twist[:, :3] + cross(twist[:, 3:], rotation @ PLACE))

    target = kernel.target.parameters
    place = np.broadcast_to(PLACE, (len(rotation), 3))
    measured = truth.base_linear_velocity + cross(truth.base_angular_velocity, place)
    assert np.allclose(velocity(target), rotate(rotation, measured), atol=1e-9), 'conservation predicts what is true'
    small = np.diag(1e-4 * unknown_scale(kernel)[:10])
    slopes = [(velocity(target + each) - velocity(target - each)) / (2.0 * each.sum()) for each in small]
    changes = np.diff(np.stack(slopes, axis=-1), axis=0)
    drifts = 0.5 * STEP * (rotation[1:] + rotation[:-1])
    rows = np.concatenate((changes, drifts), axis=2).reshape(-1, 13) / (density * np.sqrt(STEP))
    whole_of = rows.T @ rows
    whole_of[10:, 10:] += np.eye(3) / bias**2
    about = whole_of[:10, :10] - whole_of[:10, 10:] @ np.linalg.solve(whole_of[10:, 10:], whole_of[10:, :10])
    back = np.linalg.inv(physical_jacobian(target))
    return np.asarray(back.T @ about @ back)


def main() -> None:
    """Print a table."""
    CONDITIONS['gyro alone'] = (GYRO, ALONE, False)
    oriented = {**GYRO, 'imu.orientation_noise': 1e-3}, {**ALONE, 'imu.orientation': True}, False
    CONDITIONS['orientation of 1 mrad and gyro'] = oriented
    print(f'| robot, sensors | {" | ".join(GRADES)} |')
    print('|---|' + '---|' * len(GRADES))
    for name, short in RUNS:
        for condition in WITH:
            duration = 60.0 if 'pose' in condition else short
            estimate = run_of(name, duration, 0, condition)[0]
            known = estimate.identifiable
            covariance = estimate.covariance[np.ix_(known, known)]
            cells = []
            for grade in GRADES.values():
                more = information(name, duration, *grade)[np.ix_(known, known)]
                after = np.linalg.inv(np.linalg.inv(covariance) + more)
                ratio = np.sqrt(np.diag(after) / np.diag(covariance))
                cells.append(f'mass {ratio[0]:.2f}, median {np.median(ratio):.2f}')
            print(f'| {name}, {duration:g} s, {condition} | {" | ".join(cells)} |', flush=True)


if __name__ == '__main__':
    main()
