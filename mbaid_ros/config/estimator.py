"""The parameters of the estimator, for the node and for `replay` alike."""

from __future__ import annotations

from dataclasses import dataclass, field

from mbaid_ros.config.environment import OrbitConfig, WheelsConfig
from mbaid_ros.config.model_errors import (
    FlexibleConfig,
    KnownJointsConfig,
    KnownLinksConfig,
    OdometryConfig,
    OdometryMountConfig,
    TargetPriorConfig,
)
from mbaid_ros.config.parameters import METHODS, parameter
from mbaid_ros.config.sensors import ImuConfig, NoiseConfig, PoseConfig

REFERENCES = ('previous', 'first')
TWIST_FRAMES = ('child', 'inertial')
CONSTANT_FORCES = ('none', 'inertial', 'body')
PUSH_AXES = ('body', 'inertial', 'orbit')
PHASES = ('post_capture', 'pre_capture')


@dataclass(frozen=True)
class MomentumConfig:
    """The prior of the total momentum."""

    linear_prior_std: float = parameter(0.0, 'N s', minimum=0.0)
    """Standard deviation of the total linear momentum about zero, if the servicer matched velocities before the
    capture; 0: unknown."""


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
class TimeOffsetConfig:
    """A constant offset between the stamps of JointState and Odometry."""

    estimate: bool = parameter(default=True)
    """Estimate how late JointState is stamped relative to Odometry (trajectory only)."""
    prior_std: float = parameter(0.02, 's', minimum=0.0, exclusive_minimum=True)
    """Prior standard deviation of the time offset between JointState and Odometry, about zero."""
    drift_std: float = parameter(5e-5, minimum=0.0, maximum=0.01)
    """Standard deviation of the drift between the clocks of JointState and Odometry, s a second: 2e-5 for a computer's
    own quartz; 0: one clock, or synchronised clocks."""


@dataclass(frozen=True)
class MarkerConfig:
    """A frame on the base that the odometry locates and that is no link of the robot."""

    position: tuple[float, ...] = parameter((), 'm', lengths=(0, 3))
    """Origin, in the base link's frame, of a child_frame_id that is no link of the robot; empty: refused."""
    orientation: tuple[float, ...] = parameter((0.0, 0.0, 0.0, 1.0), lengths=(4,))
    """Orientation of the marker's frame in the base link's: quaternion x, y, z, w."""


@dataclass(frozen=True)
class ConvergenceConfig:
    """The wanted precision."""

    relative_std: float = parameter(0.01, minimum=0.0, exclusive_minimum=True)
    """An estimate is converged when its standard deviations, relative to its size, are below this; that of the centre
    of mass is relative to twice the radius of gyration, at most 1 m."""


@dataclass(frozen=True)
class DebrisConfig:
    """The captured body alone."""

    report: bool = parameter(default=False)
    """Also report the captured body alone: the estimate minus the target link's <inertial>, which known_links.<link>
    then declares, as in calibrate."""


@dataclass(frozen=True)
class DisturbanceConfig:
    """External forces and torques."""

    constant: str = parameter('none', choices=CONSTANT_FORCES)
    """Constant external force and torque that trajectory estimates: body (axes of the base link), inertial (on the base
    or at the common centre of mass, as the data show), or none (only if the data show one)."""
    torque_std: float = parameter(0.0, 'N m', minimum=0.0)
    """Standard deviation of an external torque about each axis, different in every motion, as from air on a thrown
    body; 0: none."""
    torque_time: float = parameter(0.0, 's', minimum=0.0)
    """Time constant of the external torque within a motion, a Gauss-Markov process: drag and venting vary in minutes;
    0: constant."""
    force_std: float = parameter(0.0, 'N', minimum=0.0)
    """Standard deviation of an external force along each axis, through the common centre of mass, different in every
    motion; 0: none."""
    force_time: float = parameter(0.0, 's', minimum=0.0)
    """Time constant of the external force within a motion; 0: constant."""
    axes: str = parameter('body', choices=PUSH_AXES)
    """Axes of the external torque and force: body (the base), inertial, or orbit (LVLH of the declared orbit)."""


@dataclass(frozen=True)
class ThrustConfig:
    """The commanded thrust on the topic thrust."""

    scale_std: float = parameter(0.0, minimum=0.0)
    """Relative standard deviation of the strength of a thruster, constant, estimated by trajectory; 0: commands are
    exact."""
    direction_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of a thruster's constant misalignment about each axis of its frame; 0: exact."""
    delay_std: float = parameter(0.02, 's', minimum=0.0, maximum=1.0)
    """Standard deviation of a thruster's constant delay after the stamps of its commands; 0: in time."""
    frames: tuple[str, ...] = parameter(())
    """Frames of the thrusters that have such errors, each its own; empty: the base link if a scale or a direction is
    uncertain, otherwise none."""


@dataclass(frozen=True)
class CaptureConfig:
    """The capture, in data that begin before it."""

    phase: str = parameter('post_capture', choices=PHASES)
    """First phase: post_capture identifies from the first sample on; pre_capture checks the known model until ~/capture
    is called."""
    time: float = parameter(0.0, 's', minimum=0.0)
    """Time of the capture after the first sample, if known beforehand; 0: phase decides."""
    detect: bool = parameter(default=False)
    """Interpret a jump of the momentum as the capture, once pre_capture has lasted five seconds."""


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
    """JSON file of replay, of a run of the same robot and target with the same parameters: this run goes on from what
    that one has taught, but for the momentum."""
    frame_prefix: str = parameter('')
    """Prefix of link names in frame names, in received and published messages, as for robot_state_publisher:
    servicer/."""
    marker: MarkerConfig = field(default_factory=MarkerConfig)
    pose: PoseConfig = field(default_factory=PoseConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
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
    paper: PaperConfig = field(default_factory=PaperConfig)
    convergence: ConvergenceConfig = field(default_factory=ConvergenceConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)
