"""A run of the estimator, for both faces: messages go in, estimates and explanations come out."""

from mbaid_ros.session.explanation import doubts, explain, intake_warnings, missing_joints, obstacles
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.model_summary import ModelSummary, summarise
from mbaid_ros.session.posterior import as_numbers, from_numbers
from mbaid_ros.session.session import Session
from mbaid_ros.session.settings import springs, storage, with_surroundings

__all__ = [
    'ModelSummary',
    'Session',
    'as_numbers',
    'doubts',
    'explain',
    'from_numbers',
    'intake_warnings',
    'make_estimator',
    'missing_joints',
    'obstacles',
    'springs',
    'storage',
    'summarise',
    'with_surroundings',
]
