"""Which topics of bags are read, and the arguments that say so."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # `--help` needs the defaults alone
    from mbaid_ros.bags import BagReader, Recorded
    from mbaid_ros.session import Session

JOINT_STATE_TYPE = 'sensor_msgs/msg/JointState'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'
THRUST_TYPE = 'geometry_msgs/msg/WrenchStamped'
STORED_MOMENTUM_TYPE = 'geometry_msgs/msg/Vector3Stamped'
# Read where a bag has it, even if not asked for.
THRUST = '/thrust'
STORED_MOMENTUM = '/stored_momentum'


@dataclass(frozen=True)
class Inputs:
    """The topics to read.

    Attributes
    ----------
    joint_states : of type sensor_msgs/JointState
    odometry : of type nav_msgs/Odometry
    thrust : of type geometry_msgs/WrenchStamped; empty is /thrust, where there is one
    stored_momentum : of type geometry_msgs/Vector3Stamped; empty is /stored_momentum, where there is one
    """

    joint_states: str = '/joint_states'
    odometry: str = '/odom'
    thrust: str = ''
    stored_momentum: str = ''

    @staticmethod
    def of(arguments: argparse.Namespace) -> Inputs:
        """Return what the arguments of `add_input_arguments` say."""
        return Inputs(arguments.joint_states, arguments.odom, arguments.thrust, arguments.stored_momentum)

    def topics(self, bag: BagReader) -> tuple[str, ...]:
        """Return what of a bag is to be read, joint states and odometry first.

        Raises
        ------
        DataError
            The bag lacks a topic, or has it with another type.
        """
        bag.require(self.joint_states, JOINT_STATE_TYPE)
        bag.require(self.odometry, ODOMETRY_TYPE)
        others = []
        for wanted, usual, kind in (
            (self.thrust, THRUST, THRUST_TYPE),
            (self.stored_momentum, STORED_MOMENTUM, STORED_MOMENTUM_TYPE),
        ):
            if wanted:
                bag.require(wanted, kind)
            if wanted or (usual in bag.topics and bag.topics[usual].type == kind):
                others.append(wanted or usual)
        return self.joint_states, self.odometry, *others

    def add_to(self, session: Session, messages: Recorded) -> None:
        """Hand messages of the topics to a session."""
        thrust, stored = self.thrust or THRUST, self.stored_momentum or STORED_MOMENTUM
        takes = {
            self.joint_states: session.add_joint_state,
            self.odometry: session.add_odometry,
            stored: session.add_stored_momentum,
        }
        for part in messages.runs(thrust):
            if thrust in part.messages:
                for message in part.of(thrust):
                    session.add_thrust(message)
            elif session.add_at_once(part.of(self.joint_states), part.of(self.odometry)):
                for message in part.of(stored):
                    session.add_stored_momentum(message)
            else:
                for topic, message, _ in part:
                    takes[topic](message)


def add_input_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name bags and the topics to read."""
    add = parser.add_argument
    add('bags', nargs='+', metavar='BAG', help='rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file')
    add('--joint-states', default=Inputs.joint_states, metavar='TOPIC', help='default: %(default)s')
    add('--odom', default=Inputs.odometry, metavar='TOPIC', help='default: %(default)s')
    add(
        '--stored-momentum',
        default='',
        metavar='TOPIC',
        help='momentum of wheels or gyros, Vector3Stamped (default: /stored_momentum, if recorded)',
    )
    add('--thrust', default='', metavar='TOPIC', help='commanded thrust, WrenchStamped (default: /thrust, if recorded)')
