"""Passive joints (panels, propellant, a compliant grasp): parameters, errors of springs, warnings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mbaid_ros.core.contracts import NominalModel, Unknown, Words, diagonal
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.estimate import PassiveJoint
from mbaid_ros.core.results.verdict import Reason
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import MomentumKernel, Springs
from mbaid_ros.core.state import Layout
from mbaid_ros.core.windows import Window
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.parameters import by_name, parameter

FREQUENCY, DAMPING, SWING, DISTURBANCE = 'frequency', 'damping', 'swing', 'disturbance'
# Standard deviation of the phase, rad, up to which a frequency is resolved: beyond it, the sum of squares has more than
# one minimum within a few deviations. Times 1/(rate ratio) that a swing keeps its phase.
_RESOLVED, _COHERENT = 0.35, 3.0
_SLOWEST = 1e-3  # damping ratio, as which less counts: the amplitudes' time constant is finite
_FAR = 3.0  # standard deviations of its specified value, beyond which a frequency is another thing's
_NEW_JOINT = (
    'add to the URDF <joint name="panel" type="revolute"> with origin, axis, <parent link="base_link"/> and '
    '<child link="panel"/>, a link with its inertial, and '
)


@dataclass(frozen=True)
class PassiveJointConfig:
    """Spring and damper of a single passive joint, which act towards its zero."""

    frequency: float = parameter(0.0, 'Hz', minimum=0.0, maximum=1e3)
    """Natural frequency of this joint with everything else fixed (cantilever); required for every joint of
    flexible.joints."""
    frequency_relative_std: float = parameter(0.05, minimum=0.0, maximum=0.5)
    """Relative standard deviation of the natural frequency; 0: exact."""
    damping: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Damping ratio, a fraction of critical."""
    damping_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Standard deviation of the damping ratio; 0: exact."""
    initial_std: float = parameter(0.05, 'rad', minimum=0.0)
    """Standard deviation of the deflection at the start (m for a prismatic joint); that of the rate follows from the
    frequency. 0: at rest at zero."""
    disturbance_std: float = parameter(1e-4, 'rad', minimum=0.0)
    """Standard deviation of an unmodelled deflection (m for a prismatic joint), as from a nonlinear spring or encoder
    noise. 0: none."""


@dataclass(frozen=True)
class FlexibleConfig:
    """Passive joints."""

    joints: tuple[str, ...] = parameter(())
    """Joints of the URDF on a spring, which no JointState reports: panels, booms, propellant, an elastic grasp."""
    each: Mapping[str, Mapping[str, float]] = by_name(PassiveJointConfig, 'joint')

    def passive(self, joint_names: tuple[str, ...]) -> dict[str, PassiveJointConfig]:
        """Return the passive joints by their names.

        Raises ParameterError: A name is no joint's, or a joint has no frequency.
        """
        for name in self.joints:
            if name not in joint_names or self.joints.count(name) > 1:
                raise ParameterError(
                    f"parameter 'flexible.joints' has '{name[:60]}'; accepted: {listing(joint_names)}, each once"
                )
        foreign = [name for name in self.each if name not in self.joints]
        if foreign:
            raise ParameterError(
                f"parameter 'flexible.{foreign[0][:60]}' is of no joint in 'flexible.joints'; accepted: "
                f'{listing(self.joints) or "none"}'
            )
        found = {name: PassiveJointConfig(**self.each.get(name, {})) for name in self.joints}
        still = [name for name, joint in found.items() if joint.frequency == 0.0]
        if still:
            raise ParameterError(f"parameter 'flexible.{still[0]}.frequency' is 0 Hz; accepted: above 0")
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class _OfSprings(Unknown):
    """Numbers of passive joints; where they are held, windows are linearised at their declaration."""

    held: bool = False
    in_equations = False

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return zero where it is held."""
        del deviation
        return np.zeros_like(value) if self.held else value

    def eased(self, part: float, unknowns: Sequence[Unknown]) -> Unknown:
        """Return it held in the loosest stage, which begins as declared; itself where no swing at the start is free."""
        return self if _at_the_start(unknowns) is None else replace(self, held=part >= 1.0)


@dataclass(frozen=True, eq=False)
class SpringErrors(_OfSprings):
    """Of each passive joint: relative error of its natural frequency, and error of its damping ratio.

    Attributes
    ----------
    joints : names
    """

    joints: tuple[str, ...]

    words: ClassVar = {
        FREQUENCY: Words(
            'the frequencies of passive joints',
            'flexible.<joint>.frequency_relative_std',
            'the frequency of {}: measure it (flexible)',
            lambda name, value: f'the frequency of {name} is off by {100.0 * np.sum(value):+.3g} %: correct flexible',
        ),
        DAMPING: Words(
            'the damping of passive joints',
            'flexible.<joint>.damping_std',
            'the damping of {}: measure it (flexible)',
            lambda name, value: f'the damping ratio of {name} is off by {np.sum(value):+.2g}: correct flexible',
        ),
    }

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these springs, or with the joints held; a damper never drives."""
        springs, each = nominal.kernel.springs, value.reshape(-1, 2)
        if not springs.count:
            return nominal
        rate = springs.frequency * np.exp(each[:, 0])
        ratio = np.maximum(springs.damping_ratio + each[:, 1], 0.0)
        return replace(
            nominal, kernel=nominal.kernel.with_springs(replace(springs, frequency=rate, damping_ratio=ratio))
        )


@dataclass(frozen=True, eq=False)
class StartingSwing(_OfSprings):
    """Of each passive joint: deflection (rad or m) and rate at the first instant after a gap or the start."""

    words: ClassVar = {SWING: Words('the swing of passive joints at the start', 'flexible.<joint>.initial_std')}
    redrawn_per_motion = True
    redrawn_after_gap = True

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this start, or with the joints held."""
        springs = nominal.kernel.springs
        if not springs.count:
            return nominal
        state = springs.initial_state + value.reshape(-1, 2).T
        return replace(nominal, kernel=nominal.kernel.with_springs(replace(springs, initial_state=state)))


def _at_the_start(unknowns: Sequence[Unknown]) -> Array | None:
    """Return the factor (2 f, e) of the swing at the start; None where it is exact."""
    return next((each.factor for each in unknowns if isinstance(each, StartingSwing)), None)


@dataclass(frozen=True, eq=False)
class SwingNoise(Unknown):
    """Unmodelled excitation of each passive joint, as two quadratures of a swing, Gauss-Markov processes.

    White noise drives a spring with a damper to a swing whose amplitudes are first-order Gauss-Markov processes, with
    the time constant of the damping.

    Attributes
    ----------
    correlation : (e,) s, time constant of each independent number
    """

    correlation: Array

    words: ClassVar = {
        DISTURBANCE: Words('unmodelled excitation of passive joints', 'flexible.<joint>.disturbance_std')
    }
    in_equations = False
    noise_driven = True

    @property
    def time_constants(self) -> Array:
        """Time constants of the amplitudes."""
        return self.correlation

    def process_variances(self, rates: Array) -> Array:
        """Return the variances (B, e) that white noise adds to the amplitudes, and rates (B, f) of that size to joints.

        Either amplitude takes half.
        """
        joints = np.argmax(np.abs(self.factor), axis=0) // 2
        sizes = np.sqrt(np.sum(self.factor[1::2] ** 2, axis=1))
        return np.asarray(0.5 * (rates[:, joints] / sizes[joints]) ** 2)

    def eased(self, part: float, unknowns: Sequence[Unknown]) -> Unknown:
        """Return it for a swing that changes by part of its start at least."""
        start = _at_the_start(unknowns)
        if start is None or start.shape != self.factor.shape:
            return self
        return replace(self, factor=np.maximum(self.factor, part * start))

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model as it is: windows are linearised without."""
        del value
        return nominal

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return zero."""
        del deviation
        return np.zeros_like(value)


def resolved(rates: Array, ratios: Array, relative: Array, seconds: float) -> Flags:
    """Return which frequencies (f,) are resolved after a time, with relative standard deviations; rates in rad/s."""
    times = np.minimum(seconds, _COHERENT / (np.maximum(ratios, _SLOWEST) * rates))
    return np.asarray(relative * rates * times < _RESOLVED)


def swing_noise(
    joints: Sequence[str],
    deviations: Sequence[float] | Array,
    rates: Sequence[float] | Array,
    ratios: Sequence[float] | Array,
) -> SwingNoise:
    """Return it as an unknown: stationary standard deviations of deflections, rad or m; rates, rad/s; ratios."""
    each, rate = np.asarray(deviations, dtype=float), np.asarray(rates, dtype=float)
    factor = diagonal(np.column_stack((each, each * rate)).ravel())
    labels = tuple(f'{DISTURBANCE}:{name}' for name in joints for _ in range(2))
    times = np.repeat(1.0 / (np.maximum(ratios, _SLOWEST) * rate), 2)[np.repeat(each > 0.0, 2)]
    return SwingNoise(factor, labels, times)


def spring_errors(
    joints: Sequence[str], frequencies: Sequence[float] | Array, ratios: Sequence[float] | Array
) -> SpringErrors:
    """Return them as an unknown: relative standard deviations of frequencies, and those of damping ratios."""
    labels = tuple(f'{kind}:{name}' for name in joints for kind in (FREQUENCY, DAMPING))
    return SpringErrors(diagonal(np.column_stack((frequencies, ratios)).ravel()), labels, joints=tuple(joints))


def starting_swing(
    joints: Sequence[str], deviations: Sequence[float] | Array, rates: Sequence[float] | Array
) -> StartingSwing:
    """Return it as an unknown: standard deviations of deflections, rad or m; natural frequencies, rad/s."""
    each = np.asarray(deviations, dtype=float)
    labels = tuple(f'{SWING}:{name}' for name in joints for _ in range(2))
    return StartingSwing(diagonal(np.column_stack((each, each * np.asarray(rates))).ravel()), labels)


def passive_joints(
    estimated: Iterable[tuple[SpringErrors, Array, Array]], kernel: MomentumKernel, deflections: Array, resolved: Flags
) -> tuple[PassiveJoint, ...]:
    """Return the passive joints as estimated, those not resolved as declared; see `PassiveJoint.all_of`."""
    springs = kernel.springs
    value, std, prior = np.zeros((3, springs.count, 2))
    for unknown, *numbers in estimated:
        value, std, prior = (each.reshape(-1, 2) for each in (*numbers, np.linalg.norm(unknown.factor, axis=1)))
    names = [kernel.model.joint_names[joint] for joint in springs.joints]
    declared = springs.frequency, springs.damping_ratio, prior
    return PassiveJoint.all_of(names, declared, value, std, deflections, resolved)


def implausible_springs(mean: Array, layout: Layout, joints: Sequence[PassiveJoint], resolved: Flags) -> list[Reason]:
    """Return why passive joints contradict their declaration, by the estimated state (s,).

    `resolved` (f,): whose frequency the data resolve.
    """
    model, springs = layout.kernel.model, layout.kernel.springs
    reasons = []
    away, found = {}, springs.frequency / (2.0 * np.pi)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors):
            away = dict(zip(unknown.causes, mean[place].tolist(), strict=True))
            found = found * np.exp((unknown.factor @ mean[place])[::2])
    for joint, index, rate, hertz, seen in zip(joints, springs.joints, springs.frequency, found, resolved, strict=True):
        far = abs(away.get(f'{FREQUENCY}:{joint.joint}', 0.0))
        if far > _FAR and seen:
            text = (
                f'{joint.joint} would swing at {hertz:.3g} Hz, {far:.1f} standard deviations from '
                f'flexible.{joint.joint}.frequency, {rate / (2.0 * np.pi):.3g} Hz: correct it, or something else swings'
            )
            reasons.append(Reason(text, 'contradiction', 0.5 * far**2))
        limit = model.limits[index]
        lower, upper = (limit.lower, limit.upper) if limit.upper > limit.lower else (-np.inf, np.inf)
        if joint.deflection > min(upper, -lower):
            text = (
                f'{joint.joint} would swing by {joint.deflection:.3g} rad (m), beyond its limits in the URDF, '
                f'{lower:.3g} to {upper:.3g}: something else moves'
            )
            reasons.append(Reason(text, 'contradiction', 0.5 * _FAR**2))
    return reasons


def soft_grasp_warnings(kernel: MomentumKernel) -> list[str]:
    """Return a warning of each passive joint between base and target."""
    names = kernel.model.joint_names
    return [
        f'{names[joint]} is passive and carries the target: encoder noise drives its swing, so its frequency and '
        'damping stay as set'
        for joint, carries in zip(kernel.springs.joints, joints_carrying_target(kernel), strict=True)
        if carries
    ]


def joints_carrying_target(kernel: MomentumKernel) -> Flags:
    """Return which passive joints (f,) lie between base and target: 3 Hz of one were found 9.7 deviations off."""
    return np.asarray(kernel.kinematics.ancestors[kernel.target.body, list(kernel.springs.joints)], dtype=bool)


def resolved_frequencies(layout: Layout, deviation: Array, seconds: float) -> Flags:
    """Return which passive joints' frequencies (f,) the data of some seconds resolve, the state to (s,) deviations."""
    springs = layout.kernel.springs
    relative: Array = np.zeros(springs.count)
    if not springs.count:
        return relative > 0.0
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors):
            relative = np.abs(unknown.factor @ deviation[place])[::2]
    return resolved(springs.frequency, springs.damping_ratio, relative, seconds)


def swinging_text(frequency: float, windows: Sequence[Window], names: Sequence[str]) -> str:
    """Return that something swings (Hz), with the lines to add: for a joint that reads zero always, or a new one."""
    unread = np.all([np.all(each.knots.joint_position == 0.0, axis=0) for each in windows], axis=0)
    joint = next((name for name, flag in zip(names, unread.tolist(), strict=True) if flag), '')
    name, urdf = joint or 'panel', '' if joint else _NEW_JOINT
    return (
        f'something swings at {frequency:.2g} Hz: a panel, fuel or a flexible part, not rigid; {urdf}set '
        f'flexible.joints: [{name}], flexible.{name}.frequency: {frequency:.2g}'
    )


def springs(config: FlexibleConfig, model: RobotModel) -> Springs:
    """Return the springs of passive joints as declared.

    Raises ParameterError: A name is no joint's, a joint has no frequency, or mimics another.
    """
    passive = config.passive(model.joint_names)
    followers = [name for name in passive if name not in model.independent_joints]
    if followers:
        raise ParameterError(
            f"parameter 'flexible.joints' has '{followers[0]}', which mimics another joint; accepted: "
            f'{listing(model.independent_joints)}'
        )
    return Springs(
        tuple(model.joint_names.index(name) for name in passive),
        2.0 * np.pi * np.array([joint.frequency for joint in passive.values()]),
        np.array([joint.damping for joint in passive.values()]),
        np.zeros((2, len(passive))),
    )


def declared_springs(config: FlexibleConfig, kernel: MomentumKernel) -> tuple[Unknown, ...]:
    """Return the springs of passive joints, how these swing at the start, and what else excites them."""
    own, passive = kernel.springs, config.passive(kernel.model.joint_names).values()
    if not own.count:
        return ()
    names = [kernel.model.joint_names[joint] for joint in own.joints]
    return (
        spring_errors(
            names, [joint.frequency_relative_std for joint in passive], [joint.damping_std for joint in passive]
        ),
        starting_swing(names, [joint.initial_std for joint in passive], own.frequency),
        swing_noise(names, [joint.disturbance_std for joint in passive], own.frequency, own.damping_ratio),
    )
