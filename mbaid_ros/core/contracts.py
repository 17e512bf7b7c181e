"""What a thing may contribute (unknowns, checks, hypotheses) and the record of a window that it sees."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, Integers, cross, crossed, exp, mounted_base, rotate_back
from mbaid_ros.core.repair import Conversion, Repair, Setting
from mbaid_ros.core.results.verdict import Reason
from mbaid_ros.core.robot.model import Configuration, PlaneDetector
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel
from mbaid_ros.core.samples import Samples, Stamps
from mbaid_ros.core.windows import Knots, Midpoints, Window, at_the_base, midpoints, with_gears, with_joints_later

_LARGEST_SIZE = 100.0  # that is tried (intervals.md, eq. 3): beyond it, how many times is not known
CLEAR = 4.0  # standard deviations, from which a delay is one: joints are moved in time at the price of noise in them
STACK = 10  # windows linearised at a time: one piece of work, of some milliseconds
# Where a constant force and torque acts, and in which axes.
Axes = Literal['none', 'inertial', 'inertial on the base', 'body']
# Part of the misfit that a convention may leave to be tried, and that another target link or other axes may: a body
# that slips in the grasp resembles another link, but less well.
LEFT, RIGHT = 0.8, 0.2
_LESS = 1.0 - 1e-9  # of two causes that a number belongs to alike, it is not of the one that follows the other


@dataclass(frozen=True, eq=False)
class NominalModel:
    """The robot that a prediction is linearised at: its URDF, moved by the estimates."""

    kernel: MomentumKernel  # bodies and joint placements
    zeros: Array  # (n,) rad or m, added to the measured joint positions
    mount: Array  # (6,) the base's frame in the one that the odometry locates: rotation vector (rad), position (m)
    delay: float  # s, by how much the joints' stamps are late
    # (5 f,) by how much each thruster is off its command: scale, turn, delay; empty is not at all
    thrust: Array = field(default_factory=lambda: np.zeros(0))
    # (12,) bias, scale, turn and cross-axis of a gyro that alone observes the orientation
    gyro: Array = field(default_factory=lambda: np.zeros(12))
    # (n,) s, by how much each joint is read later than that; empty is not at all
    lags: Array = field(default_factory=lambda: np.zeros(0))
    # (n, 3) how each joint deviates from its reading by sine (rad or m), cosine and proportion of it; empty is not
    gears: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @staticmethod
    def nominal(kernel: MomentumKernel) -> NominalModel:
        """Return the robot as its URDF has it."""
        return NominalModel(kernel, np.zeros(kernel.model.joints), np.zeros(6), 0.0)

    def corrected(self, samples: Samples) -> Samples:
        """Return samples of the base's own frame: q + zeros, p + R mu_p and R Exp(mu_R); delayed as they are."""
        if not (np.any(self.zeros) or np.any(self.mount)):
            return samples
        rotation, away, linear = mounted_base(
            samples.base_rotation, samples.base_linear_velocity, samples.base_angular_velocity, self.mount
        )
        return replace(
            samples,
            joint_position=samples.joint_position + self.zeros,
            base_position=samples.base_position + away,
            base_rotation=rotation,
            base_linear_velocity=linear,
        )


@dataclass(frozen=True)
class Motion:
    """The motion of B windows and of what a sensor reads of it; angular parts first, odometry axes."""

    time: Array  # (B,) s, of the windows' middles
    origin: Array  # (3,) m, the run's, in the odometry frame
    position: Array  # (B, 3) m, mean position of the base at the knots, from the run's origin
    rotation: Array  # (B, 3, 3) mean orientation of the base at the knots
    twist: Array  # (B, 6) mean twist (w, v) of the base at the knots
    # slope, rate: (B, r) how fast the r numbers change that the sensor reads, and how much they grow, relatively, with
    # the speed of the motion: of poses the twist and 0, of twists (w', v' - w x v) and the twist itself
    slope: Array
    rate: Array
    # Of twists and angular velocities alone, weighted means (B, 3, 3) of R, [w]x R, [v]x R, R diag(R^T w) and
    # R X(R^T w), with the sensor's axes R and angular velocity w, and X as in `geometry.crossed`:
    axes: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    turning: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    sliding: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    stretching: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    crossing: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))


class PlacedFrame(Protocol):
    """A frame on the base."""

    @property
    def rotation(self) -> Array:
        """Its axes in the base link's frame, (3, 3)."""

    @property
    def position(self) -> Array:
        """Its origin there, (3,) m."""


@dataclass(frozen=True)
class Words:
    """The words for the causes of one kind: 'zero:elbow' is of the kind 'zero'."""

    every: str = ''  # all causes of the kind together
    parameter: str = ''  # where their standard deviation is declared
    remedy: str = ''  # how to know them better; {} stands for the name
    # of the thing's name and its numbers (SI units), what they would have to be, and what to do
    deviation: Callable[[str, Array], str] | None = None
    together: Callable[[Sequence[str], Array], str] | None = None  # the same of all things of the kind


@dataclass(frozen=True, eq=False)
class Unknown:
    """An uncertain thing of the nominal model.

    The k numbers themselves (SI units) are `factor` times e independent standard normal ones, which are the filter's.
    """

    factor: Array  # (k, e) of the prior covariance factor factor^T
    labels: tuple[str, ...]  # k, the cause of each number in the error budget
    # labels of numbers that contain those of others, as of a joint that follows another
    led: tuple[str, ...] = field(default=(), kw_only=True)

    # By the kind of its labels.
    words: ClassVar[Mapping[str, Words]] = {}
    # Whether the sensors' readings depend on it. Windows that follow each other then share its linearisation point: the
    # pose error that links them is about the readings.
    of_measurement = False
    # Whether the momentum of the robot that moves as measured depends on it.
    in_equations = True
    # Whether it changes the momentum with time.
    changes_momentum = False
    pushes = False  # whether it is a force or torque so large that linearisation points follow it
    # Whether it is drawn anew for every motion.
    redrawn_per_motion = False
    # Whether it is drawn anew after every gap in the data.
    redrawn_after_gap = False
    # Whether it adds to the joints' motion.
    moves_joints = False
    # Whether a calibration file holds it: links, placements of joints, mount.
    calibrated = False
    # Whether the joints' noise drives its numbers beyond their prior.
    noise_driven = False

    @property
    def count(self) -> int:
        """Number e of independent numbers."""
        return self.factor.shape[1]

    @cached_property
    def causes(self) -> tuple[str, ...]:
        """Of each independent number, the label it has most to do with."""
        size = np.sqrt(np.sum(self.factor**2, axis=1, keepdims=True))
        relative = np.abs(self.factor) / np.where(size > 0.0, size, 1.0)
        relative[[label in self.led for label in self.labels]] *= _LESS
        return tuple(self.labels[row] for row in np.argmax(relative, axis=0)) if self.count else ()

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Of each independent number, the part of its cause that it is, where that may be mistaken by itself; or ''."""
        return ('',) * self.count

    @cached_property
    def directions(self) -> Mapping[str, Array]:
        """By name, unit vectors (e,) in its independent numbers along which a whole cause may be mistaken."""
        return {}

    def part(self, cause: str) -> Unknown:
        """Return its independent numbers that have most to do with a label alone, or with all of a kind."""
        return replace(self, factor=self.factor[:, [belongs(own, cause) for own in self.causes]])

    def without(self, causes: Collection[str]) -> Unknown:
        """Return it without the independent numbers that have most to do with some labels; itself if it has none."""
        if not set(causes) & set(self.causes):
            return self
        return replace(self, factor=self.factor[:, [cause not in causes for cause in self.causes]])

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair | None:
        """Return how a run takes a cause of it into account; None where it cannot.

        Parameters
        ----------
        cause : one of its labels
        value, std : the numbers (k,) of that cause as estimated with a wider prior, SI units
        kernel : of the robot
        """
        del cause, value, std, kernel
        return None

    def load_motions(self, kernel: MomentumKernel, placed: Configuration) -> Array | None:
        """Return the small motions (N, n, d, 6), (u, w), of each joint's load by its n d numbers; None: it moves none.

        Parameters
        ----------
        kernel : of the robot where it is linearised
        placed : in N instants; motions are about the base's origin then, odometry axes
        """
        del kernel, placed
        return None

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array | None:
        """Return how the momentum depends on it, all twists as they are, (N, 6, k); None where it does not.

        Parameters
        ----------
        kernel : of the robot where it is linearised
        states : of N samples, all bodies known
        """
        del kernel, states
        return None

    def mass_row(self) -> Array | None:
        """Return how the robot's mass depends on its independent numbers, (e,), kg; None where it does not."""
        return None

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum equations about the base's origin depend on it, at measured motion, (N, 6, k)."""
        columns = self.momentum_columns(kernel, states)
        if columns is None:
            raise NotImplementedError(type(self).__name__)
        return columns

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return how fast (P, L) change by it, (B, 6, k), where they do.

        Parameters
        ----------
        whole : (B, 10) standard parameters of the whole robot in odometry axes, about the point that L is about
        origin : (3,) m, that point in the odometry frame
        time : (B,) s since the begin
        rotation : (B, 3, 3) of the base
        """
        raise NotImplementedError(type(self).__name__)

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return how much more a sensor reads by it in B windows, (B, r, k); None where it is not in the readings.

        Parameters
        ----------
        sensor : 'pose' and 'twist', of r = 6 numbers each, angular ones first, or the name of a gyro, of 3
        motion : of what this sensor reads
        """
        del sensor, motion
        return None

    def deflections(self, position: Array, rate: Array, acceleration: Array) -> tuple[Array, Array]:
        """Return how much further on and faster than read the joints are by it, (N, n, k) each, of motion (N, n)."""
        raise NotImplementedError(type(self).__name__)

    @property
    def tilt(self) -> float:
        """Standard deviation by which it turns the base's axes, as a pose has them, about each of them, rad."""
        return 0.0

    @property
    def random_walk(self) -> Array:
        """The (k, w) factor of the covariance that a second adds; no columns where it is constant."""
        return np.zeros((len(self.factor), 0))

    @property
    def time_constants(self) -> Array:
        """Time constant (e,) of each independent number that is a first-order Gauss-Markov process, s; inf: constant.

        Its prior is the stationary one, of unit variance; numbers D apart correlate by exp(-D / time).
        """
        return np.full(self.count, np.inf)

    def process_variances(self, rates: Array) -> Array:
        """Return the variances (B, e) that the joints' noise adds to its numbers, where that drives them.

        Parameters
        ----------
        rates : (B, f) that a window's noise adds to each passive joint, rad/s or m/s
        """
        raise NotImplementedError(type(self).__name__)

    @property
    def joint_columns(self) -> Array | None:
        """How much further on than read the joints are by each independent number, (n, e); None: it is not of them."""
        return None

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return the linearisation point (k,) of an estimate (k,) with standard deviations (k,)."""
        del deviation
        return value

    def eased(self, part: float, unknowns: Sequence[Unknown]) -> Unknown:
        """Return it as a search takes it that begins with a loose swing of passive joints: itself, where of none.

        Parameters
        ----------
        part : 1 in the loosest stage: the swing's change from window to window, relative to that at the start
        unknowns : all of the state
        """
        del part, unknowns
        return self

    def finding(self, mean: Array, covariance: Array) -> Reason | None:
        """Return why its estimate by itself contradicts the model, with the likelihood gain; None where it does not.

        Parameters
        ----------
        mean, covariance : (e,), (e, e) of its independent numbers
        """
        del mean, covariance
        return None

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this value (k,)."""
        raise NotImplementedError

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return orthonormal (k, p) directions of it that a planar motion depends on."""
        del detector
        return np.eye(len(self.factor))

    def in_plane(self, detector: PlaneDetector) -> Unknown:
        """Return it as a planar motion depends on it."""
        basis = self.plane_basis(detector)
        seen = basis.T @ self.factor
        # The same covariance with no more columns than directions.
        root = np.asarray(np.linalg.qr(seen.T, mode='r')).T if seen.shape[1] > seen.shape[0] else seen
        return replace(self, factor=basis @ root)


@dataclass(frozen=True, eq=False)
class Linear(Unknown):
    """An unknown, mostly of the readings, that enters the measurement linearly: windows need no relinearisation."""

    of_measurement = True
    in_equations = False

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return zero: windows are linearised as read."""
        del deviation
        return np.zeros_like(value)

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model as it is."""
        del value
        return nominal


def belongs(label: str, cause: str) -> bool:
    """Return whether a label is a cause, or of the kind that the cause is: 'lag:elbow' is of 'lag'."""
    return label == cause or label.partition(':')[0] == cause


def together(cause: str) -> bool:
    """Return whether all things of the kind of a cause may be mistaken at once, each by its own."""
    return _words_of(cause)[0].together is not None


def diagonal(deviations: Sequence[float] | Array) -> Array:
    """Return the (k, e) factor of independent numbers with these standard deviations (k,); 0 is exact."""
    sizes = np.asarray(deviations, dtype=float)
    return np.diag(sizes)[:, sizes > 0.0]


def uncertain(*unknowns: Unknown) -> tuple[Unknown, ...]:
    """Return those that are not exact, in the same order."""
    return tuple(unknown for unknown in unknowns if unknown.count and unknown.factor.any())


def twist_in_plane(detector: PlaneDetector) -> Array:
    """Return the (6, 3) basis of the base's planar twists: the turn about the normal, two directions in the plane."""
    plane = detector.plane_of_body(0)
    basis = np.zeros((6, 3))
    basis[:3, 0], basis[3:, 1:] = plane.normal, plane.axes.T
    return basis


@dataclass(frozen=True, eq=False)
class Disturbance(Linear):
    """An unknown that changes the momentum as time goes by; none of a planar motion, as tables do not orbit."""

    in_equations = True
    changes_momentum = True

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return no direction."""
        del detector
        return np.zeros((len(self.factor), 0))


def _kinds(kind: type[Unknown]) -> list[type[Unknown]]:
    """Return a class of unknowns and all that derive from it."""
    return [kind, *(each for part in kind.__subclasses__() for each in _kinds(part))]


# By kind of cause: those of the priors of target and momentum.
_OF_PRIORS = {
    'target prior': Words(remedy='the prior of the target (target_prior)'),
    'momentum prior': Words(remedy='the prior of the momentum (momentum.linear_prior_std)'),
}


@cache  # at first use: by then all classes of unknowns are there
def _words() -> Mapping[str, Words]:
    """Return the words of all causes by their kind."""
    return _OF_PRIORS | {cause: words for kind in _kinds(Unknown) for cause, words in kind.words.items()}


def _words_of(cause: str) -> tuple[Words, str]:
    """Return the words of a cause's kind and the name of the thing: 'zero:elbow', or 'zero' for all zeros."""
    kind, _, name = cause.partition(':')
    return _words().get(kind, Words()), name


def in_words(cause: str) -> str:
    """Return a cause of the error budget in words: 'link:arm' is link arm, 'zero:elbow' the zero of elbow."""
    kind, _, name = cause.partition(':')
    return f'{kind} {name}' if kind == 'link' else f'the {kind} of {name}' if name else kind


@lru_cache(maxsize=1024)  # asked for at each window
def kind_in_words(cause: str) -> str:
    """Return a cause of the error budget, or a kind of them, in words: 'zero' is the joints' zeros."""
    words, name = _words_of(cause)
    return words.every if words.every and not name else in_words(cause)


def remedy_text(cause: str) -> str:
    """Return a cause in words, and its remedy."""
    words, name = _words_of(cause)
    return words.remedy.format(name) or cause


def underestimated_text(cause: str, size: float) -> str:
    """Return that a thing, 'link:arm', or all of a kind, 'link', is `size` times as far off as declared."""
    words, name = _words_of(cause)
    parameter = words.parameter or 'its standard deviation'
    times = f'{size:.{1 if size < 10.0 else 0}f}' if size < 0.95 * _LARGEST_SIZE else f'{_LARGEST_SIZE:g} or more'
    return (
        f'{kind_in_words(cause)} {"looks" if name else "look"} {times} times as far off as specified: intervals allow '
        f'for that; raise {parameter}'
    )


def deviation_text(cause: str, value: Array, names: Sequence[str] = ()) -> str:
    """Return the value that an unknown would need, by its label and numbers (k,), SI units, and the remedy.

    `names` are those of the things where the label is that of a whole kind.
    """
    words, name = _words_of(cause)
    if names and words.together is not None:
        return words.together(names, value)
    if words.deviation is None:
        return f'{cause} is off by {np.linalg.norm(value):.3g}'
    return words.deviation(name, value)


class Check(Protocol):
    """Something that windows may show to be wrong."""

    def update(self, window: Samples) -> Reason | None:
        """Add the next window; return the findings until then."""


@dataclass(frozen=True)
class Stack:
    """Windows of one shape, side by side."""

    windows: tuple[Window, ...]  # B of them
    places: tuple[int, ...]  # where they are in the list that was stacked

    @cached_property
    def knots(self) -> Knots:
        """All knots, (J, B, ...)."""
        return Knots.stack([window.knots for window in self.windows])

    @cached_property
    def middle(self) -> Midpoints:
        """The motion midway between all knots as measured, (J - 1, B, ...)."""
        return midpoints(self.knots, self.windows[0].spacing)

    def corrected(self, nominal: NominalModel) -> Knots:
        """Return the knots of the base's own frame, as a nominal model corrects them."""
        if nominal.mount.any():
            return at_the_base(self.knots, nominal.mount)
        if nominal.gyro.any() and self.knots.attitude_sensitivity.shape[-1]:
            return _turned_back(self.knots, nominal.gyro)
        return self.knots

    def motion(self, nominal: NominalModel, beside: int = 1) -> tuple[Midpoints, slice]:
        """Return the motion as a nominal model corrects it, with intervals `beside` it, and the own part."""
        knots = self.corrected(nominal)
        middle = self.middle if knots is self.knots else midpoints(knots, self.windows[0].spacing)
        if not nominal.mount.any() and knots is not self.knots:  # by the errors of a gyro
            read = rotate_back(middle.base_rotation, middle.turn / self.windows[0].spacing)
            bias, scale, turn, shared = nominal.gyro.reshape(4, 3)
            errors = bias + scale * read + cross(read, np.broadcast_to(turn, read.shape)) + crossed(read) @ shared
            own, others = np.split(middle.further, [3], axis=-1)
            middle = replace(middle, further=np.concatenate((own - errors, others), axis=-1))
        if nominal.delay != 0.0 or nominal.lags.any():
            middle = with_joints_later(middle, nominal.delay, nominal.lags, self.windows[0].spacing)
        if nominal.gears.any():
            middle = with_gears(middle, nominal.gears, nominal.kernel.model.transmission)
        if nominal.zeros.any():
            middle = replace(middle, joint_position=middle.joint_position + nominal.zeros)
        first, last, _ = self.windows[0].inside.indices(len(middle))
        begin = max(first - beside, 0)
        return middle[begin : last + beside], slice(first - begin, last - begin)

    @cached_property
    def samples(self) -> Array:
        """Number of samples in each window, (B, 1, 1)."""
        return np.array([float(window.noise.samples) for window in self.windows])[:, None, None]

    @cached_property
    def middles(self) -> Array:
        """Time in the middle of each window, (B,) s."""
        return np.array([window.start + 0.5 * window.length for window in self.windows])

    @cached_property
    def whitening(self) -> Array:
        """Share of a pose's change over each window that whitens the errors of its mean when added, (B, 1).

        For an autoregression x' = c x + e from knot to knot, the mean of e over m knots, over 1 - c, is the mean of x
        and 1 / (m (1 - c)) of its change. 0 where the errors are independent.
        """
        times = np.array([window.noise.correlation_time for window in self.windows])
        step = -np.expm1(-self.windows[0].spacing / np.where(times > 0.0, times, np.inf))
        first, last, _ = self.windows[0].inside.indices(len(self.knots))
        return np.where(times > 0.0, 1.0 / ((last - first) * np.where(times > 0.0, step, 1.0)), 0.0)[:, None]

    @cached_property
    def integrates_twist(self) -> Flags:
        """Which windows' twist counts by its integral (B,): where that is the better change of correlated poses.

        Its noise then adds to that of the mean pose. Not with a further sensor beside.
        """
        inside = self.windows[0].inside
        twist = np.isfinite(self.knots.base_twist[inside.start : inside.stop + 1]).all(axis=(0, 2))
        if self.knots.further.shape[-1] or self.knots.readings.shape[-1]:
            return np.zeros_like(twist)
        twist &= np.isfinite(self.pose_covariance).all(axis=(1, 2))
        pose, of_twist = (
            np.diagonal(each, axis1=1, axis2=2).reshape(-1, 2, 3).sum(axis=2)
            for each in (self.pose_covariance, self.twist_covariance)
        )
        added = (self.whitening * self.windows[0].length) ** 2 * of_twist
        return np.asarray((self.whitening[:, 0] > 0.0) & twist & np.all(added < pose, axis=1))

    @cached_property
    def joint_variance(self) -> Array:
        """Variance of the joint positions in one sample, (B, 1, 1) rad^2 or m^2; (B, 1, n) where joints differ."""
        return np.stack([np.atleast_1d(window.noise.joint_position**2) for window in self.windows])[:, None, :]

    @cached_property
    def pose_covariance(self) -> Array:
        """Covariances of one sample, (B, 6, 6)."""
        return np.stack([window.noise.pose for window in self.windows])

    @cached_property
    def twist_covariance(self) -> Array:
        """Covariances of one sample, (B, 6, 6)."""
        return np.stack([window.noise.twist for window in self.windows])


def _turned_back(knots: Knots, errors: Array) -> Knots:
    """Return knots whose orientation and angular velocity are those of a gyro without (12,) errors."""
    away = knots.attitude_sensitivity.reshape(*knots.attitude_sensitivity.shape[:-1], 3, 12) @ errors
    return replace(knots, base_rotation=exp(-away) @ knots.base_rotation)


@dataclass(frozen=True, eq=False)
class Course:
    """A stack's windows, m intervals of each, and how the robot moves in them as predicted; odometry axes."""

    stack: Stack
    around: Midpoints  # the motion as measured, with intervals beside
    inside: slice  # the windows' own intervals among these
    # twist, slope: (m, B, 6) (v, w) of the base and its change a second, in the own intervals
    twist: Array
    slope: Array
    placed: Configuration  # of the robot in all intervals, one window after the other in each
    knots: Knots  # of the base's own frame, as the nominal model corrects them, of which `inside` are the windows' own

    @property
    def spacing(self) -> float:
        """Length of an interval, s."""
        return self.stack.windows[0].spacing


@dataclass(frozen=True)
class Observation:
    """What a sensor measures of the base's mean twist or pose in B windows, r numbers, odometry axes."""

    value: Array  # (B, r) weighted mean of its readings, less what joints between add; NaN where it has none
    covariance: Array  # (B, r, r) of its own noise in that, which it shares with no other sensor
    motion: Motion  # that it reads, for the unknowns
    joint_gain: Array | None = None  # (B, r, n) its derivative by the joint rates beside the base's; None: none
    # (B, m + 1) of a sensor of the pose, the weights of its readings at a window's knots and the next; zeros where it
    # has none
    weights: Array | None = None
    of_base: Array | None = None  # (B, r, 6) as of the sensor, where it depends on the motion
    carried: Carried | None = None  # by joints, where these move the sensor


@dataclass(frozen=True)
class Carried:
    """How what a sensor on a link reads depends on the joints that move it, at one instant of each of B windows."""

    instants: Integers  # (B,) their places in the course, one window after the other in each interval
    # (B, r, n, 6) by how much more it reads by a small motion (u, w) of each joint's load, about the base's origin
    by_loads: Array


class Sensor(Protocol):
    """What measures the base's motion beside encoders and odometry's poses: its twist, any gyro, any further pose.

    A sensor of the pose returns weights with each observation; its value is by how much it reads more than the knots.
    """

    @property
    def name(self) -> str:
        """Its name: that of its parameters."""

    @property
    def of_base(self) -> Array:
        """What it reads of the base's twist (w, v), or pose error (theta, rho), in odometry axes, (r, 6)."""

    def observed(self, attitude_sensitivity: Course, base: Motion) -> Observation:
        """Return what it measures in windows; `base` is their motion as twists are read."""


class NamedSensor(Sensor, Protocol):
    """A sensor that parameters declare by name."""

    @property
    def of_pose(self) -> bool:
        """Whether it measures the pose or a part of it."""

    @property
    def noise(self) -> Mapping[str, float]:
        """The parameters of its noise, and their values; 0 where the messages have it."""

    @property
    def leave_out(self) -> Mapping[str, Setting]:
        """The parameters that leave it out."""

    def without(self, window: Window) -> Window:
        """Return a window without its readings; the same object whenever it is asked for."""


class Reader(Protocol):
    """Reads the messages of a named sensor."""

    @property
    def other_frame(self) -> str:
        """The latest frame that it cannot be on; empty if there was none."""

    def read(self, messages: Sequence[Any]) -> tuple[Any, Counter[str]]:
        """Return the measurements, None if there are none, and the numbers of dropped messages by cause."""


class Follower(Protocol):
    """Puts the readings of a named sensor to the stamps of samples; how its stream is cut makes no difference."""

    field: str  # of Samples, that its columns are in
    on_base: bool  # whether it is a gyro that is fixed to the base
    newest: int | None  # ns, stamp of the latest reading; None before the first
    dropped: Counter[str]  # readings that were not used, by cause

    def push(self, stream: Any) -> None:
        """Add readings in the order of their stamps; None if there are none."""

    def complete_until(self, joints: int) -> int:
        """Return the last stamp (ns) for which nothing more is to come; `joints` is the latest stamp of these."""

    def columns(self, samples: Samples, stamps: Stamps) -> Array:
        """Return its columns (N, c) at samples, in order."""

    def forget_before(self, stamp: int) -> None:
        """Drop readings that no sample after a stamp needs."""


class Instrument(NamedTuple):
    """A named sensor from its messages to the filter."""

    sensor: NamedSensor
    reader: Reader
    follower: Follower
    numbers: Callable[[Any], Array]  # from N readings to the (N, k) numbers by which copies are recognised


def stacked(windows: Sequence[Window]) -> list[Stack]:
    """Return windows in stacks of one shape each."""
    alike: dict[tuple[int, int, int], list[int]] = {}
    for place, window in enumerate(windows):
        alike.setdefault(window.shape, []).append(place)
    return [Stack(tuple(windows[place] for place in places), tuple(places)) for places in alike.values()]


def in_stacks(windows: Sequence[Window], size: int = STACK) -> list[list[Stack]]:
    """Return windows in order, `size` at a time, each part in stacks of one shape."""
    return [stacked(windows[first : first + size]) for first in range(0, len(windows), size)]


@dataclass(frozen=True)
class Hypothesis:
    """A disturbance or drift: a constant force, and random walks with intensities a square root of a second."""

    name: str  # in words
    cause: str = ''  # the likely source, and the remedy
    momentum: float = 0.0  # N s and N m s: an external force
    position: float = 0.0  # m: the odometry's own drift
    # axes of a constant force and torque: of the base, on its origin, or inertial, at the common centre of mass
    force: Axes = 'none'
    physical: bool = True  # whether it has a mechanism; a random walk follows anything
    repair: Repair | None = None  # how a run takes it into account; None where it cannot

    @property
    def disturbed(self) -> bool:
        """Whether anything acts or drifts at all."""
        return self.force != 'none' or self.position > 0.0 or self.momentum > 0.0

    @cached_property
    def random_walk(self) -> Array:
        """The (12, w) factor of the walks of pose error and momentum."""
        intensities = np.repeat((0.0, self.position, self.momentum), (3, 3, 6))
        return np.diag(intensities)[:, intensities > 0.0]


UNDISTURBED = Hypothesis('nothing drifts')


class Force(Protocol):
    """A known change of the momentum: commanded thrust, the gravity gradient of an orbit."""

    def with_momentum(self, window: Samples, origin: int) -> Samples:
        """Return the next window with the change until each of its samples; `origin` is the stamp at time 0, ns."""


@dataclass(frozen=True, eq=False)
class Convention:
    """How the readings or the robot may be meant."""

    text: str  # the mistake and its remedy
    kernel: MomentumKernel  # of the robot under this hypothesis
    windows: Callable[[Sequence[Window]], Sequence[Window]] = list  # the windows under this hypothesis
    joint_range: float = 0.0  # rad, that joint readings exceed at least where it may be so
    base_range: float = 0.0  # m, that positions of the base do
    delay: float = 0.0  # s, of the joints' stamps
    # Part of the misfit that it may leave to be tried; infinite: noise hides its misfit, and the likelihood decides.
    misfit_left: float = LEFT
    least_mass: float = 0.0  # kg, of a target that it may be so for: a body in the hand makes no link lighter
    repair: Repair | None = None  # how a run takes it into account; None where it cannot
    rest: tuple[Unknown, ...] = ()  # how far the numbers that were found for it may be off

    def possible(self, windows: Sequence[Window]) -> bool:
        """Return whether windows may follow this convention: degrees make whole turns, millimetres are long."""
        if self.joint_range and _largest(each.knots.joint_position for each in windows) < self.joint_range:
            return False
        return not self.base_range or _largest(each.knots.base_position for each in windows) > self.base_range


# What may be mistaken on a robot.
ConventionFactory = Callable[[MomentumKernel], Iterable[Convention]]


def converted(text: str, conversion: Conversion) -> Repair:
    """Return the repair of a cause, the first part of its text, by a conversion of the readings."""
    return Repair(text.partition(':')[0], conversion=conversion)


def _largest(values: Iterable[Array]) -> float:
    """Return the largest of all magnitudes; zero where nothing is known."""
    return max((float(np.max(np.abs(np.nan_to_num(each)), initial=0.0)) for each in values), default=0.0)
