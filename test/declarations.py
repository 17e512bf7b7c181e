"""Robots that are known exactly but for what parameters declare."""

from __future__ import annotations

from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.state import Declared
from mbaid_ros.parameters import build
from mbaid_ros.session.catalogue import declaration


def exact_but(robot: MomentumKernel, **parameters: object) -> Declared:
    """Return what parameters (with __ for the dot) declare of a robot that is exact otherwise."""
    given = {name.replace('__', '.'): value for name, value in parameters.items()}
    return declaration(build(EstimatorConfig, {**EXACT, **given}), robot)
