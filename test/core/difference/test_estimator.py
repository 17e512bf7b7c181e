"""The weighted difference form on exact data: every parameter and the momentum, whatever the momentum is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation.motion import random_sinusoids
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from observed import HIGH, LOW, MID, drifting, identify, kernel, true_body
from random_robots import random_urdf
from simulated import state


def errors(found: Array, true: Array) -> Array:
    return np.abs(found / true - 1.0)


def test_a_minute_of_exact_data_gives_every_parameter(spatial_minute: Truth) -> None:
    unknown = kernel('servicer7')
    estimates = identify(unknown, spatial_minute, MID)
    last = estimates[-1]
    assert last.status == 'converged'
    # The integrator conserves momentum to 1e-10 of its size.
    assert errors(last.parameters, true_body(unknown)).max() < 1e-8
    assert last.residual < 1e-4  # of what the noise would leave
    assert last.consistency_correction == 0.0
    assert last.momentum == pytest.approx(total_momentum(unknown.model, spatial_minute[:1])[0], abs=1e-7)


@pytest.mark.parametrize('speed', [0.01, 0.1])
def test_a_drift_of_the_whole_system_makes_no_difference(spatial: Truth, drift: Array, speed: float) -> None:
    unknown = kernel('servicer7')
    truth = drifting(spatial, speed * drift)
    last = identify(unknown, truth, MID)[-1]
    # After 20 s the worst parameter amplifies the integrator's errors a hundredfold.
    assert errors(last.parameters, true_body(unknown)).max() < 1e-7
    total = total_momentum(unknown.model, truth[:1])[0]
    assert np.linalg.norm(total[:3]) > 700.0 * speed
    assert last.momentum == pytest.approx(total, abs=1e-6)


def test_far_from_the_origin_of_the_odometry(spatial: Truth, drift: Array) -> None:
    """At 7000 km, coordinates are known to 1e-9 m at best: the body's numbers stay, and so do their deviations."""
    unknown = kernel('servicer7')
    near = identify(unknown, drifting(spatial, 0.1 * drift), MID)[-1]
    truth = drifting(spatial, 0.1 * drift, np.array([7.0e6, -1.0e6, 2.0e6]))
    far = identify(unknown, truth, MID)[-1]
    assert errors(far.parameters, true_body(unknown)).max() < 1e-5
    assert far.std == pytest.approx(near.std, rel=1e-4)
    total = total_momentum(unknown.model, truth[:1])[0]
    assert far.momentum == pytest.approx(total, rel=1e-8)


@pytest.mark.parametrize('noise', [LOW, MID, HIGH], ids=['low', 'mid', 'high'])
def test_the_papers_case_gives_what_a_plane_can_tell(planar: Truth, noise: SensorNoise) -> None:
    unknown = kernel('table1')
    last = identify(unknown, planar[::5], noise)[-1]
    expected = [0, 1, 2, 9]
    assert np.flatnonzero(last.identifiable).tolist() == expected
    if noise is HIGH:
        # Ten samples a second say so little that windows leave with noise taken off, of which these have none.
        assert np.all(np.abs(last.parameters - true_body(unknown))[expected] < last.std[expected])
    else:
        assert errors(last.parameters, true_body(unknown))[expected].max() < 1e-6
        assert last.momentum[5] == pytest.approx(4597.634, abs=1e-3)
    assert np.isnan(np.delete(last.parameters, expected)).all()
    assert last.warnings[0].startswith('planar motion')


def test_the_target_may_be_any_link(spatial: Truth) -> None:
    """Also one in the middle of the arm, and the base itself."""
    model = kernel('servicer7').model
    for name, count in (('link4', 4), ('base_link', 10)):
        unknown = MomentumKernel(model, name)
        last = identify(unknown, spatial, LOW)[-1]
        known = last.identifiable
        assert known.sum() >= count
        assert errors(last.parameters, true_body(unknown))[known].max() < 1e-6


@pytest.mark.parametrize('seed', range(3))
def test_random_trees_with_all_types_of_joints(seed: int) -> None:
    model = load_model(random_urdf(np.random.default_rng(seed), joints=4, chain=True))
    unknown = MomentumKernel(model, model.last_link)
    motion = random_sinusoids(np.zeros(model.joints), seed, 2, 0.8, 4.0, 12.0)
    start = state(motion.start, motion.reference(0.0)[1], (0.02, -0.05, 0.03), 0.1)
    truth = Simulation(model, motion, start, 0.02).advance(np.arange(200) * 0.05)
    last = identify(unknown, truth, LOW)[-1]
    assert last.identifiable.all()
    assert (np.abs(last.parameters - true_body(unknown)) < 1e-6 * last.std).all()


def test_the_unknowns_have_the_size_of_the_robot() -> None:
    scale = unknown_scale(kernel('servicer7'))
    true = np.concatenate((kernel('servicer7').target.parameters, np.zeros(6)))
    assert (scale > np.abs(true)).all()
    assert scale[0] == pytest.approx(640.0, rel=0.02)  # the known bodies
    # A robot of nothing but its target has a size still.
    bare = MomentumKernel(load_model('<robot name="r"><link name="base"/></robot>'), 'base')
    assert (unknown_scale(bare) > 0.0).all()


def test_a_robot_at_rest_tells_nothing(spatial: Truth) -> None:
    unknown = kernel('servicer7')
    still = replace(spatial[np.zeros(100, dtype=int)], time=np.arange(100) * 0.05)
    still = replace(
        still,
        joint_velocity=np.zeros_like(still.joint_velocity),
        base_linear_velocity=np.zeros((100, 3)),
        base_angular_velocity=np.zeros((100, 3)),
    )
    for seed in (None, 0):
        estimates = identify(unknown, still, MID, seed)
        assert {x.status for x in estimates} == {'not_identifiable'}
        assert all(np.isnan(x.parameters).all() for x in estimates)
        assert all(np.isfinite(x.momentum).all() for x in estimates)
