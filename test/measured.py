"""A smooth motion of joints and base in closed form, and what is measured of it at given stamps."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np

from mbaid_ros.core.geometry import Array, exp, rotate
from mbaid_ros.core.samples import BaseStream, JointStream, Stamps

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
