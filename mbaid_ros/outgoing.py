"""Estimates to messages, duck-typed: one builder for rclpy's classes and rosbags', so that both faces say the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbaid_ros.core.capture import Capture
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.debris import Debris
from mbaid_ros.core.results.estimate import Estimate


@dataclass(frozen=True)
class MessageTypes:
    """Where the message classes come from.

    Attributes
    ----------
    find : returns the class of a type: ``package/msg/Type``
    flags : returns what a field of type bool[] takes: rclpy wants a list, rosbags an array
    """

    find: Callable[[str], Any]
    flags: Callable[[Flags], Any]


@dataclass(frozen=True)
class Frames:
    """The frames an estimate is given in.

    Attributes
    ----------
    target_link : frame of mass properties
    odometry : frame of the momenta
    """

    target_link: str
    odometry: str


def estimate_message(estimate: Estimate, types: MessageTypes, frames: Frames, warnings: Sequence[str] = ()) -> Any:
    """Return an estimate as a mbaid_msgs/InertiaEstimate.

    Parameters
    ----------
    estimate : Estimate
    types : MessageTypes
    frames : Frames
    warnings : those of the run, which come after the estimate's own
    """
    seconds, nanoseconds = divmod(max(0, round(estimate.time * 1e9)), 1_000_000_000)
    return types.find('mbaid_msgs/msg/InertiaEstimate')(
        header=_header(estimate, types, frames),
        method=estimate.method,
        status=estimate.status,
        inertia=_inertia(estimate.parameters, types),
        covariance=np.ascontiguousarray(estimate.covariance, dtype=float).ravel(),
        identifiable=types.flags(np.asarray(estimate.identifiable, dtype=bool)),
        momentum_frame=frames.odometry,
        linear_momentum=_vector(estimate.momentum[:3], types),
        angular_momentum=_vector(estimate.momentum[3:], types),
        momentum_covariance=np.ascontiguousarray(estimate.momentum_covariance, dtype=float).ravel(),
        residual=float(estimate.residual),
        time_offset=float(estimate.time_offset),
        time_offset_std=float(estimate.time_offset_std),
        consistency_correction=float(estimate.consistency_correction),
        samples=int(estimate.samples),
        span=types.find('builtin_interfaces/msg/Duration')(sec=seconds, nanosec=nanoseconds),
        warnings=[*estimate.warnings, *warnings],
    )


def debris_message(
    alone: Debris, estimate: Estimate, types: MessageTypes, frames: Frames, capture: Capture | None = None
) -> Any:
    """Return the captured body alone as a mbaid_msgs/InertiaEstimate in its own frame.

    Its momenta are those that the body alone had before the capture; NaN where the run began after it.

    Parameters
    ----------
    alone : the captured body
    estimate : that it was taken from
    types : MessageTypes
    frames : of the estimate
    capture : Capture, optional
    """
    body = replace(
        estimate,
        parameters=alone.parameters,
        covariance=alone.covariance,
        momentum=np.full(6, np.nan) if capture is None else capture.momentum,
        momentum_covariance=np.full((6, 6), np.nan) if capture is None else capture.covariance,
    )
    return estimate_message(body, types, replace(frames, target_link=alone.frame.name))


def inertia_message(estimate: Estimate, types: MessageTypes, frames: Frames) -> Any:
    """Return the mass properties alone as a geometry_msgs/InertiaStamped; NaN is what the data do not determine."""
    return types.find('geometry_msgs/msg/InertiaStamped')(
        header=_header(estimate, types, frames), inertia=_inertia(estimate.parameters, types)
    )


def _header(estimate: Estimate, types: MessageTypes, frames: Frames) -> Any:
    seconds, nanoseconds = divmod(estimate.stamp, 1_000_000_000)
    time = types.find('builtin_interfaces/msg/Time')(sec=seconds, nanosec=nanoseconds)
    return types.find('std_msgs/msg/Header')(stamp=time, frame_id=frames.target_link)


def _inertia(parameters: Array, types: MessageTypes) -> Any:
    mass, _, _, _, ixx, ixy, ixz, iyy, iyz, izz = (float(value) for value in parameters)
    return types.find('geometry_msgs/msg/Inertia')(
        m=mass, com=_vector(parameters[1:4], types), ixx=ixx, ixy=ixy, ixz=ixz, iyy=iyy, iyz=iyz, izz=izz
    )


def _vector(values: Array, types: MessageTypes) -> Any:
    return types.find('geometry_msgs/msg/Vector3')(x=float(values[0]), y=float(values[1]), z=float(values[2]))
