"""Windows linearised: the twist predicted from the momentum, integrated along a window, all rows whitened."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.contracts import Axes, Carried, Course, Motion, Observation, Sensor, Stack, stacked
from mbaid_ros.core.geometry import Array, Integers, composed, cross, exp, skew, unvec
from mbaid_ros.core.joints.model import JointNoise, by_deflections, errors_in_variables_bias, joint_noise
from mbaid_ros.core.odometry.model import (
    BorderNoise,
    IntegratedTwist,
    Measurement,
    Twist,
    at_knots,
    integral_weights,
    integrated_twist,
    integrated_twist_rows,
    mean_over_knots,
    mean_twist,
    parabolic_weights,
    pose_measurement,
    rate_measurement,
    state_rows,
    telescoped,
    total,
)
from mbaid_ros.core.robot.model import Configuration, express
from mbaid_ros.core.robot.momentum import (
    THRUSTER_ERRORS,
    BodyStates,
    MomentumKernel,
    about_points,
    inverse_inertia_and_joint_momentum,
    link_columns,
    summed_over_bodies,
)
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.state import BODY, MOMENTUM, POSE, Layout, Point, Variables
from mbaid_ros.core.swing import (
    BESIDE,
    Motions,
    PassiveColumns,
    PassiveInertias,
    PassiveMotion,
    SwingTrajectory,
    passive_columns,
    spring_constants,
)
from mbaid_ros.core.windows import ANGULAR_FIRST, Bodies, Midpoints, Prediction, Window, gradient

_IDENTITY = np.eye(6)
TWIST = Twist()
_ACTING: tuple[Axes, ...] = ('inertial', 'inertial on the base', 'body')
LINEARISED = 5  # work of linearising a window, in steps of the filter
TOGETHER = 8  # windows linearised at once: singly a replay takes a sixth longer, by 32 no less


def total_momentum(middle: Midpoints, point: Point, known: Array, impulses: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the total (P, L_b) at N instants, (N, 3) each: that of the point, thrust and orbit included.

    Parameters
    ----------
    middle, point : Midpoints, Point
    known : (n + 1, 10) standard parameters of all bodies
    impulses : columns of gravity and of thrusters that deviate from their commands
    """
    parameters, (gravity_columns, thrust) = point.parameters, impulses
    linear, angular = parameters[:3] + middle.impulse[:, :3], parameters[3:6] + middle.impulse[:, 3:]
    about_base = angular - cross(middle.base_position, linear)
    parts = [(gravity_columns, known)] if gravity_columns.shape[1] else []
    if thrust.shape[1] and point.nominal.thrust.any():
        parts.append((thrust, point.nominal.thrust.reshape(-1, THRUSTER_ERRORS)))
    for columns, numbers in parts:
        more = summed_over_bodies(columns, numbers)
        linear, about_base = linear + more[:, :3], about_base + more[:, 3:]
    return linear, about_base


def predict(layout: Layout, middle: Midpoints, point: Point, along: Array | None = None) -> tuple[Prediction, Bodies]:
    """Return the twist that conservation predicts at midpoints, and the bodies of a robot that moves so.

    Parameters
    ----------
    layout : of the state
    middle : Midpoints of N intervals, as the point's nominal model corrects them
    point : its momentum is that before any known thrust or orbit, L about the run's origin
    along : (N, f) s of passive joints, whose rates follow and are zero in `middle`; None without any
    """
    parameters, kernel = point.parameters, point.nominal.kernel
    target, kinematics = kernel.target, kernel.kinematics
    known = kernel.body_parameters(parameters[6:16])
    placed = kinematics.configure(middle.base_rotation, middle.joint_position)
    body_twist = kinematics.body_twists(placed, middle.joint_velocity, np.zeros((len(middle), 6)))
    expressed = express(known, placed.rotation, placed.position)
    inverse_inertia, moving = inverse_inertia_and_joint_momentum(
        kernel, middle.stored, expressed, placed, body_twist, layout.plane
    )
    gravity_columns = about_points(middle.gravity_columns, middle.base_position)
    thrust = about_points(middle.thrust, middle.base_position, THRUSTER_ERRORS)
    linear, about_base = total_momentum(middle, point, known, (gravity_columns, thrust))
    total = np.concatenate((linear, about_base), axis=1) - moving
    motion: PassiveMotion | None = None
    if along is None:
        twist: Array = (inverse_inertia @ total[..., None])[..., 0]
        body_twist += twist[:, None]
    else:
        joints = list(kernel.springs.joints)
        deflection = middle.joint_position[:, joints] - point.nominal.zeros[joints]
        inertias = PassiveInertias.from_bodies(kernel, expressed, placed, inverse_inertia)
        state, constants = (deflection, along), spring_constants(kernel, known)
        motion = PassiveMotion.from_state(kernel, inertias, expressed, (body_twist, total), state, constants)
        twist, body_twist = motion.twist, motion.body_twist
    states = BodyStates(
        placed,
        body_twist,
        expressed,
        *placed.link_pose(target),
        body_twist[:, target.body],
        kernel.storage,
        middle.stored,
        gravity_columns,
        thrust,
    )
    right = _right_hand_sides(layout, kernel, states, middle.base_position, (linear, about_base))
    passive: PassiveColumns | None = None
    if motion is None:
        solved: Array = inverse_inertia @ right
    else:
        solved, passive = passive_columns(layout, point, states, motion, right, deflection)
        inverse_inertia = motion.inertias.free_mobility
    return Prediction(twist, solved[..., :-6], solved[..., -6:]), Bodies(known, inverse_inertia, states, passive)


def _right_hand_sides(
    layout: Layout, kernel: MomentumKernel, states: BodyStates, position: Array, total: tuple[Array, Array]
) -> Array:
    """Return minus the change of the momentum at fixed twists, (N, 6, u + 6), by parameters and the base's pose error.

    `position` (N, 3) of the base, `total` (P, L_b), (N, 3) each.
    """
    linear, about_base = total
    # M V + b = h_b, so M dV = dh - (dM V + db): the latter is the change of the predicted motion's momentum.
    count = 16 + sum(each.count for each in layout.predicted)
    right = np.zeros((len(position), 6, count + 6))
    right[..., :6] = np.eye(6)
    right[:, 3:, :3] = -skew(position)
    right[..., 6:16] = -states.regressor
    if states.gravity_columns.shape[1]:
        right[..., 6:16] += link_columns(states.gravity_columns, kernel.target)
    column = 16
    for unknown in layout.predicted:
        columns = unknown.momentum_columns(kernel, states)
        if columns is not None:
            right[..., column : column + unknown.count] = -columns @ unknown.factor
        column += unknown.count
    # A turn theta of the base turns M and b, and the momentum stays: M^-1 (P x theta, L_b x theta + P x rho).
    turned = skew(linear)
    right[:, :3, count : count + 3] = turned
    right[:, 3:, count : count + 3] = skew(about_base)
    right[:, 3:, count + 3 :] = turned
    return right


def twist_motion(
    stack: Stack, predicted: Prediction, motion: tuple[Midpoints, slice], slope: Array, weights: Array | None = None
) -> Motion:
    """Return the motion of a stack's windows as twists are read; weights (m,) as of `mean_twist`."""
    around, inside = motion
    weights = parabolic_weights(inside.stop - inside.start) if weights is None else weights
    weight, change, inner = weights[:, None, None], stack.whitening, predicted.twist[inside]
    # A chain that is tau late has xi = -tau (w, v): F times that remains, and the joints' own delay.
    linear = slope[..., :3] - cross(inner[..., 3:], inner[..., :3])
    rotation, axes = at_knots(around.base_rotation, inside), around.base_rotation[inside]
    twist = mean_over_knots(at_knots(predicted.twist, inside), change)[..., ANGULAR_FIRST]
    return Motion(
        time=stack.middles,
        origin=stack.windows[0].origin,
        position=mean_over_knots(at_knots(around.base_position, inside), change),
        rotation=mean_over_knots(rotation, change[..., None]),
        twist=twist,
        slope=total(weight * np.concatenate((slope[..., 3:], linear), axis=-1)),
        rate=twist,
        axes=total(weight[..., None] * axes),
        turning=total(weight[..., None] * (skew(inner[..., 3:]) @ axes)),
        sliding=total(weight[..., None] * (skew(inner[..., :3]) @ axes)),
    )


def reading_columns(layout: Layout, sensor: str, motion: Motion) -> Array:
    """Return the derivatives (B, r, e) of what a sensor reads by the independent numbers of the readings' unknowns."""
    columns = [np.zeros((*motion.slope.shape, 0))]
    for unknown in layout.of_measurement:
        more = unknown.measured(sensor, motion)
        columns.append(np.zeros((*motion.slope.shape, unknown.count)) if more is None else more @ unknown.factor)
    return np.concatenate(columns, axis=-1)


def _position_noise(layout: Layout, motion: Motion, covariance: Array) -> Array:
    """Return the covariance (B, 6, 6, r) of the noise of poses, (B, 6, 6) each, with that of their columns.

    Columns are linear in the position that is read.
    """
    corners = np.broadcast_to(np.eye(4, 3)[:, None], (4, len(covariance), 3))  # a metre along each axis, and the origin
    columns = np.stack([reading_columns(layout, 'pose', replace(motion, position=corner)) for corner in corners])
    return np.asarray(np.einsum('bik,kbjr->bijr', covariance[..., 3:], columns[:3] - columns[3]))


@dataclass(frozen=True)
class WindowModel(ArrayRecord):
    """Windows, linear in the state x at their first knots: measurements, and the transition to the next window.

    All arrays have a first axis of the windows, which the shapes below leave out.
    """

    pose: Measurement  # (6,), mean over the knots
    rates: Measurement  # (r,), of the twist, six, and of each further sensor
    # transition, drift: (6, s), (6,): pose error at the next window's first knot = transition x + drift
    transition: Array
    drift: Array
    noise: JointNoise  # of the joints; the part in the pose as it is measured
    joints_in_rates: Array  # (r, n) as it is in what each sensor reads of one pose error
    joints_in_twist: Array  # () its variance in the twist over that in the pose
    length: Array  # () s
    # rotation, position: (3, 3), (3,) m, of the base at the window's end
    rotation: Array
    position: Array
    centre: Array  # (3,) m, the common centre of mass there
    momentum_change: Array  # (6, s) change of (P, L) until the next window by the unknowns
    thrust_noise: Array  # (6, 6) factor of the noise of (P, L) until then, by the poses that thrust is integrated along
    body: Array  # (10,) standard parameters of the target at the linearisation point
    integrated: IntegratedTwist  # it takes the place of the twist where it counts
    # (r, r) by how much more than the twist's alone two numbers share that variance; (0, 0) where all are of the twist
    joint_overlap: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (6, 6, r) covariance of the noise of the pose with that of its columns; (6, 6, 0) without
    position_noise: Array = field(default_factory=lambda: np.zeros((6, 6, 0)))
    # (6, s + 1) change of (P, L) until the next window, as that by forces depends on the state, and a constant part;
    # (6, 0) without
    leverage: Array = field(default_factory=lambda: np.zeros((6, 0)))

    def __post_init__(self) -> None:
        """Fill in the defaults."""
        if self.leverage.ndim == 2 and self.length.ndim:
            object.__setattr__(self, 'leverage', np.zeros((*self.length.shape, 6, 0)))
        if self.position_noise.ndim == 3 and self.length.ndim:
            object.__setattr__(self, 'position_noise', np.zeros((*self.length.shape, 6, 6, 0)))
        if self.joint_overlap.shape[: self.length.ndim] != self.length.shape:
            object.__setattr__(self, 'joint_overlap', np.zeros((*self.length.shape, 0, 0)))


def window_models(
    layout: Layout, stacks: Sequence[Stack], point: Point, course: SwingTrajectory | None = None
) -> WindowModel:
    """Return windows linearised at one point, in their order before they were stacked.

    Below, arrays have a window's m intervals (or m + 1 knots) first, and the B windows of a stack second.

    Parameters
    ----------
    layout, stacks : of the state; of windows of one shape each
    point : windows of one chain share its readings, which correct the motion
    course : of passive joints in the windows before; None where there are none of either
    """
    swinging = point.nominal.kernel.springs.count > 0
    motions: Motions = [stack.motion(point.nominal, BESIDE if swinging else 1) for stack in stacks]
    if point.drift is not None:
        motions = [
            (replace(motion, impulse=motion.impulse + point.drift.at(_starts(stack))), inside)
            for stack, (motion, inside) in zip(stacks, motions, strict=True)
        ]
    swing: Array | None = None
    if swinging:
        course = course or SwingTrajectory(layout, predict)
        motions, prediction, bodies, swing = course.predict(stacks, motions, point)
    else:
        prediction, bodies = predict(layout, Midpoints.concatenate([motion.flat for motion, _ in motions]), point)
    for unknown, place in layout.of_joints:
        every = Midpoints.concatenate([motion.flat for motion, _ in motions])
        faster = np.concatenate(
            [_accelerations(stack, motion) for stack, (motion, _) in zip(stacks, motions, strict=True)]
        )
        prediction.by_parameters[..., place] += by_deflections(unknown, point.nominal.kernel, every, faster, bodies)
    predictions = prediction.divided([motion.turn.shape[:2] for motion, _ in motions])
    noises = joint_noise(
        layout, point.nominal.kernel, stacks, [inside for _, inside in motions], predictions, bodies, swing=swing
    )
    models, begin = [], 0
    for stack, motion, prediction, noise in zip(stacks, motions, predictions, noises, strict=True):
        around, inside = motion
        rows, windows = around.turn.shape[:2]
        last = begin + (inside.stop - 1) * windows + np.arange(windows)
        placed = bodies.states.configuration[begin : begin + rows * windows]
        begin += rows * windows
        impulses = _momentum_change(layout, stack, bodies[last], around.base_position[inside.stop - 1], point)
        models.append(_models(layout, stack, (*motion, placed), prediction, point, (noise, impulses)))
    if len(stacks) == 1:
        return models[0]
    return WindowModel.concatenate(models)[np.argsort(np.concatenate([stack.places for stack in stacks]))]


def _starts(stack: Stack) -> list[float]:
    return [window.start for window in stack.windows]


def _accelerations(stack: Stack, motion: Midpoints) -> Array:
    """Return the joints' accelerations (N, n) in a stack's motion, one window after the other in each interval."""
    rate = motion.joint_velocity
    return (gradient(rate) / stack.windows[0].spacing).reshape(-1, rate.shape[-1])


def _models(
    layout: Layout,
    stack: Stack,
    motion: tuple[Midpoints, slice, Configuration],
    predicted: Prediction,
    point: Point,
    effects: tuple[JointNoise, tuple[Array, Array, Array]],
) -> WindowModel:
    """Return a stack's windows from its motion, the prediction, the joints' noise and the impulses."""
    noise, (impulses, leverage, centre) = effects
    around, inside, placed = motion
    parameters, spacing = point.parameters, stack.windows[0].spacing
    around_slope = gradient(predicted.twist) / spacing
    integral = _integral(predicted.twist, around_slope, spacing)[inside]
    middle, prediction, slope = around[inside], predicted[inside], around_slope[inside]
    errors = composed(*_chain_steps(prediction, integral, middle, spacing))
    # Absolute parameters instead of deviations from the point: their part moves to the constant.
    errors[..., -1] -= errors[..., 6:-1] @ parameters
    offset = None if point.drift is None else point.drift.at(_starts(stack))
    if offset is not None:
        errors[..., -1] -= (errors[..., 6:12] @ offset[..., None])[..., 0]
    of_joints = noise.pose @ np.swapaxes(noise.pose, -1, -2)
    change, parabolic = stack.whitening, parabolic_weights(len(middle))
    # The integrated twist has no Gauss-Markov joint errors.
    integrated = stack.integrates_twist & (layout.time_constants.size == 0)
    # The change of the pose has the joints' errors of two knots, independent of the others.
    ends = np.where(integrated[:, None], 1.0, 1.0 - 2.0 * change + 2.0 * len(middle) * change**2)[..., None]
    moving = twist_motion(stack, predicted, (around, inside), slope)
    seen = replace(moving, slope=moving.twist, rate=np.zeros_like(moving.twist))
    pose = reading_columns(layout, 'pose', seen)
    course = Course(stack, around, inside, prediction.twist, slope, placed, stack.corrected(point.nominal))
    mean = mean_twist(errors, prediction, point, parabolic, offset)
    rates, in_rates, overlap = _rates(layout, course, moving, (mean, errors), noise, point)
    whole = IntegratedTwist.none(len(stack.windows), layout.size)
    if integrated.any():
        each = integral_weights(len(middle))
        motions = (twist_motion(stack, predicted, (around, inside), slope, weights) for weights in each)
        turned = [reading_columns(layout, 'twist', moving) for moving in motions]
        whole = integrated_twist(stack, prediction, middle, errors, point, by_readings=turned, stored=noise.common)
        whole = replace(whole, replaces_twist=integrated)
    of_poses = stack.pose_covariance / stack.samples if layout.odometry else np.full_like(of_joints, np.nan)
    return WindowModel(
        Measurement(*pose_measurement(errors, change, pose, point.nuisance), of_poses + ends * of_joints),
        rates,
        transition=state_rows(errors[-1], np.zeros_like(pose)),
        drift=errors[-1][..., -1],
        noise=replace(noise, pose=np.sqrt(ends) * noise.pose, by_unknowns=np.sqrt(ends)[..., None] * noise.by_unknowns),
        joints_in_rates=np.sqrt(ends) * in_rates,
        joints_in_twist=telescoped(len(middle), spacing) / ends[:, 0, 0],
        length=np.full(len(stack.windows), len(middle) * spacing),
        rotation=exp(0.5 * middle.turn[-1]) @ middle.base_rotation[-1],
        position=middle.base_position[-1] + 0.5 * middle.step[-1],
        centre=centre,
        momentum_change=impulses,
        leverage=leverage,
        thrust_noise=_thrust_noise(stack, around, inside),
        position_noise=_position_noise(layout, seen, np.nan_to_num(of_poses)),
        body=np.tile(point.body, (len(stack.windows), 1)),
        integrated=whole,
        joint_overlap=overlap,
    )


def _rates(
    layout: Layout, course: Course, base: Motion, models: tuple[Array, Array], noise: JointNoise, point: Point
) -> tuple[Measurement, Array, Array]:
    """Return what twist and further sensors measure in windows, and the joints' noise as it is in that, and overlaps.

    The covariance is blockdiag(own) + t (J A + G)(J A + G)^T + w (J S)(J S)^T. J is what sensors read of the twist; A,
    the joints' noise in the pose, telescopes, and so does G, which joints between base and sensor add; S is white.
    Of poses, each with readings of its own stamps, the joints' noise at different knots counts: the second term is
    multiplied, number by number, with the overlap.

    Parameters
    ----------
    base, models : the windows' motion as twists are read; as of `mean_twist`, and the pose error at the knots
    """
    sensors: tuple[Sensor, ...] = (TWIST, *layout.sensors)
    stack, count = course.stack, course.inside.stop - course.inside.start
    seen = [sensor.observed(course, base) for sensor in sensors]
    columns = [reading_columns(layout, sensor.name, each.motion) for sensor, each in zip(sensors, seen, strict=True)]
    parts = [
        sensor.of_base if each.of_base is None else each.of_base for sensor, each in zip(sensors, seen, strict=True)
    ]
    joints = np.concatenate([part @ noise.pose for part in parts], axis=1)
    covariance, begin = np.zeros((*joints.shape[:2], joints.shape[1])), 0
    for each in seen:
        own = slice(begin, begin + each.value.shape[1])
        begin, covariance[:, own, own] = own.stop, each.covariance
        if each.joint_gain is not None:
            deviation = np.sqrt(stack.joint_variance / stack.samples)
            joints[:, own] += layout.kernel.model.transmission.by_noise(deviation, each.joint_gain)
    common, overlap = joints @ np.swapaxes(joints, -1, -2), _joint_overlap(seen, course)
    covariance += telescoped(count, course.spacing) * (overlap * common if overlap.size else common)
    if noise.common.shape[-1]:
        # It hardly moves a pose within a window.
        common = np.concatenate(
            [part * (each.weights is None) @ noise.common for part, each in zip(parts, seen, strict=True)], axis=1
        )
        common += _by_tracking(layout, stack, seen, common.shape)
        white = count * np.sum(parabolic_weights(count) ** 2) / stack.samples
        covariance += white * (common @ np.swapaxes(common, -1, -2))
    value = np.concatenate([each.value for each in seen], axis=1)
    mean, errors = models
    expected = [
        part @ (mean if each.weights is None else total(each.weights.T[..., None, None] * errors))
        for part, each in zip(parts, seen, strict=True)
    ]
    for moved, each in zip(expected, seen, strict=True):
        if each.carried is not None:
            _add_joint_errors(moved, layout, course, each, each.carried, point)
    measured = rate_measurement(
        np.concatenate(expected, axis=1), value, np.concatenate(columns, axis=1), point.nuisance
    )
    return Measurement(*measured, covariance), joints, overlap


def _by_tracking(layout: Layout, stack: Stack, seen: Sequence[Observation], shape: tuple[int, ...]) -> Array:
    """Return the white noise that tracking errors of joints add beside the base's motion, a factor (B, r, c)."""
    added: Array = np.zeros(shape)
    if not layout.time_constants.size:
        return added
    times = layout.time_constants[np.isfinite(layout.time_constants)]
    size, begin = np.sqrt(2.0 / times * stack.samples / stack.windows[0].length), 0
    for each in seen:
        own = slice(begin, begin + each.value.shape[1])
        begin = own.stop
        if each.joint_gain is not None and each.weights is None:
            added[:, own, -len(times) :] = size * (each.joint_gain @ layout.joint_columns)
    return added


def _add_joint_errors(
    expected: Array, layout: Layout, course: Course, seen: Observation, carried: Carried, point: Point
) -> None:
    """Add to what a sensor on a link is expected to read, (B, r, p + 1), how errors of joints move that link."""
    places = carried.instants
    placed, motion = course.placed[places], course.around.flat[places]
    along = np.einsum('brnx,bnx->brn', carried.by_loads, placed.joint_twist)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if unknown.moves_joints:
            faster = _accelerations(course.stack, course.around)[places]
            further, rate = unknown.deflections(motion.joint_position, motion.joint_velocity, faster)
            columns = along @ further
            if seen.weights is None and seen.joint_gain is not None:
                columns += seen.joint_gain @ rate
        else:
            displaced = unknown.load_motions(point.nominal.kernel, placed)
            if displaced is None:
                continue
            columns = np.einsum('brnx,bndx->brnd', carried.by_loads, displaced).reshape(*along.shape[:2], -1)
        by_unknown = columns @ unknown.factor
        expected[..., place] += by_unknown
        first = layout.parameters.start
        expected[..., -1] -= by_unknown @ point.parameters[place.start - first : place.stop - first]


def _joint_overlap(seen: Sequence[Observation], course: Course) -> Array:
    """Return how much more than two numbers of the twist any two of all r share the joints' noise, (B, r, r).

    It is the product of how both depend on the joints at the knots. Nothing, (B, 0, 0), where all are of the twist.
    """
    windows, count = len(seen[0].value), course.inside.stop - course.inside.start
    if all(each.weights is None for each in seen):
        return np.zeros((windows, 0, 0))
    begin = course.stack.windows[0].inside.start
    spread = course.knots.spread[begin : begin + count + 1].T
    of_twist = np.broadcast_to(-np.diff(np.pad(parabolic_weights(count), 1)) / course.spacing, (windows, count + 1))
    parts = [
        np.pad(of_twist, ((0, 0), (1, 1))) if each.weights is None else _by_means(each.weights, spread) for each in seen
    ]
    by_knot = np.concatenate(
        [np.repeat(part[:, None], each.value.shape[1], axis=1) for part, each in zip(parts, seen, strict=True)], axis=1
    )
    return np.asarray(count / telescoped(count, course.spacing) * (by_knot @ np.swapaxes(by_knot, -1, -2)))


def _by_means(weights: Array, spread: Array) -> Array:
    """Return weights (B, m + 1) of values at knots' centres as those of knots' means, of which one more on either side.

    A value at a centre is a mean less half the `spread` (B, m + 1) times the second difference, as of `midpoints`. That
    cancels in a mean over a window, but a single reading has a fifth more of the joints' noise by it.
    """
    return np.asarray(np.pad(weights, ((0, 0), (1, 1))) - 0.5 * np.diff(np.pad(spread * weights, ((0, 0), (2, 2))), 2))


def _momentum_change(
    layout: Layout, stack: Stack, bodies: Bodies, position: Array, point: Point
) -> tuple[Array, Array, Array]:
    """Return changes of the momentum until the next window, and the centre of mass, m.

    The changes are by the unknowns, (B, 6, s), and by forces as they depend on the state, (B, 6, s + 1).

    Parameters
    ----------
    layout, stack : of the state, of B windows
    bodies, position : near the end of each; (B, 3) m, of the base then
    point : of linearisation
    """
    impulses = np.zeros((len(position), 6, layout.size))
    placed, length = bodies.states.configuration, stack.windows[0].length
    system = np.sum(express(bodies.parameters, placed.rotation, position[:, None] + placed.position), axis=1)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if unknown.changes_momentum:
            ends = stack.middles + 0.5 * length
            rates = unknown.momentum_rates(system, stack.windows[0].origin, ends, placed.rotation[:, 0])
            impulses[..., place] = length * rates @ unknown.factor
    centre = system[:, 1:4] / system[:, :1]
    if point.drift is None or not point.drift.central:
        return impulses, np.zeros((len(position), 6, 0)), centre
    brought = point.drift.until_next(_starts(stack), length)
    leverage = np.zeros((len(position), 6, layout.size + 1))
    leverage[..., :-1] = _accelerated_columns(layout, point, bodies, system, brought, position)
    leverage[..., -1] = -leverage[..., :-1] @ point.state  # absolute parameters instead of deviations from the point
    return impulses, leverage, centre


def _accelerated_columns(
    layout: Layout, point: Point, bodies: Bodies, system: Array, change: Array, position: Array
) -> Array:
    """Return the derivatives (B, 6, s), by the state, of a change of (P, L) that forces bring, as accelerations are.

    Forces are proportional to what they accelerate: noise in them, which may be large, shows no mass
    (initialisation.md, forces and drifts). The change of (P, L) is the momentum of the robot at another motion, whose
    joints rest.

    Parameters
    ----------
    system, change : (B, 10) standard parameters of all bodies together; (B, 6)
    position : (B, 3) m, of the base
    """
    states, centre = bodies.states, system[:, 1:4] / system[:, :1]
    about_centre = express(system, np.broadcast_to(np.eye(3), (len(system), 3, 3)), -centre)
    spin = change[:, 3:] - cross(centre, change[:, :3])
    turning = (np.linalg.pinv(unvec(about_centre[:, 4:]), rcond=1e-9, hermitian=True) @ spin[..., None])[..., 0]
    twist = np.concatenate((change[:, :3] / system[:, :1] + cross(turning, position - centre), turning), axis=1)
    moving = replace(
        states,
        body_twist=np.broadcast_to(twist[:, None], states.body_twist.shape),
        twist=twist,
        stored=np.zeros_like(states.stored),
        thrust=np.zeros_like(states.thrust),
    )
    columns = np.zeros((len(position), 6, layout.size))
    columns[..., BODY] = moving.regressor
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        # Processes move the centre to and fro.
        if not unknown.of_measurement and not np.isfinite(unknown.time_constants).any():
            by_unknown = unknown.momentum_columns(point.nominal.kernel, moving)
            if by_unknown is not None:
                columns[..., place] = by_unknown @ unknown.factor
    columns[:, 3:] += skew(position) @ columns[:, :3]  # about the origin instead of the base
    return columns


def _thrust_noise(stack: Stack, around: Midpoints, inside: slice) -> Array:
    """Return a factor (B, 6, 6) of the noise that poses add to the momentum while thrust acts.

    Commands are integrated along the measured motion, of which each knot has noise of its own: an error (theta, rho)
    turns force and torque, and moves the force. The momentum so makes a random walk.

    Parameters
    ----------
    stack, around, inside : of B windows, their motion, and the part of it that is theirs
    """
    if not around.impulse.any():
        return np.zeros((len(stack.windows), 6, 6))
    change = np.diff(around.impulse, axis=0, append=around.impulse[-1:])[inside]
    place = at_knots(around.base_position, inside)[1:]
    force, torque = skew(change[..., :3]), skew(change[..., 3:] - cross(place, change[..., :3]))
    by_pose = np.zeros((*change.shape, 6))
    by_pose[..., :3, :3] = by_pose[..., 3:, 3:] = -force
    by_pose[..., 3:, :3] = -torque - skew(place) @ force
    count = len(change)
    knot = stack.pose_covariance * count / stack.samples  # a pose that is not measured adds an unknown amount
    step = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) * stack.windows[0].spacing
    times = np.array([window.noise.correlation_time for window in stack.windows])[:, None, None]
    correlation = np.where(times > 0.0, np.exp(-step / np.where(times > 0.0, times, 1.0)), np.eye(count))
    shared = np.linalg.cholesky(correlation)
    deviation = np.sqrt(np.nan_to_num(np.diagonal(knot, axis1=1, axis2=2)))
    factor = np.einsum('bji,jbrc,bc->brci', shared, by_pose, deviation).reshape(len(knot), 6, -1)
    return np.swapaxes(np.linalg.qr(np.swapaxes(factor, 1, 2), mode='r'), 1, 2)


def _integral(twist: Array, slope: Array, spacing: float) -> Array:
    """Return the (m, B, 6) integrals of (v, w) over each interval, fourth order, the rotation's commutator included."""
    change = twist[1:] - twist[:-1]
    bend = np.zeros_like(twist)
    bend[1:-1] = change[1:] - change[:-1]
    bend[0], bend[-1] = bend[1], bend[-2]
    integral = spacing * (twist + bend / 24.0)
    integral[..., 3:] += spacing**3 / 12.0 * cross(slope[..., 3:], twist[..., 3:])
    return integral


def _chain_steps(prediction: Prediction, integral: Array, middle: Midpoints, spacing: float) -> tuple[Array, Array]:
    """Return, for each interval, the (6, 6) transition of xi and the (6, u + 1) gain of parameters and of 1."""
    gain = np.empty((*middle.turn.shape[:-1], 6, prediction.by_parameters.shape[-1] + 1))
    gain[..., :-1] = spacing * prediction.by_parameters[..., ANGULAR_FIRST, :]
    gain[..., :3, -1] = integral[..., 3:] - middle.turn
    gain[..., 3:, -1] = integral[..., :3] - middle.step
    # xi acts at mid-interval, the mean of both ends: (1 - D F~ / 2) xi' = (1 + D F~ / 2) xi + gain
    back = np.linalg.inv(_IDENTITY - 0.5 * spacing * prediction.error_slope)
    return 2.0 * back - _IDENTITY, back @ gain


@dataclass(frozen=True)
class WhitenedWindow:
    """A window in the filter's variables, measurements in units of their noise."""

    # value, rows: (k,), (k, v): value = rows variables + white noise of variance 1
    value: Array
    rows: Array
    log_noise: float  # logarithm of the determinant of the noise's covariance
    # transition, drift, process: (p, v), (p,), (p, n): to the p pose errors, the first variables, at the next window's
    # first knot; the last is a factor of the joint noise that accumulates until then
    transition: Array
    drift: Array
    process: Array
    inverse_transition: Array  # (2 p, 2 p) inverse of the transition of pose error and momentum
    shared: Array  # (v,) mean score by noise that rows and value share
    bias_information: Array  # (b, b + 1) information M of the body by noise in the rows, and M times the body
    pose_error_by_momentum: Array  # (6, 6) derivative of the next pose error by the momentum, SI units
    momentum_change: Array  # (p, v) change of the momentum until the next window by the variables
    thrust_noise: Array  # (p, 6) factor of the noise of the momentum until then, as of `WindowModel`
    momentum_by_force: Array  # (3, p, f) change of the momentum by a constant force and torque, acting as in `_ACTING`
    process_gain: Array  # (p, f) as of `JointNoise`
    process_variance: Array  # (f,) the same
    length: float  # s
    places: Integers  # (k,) of the values among the numbers that a window may measure, as of `Innovations`
    border_noise: BorderNoise | None = None  # for an integrated twist, the links to the windows before and after
    leverage: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (p, v + 1) as of `WindowModel`; empty without

    def with_known(self, values: Array) -> WhitenedWindow:
        """Return the window where some variables are known exactly: their values (v,), NaN for the others."""
        known = np.isfinite(values)
        at = np.where(known, values, 0.0)
        return replace(
            self,
            value=self.value - self.rows @ at,
            rows=self.rows * ~known,
            drift=self.drift + self.transition @ at,
            transition=self.transition * ~known,
        )

    def force_impulse(self, axes: Axes) -> Array:
        """Return the change of the momentum by a constant force and torque in these axes, (p, f)."""
        return self.momentum_by_force[_ACTING.index(axes)]

    def impulse_in_gap(self, axes: Axes, window: Window) -> Array:
        """Return the same over the gap before the window, (p, f)."""
        return self.over_gap(self.force_impulse(axes), window)

    def over_gap(self, change: Array, window: Window) -> Array:
        """Return a change over the window by what acts, as one over the gap before it: on the robot as it is after."""
        return np.asarray(window.gap / self.length * change)


def whitened_windows(windows: WindowModel, variables: Variables) -> list[WhitenedWindow]:
    """Return B windows in the filter's variables."""
    known = np.isfinite(windows.pose.covariance)
    # In a run all windows measure the same parts: pose, orientation alone, or nothing.
    missing = ~np.diagonal(known, axis1=1, axis2=2).all(axis=0)
    select = variables.measured[~np.any(variables.measured[:, missing], axis=1)]
    measurement = replace(windows.pose, covariance=np.where(known, windows.pose.covariance, np.eye(6)))
    pose = _whitened(measurement, variables, select, _IDENTITY)
    precision = pose.precision
    weighed = pose.weighed(windows.noise.pose)
    places = np.arange(len(select))
    measured = [(*each, places) for each in zip(pose.value, pose.rows, pose.log_noise, strict=True)]
    links: list[BorderNoise | None] = [None] * len(measured)
    integrated = windows.integrated.replaces_twist
    if integrated.any():
        chosen = windows[integrated]
        joined, precision[integrated] = integrated_twist_rows(chosen.integrated, chosen.pose, chosen.noise, variables)
        weighed[integrated] = precision[integrated] @ chosen.noise.pose
        for index, (value, rows, log_noise, link) in zip(np.flatnonzero(integrated).tolist(), joined, strict=True):
            measured[index], links[index] = (value, rows, log_noise, np.arange(len(value))), link
    alone = np.where(integrated[:, None], np.nan, windows.rates.value)
    for moving, select, of_rates in _alike(alone, variables):
        measurement = windows.rates[moving]
        measurement = replace(measurement, value=np.nan_to_num(measurement.value))  # of those outside this selection
        rates = _whitened(measurement, variables, select, variables.of_base)
        times, overlap = windows.joints_in_twist[moving, None, None], windows.joint_overlap[moving]
        if overlap.size:
            shared = overlap * (np.swapaxes(rates.whiten, -1, -2) @ rates.whiten)
            precision[moving] += times * (variables.of_base.T @ shared @ variables.of_base)
            weighed[moving] += times * (variables.of_base.T @ shared @ windows.joints_in_rates[moving])
        else:
            precision[moving] += times * rates.precision
            weighed[moving] += times * rates.weighed(windows.joints_in_rates[moving])
        values = np.concatenate((pose.value[moving], rates.value), axis=1)
        both = np.concatenate((pose.rows[moving], rates.rows), axis=1)
        log_noise = pose.log_noise[moving] + rates.log_noise
        all_places = np.concatenate((places, of_rates))
        for index, values_of_window in zip(moving.tolist(), zip(values, both, log_noise, strict=True), strict=True):
            measured[index] = (*values_of_window, all_places)
    turn = variables.from_state[: variables.pose_size, POSE]
    transition = turn @ variables.rows(windows.transition)
    head: Array = np.tile(np.eye(variables.moving), (len(transition), 1, 1))
    head[:, : variables.pose_size] = transition[..., : variables.moving]
    to_momentum = variables.from_state[variables.pose_size : variables.moving, MOMENTUM]
    return [
        WhitenedWindow(value, rows, float(log_noise), *rest)
        for (value, rows, log_noise), *rest in zip(
            (each[:3] for each in measured),
            transition,
            (turn @ windows.drift[..., None])[..., 0],
            turn @ windows.noise.process,
            np.linalg.inv(head),
            _shared(weighed, windows.noise.by_unknowns, (pose.precision, windows.position_noise), variables),
            errors_in_variables_bias(precision, windows.noise.by_unknowns, windows.body, variables),
            windows.transition[..., MOMENTUM],
            to_momentum @ variables.rows(windows.momentum_change),
            to_momentum @ windows.thrust_noise,
            _momentum_by_force(windows, variables),
            turn @ windows.noise.process_gain,
            windows.noise.process_variance,
            windows.length.tolist(),
            (each[3] for each in measured),
            links,
            _in_variables(to_momentum, windows.leverage, variables),
            strict=True,
        )
    ]


def _in_variables(to_momentum: Array, leverage: Array, variables: Variables) -> Array:
    """Return the change (B, p, v + 1) of the momentum in the variables, from (B, 6, s + 1) of the state; or of none."""
    if not leverage.shape[-1]:
        return np.zeros((len(leverage), len(to_momentum), 0))
    rows = np.concatenate((variables.rows(leverage[..., :-1]), leverage[..., -1:]), axis=-1)
    return np.asarray(to_momentum @ rows)


@dataclass(frozen=True)
class _White:
    """Measurements of B windows in units of their noise."""

    # value, rows, log_noise: (B, k), (B, k, v), (B,) as in `WhitenedWindow`
    value: Array
    rows: Array
    log_noise: Array
    whiten: Array  # (B, k, r) the whitening matrix
    of_base: Array  # (B, k, 6) the same of a pose error or twist of the base

    @property
    def precision(self) -> Array:
        """J^T S^-1 J of these measurements, J what they are of a pose error or twist of the base, (B, 6, 6)."""
        return np.asarray(np.swapaxes(self.of_base, -1, -2) @ self.of_base)

    def weighed(self, joints: Array) -> Array:
        """Return J^T S^-1 A of the joints' noise A in the measurements, (B, r, n)."""
        return np.asarray(np.swapaxes(self.of_base, -1, -2) @ (self.whiten @ joints))


def _alike(value: Array, variables: Variables) -> Iterator[tuple[Integers, Array, Integers]]:
    """Yield the windows that have the same sensors, the combinations that hold, and their places.

    A value (B, r) of twist and further sensors is NaN where it is not measured.
    """
    parts = variables.rate_combinations
    widths, counts = zip(*((part.shape[1], len(part)) for part in parts), strict=True)
    begins, select = np.cumsum((0, *widths[:-1])), block_diag(*parts)
    known = np.logical_and.reduceat(np.isfinite(value), begins, axis=1)
    for which in np.unique(known, axis=0):
        rows = np.repeat(which, counts)
        if rows.any():
            yield np.flatnonzero((known == which).all(axis=1)), select[rows], variables.pose_size + np.flatnonzero(rows)


def _whitened(measurement: Measurement, variables: Variables, select: Array, of_base: Array) -> _White:
    """Return a measurement of B windows in white noise, of the combinations that hold; `of_base` as in `_White`."""
    factor = np.linalg.cholesky(select @ measurement.covariance @ select.T)
    whiten = np.linalg.inv(factor) @ select
    return _White(
        value=(whiten @ measurement.value[..., None])[..., 0],
        rows=whiten @ variables.rows(measurement.rows),
        # One after the other along the first axis, in the same order for one window as for many.
        log_noise=2.0 * np.add.reduce(np.log(np.diagonal(factor, axis1=1, axis2=2).T.copy()), axis=0),
        whiten=whiten,
        of_base=whiten @ of_base,
    )


def _shared(weighed: Array, slope: Array, of_poses: tuple[Array, Array], variables: Variables) -> Array:
    """Return the (B, v) mean score by the noise that values and rows share.

    That of the joints is in poses (B, 6, n) and in rows (B, 6, 10 + e, n). Of poses, the precision (B, 6, 6) and the
    covariance (B, 6, 6, r) of their noise with that of their columns, which counts with the other sign: values have the
    negative of what joints do to a pose. A scale has the positions read as its column: noise makes it seem larger.
    """
    windows, _, numbers, _ = slope.shape
    precision, covariance = of_poses
    by_number = slope.transpose(0, 2, 1, 3).reshape(windows, numbers, -1)
    score = np.zeros((windows, 1, len(variables.basis)))
    score[:, 0, BODY.start : BODY.start + numbers] = (by_number @ weighed.reshape(windows, -1, 1))[..., 0]
    if covariance.shape[-1]:
        score[:, 0, -covariance.shape[-1] :] -= np.einsum('bij,bijr->br', precision, covariance)
    return variables.rows(score)[:, 0]


def _momentum_by_force(windows: WindowModel, variables: Variables) -> Array:
    """Return the (B, 3, p, f) change of the momentum by a constant force and torque, as in `_ACTING`.

    A window's momentum is that of its middle. The force acts from there to the middle of the next window, on a robot
    that is between the two.
    """
    upright = np.broadcast_to(np.eye(3), windows.rotation.shape)
    rotation = np.stack((upright, upright, windows.rotation), axis=1)
    point = np.stack((windows.centre, windows.position, windows.position), axis=1)
    push = np.zeros((*point.shape[:2], 6, 6))
    push[..., :3, :3] = push[..., 3:, 3:] = rotation
    push[..., 3:, :3] = skew(point) @ rotation
    force = windows.length[:, None, None, None] * variables.force
    return np.asarray(variables.from_state[variables.pose_size : variables.moving, MOMENTUM] @ (push @ force))


class LinearisationCache:
    """Linearises windows, and the next ones with them: one numpy call costs much the same for ten as for one."""

    def __init__(self, layout: Layout, variables: Variables) -> None:
        self._layout = layout
        self._variables = variables
        self._course = SwingTrajectory(layout, predict) if layout.kernel.springs.count else None
        self._coming: Sequence[Window] = ()
        self._turn: dict[Window, int] = {}
        self._made: dict[Window, WhitenedWindow] = {}
        self._point: Point | None = None  # at which these are linearised

    def expect(self, windows: Sequence[Window]) -> None:
        """Set the coming windows, in order."""
        self._coming = windows
        self._turn = {window: turn for turn, window in enumerate(windows)}
        self._made.clear()

    def deflections(self, window: Window) -> Array:
        """Return the largest deflections of passive joints so far, least and highest in a window, (3, f) rad or m."""
        return np.zeros((3, 0)) if self._course is None else self._course.deflections(window)

    def whitened(self, window: Window, point: Point) -> WhitenedWindow:
        """Return a window, linearised at a point."""
        if point is not self._point:
            self._point = point
            self._made.clear()
        if window not in self._made:
            turn = self._turn.get(window)
            # Passive joints are followed from the window before: how calls are cut must make no difference.
            count = TOGETHER if self._course is None else 1
            together = [window] if turn is None else self._coming[turn : turn + count]
            self._made.update(self.all_whitened(stacked(together), point))
        return self._made.pop(window)

    def all_whitened(self, stacks: Sequence[Stack], point: Point) -> list[tuple[Window, WhitenedWindow]]:
        """Return stacked windows in their order before they were stacked, as they are and linearised."""
        models = window_models(self._layout, stacks, point, self._course)
        placed = dict(pair for stack in stacks for pair in zip(stack.places, stack.windows, strict=True))
        windows = [placed[place] for place in sorted(placed)]
        return list(zip(windows, whitened_windows(models, self._variables), strict=True))
