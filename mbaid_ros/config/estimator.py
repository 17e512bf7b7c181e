"""The parameters of the estimator, for the node and for `replay` alike."""

from __future__ import annotations

from dataclasses import dataclass, field

from mbaid_ros.config.capture import (
    CaptureConfig,
    DebrisConfig,
    DisturbanceConfig,
    SelfCalibrationConfig,
    ThrustConfig,
)
from mbaid_ros.config.environment import OrbitConfig, WheelsConfig
from mbaid_ros.config.flexible import FlexibleConfig
from mbaid_ros.config.methods import METHODS
from mbaid_ros.config.model_errors import (
    KnownJointsConfig,
    KnownLinksConfig,
    OdometryConfig,
    OdometryMountConfig,
    TargetPriorConfig,
)
from mbaid_ros.config.parameters import parameter
from mbaid_ros.config.plan import PlanConfig
from mbaid_ros.config.sensors import ImuConfig, NoiseConfig, PoseConfig

REFERENCES = ('previous', 'first')
TWIST_FRAMES = ('child', 'inertial')
TIME_JUMPS = ('reset', 'error', 'ignore')


@dataclass(frozen=True)
class MomentumConfig:
    """The prior of the total momentum."""

    linear_prior_std: float = parameter(
        0.0,
        'Standard deviation of the total linear momentum about zero, if the servicer matched velocities before the '
        'capture; 0: unknown.',
        unit='N s',
        minimum=0.0,
    )


@dataclass(frozen=True)
class PaperConfig:
    """The recursive least squares of the two methods of the paper."""

    forgetting_factor: float = parameter(
        0.99,
        'Weight of the past at each sample: 1 never forgets.',
        minimum=0.0,
        maximum=1.0,
        exclusive_minimum=True,
    )
    initial_covariance: float = parameter(
        1e6,
        'Each diagonal entry of the covariance that the recursion starts from.',
        minimum=0.0,
        exclusive_minimum=True,
    )
    reference: str = parameter(
        'previous',
        'Sample that the angular equations are differenced against: the previous one or the first.',
        choices=REFERENCES,
    )
    lag: int = parameter(
        0,
        'Number of samples between the two that are differenced, in place of the reference; 0: off.',
        unit='samples',
        minimum=0,
    )
    total_angular_momentum: tuple[float, ...] = parameter(
        (),
        'Total angular momentum about the origin of the odometry frame, which paper_main needs; empty: not given.',
        unit='N m s',
        lengths=(0, 3),
    )


@dataclass(frozen=True)
class TimeOffsetConfig:
    """A constant offset between the stamps of JointState and Odometry."""

    estimate: bool = parameter(
        default=True,
        description='Estimate how late JointState is stamped relative to Odometry (trajectory only).',
    )
    prior_std: float = parameter(
        0.02,
        'Standard deviation of that offset about zero, before the data.',
        unit='s',
        minimum=0.0,
        exclusive_minimum=True,
    )
    drift_std: float = parameter(
        5e-5,
        'Standard deviation of the drift of the clock of JointState relative to the other one, s a second: 2e-5 for '
        "a computer's own quartz; 0: one clock, or synchronised clocks.",
        minimum=0.0,
        maximum=0.01,
    )


@dataclass(frozen=True)
class MarkerConfig:
    """A frame on the base that the odometry locates and that is no link of the robot."""

    position: tuple[float, ...] = parameter(
        (),
        "Origin, in the base link's frame, of a child_frame_id that is no link of the robot; empty: refused.",
        unit='m',
        lengths=(0, 3),
    )
    orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        "Orientation of that frame in the base link's: quaternion x, y, z, w.",
        lengths=(4,),
    )


@dataclass(frozen=True)
class ConvergenceConfig:
    """Thresholds of published estimates; changes at run time count from the next window on."""

    relative_std: float = parameter(
        0.01,
        'An estimate is converged when its standard deviations, relative to its size, are below this.',
        minimum=0.0,
        exclusive_minimum=True,
        read_only=False,
    )
    identifiable_std: float = parameter(
        0.5,
        'A parameter is identifiable when its relative standard deviation is below this.',
        minimum=0.0,
        exclusive_minimum=True,
        read_only=False,
    )
    largest_residual: float = parameter(
        2.0,
        'A run is inconsistent when its residuals exceed this multiple of the noise.',
        minimum=1.0,
        read_only=False,
    )
    length: float = parameter(
        1.0,
        'Length that the standard deviation of the centre of mass is relative to.',
        unit='m',
        minimum=0.0,
        exclusive_minimum=True,
        read_only=False,
    )


@dataclass(frozen=True)
class EstimatorConfig:
    """All parameters of the estimator."""

    robot_description_file: str = parameter('', 'URDF file of the robot; empty: the topic robot_description.')
    base_link: str = parameter(
        '',
        "Link that floats, even if the URDF attaches it to another; empty: the root, or the child of 'world'.",
    )
    target_link: str = parameter(
        '', 'Link whose inertia is identified; empty: the last one with an inertia, furthest from the base.'
    )
    method: str = parameter('trajectory', 'Identification method.', choices=METHODS)
    window: float = parameter(
        0.5, 'Length of the windows in which the data are processed.', unit='s', minimum=0.0, exclusive_minimum=True
    )
    maximum_gap: float = parameter(
        0.1,
        'Longest gap between two Odometry messages that is interpolated; joint states in longer gaps are dropped.',
        unit='s',
        minimum=0.0,
        exclusive_minimum=True,
    )
    twist_frame: str = parameter(
        'child',
        'Frame of the twist in the Odometry: child (child_frame_id, the ROS convention) or inertial (header.frame_id).',
        choices=TWIST_FRAMES,
    )
    time_jump: str = parameter(
        'reset',
        'After stamps that jump back: start again (reset), stop with an error, or drop messages until time has caught '
        'up (ignore).',
        choices=TIME_JUMPS,
    )
    reorder_time: float = parameter(
        0.05,
        'Longest time that messages wait for late ones, once a topic has had some; 0 drops late ones.',
        unit='s',
        minimum=0.0,
        maximum=1.0,
    )
    publish_tf: bool = parameter(
        default=False,
        description='Send the frames of the links on /tf, if no robot_state_publisher does.',
        read_only=False,
    )
    frame_prefix: str = parameter(
        '',
        'Prefix of link names in frame names, in received and published messages, as for robot_state_publisher: '
        'servicer/.',
    )
    marker: MarkerConfig = field(default_factory=MarkerConfig)
    pose: PoseConfig = field(default_factory=PoseConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    momentum: MomentumConfig = field(default_factory=MomentumConfig)
    time_offset: TimeOffsetConfig = field(default_factory=TimeOffsetConfig)
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    calibration: SelfCalibrationConfig = field(default_factory=SelfCalibrationConfig)
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
