"""Forces and torques from outside: commanded thrust, thrusters that deviate, declared and constant disturbances."""

from __future__ import annotations

from bisect import insort
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar, Literal, cast

import numpy as np

from mbaid_ros.core.clocks import LARGEST_BACKLOG
from mbaid_ros.core.contracts import Axes, Disturbance, Hypothesis, NominalModel, Unknown, Words, diagonal
from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.orbit import Orbit, OrbitConfig, make_orbit
from mbaid_ros.core.repair import Repair, Setting, widened, wider_prior
from mbaid_ros.core.results.estimate import BAND, with_band
from mbaid_ros.core.robot.model import Kinematics, PlaneDetector, RobotModel
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS, BodyStates, MomentumKernel
from mbaid_ros.core.samples import Samples, stamp_of
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.parameters import by_name, parameter

CONSTANT_FORCES = ('none', 'inertial', 'body')
PUSH_AXES = ('body', 'inertial', 'orbit')
NOT_FINITE_THRUST = 'thrust with a NaN or infinite value'
UNKNOWN_FRAME = 'thrust in a frame that is no link'
FAR_THRUST = 'thrust stamped far from the samples'
LATE_THRUST = 'a thrust command arrived after its samples had been used: its impulse counts from then on'
EXACT_THRUST = (
    'thrust counts as exactly as commanded: if it is weaker, misaligned or late, the intervals are too narrow; set '
    'thrust.scale_std, thrust.direction_std and thrust.delay_std'
)
SHARED_THRUST = (
    'thrust in {} changes to and fro between two commands, as of two publishers, of which each ends the other: give '
    'each a frame of its own, such as a link that is fixed to this one'
)
HOLD = 1_000_000_000  # ns, longest time that a command acts: drivers repeat theirs several times a second
_FAR = 10_000_000_000  # ns, from the newest sample: a command further away is by another clock
_SHARED = 10  # commands between two with other components, from which they are another publisher's
_REMEMBERED = 4 * _FAR  # ns, for commands that come late
# Derivatives of a wrench by a thruster's scale, and by its turn about each axis, (4, 6, 6).
_BY_ERROR = np.zeros((4, 6, 6))
_BY_ERROR[0] = np.eye(6)
_BY_ERROR[1:, :3, :3] = _BY_ERROR[1:, 3:, 3:] = skew(np.eye(3))
_DEVIATIONS = ('scale_std', 'direction_std', 'delay_std')  # of a thruster, in the order of its numbers
_PARTS = (slice(0, 1), slice(1, 4), slice(4, 5))  # the numbers of each
_OFF = 3.0  # specified deviations, from which a number of a thruster counts as the one that is off
TORQUE, FORCE = 'external torque', 'external force'
DisturbanceAxes = Literal['body', 'inertial', 'orbit']
# N s / sqrt(s) / kg of the known bodies: random walk of the momentum that stands for a force which is not constant.
_CHANGING_FORCE = 5e-5


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
    """Axes of the external torque and force: body (the base), inertial, or orbit (LVLH of orbit.*)."""


@dataclass(frozen=True)
class ThrusterDeviations:
    """Standard deviations of a thruster from its commands."""

    scale_std: float = parameter(0.0, minimum=0.0)
    """Relative standard deviation of the strength of a thruster, constant, estimated by trajectory; 0: commands are
    exact."""
    direction_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of a thruster's constant misalignment about each axis of its frame; 0: exact."""
    delay_std: float = parameter(0.02, 's', minimum=0.0, maximum=1.0)
    """Standard deviation of a thruster's constant delay after the stamps of its commands; 0: in time."""


@dataclass(frozen=True)
class ThrustConfig(ThrusterDeviations):
    """The commanded thrust on the topic thrust."""

    common_scale_std: float = parameter(0.0, minimum=0.0)
    """Relative standard deviation of the strength that all thrusters share, beside scale_std: the pressure of a common
    supply. A body without joints is known as well as this; 0: none."""
    frames: tuple[str, ...] = parameter(())
    """Frames of the thrusters that have such errors, each its own; empty: the base link if a scale or a direction is
    uncertain, otherwise none."""
    each: Mapping[str, Mapping[str, float]] = by_name(ThrusterDeviations, 'thruster')

    def deviations(self, frame: str) -> tuple[float, float, float]:
        """Return the standard deviations of scale, direction (rad) and delay (s) of a thruster."""
        own = self.each.get(frame, {})
        scale, direction, delay = (own.get(name, getattr(self, name)) for name in _DEVIATIONS)
        return scale, direction, delay


@dataclass(order=True)
class _Command:
    """A wrench from a stamp (ns) on."""

    stamp: int
    wrench: Array = field(compare=False)


class Thrust:
    """Integrates commanded thrust to momentum.

    Parameters
    ----------
    uncertain : frames of thrusters whose thrust may differ from the command

    Attributes
    ----------
    odometry_frame : name of the frame with the inertial axes; empty while unknown
    impulse : (6,) change of (P, L) since the first sample, odometry frame, L about its origin
    commands : number of those used
    late : whether one came after samples that it acts on
    exact : whether one counted as exactly as commanded
    dropped : commands that were not used, by cause
    shared : frame that two publishers seem to command; empty for none
    """

    def __init__(self, model: RobotModel, uncertain: Sequence[str] = ()) -> None:
        self._kinematics = Kinematics(model)
        self._links = {link.name: link for link in model.links}
        self._uncertain = {frame: index for index, frame in enumerate(uncertain)}
        self._columns: Array = np.zeros((len(uncertain), 6, THRUSTER_ERRORS))  # derivatives of `impulse` by the errors
        self._commands: dict[str, list[_Command]] = {}
        self._origin = 0
        self._past: deque[Samples] = deque()  # windows that were used, of the last seconds and the one before
        self.odometry_frame = ''
        self.impulse: Array = np.zeros(6)
        self.commands = 0
        self.late = False
        self.exact = False
        self.dropped: Counter[str] = Counter()
        self.shared = ''
        self._between: Counter[str] = Counter()  # by frame, commands between two of another publisher
        self._components: dict[str, tuple[set[int], set[int]]] = {}  # of its last two commands, those that are not zero

    def affects_samples(self, frame: str, stamp: int, wrench: Array, newest: int | None) -> bool:
        """Return whether samples up to the newest stamp may depend on the arrival of a command."""
        earlier = self._commands.get(frame, [])
        before = earlier[-1] if earlier else _Command(stamp, np.zeros(6))
        over = newest is not None and newest >= before.stamp + HOLD and bool(np.any(wrench))
        return over or stamp < before.stamp or not np.array_equal(wrench, before.wrench)

    def add_command(self, frame: str, stamp: int, wrench: Array, newest: int | None) -> None:
        """Add a command.

        Parameters
        ----------
        frame : a link, or the odometry frame
        stamp : ns, from when on
        wrench : (6,) force, N, and torque about the frame's origin, N m, in its axes
        newest : ns, latest stamp of the other inputs; None before the first
        """
        if not np.all(np.isfinite(wrench)):
            self.dropped[NOT_FINITE_THRUST] += 1
        elif newest is not None and abs(stamp - newest) > _FAR:
            self.dropped[FAR_THRUST] += 1
        elif frame not in self._links and self.odometry_frame not in {'', frame}:
            self.dropped[UNKNOWN_FRAME] += 1
        else:
            self._detect_shared_frame(frame, wrench)
            self._insert(frame, _Command(stamp, wrench))

    def _detect_shared_frame(self, frame: str, wrench: Array) -> None:
        """Detect a frame with alternating forces and torques, without any command of both."""
        before, between = self._components.get(frame, (set(), set()))
        after = set(np.flatnonzero(wrench).tolist())
        self._components[frame] = between, after
        if after and between and before == after and not between & after:
            self._between[frame] += 1
            self.shared = frame if self._between[frame] >= _SHARED else self.shared

    def with_momentum(self, window: Samples, origin: int) -> Samples:
        """Return the next window with the impulse of thrust until each of its samples; `origin` is ns at time 0."""
        self._origin = origin
        self._past.extend([window] if self._past else [window[:1], window])
        while window.time[-1] - self._past[1].time[-1] > _FAR * 1e-9:
            self._past.popleft()
        columns = np.tile(self._columns, (len(window), 1, 1, 1))
        if not self.commands:
            return replace(window, thrust=columns.reshape(len(window), -1)) if self._uncertain else window
        joined = self._joined(self._past[-2], window)
        total = np.tile(self.impulse, (len(window), 1))
        for frame in list(self._commands):
            if frame not in self._links and frame != self.odometry_frame:
                self.dropped[UNKNOWN_FRAME] += len(self._commands.pop(frame))
                continue
            by_errors = np.cumsum(self._pulses(frame, joined), axis=0)
            total += by_errors[..., 0]
            if frame in self._uncertain:
                columns[:, self._uncertain[frame]] += by_errors
            known, oldest = self._commands[frame], origin + round(float(window.time[-1]) * 1e9) - _REMEMBERED
            while len(known) > 1 and known[1].stamp < oldest:  # nothing depends on it any more
                del known[0]
        self.impulse, self._columns = total[-1], columns[-1].copy()
        return replace(window, impulse=total, thrust=columns.reshape(len(window), -1))

    def _insert(self, frame: str, command: _Command) -> None:
        """Add a command, and correct the impulse of windows that were used already."""
        time = (command.stamp - self._origin) * 1e-9
        missed = [self._joined(before, window) for before, window in pairwise(self._past) if window.time[-1] > time]

        def total() -> Array:
            return sum((np.sum(self._pulses(frame, part), axis=0) for part in missed), np.zeros((6, THRUSTER_ERRORS)))

        before = total()
        known = self._commands.setdefault(frame, [])
        insort(known, command)
        if len(known) > LARGEST_BACKLOG:  # no samples come
            del known[0]
            self.dropped[FAR_THRUST] += 1
        self.commands += 1
        self.exact = self.exact or (frame not in self._uncertain and bool(np.any(command.wrench)))
        more = total() - before
        self.impulse = self.impulse + more[:, 0]
        if frame in self._uncertain:
            self._columns[self._uncertain[frame]] += more
        self.late = self.late or bool(np.any(more[:, 0]))

    @staticmethod
    def _joined(before: Samples, window: Samples) -> Samples:
        """Return the last sample before a window, and its samples."""
        return Samples.concatenate([before[-1:], window])

    def _pulses(self, frame: str, samples: Samples) -> Array:
        """Return the changes of (P, L) from each of N samples to the next by the errors of a thruster, (N - 1, 6, 5).

        Scale, turn and delay: the change by the scale is that by the commands themselves.
        """
        impulses = np.diff(self._impulse(frame, samples.time), axis=0)
        delayed = -np.diff(self._wrench(frame, samples.time), axis=0)  # lacking at a late begin, surplus at a late end
        columns = np.concatenate((np.einsum('kij,nj->nik', _BY_ERROR, impulses), delayed[..., None]), axis=2)
        return self._mean_gain(frame, samples) @ columns if np.any(columns) else columns

    def _wrench(self, frame: str, time: Array) -> Array:
        """Return the commanded wrench (N, 6) of a frame just before N times, s."""
        start, length, wrenches = self._schedule(frame)
        return np.asarray(((time[:, None] > start) & (time[:, None] <= start + length)) @ wrenches)

    def _impulse(self, frame: str, time: Array) -> Array:
        """Return the impulses (N, 6), in the frame's axes, of its commands from the first sample until N times, s."""
        start, length, wrenches = self._schedule(frame)
        # The initial momentum of the run includes impulses before the first sample.
        passed = np.clip(time[:, None] - start, 0.0, length) - np.clip(-start, 0.0, length)
        return np.asarray(passed @ wrenches)

    def _schedule(self, frame: str) -> tuple[Array, Array, Array]:
        """Return when the commands of a frame begin, s, how long each of them holds, s, and their wrenches (c, 6)."""
        commands = self._commands.get(frame, [])
        start = np.array([command.stamp - self._origin for command in commands]) * 1e-9
        length = np.minimum(np.diff(start, append=np.inf), HOLD * 1e-9)
        return start, length, np.array([command.wrench for command in commands]).reshape(-1, 6)

    def _mean_gain(self, frame: str, samples: Samples) -> Array:
        """Return d(P, L)/dt by a wrench in a frame, mean over each of N samples and the next, (N - 1, 6, 6)."""
        gain = np.zeros((len(samples), 6, 6))
        gain[:] = np.eye(6)
        link = self._links.get(frame)
        if link is not None:
            configuration = self._kinematics.configure(samples.base_rotation, samples.joint_position)
            rotation, position = configuration.link_pose(link)
            gain[:, :3, :3] = gain[:, 3:, 3:] = rotation
            gain[:, 3:, :3] = skew(samples.base_position + position) @ rotation
        return np.asarray(0.5 * (gain[1:] + gain[:-1]))


def constant_force(axes: str) -> str:
    """Return the likely sources of a constant force and torque, by its axes."""
    acting = {
        'inertial': 'inertial axes, at the common centre of mass: a tilted table, drag or gravity in orbit',
        'inertial on the base': 'inertial axes, on the base: a cable, or a leak',
        'body': 'base axes: a leak or thrust',
    }
    return f'a force or torque that is constant in {acting[axes]}'


@dataclass(frozen=True)
class DisturbanceModel:
    """How a force or torque from outside varies."""

    deviation: float = 0.0  # N or N m, standard deviation along each axis; 0 is none
    # s, time constant of the first-order Gauss-Markov process that each component is; 0: constant in a motion
    time: float = 0.0
    axes: DisturbanceAxes = 'body'  # in which it is constant or varies; those of the orbit are LVLH
    orbit: Orbit | None = None  # whose axes these are, its epoch at the begin of the run

    def rotation(self, time: Array, base: Array) -> Array:
        """Return the (B, 3, 3) rotations from its axes to inertial ones, (B,) s after the begin; `base` of the base."""
        if self.axes == 'body':
            return base
        if self.axes == 'inertial' or self.orbit is None:
            return np.broadcast_to(np.eye(3), base.shape)
        down = -self.orbit.zenith_at(time)
        across = np.broadcast_to(-self.orbit.normal, down.shape)
        return np.stack((cross(across, down), across, down), axis=-1)


@dataclass(frozen=True, eq=False)
class ExternalTorque(Disturbance):
    """A torque, (3,) N m; another one in every motion."""

    model: DisturbanceModel

    words: ClassVar = {
        TORQUE: Words(
            'external torques',
            'disturbance.torque_std',
            'an external torque: shield it, or record longer (disturbance.torque_std)',
            lambda name, value: (
                f'a torque of {np.linalg.norm(value):.2g} N m {_varying(name)}: find its source, or raise '
                'disturbance.torque_std'
            ),
        )
    }
    redrawn_per_motion = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return it as uncertain as it is large."""
        del kernel
        kind, unit = ('force', 'N') if cause.startswith(FORCE) else ('torque', 'N m')
        return wider_prior(
            f'a {kind} of {with_band(value, std)} {unit} acts from outside', f'disturbance.{kind}_std', value, std, unit
        )

    pushes = True

    @property
    def time_constants(self) -> Array:
        """The time constant of each component; inf where it is constant."""
        return np.full(self.count, self.model.time or np.inf)

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each component."""
        del origin
        rates = np.zeros((len(whole), 6, 3))
        rates[:, 3:] = self.model.rotation(time, rotation)
        return rates

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the one about the normal."""
        if self.model.axes == 'body':
            return np.asarray(detector.plane_of_body(0).normal[:, None])
        return detector.equation_selection()[2:, 3:].T


@dataclass(frozen=True, eq=False)
class ExternalForce(ExternalTorque):
    """A force, (3,) N, through the common centre of mass; another one in every motion. Its lever arm is a torque."""

    words: ClassVar = {
        FORCE: Words(
            'external forces',
            'disturbance.force_std',
            'an external force: shield it, or record longer (disturbance.force_std)',
            lambda name, value: (
                f'a force of {np.linalg.norm(value):.2g} N {_varying(name)}: find its source, or raise '
                'disturbance.force_std'
            ),
        )
    }

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each component."""
        del origin
        axes, centre = self.model.rotation(time, rotation), whole[:, 1:4] / whole[:, :1]
        return np.concatenate((axes, skew(centre) @ axes), axis=1)

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the two in the plane."""
        if self.model.axes == 'body':
            return np.asarray(detector.plane_of_body(0).axes.T)
        return detector.equation_selection()[:2, :3].T


def _varying(name: str) -> str:
    return f'from outside varies with {name}' if name else 'acts from outside'


def disturbances(torque: DisturbanceModel, force: DisturbanceModel) -> tuple[ExternalTorque, ExternalForce]:
    """Return a torque and a force from outside as unknowns."""
    labels = (
        (f'{kind}:{push.time:g} s' if push.time else kind,) * 3 for kind, push in ((TORQUE, torque), (FORCE, force))
    )
    factors = (diagonal(np.full(3, push.deviation)) for push in (torque, force))
    one, other = zip(factors, labels, (torque, force), strict=True)
    return ExternalTorque(*one), ExternalForce(*other)


def disturbance_repair(cause: str, torque: DisturbanceModel, force: DisturbanceModel) -> Repair:
    """Return a torque and a force that vary, each with a level and a time, as the repair of a cause."""
    parameters: dict[str, Setting] = {}
    for kind, push in (('torque', torque), ('force', force)):
        if push.deviation > 0.0:
            parameters |= {f'disturbance.{kind}_std': push.deviation, f'disturbance.{kind}_time': push.time}
    level = torque.deviation or force.deviation
    return Repair(cause, parameters, value=level, unit='N m' if torque.deviation > 0.0 else 'N')


@dataclass(frozen=True, eq=False)
class Thrusters(Unknown):
    """Scale, turn (rad, in the axes of its frame) and delay (s) of each thruster less those of its command."""

    frames: tuple[str, ...]  # names of the thrusters

    words: ClassVar = {
        'thrust': Words(
            'the thrusters',
            'thrust.scale_std',
            'the thrust of {}: calibrate it, or log its pressure (thrust.scale_std)',
            lambda name, value: f'{_deviation(name, value)}: check its valve, or set thrust.{name}.scale_std',
        )
    }

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the thruster's scale, direction and delay as uncertain as they are off."""
        del kernel
        name = cause.partition(':')[2]
        first = self.labels.index(cause)
        declared = np.sqrt(np.sum(self.factor[first : first + THRUSTER_ERRORS] ** 2, axis=1))
        off = [np.max(np.abs(value[part]) / np.maximum(declared[part], 1e-9)) for part in _PARTS]
        parts = [k for k in range(len(_PARTS)) if off[k] > min(_OFF, max(off))] or [int(np.argmax(off))]
        wider = {f'thrust.{name}.{_DEVIATIONS[k]}': widened(float(np.max(np.abs(value[_PARTS[k]])))) for k in parts}
        return Repair(_deviation(name, value, std), wider, value=float(value[0]), std=float(std[0]))

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the momentum (P, L) that they have brought, which is subtracted to leave a constant."""
        del kernel
        return -np.moveaxis(states.thrust, 1, 2).reshape(len(states.thrust), 6, THRUSTER_ERRORS * len(self.frames))

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these thrusters."""
        return replace(nominal, thrust=nominal.thrust + value if nominal.thrust.size else value)


def _deviation(name: str, value: Array, std: Array | None = None) -> str:
    """Return by how much a thruster is off its commands, from its numbers (5,)."""
    band = '' if std is None else f' ± {100.0 * BAND * std[0]:.2g}'
    return f'{name} has {100.0 * (1.0 + value[0]):.3g}{band} % of its commanded thrust'


@dataclass(frozen=True, eq=False)
class ThrustSupply(Unknown):
    """Relative error of the strength of all thrusters, as by the pressure of their supply."""

    frames: int  # number of thrusters

    words: ClassVar = Thrusters.words

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return it as uncertain as it is off."""
        del cause, kernel
        text = f'all thrusters have {100.0 * (1.0 + value[0]):.3g} ± {100.0 * BAND * std[0]:.2g} % of their thrust'
        return wider_prior(text, 'thrust.common_scale_std', value, std)

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the momentum that all have brought, which is subtracted to leave a constant."""
        del kernel
        return -np.sum(states.thrust[..., :1], axis=1)

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these thrusters."""
        scale = np.tile([1.0, *(0.0,) * (THRUSTER_ERRORS - 1)], self.frames) * value
        return replace(nominal, thrust=nominal.thrust + scale if nominal.thrust.size else scale)


def thrusters(frames: Sequence[str], deviations: Sequence[tuple[float, float, float]]) -> Thrusters:
    """Return thrusters by their frames as an unknown, with standard deviations of each.

    These are relative, rad about each axis, and s; 0 is exact.
    """
    numbers = [each for scale, direction, delay in deviations for each in (scale, *(direction,) * 3, delay)]
    labels = tuple(f'thrust:{frame}' for frame in frames for _ in range(THRUSTER_ERRORS))
    return Thrusters(diagonal(numbers), labels, tuple(frames))


def _constant_force(axes: Axes, where: str, what: str) -> Hypothesis:
    name = f'a constant force or torque acts, in {where}'
    declared = 'body' if axes == 'body' else 'inertial'
    return Hypothesis(name, f'{name}: {what}; set disturbance.constant to {declared}', force=axes)


INERTIAL_FORCES = (
    _constant_force('inertial', 'inertial axes, at the common centre of mass', 'a tilted table, or drag'),
    _constant_force('inertial on the base', 'inertial axes, on the base', 'a cable, or a leak'),
)


BODY_FORCE = _constant_force('body', 'base axes', 'a leak or thrust, or unreported wheels spin up')


def drifting_momentum(known_mass: float) -> Hypothesis:
    """Return the momentum of a robot with known bodies of a mass, kg, as a random walk."""
    return Hypothesis(
        'the momentum drifts',
        'an unreported part moves (wheels, an arm, fuel), or a changing force acts: the momentum drifts; publish the '
        'part, or set disturbance.torque_std and disturbance.torque_time',
        momentum=_CHANGING_FORCE * known_mass,
        physical=False,
    )


def wrench_of(message: Any) -> tuple[str, int, Array]:
    """Return frame, stamp (ns) and (6,) force and torque (N, N m) of a WrenchStamped."""
    force, torque = message.wrench.force, message.wrench.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z], dtype=float)
    return message.header.frame_id.lstrip('/'), stamp_of(message), values


def uncertain_thrusters(config: ThrustConfig, model: RobotModel) -> tuple[str, ...]:
    """Return the frames of thrusters whose strength and direction are estimated.

    Raises ModelError, ParameterError: A frame is no link, named twice, or has deviations without being named.
    """
    frames = config.frames or tuple(config.each)
    foreign = [name for name in config.each if name not in frames]
    if foreign:
        raise ParameterError(
            f"parameter 'thrust.{foreign[0][:60]}' is of no thruster; accepted: {listing(frames)}, of thrust.frames"
        )
    if config.scale_std == config.common_scale_std == config.direction_std == 0.0 and not frames:
        return ()
    if len(set(config.frames)) < len(config.frames):
        raise ParameterError(
            f"parameter 'thrust.frames' is {listing(config.frames)}; accepted: links of the robot, each once"
        )
    return tuple(model.link(name).name for name in frames or (model.base_link,))


def declared_thrusters(config: ThrustConfig, model: RobotModel) -> tuple[Thrusters, ThrustSupply]:
    """Return the thrusters, and what they share.

    Raises ModelError, ParameterError: As of `uncertain_thrusters`.
    """
    frames = uncertain_thrusters(config, model)
    each = thrusters(frames, [config.deviations(frame) for frame in frames])
    return each, ThrustSupply(diagonal([config.common_scale_std]), ('thrust',), len(frames))


def declared_disturbances(
    config: DisturbanceConfig, orbit: OrbitConfig, window: float, *, located: bool
) -> tuple[ExternalTorque, ExternalForce]:
    """Return a torque and a force from outside; no force where nothing locates the base.

    Raises ParameterError: They vary within a window (s), or have the axes of no orbit.
    """
    torque = _pushing(config, 'torque', orbit, window)
    return disturbances(torque, _pushing(config, 'force', orbit, window) if located else DisturbanceModel())


def _pushing(config: DisturbanceConfig, kind: str, declared: OrbitConfig, window: float) -> DisturbanceModel:
    """Return how a force or torque from outside varies; a time that windows cannot show, or no orbit, is refused."""
    deviation, time = getattr(config, f'{kind}_std'), getattr(config, f'{kind}_time')
    if 0.0 < time < window:
        raise ParameterError(
            f"parameter 'disturbance.{kind}_time' is {time:g} s; accepted: 0, or at least window, {window:g} s"
        )
    axes = cast('DisturbanceAxes', config.axes)
    orbit = make_orbit(declared) if axes == 'orbit' else None
    if axes == 'orbit' and (orbit is None or declared.epoch > 0.0):
        raise ParameterError(
            "parameter 'disturbance.axes' is 'orbit'; accepted with orbit.mean_motion above 0 and orbit.epoch 0"
        )
    return DisturbanceModel(deviation, time, axes, orbit)
