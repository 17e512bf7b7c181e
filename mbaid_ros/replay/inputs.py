"""Which topics of bags are read, and the arguments that say so."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mbaid_ros.core.errors import ParameterError

if TYPE_CHECKING:  # `--help` needs the defaults alone
    from mbaid_ros.bags import BagReader, Recorded
    from mbaid_ros.config.estimator import EstimatorConfig
    from mbaid_ros.session import Session

JOINT_STATE_TYPE = 'sensor_msgs/msg/JointState'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'
# What locates the base without a twist.
POSE_TYPES = (
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/PoseWithCovarianceStamped',
    'geometry_msgs/msg/TransformStamped',
    'tf2_msgs/msg/TFMessage',
)
IMU_TYPE = 'sensor_msgs/msg/Imu'
THRUST_TYPE = 'geometry_msgs/msg/WrenchStamped'
STORED_MOMENTUM_TYPE = 'geometry_msgs/msg/Vector3Stamped'
ODOMETRY, POSE, TF = '/odom', '/pose', '/tf'
# Read where a bag has it, even if not asked for.
THRUST = '/thrust'
STORED_MOMENTUM = '/stored_momentum'
IMU = '/imu'


@dataclass(frozen=True)
class Inputs:
    """The topics to read.

    Attributes
    ----------
    joint_states : of type sensor_msgs/JointState
    odometry : what locates the base: of type nav_msgs/Odometry, or one of POSE_TYPES; empty is /odom or else /pose
    thrust : of type geometry_msgs/WrenchStamped; empty is /thrust, where there is one
    stored_momentum : of type geometry_msgs/Vector3Stamped; empty is /stored_momentum, where there is one
    imu : of type sensor_msgs/Imu; empty is /imu, where there is one
    located : whether anything locates the base; else an IMU has to be there
    """

    joint_states: str = '/joint_states'
    odometry: str = ''
    thrust: str = ''
    stored_momentum: str = ''
    imu: str = ''
    located: bool = True

    @staticmethod
    def of(arguments: argparse.Namespace, config: EstimatorConfig) -> Inputs:
        """Return what the arguments of `add_input_arguments` say.

        Parameters
        ----------
        arguments : parsed
        config : what the parameters say of what locates the base

        Raises
        ------
        ParameterError
            Two topics are said to locate the base.
        """
        if arguments.odom and arguments.pose:
            raise ParameterError(
                f'--odom {arguments.odom} and --pose {arguments.pose} are given; accepted: one of them'
            )
        base = arguments.odom or arguments.pose or (TF if config.pose.tf_child_frame else '')
        others = arguments.thrust, arguments.stored_momentum, arguments.imu
        return Inputs(arguments.joint_states, base, *others, located=not config.imu.alone)

    def found(self, bag: BagReader) -> Inputs:
        """Return the same with the topic of a bag that locates the base."""
        if self.odometry or not self.located:
            return self
        of_poses = POSE in bag.topics and bag.topics[POSE].type in POSE_TYPES
        return replace(self, odometry=POSE if of_poses and ODOMETRY not in bag.topics else ODOMETRY)

    def topics(self, bag: BagReader) -> tuple[str, ...]:
        """Return what of a bag is to be read, joint states and what locates the base first.

        Raises
        ------
        DataError
            The bag lacks a topic, or has it with another type.
        """
        bag.require(self.joint_states, JOINT_STATE_TYPE)
        found = [self.joint_states]
        if self.located:
            found.append(self.found(bag).odometry)
            bag.require(found[-1], ODOMETRY_TYPE, *POSE_TYPES)
        else:
            bag.require(self.imu or IMU, IMU_TYPE)
        for wanted, usual, kind in (
            (self.thrust, THRUST, THRUST_TYPE),
            (self.stored_momentum, STORED_MOMENTUM, STORED_MOMENTUM_TYPE),
            (self.imu, IMU, IMU_TYPE),
        ):
            if wanted:
                bag.require(wanted, kind)
            if wanted or (usual in bag.topics and bag.topics[usual].type == kind):
                found.append(wanted or usual)
        return tuple(found)

    def add_to(self, session: Session, messages: Recorded) -> None:
        """Hand messages of the topics to a session."""
        thrust, stored, imu = self.thrust or THRUST, self.stored_momentum or STORED_MOMENTUM, self.imu or IMU
        takes = {
            self.joint_states: session.add_joint_state,
            self.odometry: session.add_odometry,
            stored: session.add_stored_momentum,
            imu: session.add_imu,
        }
        for part in messages.runs(thrust):
            if thrust in part.messages:
                for message in part.of(thrust):
                    session.add_thrust(message)
            elif session.add_at_once(part.of(self.joint_states), part.of(self.odometry), part.of(imu)):
                for message in part.of(stored):
                    session.add_stored_momentum(message)
            else:
                for topic, message, _ in part:
                    takes[topic](message)


def add_input_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name bags and the topics to read."""
    add = parser.add_argument
    add('bags', nargs='+', metavar='BAG', help='rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file')
    add_topic_arguments(parser)


def add_topic_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name the topics to read."""
    add = parser.add_argument
    add('--joint-states', default=Inputs.joint_states, metavar='TOPIC', help='default: %(default)s')
    add('--odom', default='', metavar='TOPIC', help='Odometry that locates the base (default: /odom)')
    add(
        '--pose',
        default='',
        metavar='TOPIC',
        help='poses that do so: PoseStamped, PoseWithCovarianceStamped, TransformStamped, or TFMessage with '
        'pose.tf_child_frame (default: /pose, if there is no /odom)',
    )
    add(
        '--stored-momentum',
        default='',
        metavar='TOPIC',
        help='momentum of wheels or gyros, Vector3Stamped (default: /stored_momentum, if recorded)',
    )
    add('--imu', default='', metavar='TOPIC', help='Imu, used with imu.noise_density (default: /imu, if recorded)')
    add('--thrust', default='', metavar='TOPIC', help='commanded thrust, WrenchStamped (default: /thrust, if recorded)')
