"""A run of the estimator, as both faces see it: messages go in, estimates and explanations come out."""

from mbaid_ros.session.explanation import explain, intake_warnings, missing_joints, obstacles
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.session import Session
from mbaid_ros.session.surroundings import spin_deviations, storage, uncertain_thrusters

__all__ = [
    'Session',
    'explain',
    'intake_warnings',
    'make_estimator',
    'missing_joints',
    'obstacles',
    'spin_deviations',
    'storage',
    'uncertain_thrusters',
]
