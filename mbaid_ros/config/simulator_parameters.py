"""The parameters of the simulator, for the node and for `simulate` alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mbaid_ros.core.orbit import SimulatedOrbitConfig
from mbaid_ros.core.passive import FlexibleConfig
from mbaid_ros.core.poses import MEASURES
from mbaid_ros.core.wheels import WheelBodies
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import by_name, named_groups, parameter


@dataclass(frozen=True)
class SimulatedWheelsConfig(WheelBodies):
    """Wheels inside the base of the simulated robot that are no joints of its description."""

    speeds: tuple[float, ...] = parameter((), 'rad/s')
    """Speed of each wheel relative to the base at time 0; empty means zero."""
    accelerations: tuple[float, ...] = parameter((), 'rad/s^2')
    """Constant acceleration of each wheel; empty means zero."""
    speed_noise: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Noise of the speeds that are read."""
    publish: str = parameter('joint_states', choices=('joint_states', 'stored_momentum', 'none'))
    """Publication of the wheels: as velocities in joint_states (positions are 0), as their momentum on stored_momentum
    with every JointState, or none."""


MOTIONS = ('passive', 'sinusoids', 'random', 'trajectory')


@dataclass(frozen=True)
class InitialConfig:
    """The state at time 0."""

    joint_positions: tuple[float, ...] = parameter((), 'rad')
    """Joint positions in the order of the URDF (m for a prismatic joint), without those that mimic; empty: zero."""
    joint_velocities: tuple[float, ...] = parameter((), 'rad/s')
    """Joint velocities in the order of the URDF (m/s for a prismatic joint), for passive motion; empty means zero."""
    base_position: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'm', lengths=(3,))
    """Position of the base link in the odometry frame."""
    base_orientation: tuple[float, ...] = parameter((0.0, 0.0, 0.0, 1.0), lengths=(4,))
    """Orientation of the base link in the odometry frame, a quaternion x, y, z, w."""
    base_linear_velocity: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'm/s', lengths=(3,))
    """Velocity of the base link's origin, in odometry axes."""
    base_angular_velocity: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'rad/s', lengths=(3,))
    """Angular velocity of the base link, in odometry axes."""
    zero_linear_momentum: bool = parameter(default=False)
    """Choose the linear velocity of the base so that the total linear momentum is zero; base_linear_velocity must then
    be zero."""


@dataclass(frozen=True)
class MotionConfig:
    """The motion of the joints."""

    kind: str = parameter('passive', choices=MOTIONS)
    """Motion of the joints: passive (no torque; random for a robot with joints that mimic others), sinusoids (those
    given), random (drawn ones) or trajectory (a file)."""
    amplitudes: tuple[float, ...] = parameter((), 'rad')
    """Sinusoids: amplitudes, the same number for each joint: q(t) = q(0) + sum of a (sin(2 pi f t + p) - sin p)."""
    frequencies: tuple[float, ...] = parameter((), 'Hz')
    """Sinusoids: frequencies, one for each amplitude."""
    phases: tuple[float, ...] = parameter((), 'rad')
    """Sinusoids: phases, one for each amplitude; empty means zero."""
    within_limits: bool = parameter(default=True)
    """Random: reduce the motion so that joints stay within the position and velocity limits of the URDF; if
    initial.joint_positions is empty, the start fits them too."""
    seed: int = parameter(0, minimum=0)
    """Random: the same seed gives the same motion."""
    terms: int = parameter(2, minimum=1, maximum=100)
    """Random: sinusoids for each joint."""
    amplitude: float = parameter(0.5, 'rad', minimum=0.0)
    """Random: largest excursion of a joint from the middle of its motion."""
    period_min: float = parameter(10.0, 's', minimum=0.0, exclusive_minimum=True)
    """Random: shortest period."""
    period_max: float = parameter(40.0, 's', minimum=0.0, exclusive_minimum=True)
    """Random: longest period."""
    trajectory_file: str = parameter('')
    """Trajectory: a trajectory_msgs/JointTrajectory in YAML, as plan --yaml writes it. Where initial.joint_positions is
    empty, the joints begin at its first point."""
    trajectory_begin: float = parameter(0.0, 's', minimum=0.0)
    """Trajectory: when the joints begin to follow it."""


@dataclass(frozen=True)
class SimulatedThrustConfig:
    """A pulse of thrust, and whether it is published."""

    time: float = parameter(0.0, 's', minimum=0.0)
    """Start of a pulse of thrust."""
    duration: float = parameter(0.0, 's', minimum=0.0)
    """Length of the pulse; 0 means no thrust."""
    link: str = parameter('')
    """Link that the thrust acts on, at the origin and in the axes of its frame; empty means the base link. With the
    name of the odometry frame it acts on the base and is constant in that frame."""
    force: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'N', lengths=(3,))
    """Commanded force."""
    torque: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'N m', lengths=(3,))
    """Commanded torque."""
    scale: float = parameter(1.0, minimum=0.0, exclusive_minimum=True)
    """Relative excess of force and torque over the command."""
    turn: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'rad', lengths=(3,))
    """Rotation of the true thrust relative to the command, a rotation vector."""
    delay: float = parameter(0.0, 's', minimum=0.0, maximum=1.0)
    """Delay of the thrust's start and end after the command."""
    publish: bool = parameter(default=True)
    """Publish the commanded wrench on thrust, ten times a second while it acts."""


@dataclass(frozen=True)
class SimulatedCaptureConfig:
    """A body that tumbles freely until the target link captures it."""

    time: float = parameter(0.0, 's', minimum=0.0)
    """Time of the capture, for a robot whose joints are driven; 0 means that there is none."""
    mass: float = parameter(0.0, 'kg', minimum=0.0)
    """Mass of the captured body."""
    com: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'm', lengths=(3,))
    """Centre of mass of the captured body in the target link's frame."""
    inertia: tuple[float, ...] = parameter((), 'kg m^2', lengths=(0, 6))
    """Inertia of the captured body about its centre of mass in the target link's axes: ixx, ixy, ixz, iyy, iyz, izz."""
    linear_velocity: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'm/s', lengths=(3,))
    """Velocity of the captured body's centre of mass just before the capture, in odometry axes."""
    angular_velocity: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'rad/s', lengths=(3,))
    """Angular velocity of the captured body just before the capture, in odometry axes."""
    settling: float = parameter(0.0, 's', minimum=0.0)
    """Time in which the captured body slips in the grasp, until it is where capture.com has it; 0: held at once."""


@dataclass(frozen=True)
class SimulatedTargetPoseConfig:
    """Poses of a frame on the captured body before its capture, as a camera tracks it."""

    rate: float = parameter(0.0, 'Hz', minimum=0.0, maximum=1e4)
    """Poses a second on target_pose, until the capture or target_pose.after it; 0 is none."""
    position: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'm', lengths=(3,))
    """Origin of the tracked frame in the target link's frame once grasped; its axes are those of the link then."""
    position_noise: float = parameter(0.0, 'm', minimum=0.0)
    """Noise of each coordinate of a pose."""
    orientation_noise: float = parameter(0.0, 'rad', minimum=0.0)
    """Noise of the orientation about each axis."""
    delay: float = parameter(0.0, 's', minimum=0.0)
    """Time from the measurement, which the stamp has, to the message."""
    missing: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Part of the poses that are missing, drawn by seed."""
    after: float = parameter(0.0, 's', minimum=0.0)
    """Time after the capture for which poses go on."""


@dataclass(frozen=True)
class SimulatedModelErrorsConfig:
    """Standard deviations of the deviations of the simulated robot from its URDF; 0: exact."""

    links_relative_std: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Relative standard deviation of the inertial parameters of every body but the target link, as the estimator's
    known_links.relative_std has it."""
    zero_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Error of each joint's zero (m for a prismatic joint)."""
    origin_std: float = parameter(0.0, 'm', minimum=0.0)
    """Error of each coordinate of each joint's origin."""
    axis_std: float = parameter(0.0, 'rad', minimum=0.0, maximum=1.0)
    """Error of each joint's axis about both directions normal to it."""
    mount_position_std: float = parameter(0.0, 'm', minimum=0.0)
    """Error of each coordinate of the odometry's mount on the base."""
    mount_orientation_std: float = parameter(0.0, 'rad', minimum=0.0, maximum=1.0)
    """Error of the orientation of the odometry's mount, about each axis."""
    frequency_relative_std: float = parameter(0.0, minimum=0.0, maximum=0.5)
    """Relative error of the natural frequency of each joint in `flexible.joints`."""
    seed: int = parameter(0, minimum=0)
    """The same seed gives the same robot."""


@dataclass(frozen=True)
class SimulatedNoiseConfig:
    """One standard deviation of the noise added to each channel of a sample; 0 is none."""

    joint_position: float = parameter(0.0, 'rad', minimum=0.0)
    """Noise of a joint position (m for a prismatic joint)."""
    joint_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Noise of a joint velocity (m/s for a prismatic joint)."""
    base_position: float = parameter(0.0, 'm', minimum=0.0)
    """Noise of each coordinate of the base position."""
    base_orientation: float = parameter(0.0, 'rad', minimum=0.0)
    """Noise of the base orientation about each axis."""
    base_linear_velocity: float = parameter(0.0, 'm/s', minimum=0.0)
    """Noise of the base velocity along each axis."""
    base_angular_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Noise of the angular velocity of the base."""


@dataclass(frozen=True)
class SimulatedImuConfig:
    """An IMU on a link, in its axes."""

    rate: float = parameter(0.0, 'Hz', minimum=0.0, maximum=1e4)
    """Imu messages a second; 0 is no IMU."""
    noise_density: float = parameter(0.0, 'rad/s/sqrt(Hz)', minimum=0.0)
    """White noise density of the gyro."""
    bias: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'rad/s', lengths=(3,))
    """Bias of the gyro at the start."""
    bias_walk: float = parameter(0.0, 'rad/s/sqrt(s)', minimum=0.0)
    """Standard deviation of the change of the bias in a second."""
    scale: tuple[float, ...] = parameter((0.0, 0.0, 0.0), lengths=(3,))
    """Relative error of the gyro's scale on each axis."""
    delay: float = parameter(0.0, 's')
    """Delay of the IMU's stamps after the measurements."""
    orientation_noise: float = parameter(0.0, 'rad', minimum=0.0)
    """Noise of an orientation in the Imu messages, as from a star tracker; 0: no orientation (covariance -1, REP
    145)."""
    link: str = parameter('')
    """Link that carries the IMU; empty means the base link."""
    turn: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'rad', lengths=(3,))
    """Misalignment of its axes on that link, a rotation vector."""


@dataclass(frozen=True)
class SimulatedGyrosConfig:
    """Further gyros."""

    names: tuple[str, ...] = parameter(())
    """Gyros beside that of imu, each an Imu on the topic of its name."""
    each: Mapping[str, Mapping[str, Any]] = by_name(SimulatedImuConfig, 'name')


@dataclass(frozen=True)
class SimulatedPoseConfig:
    """A star tracker, a camera or motion capture."""

    rate: float = parameter(0.0, 'Hz', minimum=0.0, maximum=1e4)
    """Readings a second; 0 is none."""
    measures: str = parameter('both', choices=MEASURES)
    """What it measures: position, orientation, or both; an orientation is a QuaternionStamped, others a PoseStamped."""
    link: str = parameter('')
    """Link that it locates; empty means the base link."""
    position: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'm', lengths=(3,))
    """Point that it locates, in the frame of that link."""
    turn: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'rad', lengths=(3,))
    """Misalignment of its axes on that link, a rotation vector."""
    position_noise: float = parameter(0.0, 'm', minimum=0.0)
    """Noise of each coordinate of a position."""
    orientation_noise: float = parameter(0.0, 'rad', minimum=0.0)
    """Noise of an orientation about each axis."""
    correlation_time: float = parameter(0.0, 's', minimum=0.0)
    """Time over which its errors are correlated; 0: white noise."""
    world_turn: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'rad', lengths=(3,))
    """Turn from the odometry's frame to its own, a rotation vector."""
    world_position: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'm', lengths=(3,))
    """Origin of the odometry's frame in its own."""
    delay: float = parameter(0.0, 's')
    """Delay of its stamps after the measurements."""


@dataclass(frozen=True)
class SimulatedPosesConfig:
    """Further sensors of poses."""

    names: tuple[str, ...] = parameter(())
    """Sensors of poses beside the odometry, each on the topic of its name."""
    each: Mapping[str, Mapping[str, Any]] = by_name(SimulatedPoseConfig, 'name')


@dataclass(frozen=True)
class SimulatorConfig:
    """All parameters of the simulator."""

    robot_description_file: str = parameter('')
    """URDF file of the robot."""
    duration: float = parameter(0.0, 's', minimum=0.0)
    """Length of the run; 0 means that the node runs on."""
    joint_rate: float = parameter(100.0, 'Hz', minimum=0.0, maximum=1e4, exclusive_minimum=True)
    """JointState messages a second."""
    odometry_rate: float = parameter(100.0, 'Hz', minimum=0.0, maximum=1e4, exclusive_minimum=True)
    """Odometry messages a second."""
    pose_only: bool = parameter(default=False)
    """Publish PoseStamped on pose in place of Odometry on odom, as motion capture does."""
    seed: int = parameter(0, minimum=0)
    """The same seed gives the same sensor noise."""
    real_time_factor: float = parameter(1.0, minimum=0.0, maximum=1e3, exclusive_minimum=True)
    """Simulated seconds in a second of the node; fewer if the machine does not keep up."""
    publish_clock: bool = parameter(default=False)
    """Publish /clock and stamp with simulated time from 0, for nodes with use_sim_time."""
    wait_for_subscribers: int = parameter(0, minimum=0, maximum=1000)
    """Subscribers of joint_states and of odom (or pose) that the node waits for before it starts."""
    base_link: str = parameter('')
    """Link that floats, even if the URDF attaches it to another; empty: the root, or the child of 'world'."""
    target_link: str = parameter('')
    """Link whose inertia is published as the truth; empty means the last one with an inertia."""
    odom_frame: str = parameter('odom')
    """Name of the odometry frame."""
    initial: InitialConfig = field(default_factory=InitialConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    thrust: SimulatedThrustConfig = field(default_factory=SimulatedThrustConfig)
    orbit: SimulatedOrbitConfig = field(default_factory=SimulatedOrbitConfig)
    wheels: SimulatedWheelsConfig = field(default_factory=SimulatedWheelsConfig)
    flexible: FlexibleConfig = field(default_factory=FlexibleConfig)
    capture: SimulatedCaptureConfig = field(default_factory=SimulatedCaptureConfig)
    target_pose: SimulatedTargetPoseConfig = field(default_factory=SimulatedTargetPoseConfig)
    model_errors: SimulatedModelErrorsConfig = field(default_factory=SimulatedModelErrorsConfig)
    noise: SimulatedNoiseConfig = field(default_factory=SimulatedNoiseConfig)
    imu: SimulatedImuConfig = field(default_factory=SimulatedImuConfig)
    gyros: SimulatedGyrosConfig = field(default_factory=SimulatedGyrosConfig)
    poses: SimulatedPosesConfig = field(default_factory=SimulatedPosesConfig)

    @property
    def further_gyros(self) -> dict[str, SimulatedImuConfig]:
        """All gyros that speak, by their topics.

        Raises ParameterError: A name cannot be that of a sensor.
        """
        named = named_groups(SimulatedImuConfig, 'gyros', self.gyros.names, self.gyros.each)
        return {name: each for name, each in {'imu': self.imu, **named}.items() if each.rate > 0.0}

    @property
    def further_poses(self) -> dict[str, SimulatedPoseConfig]:
        """All further sensors of poses that speak, by their topics.

        Raises ParameterError: A name cannot be that of a sensor.
        """
        named = named_groups(SimulatedPoseConfig, 'poses', self.poses.names, self.poses.each)
        if twice := [name for name in named if name in self.gyros.names]:
            raise ParameterError(f"parameter 'poses.names' has '{twice[0]}'; accepted: none of 'gyros.names'")
        return {name: each for name, each in named.items() if each.rate > 0.0}
