"""Print the sensors' noise, from a bag recorded with the joints braked and the base drifting freely.

It is the standard deviation of each channel about a cubic in time, of the noisiest axis or joint.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mbaid_ros.bags import BagReader
from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.core.errors import DataError, listing
from mbaid_ros.core.geometry import Array

NAME = 'noise_at_rest'
FEWEST = 50  # messages
DEGREE = 3


def channels(bag: str, joint_states: str, odom: str) -> dict[str, Array]:
    """Return what was measured, (n, k) each; orientations as rotation vectors from the first one.

    Raises
    ------
    DataError
        The bag cannot be read, or lacks a topic or enough of its messages.
    """
    with BagReader(bag) as recording:
        for topic in (joint_states, odom):
            if topic not in recording.topics:
                raise DataError(f"bag '{bag}' has no topic '{topic}'; topics: {listing(recording.topics)}")
            if recording.topics[topic].count < FEWEST:
                raise DataError(f"bag '{bag}' has fewer than {FEWEST} messages of '{topic}'")
        joints = [message for _, message, _ in recording.read([joint_states])]
        bases = [message for _, message, _ in recording.read([odom])]
    poses, twists = [base.pose.pose for base in bases], [base.twist.twist for base in bases]
    turns = Rotation.from_quat([[getattr(pose.orientation, axis) for axis in 'xyzw'] for pose in poses])
    return {
        'joint_position': np.array([joint.position for joint in joints]),
        'joint_velocity': np.array([joint.velocity for joint in joints]),
        'base_position': _vectors([pose.position for pose in poses]),
        'base_orientation': (turns[0].inv() * turns).as_rotvec(),
        'base_linear_velocity': _vectors([twist.linear for twist in twists]),
        'base_angular_velocity': _vectors([twist.angular for twist in twists]),
    }


def scatter(values: Array) -> float:
    """Return the standard deviation about a cubic of the noisiest column of (n, k); NaN where nothing was measured."""
    if values.size == 0:
        return float('nan')
    curve = np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, len(values)), DEGREE)
    rest = values - curve @ np.linalg.lstsq(curve, values, rcond=None)[0]
    return float(np.max(np.std(rest, axis=0, ddof=DEGREE + 1)))


def _vectors(vectors: Sequence[object]) -> Array:
    return np.array([[getattr(vector, axis) for axis in 'xyz'] for vector in vectors])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program: 0 if it printed, 2 after a user's error."""
    return run(_main, argv, name=NAME)


def _main(argv: list[str]) -> int:
    parser = ArgumentParser(f'{NAME}.py', (__doc__ or '').strip(), f'{NAME}.py rest_run')
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder, or a bare .mcap or .db3 file')
    parser.add_argument('--joint-states', default='/joint_states', metavar='TOPIC', help='default: /joint_states')
    parser.add_argument('--odom', default='/odom', metavar='TOPIC', help='default: /odom')
    arguments = parser.parse(argv)
    try:
        stds = {
            name: scatter(values)
            for name, values in channels(arguments.bag, arguments.joint_states, arguments.odom).items()
        }
    except ValueError as error:  # messages of unequal lengths, no rotation
        raise DataError(f"bag '{arguments.bag}' cannot be used: {error}") from error
    print('    noise:')
    for name, std in stds.items():
        print(f'      {name}: {std:.1e}' if np.isfinite(std) else f'      # {name}: not measured')
    return 0


if __name__ == '__main__':
    sys.exit(main())
