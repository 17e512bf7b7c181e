"""Reaction wheels and stored momentum: topic, parameters, and errors of their spin inertias."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbaid_ros.core.contracts import NominalModel, Unknown, diagonal
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel, Storage
from mbaid_ros.core.samples import JointStream, stamp_of
from mbaid_ros.core.windows import ANGULAR_FIRST, Bodies
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.parameters import parameter

NOT_FINITE_MOMENTUM = 'stored momentum with a NaN or infinite value'
OTHER_MOMENTUM_FRAME = 'stored momentum in another frame'
NOT_ASKED_FOR = 'stored momentum is published but not used: set wheels.momentum_frame'
_WHEEL_SPEED_STD = 0.05  # rad/s, of tachometers and of Hall sensors: 0.5 rpm


@dataclass(frozen=True)
class WheelBodies:
    """Wheels inside the base that are no joints of the robot description."""

    names: tuple[str, ...] = parameter(())
    """Names of the wheels in JointState, whose velocities are read; none may be a joint of the robot."""
    axes: tuple[float, ...] = parameter(())
    """Axis of each wheel in the base link's frame, three numbers each; any length but zero."""
    spin_inertias: tuple[float, ...] = parameter((), 'kg m^2', minimum=0.0, exclusive_minimum=True)
    """Moment of inertia of each wheel about its axis; the base link's inertia also includes it, with the wheels
    locked."""


@dataclass(frozen=True)
class WheelsConfig(WheelBodies):
    """The wheels, with their uncertainty, and gyros of which only the momentum is published."""

    spin_inertia_relative_std: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Relative standard deviation of each spin inertia, estimated by trajectory; 0: exact."""
    momentum_frame: str = parameter('')
    """Link whose axes stored_momentum uses for the angular momentum of wheels or gyros, in place of wheels.names;
    samples without such a message are not used. Empty: the topic is not used."""
    momentum_std: float = parameter(0.0, 'N m s', minimum=0.0)
    """Standard deviation of each coordinate of stored_momentum."""


def make_storage(
    names: Sequence[str], axes: Sequence[float], spin_inertias: Sequence[float], model: RobotModel, noise: float = 0.0
) -> Storage:
    """Return wheels inside the base, whose speeds are read with a noise (rad/s).

    Raises ParameterError: Names, axes and spin inertias differ in number, an axis is zero, or a name is that of a
    joint.
    """
    count = len(names)
    for name, values, wanted in (('axes', axes, 3 * count), ('spin_inertias', spin_inertias, count)):
        if len(values) != wanted:
            raise ParameterError(
                f"parameter 'wheels.{name}' has {len(values)} numbers; accepted: {wanted}, for the {count} of "
                "'wheels.names'"
            )
    if len(set(names) - set(model.joint_names)) < count:
        raise ParameterError(
            f"parameter 'wheels.names' is {listing(names)}; accepted: names that differ, none of them a joint's: "
            f'{listing(model.joint_names)}'
        )
    directions = np.array(axes, dtype=float).reshape(count, 3)
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    if np.any(lengths == 0.0):
        raise ParameterError(
            f"parameter 'wheels.axes' is {list(axes)}; accepted: three numbers each, not all of them 0"
        )
    return Storage.from_wheels(model.link(model.base_link), names, directions / lengths, spin_inertias, noise)


class StoredMomentum:
    """Collects published stored momentum (wheels) until `stream` returns it.

    Parameters
    ----------
    frame : name of the link whose axes are used; links fixed to it are accepted as well. Empty accepts nothing

    Attributes
    ----------
    used : number of messages used
    dropped : those not used, by cause
    other_frame : frame of the last one in another
    """

    def __init__(self, model: RobotModel, frame: str) -> None:
        self._rotations: dict[str, Array] = {}
        if frame:
            wanted = model.link(frame)
            same = (link for link in model.links if link.body == wanted.body)
            self._rotations = {link.name: wanted.rotation.T @ link.rotation for link in same}
        self._stamps: list[int] = []
        self._vectors: list[Array] = []
        self.used = 0
        self.dropped: Counter[str] = Counter()
        self.other_frame = ''

    def add_sample(self, frame: str, stamp: int, momentum: Array) -> None:
        """Add a (3,) momentum, N m s, in a frame's axes at a stamp, ns."""
        if not self._rotations:
            self.dropped[NOT_ASKED_FOR] += 1
        elif frame not in self._rotations:
            self.other_frame = frame
            self.dropped[OTHER_MOMENTUM_FRAME] += 1
        elif not np.all(np.isfinite(momentum)):
            self.dropped[NOT_FINITE_MOMENTUM] += 1
        else:
            self.used += 1
            self._stamps.append(stamp)
            self._vectors.append(self._rotations[frame] @ momentum)

    def stream(self) -> JointStream | None:
        """Return all momenta since the last call, as rates of three joints without positions; None for none."""
        if not self._stamps:
            return None
        stamps, vectors = np.array(self._stamps, dtype=np.int64), np.array(self._vectors)
        self._stamps, self._vectors = [], []
        return JointStream(stamps, np.zeros_like(vectors), vectors)


@dataclass(frozen=True, eq=False)
class SpinInertias(Unknown):
    """Errors of the spin inertias of wheels inside bodies, kg m^2."""

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the momentum of each at a unit spin inertia."""
        directions = kernel.storage.axes_in_odometry(states.configuration.rotation)
        columns = np.zeros((len(directions), 6, kernel.storage.count))
        columns[:, 3:] = np.swapaxes(states.stored[..., None] * directions, 1, 2)
        return columns

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these spin inertias."""
        return replace(nominal, kernel=nominal.kernel.with_storage(nominal.kernel.storage.with_inertia_changes(value)))


def spin_inertias(kernel: MomentumKernel, deviations: Sequence[float]) -> SpinInertias:
    """Return the spin inertias as an unknown, of standard deviations (c,) in kg m^2; 0 is exact, and empty all."""
    sizes = deviations if len(deviations) else (0.0,) * kernel.storage.count
    return SpinInertias(diagonal(sizes), tuple(f'wheel:{name}' for name in kernel.storage.names))


def by_readings(bodies: Bodies) -> Array:
    """Return the effect of the noise of each reading of stored momentum on the twist, (N, 6, c)."""
    storage, placed = bodies.states.storage, bodies.states.configuration
    columns = bodies.inverse_inertia @ storage.jacobian(placed.rotation)
    return np.asarray(columns[:, ANGULAR_FIRST] * storage.noises)


def vector_of(message: Any) -> tuple[str, int, Array]:
    """Return frame, stamp (ns) and (3,) numbers of a Vector3Stamped."""
    vector = message.vector
    values = np.array([vector.x, vector.y, vector.z], dtype=float)
    return message.header.frame_id.lstrip('/'), stamp_of(message), values


def storage(config: WheelsConfig, model: RobotModel) -> Storage:
    """Return the momentum stored inside bodies: the wheels by name, then that of the topic stored_momentum.

    Raises ModelError, ParameterError: Names, axes and spin inertias differ in number, an axis is zero, or a name is a
    joint's or no link's.
    """
    wheels = make_storage(config.names, config.axes, config.spin_inertias, model, _WHEEL_SPEED_STD)
    if not config.momentum_frame:
        return wheels
    return wheels + Storage.from_published(model.link(config.momentum_frame), config.momentum_std)


def _spin_deviations(config: WheelsConfig) -> tuple[float, ...]:
    """Return the standard deviation of each spin inertia, kg m^2; 0 for a published momentum, which has none."""
    wheels = (config.spin_inertia_relative_std * inertia for inertia in config.spin_inertias)
    return (*wheels, *((0.0,) * 3 if config.momentum_frame else ()))


def declared_wheels(config: WheelsConfig, kernel: MomentumKernel) -> SpinInertias:
    """Return the spin inertias of wheels."""
    return spin_inertias(kernel, _spin_deviations(config))
