"""From parameters and the posterior of a run to the planner of the next motion."""

from __future__ import annotations

import numpy as np

from mbaid_ros.config.estimator_parameters import EstimatorConfig, PlanConfig
from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import ParameterError
from mbaid_ros.planning.planner import Planner, PlanSettings
from mbaid_ros.planning.requirements import BaseLimits
from mbaid_ros.session.methods import make_reporting
from mbaid_ros.session.robot import mesh_points
from mbaid_ros.session.session import UNSOLVABLE


def make_planner(config: EstimatorConfig, posterior: Posterior) -> Planner:
    """Return the planner that the parameters describe.

    Raises ParameterError: The parameters contradict each other or the robot.
    """
    return Planner(posterior, make_reporting(config, posterior.layout.kernel), plan_settings(config), mesh_points)


def advice(config: EstimatorConfig, posterior: Posterior) -> str:
    """Return which joint, moved by itself, would reduce the largest standard deviation most, in words.

    Empty if everything is as precise as wanted, or no motion can be planned (joints without limits).
    """
    try:
        return make_planner(config, posterior).advice()
    except (ParameterError, *UNSOLVABLE):
        return ''


def plan_settings(config: EstimatorConfig) -> PlanSettings:
    """Return the settings of a planned motion.

    Raises ParameterError: A wanted precision is not positive.
    """
    plan = config.plan
    limits = plan.base_rotation, plan.base_translation, plan.base_rate, plan.deflection
    return PlanSettings(
        relative=_wanted(plan, config.convergence.relative_std),
        duration=plan.duration,
        joint_velocity=plan.joint_velocity or np.inf,
        joint_acceleration=plan.joint_acceleration,
        base=BaseLimits(*(each or np.inf for each in limits)),
        clearance=plan.clearance,
        stuck=plan.stuck,
        held=plan.held,
        effort=plan.effort,
        window=config.window,
    )


def _wanted(plan: PlanConfig, convergence: float) -> Array:
    given = np.array(plan.relative_std or (convergence,), dtype=float)
    if not np.all(given > 0.0):
        raise ParameterError(
            f"parameter 'plan.relative_std' is {list(plan.relative_std)}; accepted: numbers > 0, one or ten"
        )
    return np.broadcast_to(given, 10)
