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
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.messages import numbers_of

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
        for topic, kind in ((joint_states, 'sensor_msgs/msg/JointState'), (odom, 'nav_msgs/msg/Odometry')):
            recording.require(topic, kind)
            if recording.topics[topic].count < FEWEST:
                raise DataError(f"bag '{bag}' has fewer than {FEWEST} messages of '{topic}'")
        joints = [message for _, message, _ in recording.read([joint_states])]
        bases = np.array([numbers_of(message) for _, message, _ in recording.read([odom])])
    position, orientation, linear, angular = np.split(bases, [3, 7, 10], axis=1)
    turns = Rotation.from_quat(orientation)
    return {
        'joint_position': np.array([joint.position for joint in joints]),
        'joint_velocity': np.array([joint.velocity for joint in joints]),
        'base_position': position,
        'base_orientation': (turns[0].inv() * turns).as_rotvec(),
        'base_linear_velocity': linear,
        'base_angular_velocity': angular,
    }


def scatter(values: Array) -> float:
    """Return the standard deviation about a cubic of the noisiest column of (n, k); NaN where nothing was measured."""
    if values.size == 0:
        return float('nan')
    curve = np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, len(values)), DEGREE)
    rest = values - curve @ np.linalg.lstsq(curve, values, rcond=None)[0]
    return float(np.max(np.std(rest, axis=0, ddof=DEGREE + 1)))


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
