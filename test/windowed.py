"""Windows for tests of the filter, and a smooth motion in closed form with what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np

from mbaid_ros.core.contracts import Stack
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.linearise import WhitenedWindow, WindowModel, whitened_windows, window_models
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.geometry import Array, exp, rotate
from mbaid_ros.core.joints.model import JointNoise
from mbaid_ros.core.odometry.model import IntegratedTwist, Measurement
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, Stamps
from mbaid_ros.core.state import BODY, Layout, Point, Variables
from mbaid_ros.core.windows import AFTER, BEFORE, Knots, Window, WindowNoise, averages
from observed import MID

LENGTH = 0.5  # s, of the window
START = 4.0  # s
FIRST, LAST = START + 0.025, START + LENGTH + 0.025  # s, its first knot and the next window's, of 0.05 s each
JOINT = 1e-4  # rad


def window_of(samples: Samples, spacing: float, correlation_time: float = 0.0) -> Window:
    """Return the window at START, with its neighbours, of samples that are free of noise."""
    begin = START - BEFORE * spacing
    count = BEFORE + round(LENGTH / spacing) + AFTER
    first, last = np.searchsorted(samples.time, [begin - 1e-6, begin + count * spacing - 1e-6])
    knots = averages([samples[int(first) : int(last)]], np.array([begin]), spacing, count, np.zeros(3))
    noise = WindowNoise(round(LENGTH * 100), JOINT, np.eye(6) * 1e-30, np.eye(6) * 1e-30, correlation_time)
    return Window(knots, slice(BEFORE, count - AFTER), spacing, noise, START, after_gap=False)


def half_second_windows(samples: Samples, until: float = 23.0) -> list[Window]:
    """Return the windows from 1 s until a time, s, of samples read with the noise of MID."""
    spacing, length = 0.05, 0.5
    count = BEFORE + round(length / spacing) + AFTER
    noise = WindowNoise(50, MID.joint_position, np.eye(6) * 1e-6, np.eye(6) * 1e-6, 0.0)
    found = []
    for start in np.arange(1.0, until, length):
        begin = start - BEFORE * spacing
        first, last = np.searchsorted(samples.time, [begin - 1e-6, begin + count * spacing - 1e-6])
        knots = averages([samples[int(first) : int(last)]], np.array([begin]), spacing, count, np.zeros(3))
        found.append(Window(knots, slice(BEFORE, count - AFTER), spacing, noise, float(start), after_gap=False))
    return found


def residuals(model: WindowModel, x: Array) -> tuple[Array, Array, Array]:
    """Return what pose and twist leave unexplained, and the pose error at the next window."""
    return (
        model.pose.value - model.pose.rows @ x,
        model.rates.value - model.rates.rows @ x,
        model.transition @ x + model.drift,
    )


def window_model(layout: Layout, window: Window, point: Point) -> WindowModel:
    """Return one window's model."""
    return window_models(layout, [Stack((window,), (0,))], point)[0]


SPACING = 0.05  # s, of knots


def joint_window(positions: Array, start: float) -> Window:
    """Return a window with joints at positions (J, n), its neighbours' knots among these; it begins at a time, s."""
    length = len(positions)
    there, nothing = np.zeros((length, 3)), np.zeros((length, 0))
    turns = np.broadcast_to(np.eye(3), (length, 3, 3))
    twist, times = np.zeros((length, 6)), np.zeros(length)
    knots = Knots(positions, turns, there, twist, times, times, twist, nothing, nothing, nothing, there, nothing)
    noise = WindowNoise(100, 1e-4, np.eye(6), np.eye(6))
    return Window(knots, slice(BEFORE, length - AFTER), SPACING, noise, start, after_gap=False)


UNKNOWNS = 3  # of the known side
NUMBERS = 10 + 2  # of the body and those unknowns that the prediction depends on
STATE = BODY.stop + UNKNOWNS


def prepare(window: WindowModel, variables: Variables) -> WhitenedWindow:
    """Return one window in the filter's variables."""
    return whitened_windows(window[None], variables)[0]  # type: ignore[index]


def variables(rng: np.random.Generator) -> Variables:
    """Return variables of drawn sizes and priors."""
    scale, deviation = rng.uniform(0.5, 2.0, STATE), rng.uniform(1.0, 1.4, STATE)
    scale[BODY.stop :] = deviation[BODY.stop :] = 1.0
    mean = rng.normal(size=STATE)
    mean[BODY.stop :] = 0.0
    force = np.diag(rng.uniform(0.5, 2.0, 6))
    return Variables(np.eye(STATE), scale, np.eye(6), force, mean, np.diag(deviation), np.eye(UNKNOWNS), np.ones(6))


def positive(rng: np.random.Generator, size: float = 1.0) -> Array:
    """Return a drawn covariance (6, 6)."""
    root = rng.normal(size=(6, 8))
    return size * root @ root.T


def window(rng: np.random.Generator, process: float = 0.0) -> WindowModel:
    """Return a drawn window whose joints' noise adds as much on the way as `process` says, (6, 8)."""
    turn = 0.1 * rng.normal(size=(6, STATE))
    turn[:, :6] += np.eye(6)
    return WindowModel(
        Measurement(rng.normal(size=6), rng.normal(size=(6, STATE)), positive(rng)),
        Measurement(rng.normal(size=6), rng.normal(size=(6, STATE)), positive(rng)),
        transition=turn,
        drift=rng.normal(size=6),
        noise=JointNoise(
            process=np.sqrt(process) * rng.normal(size=(6, 8)),
            pose=(joints := rng.normal(size=(6, 3))),
            by_unknowns=rng.normal(size=(6, NUMBERS, 3)),
            common=np.zeros((6, 0)),
            process_gain=np.zeros((6, 0)),
            process_variance=np.zeros(0),
        ),
        joints_in_rates=joints,
        joints_in_twist=np.array(rng.uniform(0.5, 2.0)),
        length=np.array(0.5),
        rotation=np.eye(3),
        position=rng.normal(size=3),
        centre=rng.normal(size=3),
        momentum_change=np.zeros((6, STATE)),
        thrust_noise=np.zeros((6, 6)),
        body=rng.normal(size=10),
        integrated=IntegratedTwist.none(1, STATE)[0],
    )


_START = 1_700_000_000_000_000_000
Stream = TypeVar('Stream', JointStream, BaseStream)


@dataclass(frozen=True)
class BaseMotion:
    """The base at N instants: position, rotation (N, 3, 3), linear and angular velocity, odometry axes."""

    position: Array
    rotation: Array
    linear_velocity: Array
    angular_velocity: Array


def smooth_motion(stamps: Stamps) -> BaseMotion:
    """Return the base's motion: about a turning axis, by about 1 m and 1 rad within seconds."""
    time = (stamps - _START) * 1e-9
    zero, one = np.zeros_like(time), np.ones_like(time)
    position = np.stack((np.sin(time), 0.5 * np.cos(1.3 * time), 0.2 * time), axis=1)
    velocity = np.stack((np.cos(time), -0.65 * np.sin(1.3 * time), 0.2 * one), axis=1)
    # R = Exp(a(t) e_z) Exp(b(t) e_x) turns at a' e_z + Exp(a e_z) b' e_x.
    first = exp(np.stack((zero, zero, np.sin(0.8 * time)), axis=1))
    second = exp(np.stack((0.5 * np.cos(1.1 * time), zero, zero), axis=1))
    rate = np.stack((-0.55 * np.sin(1.1 * time), zero, zero), axis=1)
    spin = np.stack((zero, zero, 0.8 * np.cos(0.8 * time)), axis=1) + rotate(first, rate)
    return BaseMotion(position, first @ second, velocity, spin)


def base_stream(stamps: Stamps) -> BaseStream:
    """Return the base's motion as measured without error, with covariances that differ from one stamp to the next."""
    motion = smooth_motion(stamps)
    size = 1.0 + 0.5 * np.sin((stamps - _START) * 1e-9)[:, None, None]
    covariance = np.diag([1e-6, 2e-6, 3e-6, 4e-8, 5e-8, 6e-8])
    return BaseStream(
        stamps,
        motion.position,
        motion.rotation,
        motion.linear_velocity,
        motion.angular_velocity,
        size * covariance,
        2.0 * size * covariance,
    )


def joint_stream(stamps: Stamps) -> JointStream:
    """Return two joints, measured without error."""
    time = (stamps - _START) * 1e-9
    position = np.stack((np.sin(time), np.cos(0.7 * time)), axis=1)
    return JointStream(stamps, position, np.stack((np.cos(time), -0.7 * np.sin(0.7 * time)), axis=1))


def piece(stream: Stream, begin: int, end: int) -> Stream | None:
    """Return measurements of a stream, None if there are none."""
    part = type(stream)(*(getattr(stream, item.name)[begin:end] for item in fields(stream)))
    return part if len(part.stamp) else None


def covariance_of(gaussian: SquareRootInformation, space: Variables) -> Array:
    """Return the covariance of the state."""
    factor = MeanAndCovariance.from_gaussian(gaussian, space).factor
    return np.asarray(factor @ factor.T)
