"""A free body by its tracked poses: centre of mass on a straight line, rotation by Euler's equation without a torque.

The inertia enters by its ratios alone, E = 3 I / tr(I), of a body of any shape that exists. In an orbit the gravity
gradient moves and turns it, as seen from the frame that falls along.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, cross, exp, log, rotate, skew

# The five traceless symmetric matrices B_k, orthonormal, (5, 3, 3).
RATIOS = np.zeros((5, 3, 3))
for _place, (_row, _column) in enumerate(((0, 1), (0, 2), (1, 2))):
    RATIOS[_place, _row, _column] = RATIOS[_place, _column, _row] = np.sqrt(0.5)
RATIOS[3], RATIOS[4] = np.diag([1.0, -1.0, 0.0]) * np.sqrt(0.5), np.diag([1.0, 1.0, -2.0]) * np.sqrt(1.0 / 6.0)
TURN, CENTRE, VELOCITY, SPIN, LEVER, SHAPE = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    slice(9, 12),
    slice(12, 15),
    slice(15, 20),
)
_SIZE = 20  # unknowns, in this order
_STEP_ANGLE = 0.05  # rad, that the body turns in a step of the integrator: fourth order leaves 1e-7 of that
_MOST_STEPS = 4000
_STEP_OF_FALL = 2.0  # s, of the integrator of a fall: a thousandth of an orbit leaves 1e-12 of it
_LEVER_PRIOR, _SHAPE_PRIOR = 10.0, 1.0  # m, 1: they fix what the motion leaves open, and are taken out again
_PERTURBED = 1e-6  # of the spin in rad/s times the length in s, and of the ratios, for derivatives
_ITERATIONS, _ITERATIONS_OF_PART = 25, 6  # at most: of all poses, and of the last ones alone
_LARGEST_STEP = 0.7  # of the shape's numbers, in one step
_SMALL_STEP = 1e-2  # standard deviations: a smaller step changes nothing
# s before the end that the first fit takes at most, and how many times as many each takes than the one before.
_FIRST_SPAN, _GROWTH = 8.0, 1.4
_LARGEST_TURN = 1.0  # rad, of poses that the first guess takes
_REFINEMENTS = 2  # fits of the poses that have not jumped, with noise by the fit before
_JUMP = 4.5  # times the typical residual of three coordinates, 1.54 standard deviations, from which a pose has jumped
_MEDIAN = 0.6745  # of the absolute value of a standard normal number
_MEDIAN_OF_THREE = 0.888  # of the root mean square of three of them
_TENTH_OF_THREE = 2.5  # what the root of the sum of three squares of them exceeds in a tenth of all cases
_CORRELATED = 4.0  # standard deviations of an autocorrelation, from which the errors of poses count as correlated
_EXPLAINED = 1.4  # typical normalised residual squared, from which other starts are tried
FEWEST = 12  # poses
# From (N,) s after the capture to the gradients G of gravity there, (N, 3, 3) 1/s^2, in the axes of the poses.
Gradient = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Track:
    """N poses of a frame fixed to the body, in order of time."""

    time: Array  # (N,) s, the capture at 0
    position: Array  # (N, 3) m, in the odometry frame
    rotation: Array  # (N, 3, 3) to the odometry frame
    gradient: Gradient | None = None  # of gravity, in a frame that falls in an orbit; None without one

    def __getitem__(self, index: Flags | slice) -> Track:
        """Return some of the poses."""
        return replace(self, time=self.time[index], position=self.position[index], rotation=self.rotation[index])

    @property
    def inverse(self) -> Track:
        """The poses of the odometry frame in the tracked one."""
        back = np.swapaxes(self.rotation, 1, 2)
        return Track(self.time, -rotate(back, self.position), back)

    @property
    def local_noise(self) -> tuple[float, float]:
        """Standard deviation of a position, m, and of an orientation, rad, by differences of neighbouring poses."""
        turn = log(np.swapaxes(self.rotation[:-1], 1, 2) @ self.rotation[1:])
        moved = np.diff(self.position, axis=0)
        # Third differences of white noise have 20 times its variance; a smooth motion leaves none.
        sizes = [float(np.median(np.abs(np.diff(each, n=2, axis=0)))) for each in (moved, turn)]
        return sizes[0] / _MEDIAN / np.sqrt(20.0), sizes[1] / _MEDIAN / np.sqrt(20.0)


@dataclass(frozen=True)
class PoseNoise:
    """Errors of tracked poses."""

    position: float  # m, standard deviation of each coordinate
    orientation: float  # rad, about each axis
    # s, in which their autocorrelation falls to 1/e: of positions, of orientations
    correlation_times: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class FreeFlight:
    """The motion of a free body at the capture, a Gaussian in square-root information form.

    The unknowns are errors of the numbers here: turn of the tracked frame (odometry axes), centre of mass, its
    velocity, spin (body axes), lever, shape.
    """

    rotation: Array  # (3, 3) tracked frame to odometry frame, at the capture
    centre: Array  # (3,) m, centre of mass at the capture
    velocity: Array  # (3,) m/s
    spin: Array  # (3,) rad/s, in axes of the tracked frame, at the capture
    lever: Array  # (3,) m, the tracked frame's origin from the centre of mass, in its axes
    shape: Array  # (5,) as of `inertia_of`
    rows: Array  # (20, 21) R and z: R x = z + noise of unit variance, by the poses alone
    noise: PoseNoise  # as used
    misfit: float  # mean normalised residual squared
    used: int  # number of poses
    dropped: int = 0  # of those that jumped
    # residual that a tenth of all poses exceeds, m and rad, over that of noise with a standard deviation of one
    largest: tuple[float, float] = (0.0, 0.0)

    @property
    def inertia(self) -> Array:
        """E = 3 I / tr(I) in axes of the tracked frame, (3, 3)."""
        return inertia_of(self.shape)

    @property
    def covariance(self) -> Array:
        """Of the unknowns, (20, 20), with weak priors for what the motion leaves open."""
        return np.asarray(np.linalg.inv(self.rows[:, :-1].T @ self.rows[:, :-1] + np.diag(_prior())))

    def moved(self, step: Array) -> FreeFlight:
        """Return the same with a step (20,) added to its numbers."""
        return replace(
            self,
            rotation=exp(step[TURN]) @ self.rotation,
            centre=self.centre + step[CENTRE],
            velocity=self.velocity + step[VELOCITY],
            spin=self.spin + step[SPIN],
            lever=self.lever + step[LEVER],
            shape=self.shape + step[SHAPE],
        )


def inertia_of(shape: Array) -> Array:
    """Return E (..., 3, 3) of shapes (..., 5): a body of second moments Exp(sum of shape_k B_k), of any size."""
    values, axes = np.linalg.eigh(np.tensordot(shape, RATIOS, axes=1))
    moments = np.exp(values)
    share = 1.5 * (1.0 - moments / np.sum(moments, axis=-1, keepdims=True))
    return np.asarray((axes * share[..., None, :]) @ np.swapaxes(axes, -1, -2))


def tumbled(time: Array, spin: Array, shape: Array, gradient: Gradient | None = None) -> Array:
    """Return the orientations (V, N, 3, 3), relative to that at time 0, of V free bodies.

    Parameters
    ----------
    time : (N,) s
    spin, shape : (V, 3) rad/s in body axes at time 0; (V, 5)
    gradient : of gravity, in body axes at time 0; None where no torque acts
    """
    result = np.empty((len(spin), len(time), 3, 3))
    for ahead in (True, False):
        part = time >= 0.0 if ahead else time < 0.0
        if part.any():
            result[:, part] = _one_way(time[part], spin, shape, gradient)
    return result


def _one_way(time: Array, spin: Array, shape: Array, gradient: Gradient | None) -> Array:
    """Return as `tumbled`, of times with one sign."""
    end = float(time[np.argmax(np.abs(time))])
    fastest = float(np.max(np.linalg.norm(spin, axis=1)))
    count = int(np.clip(np.ceil(abs(end) * fastest / _STEP_ANGLE), 1, _MOST_STEPS))
    step = end / count if end else 1e-9
    inertia = inertia_of(shape)[:, None]  # of each body, at any number of instants
    inverse = np.linalg.inv(inertia)

    def rate(value: Array, torque: Array) -> Array:
        return rotate(inverse, torque - cross(value, rotate(inertia, value)))

    def stepped(value: Array, length: Array | float, torque: Array) -> Array:
        first = rate(value, torque)
        second = rate(value + 0.5 * length * first, torque)
        third = rate(value + 0.5 * length * second, torque)
        last = rate(value + length * third, torque)
        return np.asarray(value + length / 6.0 * (first + 2.0 * second + 2.0 * third + last))

    def followed(torques: Array) -> tuple[Array, Array]:
        """Return spins and orientations at the ends of all steps, with a constant torque (V, count, 3) in each."""
        spins = [spin[:, None]]
        for place in range(count):
            spins.append(stepped(spins[-1], step, torques[:, place : place + 1]))
        rates = np.concatenate(spins, axis=1)
        middle = stepped(rates[:, :-1], 0.5 * step, torques)
        turns = exp(_turn(rates[:, :-1], middle, rates[:, 1:], step))
        orientations = [np.broadcast_to(np.eye(3), (len(spin), 3, 3))]
        for place in range(count):
            orientations.append(orientations[-1] @ turns[:, place])
        return rates, np.stack(orientations, axis=1)

    torques: Array = np.zeros((len(spin), count, 3))
    rates, nodes = followed(torques)
    if gradient is not None:
        # So small a torque follows from the orientations without it, in the middle of each step.
        halfway = nodes[:, :-1] @ exp(0.5 * step * rates[:, :-1])
        torques = gravity_torque(gradient((np.arange(count) + 0.5) * step), halfway, inertia)
        rates, nodes = followed(torques)
    node = np.clip((time / step).astype(int), 0, count - 1)
    rest = (time - node * step)[None, :, None]
    begin, torque = rates[:, node], torques[:, node]
    half, full = stepped(begin, 0.5 * rest, torque), stepped(begin, rest, torque)
    return np.asarray(nodes[:, node] @ exp(_turn(begin, half, full, rest)))


def gravity_torque(gradient: Array, rotation: Array, inertia: Array) -> Array:
    """Return the torque (..., 3) of gravity of a gradient (..., 3, 3) on bodies, in their axes."""
    seen = np.swapaxes(rotation, -1, -2) @ gradient @ rotation
    product = seen @ inertia
    return np.stack(
        [product[..., row, column] - product[..., column, row] for row, column in ((1, 2), (2, 0), (0, 1))], axis=-1
    )


def free_fall(time: Array, gradient: Gradient | None) -> tuple[Array, Array]:
    """Return A and B (N, 3, 3) of free centres of mass, at A x + B v where x and v are those at time 0.

    Parameters
    ----------
    time : (N,) s, of one sign
    gradient : of gravity; None where it does not act
    """
    if gradient is None or not len(time):
        return np.broadcast_to(np.eye(3), (len(time), 3, 3)), time[:, None, None] * np.eye(3)
    end = float(time[np.argmax(np.abs(time))])
    count = max(int(np.ceil(abs(end) / _STEP_OF_FALL)), 1)
    step = end / count if end else 1e-9
    pulls = gradient(0.5 * step * np.arange(2 * count + 1))
    places, rates = [np.eye(3, 6)], [np.eye(3, 6, 3)]
    for first in range(0, 2 * count, 2):
        place, rate, (begin, middle, close) = places[-1], rates[-1], pulls[first : first + 3]
        one = begin @ place
        two = middle @ (place + 0.5 * step * rate)
        three = middle @ (place + 0.5 * step * rate + 0.25 * step**2 * one)
        four = close @ (place + step * rate + 0.5 * step**2 * two)
        places.append(place + step * rate + step**2 / 6.0 * (one + two + three))
        rates.append(rate + step / 6.0 * (one + 2.0 * two + 2.0 * three + four))
    every, moving = np.array(places), step * np.array(rates)
    node = np.clip((time / step).astype(int), 0, count - 1)
    part = (time / step - node)[:, None, None]
    bend = every[node + 1] - every[node]  # Hermite's interpolation
    cubic = moving[node] + part * (
        3.0 * bend - 2.0 * moving[node] - moving[node + 1] + part * (moving[node] + moving[node + 1] - 2.0 * bend)
    )
    both = every[node] + part * cubic
    return both[:, :, :3], both[:, :, 3:]


def _turn(begin: Array, middle: Array, end: Array, length: Array | float) -> Array:
    """Return the rotation vector over a length by the spin at its begin, middle and end, to fourth order."""
    return np.asarray(length / 6.0 * (begin + 4.0 * middle + end) + length**2 / 12.0 * cross(begin, end))


def _prior() -> Array:
    """Return the information (20,) that holds what the motion leaves open."""
    information = np.zeros(_SIZE)
    information[LEVER], information[SHAPE] = _LEVER_PRIOR**-2, _SHAPE_PRIOR**-2
    return information


def _held(flight: FreeFlight) -> Array:
    """Return the numbers (20,) that the prior takes for small."""
    return np.concatenate((np.zeros(LEVER.start), flight.lever, flight.shape))


def _linearised(flight: FreeFlight, track: Track) -> tuple[Array, Array]:
    """Return residuals (2, N, 3) of positions and orientations, and their derivatives by the unknowns (2, N, 3, 20)."""
    length = max(float(np.max(np.abs(track.time))), 1.0)
    steps = np.concatenate((np.full(3, _PERTURBED / length), np.full(5, _PERTURBED)))
    spin, shape = np.tile(flight.spin, (9, 1)), np.tile(flight.shape, (9, 1))
    spin[1:4] += np.diag(steps[:3])
    shape[4:9] += np.diag(steps[3:])
    turned = flight.rotation @ tumbled(track.time, spin, shape, _seen_from(flight.rotation, track.gradient))
    rotation = turned[0]
    by_both = log(turned[1:] @ np.swapaxes(rotation, 1, 2)) / steps[:, None, None]  # (8, N, 3), odometry axes
    arm = rotate(rotation, flight.lever)
    by_centre, by_velocity = free_fall(track.time, track.gradient)
    position = by_centre @ flight.centre + by_velocity @ flight.velocity + arm
    residual = np.stack((track.position - position, log(track.rotation @ np.swapaxes(rotation, 1, 2))))
    columns = np.zeros((2, len(track.time), 3, _SIZE))
    columns[0, :, :, TURN], columns[0, :, :, CENTRE] = -skew(arm), by_centre
    columns[0, :, :, VELOCITY], columns[0, :, :, LEVER] = by_velocity, rotation
    moved = np.concatenate((np.arange(SPIN.start, SPIN.stop), np.arange(SHAPE.start, SHAPE.stop)))
    columns[0][:, :, moved] = np.moveaxis(cross(by_both, arm), 0, -1)
    columns[1, :, :, TURN] = np.eye(3)
    columns[1][:, :, moved] = np.moveaxis(by_both, 0, -1)
    return residual, columns


def _seen_from(rotation: Array, gradient: Gradient | None) -> Gradient | None:
    """Return the gradient of gravity in axes that a rotation (3, 3) turns to those it has."""
    return None if gradient is None else lambda time: rotation.T @ gradient(time) @ rotation


def _whitened(values: Array, track: Track, noise: PoseNoise) -> Array:
    """Return values (2, N, 3, ...) of poses in units of their noise, each less what it shares with the one before."""
    white = values.copy()
    for kind, (std, time) in enumerate(zip((noise.position, noise.orientation), noise.correlation_times, strict=True)):
        shape = (-1,) + (1,) * (values.ndim - 2)
        shared = np.exp(-np.diff(track.time) / time).reshape(shape) if time > 0.0 else np.zeros(1).reshape(shape)
        white[kind, 1:] = (values[kind, 1:] - shared * values[kind, :-1]) / np.sqrt(1.0 - shared**2)
        white[kind] /= std
    return white


def _rows(flight: FreeFlight, track: Track, noise: PoseNoise) -> tuple[Array, float]:
    """Return rows with the residuals beside them, (6 N, 21), and the sum of squares that is made small."""
    both = _linearised(flight, track)
    residual, columns = _whitened(both[0], track, noise), _whitened(both[1], track, noise)
    rows = np.column_stack((columns.reshape(-1, _SIZE), residual.ravel()))
    return rows, float(np.sum(rows[:, -1] ** 2) + _prior() @ _held(flight) ** 2)


def fitted(track: Track, noise: PoseNoise, start: FreeFlight, iterations: int = _ITERATIONS) -> FreeFlight:
    """Return the motion that fits poses best, by Gauss-Newton with damping from a start.

    Raises LinAlgError: It leads to no body.
    """
    flight, damping = start, 0.0
    rows, cost = _rows(flight, track, noise)
    for _ in range(iterations):
        step, root = _step(flight, rows, damping)
        there = flight.moved(step)
        new_rows, value = _rows(there, track, noise)
        if value <= cost * (1.0 + 1e-12):
            flight, rows, cost, damping = there, new_rows, value, 0.1 * damping if damping > 1e-6 else 0.0
            if damping == 0.0 and np.sum((root @ step) ** 2) < _SMALL_STEP**2:
                break
        else:
            damping = max(10.0 * damping, 1e-4)
    root = np.asarray(np.linalg.qr(rows, mode='r'))[:_SIZE]
    count = 6 * len(track.time) - np.linalg.matrix_rank(root[:, :-1])
    return replace(flight, rows=root, noise=noise, misfit=float(np.sum(rows[:, -1] ** 2)) / count, used=len(track.time))


def _step(flight: FreeFlight, rows: Array, damping: float) -> tuple[Array, Array]:
    """Return a damped step (20,), and the square root of the information."""
    prior, held = _prior(), _held(flight)
    information = rows[:, :-1].T @ rows[:, :-1] + np.diag(prior)
    gradient = rows[:, :-1].T @ rows[:, -1] - prior * held
    size = np.sqrt(np.diag(information))
    scaled = information / size / size[:, None] + damping * np.eye(_SIZE)
    step = np.linalg.solve(scaled, gradient / size) / size
    step *= min(1.0, _LARGEST_STEP / max(float(np.max(np.abs(step[SHAPE]))), 1e-12))
    return step, np.linalg.cholesky(information).T


def _first_guess(track: Track, noise: PoseNoise) -> FreeFlight:
    """Return a sphere about the tracked frame's origin, with the velocity and the spin of the last poses."""
    last = track.rotation[-1]
    turn = log(np.swapaxes(last, 0, 1) @ track.rotation)
    far = np.flatnonzero(np.linalg.norm(turn, axis=1) > _LARGEST_TURN)
    recent = slice(min(far[-1] + 1 if far.size else 0, len(turn) - 2), None)
    line = np.column_stack((np.ones(len(turn[recent])), track.time[recent]))
    spin = np.linalg.lstsq(line, turn[recent])[0][1]
    centre, velocity = np.linalg.lstsq(line, track.position[recent])[0]
    rotation = last @ exp(-track.time[-1] * spin)
    nothing = np.zeros((_SIZE, _SIZE + 1))
    return FreeFlight(rotation, centre, velocity, spin, np.zeros(3), np.zeros(5), nothing, noise, np.inf, 0)


def _steady(flight: FreeFlight, track: Track) -> Flags:
    """Return which poses have not jumped, by residuals that are typical of all."""
    residual = np.linalg.norm(_linearised(flight, track)[0], axis=2)
    return np.asarray((residual < _JUMP * np.maximum(np.median(residual, axis=1), 1e-12)[:, None]).all(axis=0))


def _typical_misfit(flight: FreeFlight, track: Track, noise: PoseNoise) -> float:
    """Return the larger of the typical normalised residuals squared of positions and orientations."""
    residual, _ = _linearised(flight, track)
    size = np.array((noise.position, noise.orientation)) * np.sqrt(3.0) * _MEDIAN_OF_THREE
    return float(np.max((np.median(np.linalg.norm(residual, axis=2), axis=1) / size) ** 2))


def _of_any_shape(track: Track, noise: PoseNoise) -> FreeFlight:
    """Return the best fit of all poses, from a sphere or else from other shapes, if the noise does not explain it."""
    shapes = [np.zeros(5), *(0.7 * np.eye(5)[3:]), *(-0.7 * np.eye(5)[3:])]
    found: list[tuple[float, FreeFlight]] = []
    for shape in shapes:
        flight = _of_growing_spans(track, noise, shape)
        kept = _steady(flight, track)
        flight = flight if kept.all() else fitted(track[kept], noise, flight)
        found.append((_typical_misfit(flight, track, noise), flight))
        if found[-1][0] < _EXPLAINED:
            break
    return min(found, key=lambda each: each[0])[1]


def _of_growing_spans(track: Track, noise: PoseNoise, shape: Array) -> FreeFlight:
    """Return the fit of all poses, from fits of the last ones: a first guess is out of phase long before."""
    flight = replace(_first_guess(track, noise), shape=shape)
    fewest = float(track.time[-1] - track.time[-min(FEWEST, len(track.time))])
    span = max(min(_FIRST_SPAN, _LARGEST_TURN / max(float(np.linalg.norm(flight.spin)), 1e-9)), fewest)
    part = track[track.time >= track.time[-1] - span]
    flight = fitted(part, noise, flight, _ITERATIONS_OF_PART)
    while len(part.time) < len(track.time):
        span *= _GROWTH
        part = track[track.time >= track.time[-1] - span]
        flight = fitted(part, noise, flight, _ITERATIONS if len(part.time) == len(track.time) else _ITERATIONS_OF_PART)
    return flight


def _estimated(flight: FreeFlight, track: Track, declared: PoseNoise) -> PoseNoise:
    """Return the noise of poses by their residuals, where none is declared (0)."""
    residual, _ = _linearised(flight, track)
    spread, times = [], []
    step = float(np.median(np.diff(track.time)))
    for kind, given in enumerate(declared.correlation_times):
        each = residual[kind]
        spread.append(np.sqrt(np.sum(each**2) / (each.size - 0.5 * _SIZE)))
        shared = float(np.sum(each[1:] * each[:-1]) / np.sum(each**2))
        significant = shared > _CORRELATED / np.sqrt(each.size)
        times.append(given or (-step / np.log(min(shared, 0.999)) if significant else 0.0))
    return PoseNoise(declared.position or spread[0], declared.orientation or spread[1], (times[0], times[1]))


def free_flight(track: Track, declared: PoseNoise) -> FreeFlight:
    """Return the motion of a free body at the capture, without poses that jump; noise of 0 is estimated.

    Raises LinAlgError: It leads to no body.

    Parameters
    ----------
    track : at least FEWEST poses
    """
    local = track.local_noise
    begin = PoseNoise(declared.position or max(local[0], 1e-9), declared.orientation or max(local[1], 1e-9))
    flight = _of_any_shape(track, begin)
    kept = _steady(flight, track)
    for _ in range(_REFINEMENTS):
        kept = _steady(flight, track)
        used = track[kept]
        flight = fitted(used, _estimated(flight, used, declared), flight)
    residual = np.quantile(np.linalg.norm(_linearised(flight, track)[0], axis=2), 0.9, axis=1) / _TENTH_OF_THREE
    flight = replace(flight, dropped=int(np.sum(~kept)), largest=(float(residual[0]), float(residual[1])))
    # Declared noise that the residuals exceed: as much wider.
    return replace(flight, rows=flight.rows / np.sqrt(max(flight.misfit, 1.0)))
