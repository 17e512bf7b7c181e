"""Estimates and motions to messages, duck-typed: one builder for rclpy's classes and rosbags'."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.estimate import PARAMETERS, Estimate, Event, is_usable
from mbaid_ros.core.target import Debris, DebrisPublication
from mbaid_ros.joint_trajectory import JointTrajectory


class InertiaPublication:
    """The mass properties of estimates that follow each other."""

    def __init__(self) -> None:
        self._published = False  # whether the last ones can be used

    def next_published(self, estimate: Estimate) -> Estimate | None:
        """Return the next estimate, without its numbers where these cannot be used; None where that is known."""
        before, self._published = self._published, is_usable(estimate)
        if self._published:
            return estimate
        return replace(estimate, parameters=np.full(10, np.nan)) if before else None


def parameters_of(message: Any) -> Array:
    """Return mass, centre of mass and inertia, (10,), of an InertiaEstimate; NaN where not identifiable."""
    inertia = message.inertia
    tensor = (getattr(inertia, name) for name in PARAMETERS[4:])
    values = np.array([inertia.m, inertia.com.x, inertia.com.y, inertia.com.z, *tensor], dtype=float)
    return np.where(np.asarray(message.identifiable, dtype=bool), values, np.nan)


if TYPE_CHECKING:
    from mbaid_ros.core.capture import Capture


@dataclass(frozen=True)
class MessageTypes:
    """Where the message classes come from."""

    find: Callable[[str], Any]  # returns the class of a type: ``package/msg/Type``
    flags: Callable[[Flags], Any]  # converts to a field of type bool[]: rclpy wants a list, rosbags an array


@dataclass(frozen=True)
class Frames:
    """The frames an estimate is given in."""

    target_link: str  # frame of mass properties, without the prefix
    odometry: str  # frame of the momenta
    prefix: str = ''  # of the name of the first one in messages


def estimate_message(
    estimate: Estimate, types: MessageTypes, frames: Frames, warnings: Sequence[str] = (), *, stale: bool = False
) -> Any:
    """Return an estimate as a mbaid_msgs/InertiaEstimate.

    Parameters
    ----------
    warnings : those of the run, which come after the estimate's own
    stale : whether it is published again because no data come
    """
    budget = estimate.budget
    return types.find('mbaid_msgs/msg/InertiaEstimate')(
        header=_header(estimate, types, frames),
        method=estimate.method,
        stage=estimate.stage,
        status=estimate.status,
        phase=estimate.phase,
        stale=stale,
        inertia=_inertia(estimate.parameters, types),
        covariance=np.ascontiguousarray(estimate.covariance, dtype=float).ravel(),
        standard_deviation=np.ascontiguousarray(estimate.std, dtype=float),
        budget_causes=[] if budget is None else list(budget.causes),
        budget_shares=np.zeros(0) if budget is None else np.ascontiguousarray(budget.shares, dtype=float).ravel(),
        identifiable=types.flags(np.asarray(estimate.identifiable, dtype=bool)),
        momentum_frame=frames.odometry,
        linear_momentum=vector(estimate.momentum[:3], types),
        angular_momentum=vector(estimate.momentum[3:], types),
        momentum_covariance=np.ascontiguousarray(estimate.momentum_covariance, dtype=float).ravel(),
        residual=float(estimate.residual),
        time_offset=float(estimate.time_offset),
        time_offset_std=float(estimate.time_offset_std),
        consistency_correction=float(estimate.consistency_correction),
        events=[_event(event, estimate, types) for event in estimate.events],
        repairs=[str(repair) for repair in estimate.repairs],
        samples=int(estimate.samples),
        span=_duration(max(0.0, estimate.time), types),
        warnings=[*estimate.warnings, *warnings, *map(str, estimate.flexible)],
    )


def debris_message(
    alone: Debris, estimate: Estimate, types: MessageTypes, frames: Frames, capture: Capture | None = None
) -> Any:
    """Return the captured body alone as a mbaid_msgs/InertiaEstimate.

    Its momenta are those that the body alone had before the capture; NaN where the run began after it. It has no error
    budget: that of the estimate is of the whole link.

    Parameters
    ----------
    alone : the captured body; NaN where nothing is known of it any more
    estimate : that it was taken from
    frames : of the estimate
    capture : Capture, optional
    """
    body = replace(
        estimate,
        parameters=alone.parameters,
        covariance=alone.covariance,
        identifiable=np.isfinite(alone.parameters),
        budget=None,
        momentum=np.full(6, np.nan) if capture is None else capture.momentum,
        momentum_covariance=np.full((6, 6), np.nan) if capture is None else capture.covariance,
    )
    return estimate_message(body, types, frames)


def inertia_message(estimate: Estimate, types: MessageTypes, frames: Frames) -> Any:
    """Return the mass properties alone as a geometry_msgs/InertiaStamped; NaN if the data do not determine one."""
    return types.find('geometry_msgs/msg/InertiaStamped')(
        header=_header(estimate, types, frames), inertia=_inertia(estimate.parameters, types)
    )


class Publications:
    """The messages of a run's estimates in order; a withdrawn form is published once more, as NaN."""

    def __init__(self, types: MessageTypes) -> None:
        self._types = types
        self._inertia, self._debris = InertiaPublication(), DebrisPublication()

    def messages_of(
        self, estimate: Estimate, frames: Frames, alone: Debris | None = None, capture: Capture | None = None
    ) -> Iterator[tuple[str, Any]]:
        """Yield the last parts of the topics' names with their messages; parameters as of `debris_message`."""
        yield 'estimate', estimate_message(estimate, self._types, frames)
        inertia, body = self._inertia.next_published(estimate), self._debris.next_published(alone)
        if inertia is not None:
            yield 'inertia', inertia_message(inertia, self._types, frames)
        if body is not None:
            yield 'debris', debris_message(body, estimate, self._types, frames, capture)


def _event(event: Event, estimate: Estimate, types: MessageTypes) -> Any:
    stamp = max(0, estimate.stamp - round((estimate.time - event.time) * 1e9))
    return types.find('mbaid_msgs/msg/MomentumEvent')(
        stamp=time_message(stamp, types),
        time=float(event.time),
        kind=event.kind,
        linear=vector(event.linear, types),
        angular=vector(event.angular, types),
        cause=event.cause,
    )


def time_message(stamp: int, types: MessageTypes) -> Any:
    """Return a stamp in ns as a builtin_interfaces/Time."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return types.find('builtin_interfaces/msg/Time')(sec=seconds, nanosec=nanoseconds)


def stamped(stamp: int, frame: str, types: MessageTypes) -> Any:
    """Return a std_msgs/Header with a stamp in ns."""
    return types.find('std_msgs/msg/Header')(stamp=time_message(stamp, types), frame_id=frame)


def _header(estimate: Estimate, types: MessageTypes, frames: Frames) -> Any:
    return stamped(estimate.stamp, f'{frames.prefix}{frames.target_link}', types)


def _inertia(parameters: Array, types: MessageTypes) -> Any:
    mass, _, _, _, ixx, ixy, ixz, iyy, iyz, izz = (float(value) for value in parameters)
    return types.find('geometry_msgs/msg/Inertia')(
        m=mass, com=vector(parameters[1:4], types), ixx=ixx, ixy=ixy, ixz=ixz, iyy=iyy, iyz=iyz, izz=izz
    )


def vector(values: Array, types: MessageTypes, name: str = 'Vector3') -> Any:
    """Return values (3,) or (4,) as a type of geometry_msgs with fields x, y, z and w."""
    return types.find(f'geometry_msgs/msg/{name}')(**dict(zip('xyzw', map(float, values), strict=False)))


def trajectory_message(trajectory: JointTrajectory, types: MessageTypes) -> Any:
    """Return a motion as a trajectory_msgs/JointTrajectory; its stamp is 0: it begins when it is received."""
    point = types.find('trajectory_msgs/msg/JointTrajectoryPoint')
    derivatives = trajectory.position, trajectory.velocity, trajectory.acceleration
    parts = [each if each.size else np.zeros((len(trajectory.time), 0)) for each in derivatives]
    return types.find('trajectory_msgs/msg/JointTrajectory')(
        header=stamped(0, '', types),
        joint_names=list(trajectory.joints),
        points=[
            point(
                positions=parts[0][k],
                velocities=parts[1][k],
                accelerations=parts[2][k],
                effort=np.zeros(0),
                time_from_start=_duration(time, types),
            )
            for k, time in enumerate(trajectory.time.tolist())
        ],
    )


def _duration(time: float, types: MessageTypes) -> Any:
    seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
    return types.find('builtin_interfaces/msg/Duration')(sec=seconds, nanosec=nanoseconds)
