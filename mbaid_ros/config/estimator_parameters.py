"""The parameters of the estimator, for the node and for `replay` alike: one line a group."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.capture import CaptureConfig
from mbaid_ros.core.clocks import TimeOffsetConfig
from mbaid_ros.core.forces import DisturbanceConfig, ThrustConfig
from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.gyro import GyrosConfig, ImuConfig
from mbaid_ros.core.joints.model import KnownJointsConfig
from mbaid_ros.core.links import KnownLinksConfig
from mbaid_ros.core.noise import CHANNELS, TYPICAL
from mbaid_ros.core.odometry.model import TWIST_FRAMES, MarkerConfig, OdometryConfig, OdometryMountConfig, PoseConfig
from mbaid_ros.core.orbit import OrbitConfig
from mbaid_ros.core.passive import FlexibleConfig
from mbaid_ros.core.poses import PosesConfig
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.target import DebrisConfig, MomentumConfig, TargetPriorConfig, TrackedTargetConfig
from mbaid_ros.core.wheels import WheelsConfig
from mbaid_ros.parameters import METHODS, parameter

# Parameters of a robot that is exactly its URDF and in no unspecified orbit, as only a simulated one is.
EXACT = {
    'known_links.relative_std': 0.0,
    'known_joints.zero_std': 0.0,
    'known_joints.origin_std': 0.0,
    'known_joints.axis_std': 0.0,
    'odometry_mount.position_std': 0.0,
    'odometry_mount.orientation_std': 0.0,
    'odometry.scale_std': 0.0,
    'odometry.angular_velocity_bias_std': 0.0,
    'time_offset.drift_std': 0.0,
    'orbit.undeclared_rate': 0.0,
    'orbit.undeclared_eccentricity': 0.0,
}
REFERENCES = ('previous', 'first')


@dataclass(frozen=True)
class NoiseConfig:
    """Standard deviation of one sample of each sensor channel."""

    joint_position: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of a joint position (for a prismatic joint the number counts in m); 0: estimated from the
    readings, 0.0001 where these do not determine it."""
    joint_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Standard deviation of a joint velocity (for a prismatic joint the number counts in m/s); 0: estimated from the
    readings, 0.001 where these do not determine it."""
    base_position: float = parameter(0.0, 'm', minimum=0.0)
    """Standard deviation of each coordinate of the base position, where the Odometry carries no pose covariance; 0:
    estimated from the readings, 0.001 where these do not determine it."""
    base_orientation: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of the base orientation about each axis, where the Odometry carries no pose covariance; 0:
    estimated from the readings, 0.0001 where these do not determine it."""
    base_linear_velocity: float = parameter(0.0, 'm/s', minimum=0.0)
    """Standard deviation of the base velocity along each axis, where the Odometry carries no twist covariance; 0:
    estimated from the readings, 0.001 where these do not determine it."""
    base_angular_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Standard deviation of the angular velocity of the base, where the Odometry carries no twist covariance; 0:
    estimated from the readings, 0.0001 where these do not determine it."""
    base_correlation_time: float = parameter(0.0, 's', minimum=0.0)
    """Time in which the correlation of errors of the base pose falls to 1/e, for poses of a filter or of visual
    odometry. 0: estimated from the readings, as that of the base twist is."""

    estimate: bool = parameter(default=False)
    """Use the noise estimated from the readings of every sensor, in place of the one set here. The estimated noise is
    reported in any case."""

    trust_declared: bool = parameter(default=False)
    """Keep the noise that is set for base and joints where the readings contradict it; otherwise the estimated noise
    replaces it, with a warning."""

    @property
    def declared(self) -> SensorNoise:
        """The noise as set, with typical values of a servicer's sensors where none is set."""
        levels = {name: getattr(self, name) or float(usual) for name, usual in zip(CHANNELS, TYPICAL, strict=True)}
        return SensorNoise(**levels, base_correlation_time=self.base_correlation_time)

    @property
    def undeclared(self) -> Flags:
        """Which of CHANNELS have no noise set, (6,)."""
        return np.array([getattr(self, name) == 0.0 for name in CHANNELS])


@dataclass(frozen=True)
class PaperConfig:
    """The recursive least squares of the two methods of the paper."""

    forgetting_factor: float = parameter(0.99, minimum=0.0, maximum=1.0, exclusive_minimum=True)
    """Weight of the past at each sample: 1 never forgets."""
    initial_covariance: float = parameter(1e6, minimum=0.0, exclusive_minimum=True)
    """Each diagonal entry of the covariance that the recursion starts from."""
    reference: str = parameter('previous', choices=REFERENCES)
    """Reference sample of the differenced angular equations: the previous one or the first."""
    lag: int = parameter(0, 'samples', minimum=0)
    """Number of samples between the two differenced ones, in place of paper.reference; 0: off."""
    total_angular_momentum: tuple[float, ...] = parameter((), 'N m s', lengths=(0, 3))
    """Total angular momentum about the origin of the odometry frame, which paper_main needs; empty: not given."""


@dataclass(frozen=True)
class ConvergenceConfig:
    """The wanted precision."""

    relative_std: float = parameter(0.01, minimum=0.0, exclusive_minimum=True)
    """An estimate is converged when its standard deviations, relative to its size, are below this; that of the centre
    of mass is relative to twice the radius of gyration, at most 1 m."""


@dataclass(frozen=True)
class PlanConfig:
    """Goal and limits of a planned motion."""

    relative_std: tuple[float, ...] = parameter((), lengths=(0, 1, 10))
    """Wanted relative standard deviation, in the sense of convergence.relative_std: one for all parameters, or ten in
    the order mass, com_x, com_y, com_z, ixx, ixy, ixz, iyy, iyz, izz; empty: convergence.relative_std."""
    duration: float = parameter(0.0, 's', minimum=0.0, maximum=3600.0)
    """Length of the most informative motion; 0: the shortest that reaches relative_std."""
    joint_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Velocity that no joint exceeds, in addition to its limit in the URDF (m/s for a prismatic joint); 0: the URDF's
    limit alone."""
    joint_acceleration: float = parameter(0.1, 'rad/s^2', minimum=0.0, exclusive_minimum=True)
    """Acceleration that no joint exceeds (m/s^2 for a prismatic joint)."""
    base_rotation: float = parameter(0.0, 'rad', minimum=0.0)
    """Largest rotation of the base by the motion, against a base with the joints at rest; 0: any."""
    base_translation: float = parameter(0.0, 'm', minimum=0.0)
    """Largest displacement of the base link's origin by the motion, against a base with the joints at rest; 0: any."""
    base_rate: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Largest change of the base's angular velocity by the motion, against a base with the joints at rest; 0: any."""
    deflection: float = parameter(0.0, 'rad', minimum=0.0)
    """Largest deflection of passive joints (flexible.joints) by the motion from rest (or m); 0: any."""
    clearance: float = parameter(0.02, 'm', minimum=0.0)
    """Smallest distance between collision shapes of the URDF; 0: they may touch, but not overlap."""
    stuck: tuple[str, ...] = parameter(())
    """Joints that are not moved."""
    held: tuple[str, ...] = parameter(())
    """Joints that keep the speed they have at the end of the run, as wheels do; empty: continuous joints without a
    velocity limit, if plan.joint_velocity is not given or they are faster."""
    effort: int = parameter(1200, minimum=10, maximum=1_000_000)
    """Motions that are compared before the best is taken."""


@dataclass(frozen=True)
class EstimatorConfig:
    """All parameters of the estimator."""

    robot_description_file: str = parameter('')
    """URDF file of the robot; empty: the topic robot_description."""
    base_link: str = parameter('')
    """Link that floats, even if the URDF attaches it to another; empty: the root, or the child of 'world'."""
    target_link: str = parameter('')
    """Link whose inertia is identified; empty: the last one with an inertia, furthest from the base."""
    method: str = parameter('trajectory', choices=METHODS)
    """Identification method."""
    window: float = parameter(0.5, 's', minimum=0.0, exclusive_minimum=True)
    """Length of the windows in which the data are processed."""
    maximum_gap: float = parameter(0.1, 's', minimum=0.0, exclusive_minimum=True)
    """Longest gap between two Odometry messages that is interpolated; joint states in longer gaps are dropped."""
    twist_frame: str = parameter('child', choices=TWIST_FRAMES)
    """Frame of the twist in the Odometry: child (child_frame_id, the ROS convention) or inertial (header.frame_id)."""
    continue_from: str = parameter('')
    """JSON file of replay, of a run with the same robot, target and parameters: this run starts from its result, with a
    new momentum."""
    repair: bool = parameter(default=False)
    """Take the leading cause of a contradiction into account and start the run again, at most three times within the
    first 300 s: only for method trajectory, and runs that begin after the capture."""
    frame_prefix: str = parameter('')
    """Prefix of link names in frame names, in received and published messages, as for robot_state_publisher:
    servicer/."""
    marker: MarkerConfig = field(default_factory=MarkerConfig)
    pose: PoseConfig = field(default_factory=PoseConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    gyros: GyrosConfig = field(default_factory=GyrosConfig)
    poses: PosesConfig = field(default_factory=PosesConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    momentum: MomentumConfig = field(default_factory=MomentumConfig)
    time_offset: TimeOffsetConfig = field(default_factory=TimeOffsetConfig)
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    known_links: KnownLinksConfig = field(default_factory=KnownLinksConfig)
    known_joints: KnownJointsConfig = field(default_factory=KnownJointsConfig)
    flexible: FlexibleConfig = field(default_factory=FlexibleConfig)
    odometry_mount: OdometryMountConfig = field(default_factory=OdometryMountConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    target_prior: TargetPriorConfig = field(default_factory=TargetPriorConfig)
    debris: DebrisConfig = field(default_factory=DebrisConfig)
    thrust: ThrustConfig = field(default_factory=ThrustConfig)
    orbit: OrbitConfig = field(default_factory=OrbitConfig)
    wheels: WheelsConfig = field(default_factory=WheelsConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    target: TrackedTargetConfig = field(default_factory=TrackedTargetConfig)
    paper: PaperConfig = field(default_factory=PaperConfig)
    convergence: ConvergenceConfig = field(default_factory=ConvergenceConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)

    @property
    def by_odometry(self) -> bool:
        """Whether odom or pose locate the base."""
        return not (self.imu.alone or self.poses.alone)

    @property
    def located(self) -> bool:
        """Whether anything measures the base's position."""
        return bool(self.poses.measuring('position')) if self.poses.alone else not self.imu.alone

    @property
    def oriented(self) -> bool:
        """Whether anything but a gyro measures the base's orientation."""
        return not self.imu.alone or self.imu.orientation

    @property
    def without_frames(self) -> EstimatorConfig:
        """The same parameters without the frames of named sensors, for any robot."""
        sensors = replace(self.imu, frame=''), self.gyros.without_frames, self.poses.without_frames
        return replace(self, **dict(zip(('imu', 'gyros', 'poses'), sensors, strict=True)))  # type: ignore[arg-type]
