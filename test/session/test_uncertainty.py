"""How uncertain the known side is, as the parameters declare it."""

from __future__ import annotations

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.unknowns.bodies import TargetPrior
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.session.settings import declared_uncertainty
from simulated import robot


def declared(**parameters: object) -> Uncertainty:
    """Return what parameters (with __ for the dot) say of the paper's robot of four joints."""
    given = {name.replace('__', '.'): value for name, value in parameters.items()}
    return declared_uncertainty(build(EstimatorConfig, {**EXACT, **given}), robot('table1'))


def test_a_joint_may_have_standard_deviations_of_its_own() -> None:
    first, *_ = names = robot('table1').joint_names
    found = declared(
        known_joints__zero_std=1e-3,
        known_joints__axis_std=2e-3,
        **{f'known_joints.{first}.zero_std': 5e-3},
    )
    assert found.zeros == (5e-3, 1e-3, 1e-3, 1e-3)
    assert found.axes == (2e-3,) * len(names)
    assert found.origins == (0.0,) * len(names)


def test_a_joint_may_wander_more_than_the_others() -> None:
    first, *_ = robot('table1').joint_names
    found = declared(known_joints__tracking_std=0.01, **{f'known_joints.{first}.tracking_std': 0.03})
    assert found.tracking == (0.03, 0.01, 0.01, 0.01)
    assert declared().tracking == (0.0,) * 4


def test_mount_and_time_and_target() -> None:
    found = declared(
        odometry_mount__position_std=2e-3,
        odometry_mount__orientation_std=1e-3,
        time_offset__estimate=False,
        target_prior__mass=160.0,
        target_prior__mass_std=2.0,
        target_prior__com=[0.1, 0.2, 0.3],
        target_prior__com_std=0.004,
    )
    assert (found.mount_position, found.mount_orientation, found.time_offset) == (2e-3, 1e-3, 0.0)
    assert found.target == TargetPrior(160.0, 2.0, (0.1, 0.2, 0.3), 0.004)


@pytest.mark.parametrize(
    ('parameters', 'named'),
    [
        ({'known_joints.elbow.zero_std': 1e-3}, "'known_joints.elbow' is of no joint"),
        ({'target_prior__mass_std': 2.0}, "without 'target_prior.mass'"),
        ({'target_prior__mass': 150.0}, "'target_prior.mass' is 150 kg without 'target_prior.mass_std'"),
        ({'target_prior__com': [0.0, 0.0, 0.1]}, "is [0.0, 0.0, 0.1] m without 'target_prior.com_std'"),
        ({'target_prior__com_std': 0.01, 'target_prior__com': [0.0, 0.0, 0.1]}, "without 'target_prior.mass_std'"),
        (
            {'target_prior__com_std': 0.01, 'target_prior__mass_std': 1.0, 'target_prior__mass': 9.0},
            "without 'target_prior.com'",
        ),
    ],
)
def test_half_of_what_is_declared_is_an_error(parameters: dict[str, object], named: str) -> None:
    with pytest.raises(ParameterError, match='accepted') as caught:
        declared(**parameters)
    assert named in str(caught.value)
    assert '\n' not in str(caught.value)
