"""The parameters of the simulator, for the node and for `simulate` alike."""

from __future__ import annotations

from dataclasses import dataclass, field

from mbaid_ros.config.environment import SimulatedOrbitConfig, SimulatedWheelsConfig
from mbaid_ros.config.flexible import FlexibleConfig
from mbaid_ros.config.parameters import parameter

MOTIONS = ('passive', 'sinusoids', 'random', 'trajectory')


@dataclass(frozen=True)
class InitialConfig:
    """The state at time 0."""

    joint_positions: tuple[float, ...] = parameter(
        (),
        'Joint positions in the order of the URDF (m for a prismatic joint), without those that mimic; empty: zero.',
        unit='rad',
    )
    joint_velocities: tuple[float, ...] = parameter(
        (),
        'Joint velocities in the order of the URDF (m/s for a prismatic joint), for passive motion; empty means zero.',
        unit='rad/s',
    )
    base_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'Position of the base link in the odometry frame.', unit='m', lengths=(3,)
    )
    base_orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        'Orientation of the base link in the odometry frame, a quaternion x, y, z, w.',
        lengths=(4,),
    )
    base_linear_velocity: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "Velocity of the base link's origin, in odometry axes.", unit='m/s', lengths=(3,)
    )
    base_angular_velocity: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'Angular velocity of the base link, in odometry axes.', unit='rad/s', lengths=(3,)
    )
    zero_linear_momentum: bool = parameter(
        False,  # noqa: FBT003 - a default
        'Choose the linear velocity of the base so that the total linear momentum is zero; base_linear_velocity must '
        'then be zero.',
    )


@dataclass(frozen=True)
class MotionConfig:
    """What drives the joints."""

    kind: str = parameter(
        'passive',
        'Motion of the joints: passive (no torque; random for a robot with joints that mimic others), sinusoids (those '
        'given), random (drawn ones) or trajectory (a file).',
        choices=MOTIONS,
    )
    amplitudes: tuple[float, ...] = parameter(
        (),
        'Sinusoids: amplitudes, as many for each joint: q(t) = q(0) + sum of a (sin(2 pi f t + p) - sin p).',
        unit='rad',
    )
    frequencies: tuple[float, ...] = parameter((), 'Sinusoids: frequencies, one for each amplitude.', unit='Hz')
    phases: tuple[float, ...] = parameter(
        (), 'Sinusoids: phases, one for each amplitude; empty means zero.', unit='rad'
    )
    within_limits: bool = parameter(
        default=True,
        description='Random: keep joints within the position and velocity limits of the URDF, by smaller motions; '
        'where initial.joint_positions is empty, they start where these fit.',
    )
    seed: int = parameter(0, 'Random: the same seed gives the same motion.', minimum=0)
    terms: int = parameter(2, 'Random: sinusoids for each joint.', minimum=1, maximum=100)
    amplitude: float = parameter(
        0.5, 'Random: largest excursion of a joint from the middle of its motion.', unit='rad', minimum=0.0
    )
    period_min: float = parameter(10.0, 'Random: shortest period.', unit='s', minimum=0.0, exclusive_minimum=True)
    period_max: float = parameter(40.0, 'Random: longest period.', unit='s', minimum=0.0, exclusive_minimum=True)
    trajectory_file: str = parameter(
        '',
        'Trajectory: a trajectory_msgs/JointTrajectory in YAML, as plan --yaml writes it. Where '
        'initial.joint_positions is empty, the joints begin at its first point.',
    )
    trajectory_begin: float = parameter(0.0, 'Trajectory: when the joints begin to follow it.', unit='s', minimum=0.0)


@dataclass(frozen=True)
class SimulatedThrustConfig:
    """A pulse of thrust, and whether it is published."""

    time: float = parameter(0.0, 'Begin of a pulse of thrust.', 's', minimum=0.0)
    duration: float = parameter(0.0, 'Its length; 0 means that there is none.', 's', minimum=0.0)
    link: str = parameter(
        '',
        'Link it acts on, at the origin and in the axes of its frame; empty means the base link. The name of the '
        'odometry frame makes it one on the base that is constant in that frame.',
    )
    force: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'Commanded force.', unit='N', lengths=(3,))
    torque: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'Commanded torque.', unit='N m', lengths=(3,))
    scale: float = parameter(
        1.0, 'How much stronger force and torque are than commanded.', minimum=0.0, exclusive_minimum=True
    )
    turn: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'By how much they are turned against the command: a rotation vector.', unit='rad', lengths=(3,)
    )
    delay: float = parameter(0.0, 'How late they begin and end after the command.', 's', minimum=0.0, maximum=1.0)
    publish: bool = parameter(
        True,  # noqa: FBT003 - a default
        'Publish the commanded wrench on thrust, ten times a second while it acts.',
    )


@dataclass(frozen=True)
class SimulatedCaptureConfig:
    """A body that tumbles freely until the target link captures it."""

    time: float = parameter(
        0.0, 'Time of the capture, for a robot whose joints are driven; 0 means that there is none.', 's', minimum=0.0
    )
    mass: float = parameter(0.0, 'Mass of the captured body.', unit='kg', minimum=0.0)
    com: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "Its centre of mass in the target link's frame, once captured.", unit='m', lengths=(3,)
    )
    inertia: tuple[float, ...] = parameter(
        (),
        "Its inertia about the centre of mass in the target link's axes: ixx, ixy, ixz, iyy, iyz, izz.",
        unit='kg m^2',
        lengths=(0, 6),
    )
    linear_velocity: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'Velocity of its centre of mass just before, in odometry axes.', unit='m/s', lengths=(3,)
    )
    angular_velocity: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'Its angular velocity just before, in odometry axes.', unit='rad/s', lengths=(3,)
    )


@dataclass(frozen=True)
class SimulatedModelErrorsConfig:
    """Standard deviations of the deviations of the simulated robot from its URDF; 0: exact."""

    links_relative_std: float = parameter(
        0.0,
        "Relative standard deviation of the inertial parameters of every body but the target link, as the estimator's "
        'known_links.relative_std has it.',
        minimum=0.0,
        maximum=1.0,
    )
    zero_std: float = parameter(0.0, "Error of each joint's zero (m for a prismatic joint).", 'rad', minimum=0.0)
    origin_std: float = parameter(0.0, "Error of each coordinate of each joint's origin.", 'm', minimum=0.0)
    axis_std: float = parameter(
        0.0, "Error of each joint's axis about both directions normal to it.", 'rad', minimum=0.0, maximum=1.0
    )
    mount_position_std: float = parameter(
        0.0, 'Error of each coordinate of where the frame that the odometry locates is on the base.', 'm', minimum=0.0
    )
    mount_orientation_std: float = parameter(
        0.0, 'Error of how that frame is turned, about each of its axes.', 'rad', minimum=0.0, maximum=1.0
    )
    seed: int = parameter(0, 'The same seed gives the same robot.', minimum=0)


@dataclass(frozen=True)
class SimulatedNoiseConfig:
    """One standard deviation of the noise added to each channel of a sample; 0 is none."""

    joint_position: float = parameter(0.0, 'Noise of a joint position (m for a prismatic joint).', 'rad', minimum=0.0)
    joint_velocity: float = parameter(
        0.0, 'Noise of a joint velocity (m/s for a prismatic joint).', 'rad/s', minimum=0.0
    )
    base_position: float = parameter(0.0, 'Noise of each coordinate of the base position.', 'm', minimum=0.0)
    base_orientation: float = parameter(0.0, 'Noise of the base orientation about each axis.', 'rad', minimum=0.0)
    base_linear_velocity: float = parameter(0.0, 'Noise of the base velocity along each axis.', 'm/s', minimum=0.0)
    base_angular_velocity: float = parameter(0.0, 'Noise of the angular velocity of the base.', 'rad/s', minimum=0.0)


@dataclass(frozen=True)
class SimulatedImuConfig:
    """An IMU on a link, in its axes."""

    rate: float = parameter(0.0, 'Imu messages a second; 0 is no IMU.', unit='Hz', minimum=0.0, maximum=1e4)
    noise_density: float = parameter(
        0.0, 'Density of the white noise of its angular velocity.', unit='rad/s/sqrt(Hz)', minimum=0.0
    )
    bias: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'Its bias at the begin.', unit='rad/s', lengths=(3,))
    bias_walk: float = parameter(
        0.0, 'Standard deviation of the change of the bias in a second.', unit='rad/s/sqrt(s)', minimum=0.0
    )
    scale: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'By what part each axis reads too much.', lengths=(3,))
    delay: float = parameter(0.0, 'How late its messages are stamped.', unit='s')
    orientation_noise: float = parameter(
        0.0,
        'It measures its orientation, too, like a star tracker: standard deviation of each reading; 0: no orientation '
        '(covariance -1, REP 145).',
        unit='rad',
        minimum=0.0,
    )
    link: str = parameter('', 'Link that it is on; empty means the base link.')


@dataclass(frozen=True)
class SimulatorConfig:
    """All parameters of the simulator."""

    robot_description_file: str = parameter('', 'URDF file of the robot.')
    duration: float = parameter(0.0, 'Length of the run; 0 means that the node runs on.', unit='s', minimum=0.0)
    joint_rate: float = parameter(
        100.0, 'JointState messages a second.', unit='Hz', minimum=0.0, maximum=1e4, exclusive_minimum=True
    )
    odometry_rate: float = parameter(
        100.0, 'Odometry messages a second.', unit='Hz', minimum=0.0, maximum=1e4, exclusive_minimum=True
    )
    step: float = parameter(
        0.02,
        'Step of the integrator; it needs no relation to the rates. 0.02 s suits motions of periods above a second.',
        unit='s',
        minimum=1e-5,
        maximum=1.0,
    )
    seed: int = parameter(0, 'The same seed gives the same sensor noise.', minimum=0)
    real_time_factor: float = parameter(
        1.0,
        'Simulated seconds that pass in a second of the node; fewer where the machine does not keep up.',
        minimum=0.0,
        maximum=1e3,
        exclusive_minimum=True,
    )
    publish_clock: bool = parameter(
        False,  # noqa: FBT003 - a default
        'Publish /clock and stamp with simulated time from 0, for nodes with use_sim_time.',
    )
    wait_for_subscribers: int = parameter(
        0,
        'Let the run of the node begin only when joint_states and odom have this many subscribers each.',
        minimum=0,
        maximum=1000,
    )
    base_link: str = parameter(
        '',
        "Link that floats, even if the URDF attaches it to another; empty: the root, or the child of 'world'.",
    )
    target_link: str = parameter(
        '', 'Link whose inertia is published as the truth; empty means the last one with an inertia.'
    )
    odom_frame: str = parameter('odom', 'Name of the odometry frame.')
    initial: InitialConfig = field(default_factory=InitialConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    thrust: SimulatedThrustConfig = field(default_factory=SimulatedThrustConfig)
    orbit: SimulatedOrbitConfig = field(default_factory=SimulatedOrbitConfig)
    wheels: SimulatedWheelsConfig = field(default_factory=SimulatedWheelsConfig)
    flexible: FlexibleConfig = field(default_factory=FlexibleConfig)
    capture: SimulatedCaptureConfig = field(default_factory=SimulatedCaptureConfig)
    model_errors: SimulatedModelErrorsConfig = field(default_factory=SimulatedModelErrorsConfig)
    noise: SimulatedNoiseConfig = field(default_factory=SimulatedNoiseConfig)
    imu: SimulatedImuConfig = field(default_factory=SimulatedImuConfig)
