"""The true cause of each condition in which one thing is wrong by more than is declared, as a regular expression."""

from __future__ import annotations

import re
from collections.abc import Sequence

_NOISE = r'noise\.(joint|base)|noise of the odometry'
_FORCE = r'\bforce\b|thrust'
_UNREAD = r'nobody reads'
_FLEXIBLE = r'joint4 is flexible'

TRUE_CAUSES = {
    "a link's mass 50 % off": r'link3\b',
    "the base's CoM 100 mm off": r'base_link\b',
    "a joint's zero 30 mrad off": r'zero of joint4\b',
    'a joint 30 mm off': r'origin of joint4\b',
    "a joint's axis 30 mrad off": r'axis of joint4\b',
    'odometry mounted 30 mm off': r'\bmount\b',
    'odometry mounted 30 mrad off': r'\bmount\b',
    'a gear 30 mrad off with the angle': _FLEXIBLE,
    "a joint's sign flipped": r'sign of joint3\b',
    'two joints swapped': r'joint3 and joint5\b',
    'an arm is missing': _UNREAD,
    "a link's mass in grams": r'link3\b',
    "the arm's masses in grams": r'link[1-6]\b',
    'the wrong target link': r'link7\b',
    'the base a third too light': r'base_link\b',
    "two links' inertials exchanged": r'link[25]\b',
    "a joint's axis reversed": r'sign of joint3\b',
    'odometry noise correlated over 0.3 s': r'correlated',
    'odometry noise correlated over 3 s': r'correlated|drift',
    '1 % outliers': r'outlier',
    '5 % outliers': r'outlier',
    'gyro bias of 10 deg/h': r'bias|base_angular_velocity',
    'the last pose repeated, one in five new': r'repeat',
    'clocks 100 ppm apart': r'clock',
    'twist 50 ms late': r'twist',
    'joints 200 ms late': r'late|time offset',
    'all noise declared 3 x too small': _NOISE,
    'all noise declared 10 x too small': _NOISE,
    'noise of the odometry declared 3 x too small': r'noise\.base|noise of the odometry',
    'noise of the joints declared 10 x too small': r'noise\.joint',
    'odometry 1 % too long': r'odometry.*(scale|too long)',
    'odometry wanders by 1 mm / sqrt(s)': r'odometry.*drift',
    'a joint read 1 % too large': r'joint3\b',
    'a joint read 3 % too large': r'joint3\b',
    'twist in the axes of the odometry frame': r'twist_frame',
    'twist in degrees a second': r'degrees a second',
    'twist of a point 0.3 m away': r'twist.* point',
    'twist in axes turned by 90 degrees': r'axes of the twist',
    'a twist of zeros': r'twist.* zero',
    'joints in degrees': r'in degrees:',
    'a prismatic joint in millimetres': r'prismatic joints are in millimetres',
    'positions in millimetres': r'position of the odometry is in millimetres',
    'orientation turned round': r'inverse',
    'quaternions with w first': r'w first',
    'odometry stamped up to 5 ms early or late': r'noise\.base|stamp',
    'an encoder that slips by 10 mrad': r'the reading of joint2 jumps',
    "a joint's reading frozen for 15 s": r'the reading of joint2\b',
    'a constant force of 10 mN, 10 mN m': _FORCE,
    'a slow sinusoidal force of 10 mN, 10 mN m': rf'{_FORCE}|momentum drifts',
    'a thrust pulse of 1 N s, 0.5 N m s': r'thrust',
    'a pulse of 0.1 N s every 4 s': rf'{_FORCE}|momentum drifts',
    'the body slips in the grasp by 5 deg': r'grasp',
    'the body slips in the grasp by 30 deg': r'grasp',
    'the hand loses the body': r'another body|lost',
    'wheels that nobody reads spin up': _UNREAD,
    'a flexible panel of 0.3 Hz': r'\bHz\b',
    'fuel that sloshes at 0.1 Hz': r'\bHz\b|fuel',
    'a flexible joint of 2 Hz': _FLEXIBLE,
    'a flexible joint of 1 Hz': _FLEXIBLE,
    'odometry in an orbit-fixed frame': 'orbit-fixed frame',
}


def rank(condition: str, causes: Sequence[str]) -> int:
    """Return at which place the true cause of a condition is named, from 1 on; 0 where it is not."""
    truth = re.compile(TRUE_CAUSES[condition])
    return next((place for place, cause in enumerate(causes, start=1) if truth.search(cause)), 0)
