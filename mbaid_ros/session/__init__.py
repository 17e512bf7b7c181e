"""A run of the estimator, as both faces see it: messages go in, estimates and explanations come out."""

from mbaid_ros.session.environment import storage
from mbaid_ros.session.explanation import doubts, explain, intake_warnings, missing_joints, obstacles
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.model_summary import Survey, survey
from mbaid_ros.session.posterior import as_numbers, from_numbers
from mbaid_ros.session.session import Session
from mbaid_ros.session.uncertainty import with_surroundings

__all__ = [
    'Session',
    'Survey',
    'as_numbers',
    'doubts',
    'explain',
    'from_numbers',
    'intake_warnings',
    'make_estimator',
    'missing_joints',
    'obstacles',
    'storage',
    'survey',
    'with_surroundings',
]
