"""The parameters about what the robot description does not have: wheels inside the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.config.parameters import parameter
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.storage import Storage


@dataclass(frozen=True)
class WheelsConfig:
    """Wheels and gyros that are no joints of the robot description."""

    names: tuple[str, ...] = parameter(
        (), 'Names of the wheels in JointState, whose velocities are read; none may be a joint of the robot.'
    )
    axes: tuple[float, ...] = parameter(
        (), "Axis of each wheel in the base link's frame, three numbers each; any length but zero."
    )
    spin_inertias: tuple[float, ...] = parameter(
        (),
        'Moment of inertia of each wheel about its axis; the base link has it, too, with the wheels locked.',
        unit='kg m^2',
        minimum=0.0,
        exclusive_minimum=True,
    )
    spin_inertia_relative_std: float = parameter(
        0.0,
        'Relative standard deviation of each spin inertia, estimated along (trajectory); 0 takes them as exact.',
        minimum=0.0,
        maximum=1.0,
    )
    speed_std: float = parameter(0.05, "Standard deviation of a wheel's speed.", unit='rad/s', minimum=0.0)
    momentum_frame: str = parameter(
        '',
        'Link in whose axes stored_momentum tells the angular momentum of wheels or gyros, wheels.names left out; '
        'samples without one are not used. Empty: the topic is not used.',
    )
    momentum_std: float = parameter(
        0.0, 'Standard deviation of each coordinate of that momentum.', unit='N m s', minimum=0.0
    )


@dataclass(frozen=True)
class SimulatedWheelsConfig:
    """Wheels inside the base of the simulated robot that are no joints of its description."""

    names: tuple[str, ...] = parameter((), 'Names of the wheels; empty means that there are none.')
    axes: tuple[float, ...] = parameter((), "Axis of each wheel in the base link's frame, three numbers each.")
    spin_inertias: tuple[float, ...] = parameter(
        (),
        'Moment of inertia of each wheel about its axis; the base link has it, too, with the wheels locked.',
        unit='kg m^2',
        minimum=0.0,
        exclusive_minimum=True,
    )
    speeds: tuple[float, ...] = parameter(
        (), 'Speed of each wheel relative to the base at time 0; empty means zero.', unit='rad/s'
    )
    accelerations: tuple[float, ...] = parameter(
        (), 'Change of that speed, constant: held without, ramped with one; empty means zero.', unit='rad/s^2'
    )
    wander: float = parameter(
        0.0, 'Largest amplitude of what each speed wanders beside, as drawn sinusoids.', unit='rad/s', minimum=0.0
    )
    seed: int = parameter(0, 'The same seed gives the same wander.', minimum=0)
    speed_noise: float = parameter(0.0, 'Noise of the speeds that are read.', unit='rad/s', minimum=0.0)
    publish: str = parameter(
        'joint_states',
        'Where the wheels are told: as velocities in joint_states (positions are 0, which nobody reads), as their '
        'momentum on stored_momentum with every JointState, or nowhere.',
        choices=('joint_states', 'stored_momentum', 'none'),
    )


def make_storage(
    names: Sequence[str], axes: Sequence[float], spin_inertias: Sequence[float], model: RobotModel, noise: float = 0.0
) -> Storage:
    """Return wheels inside the base, whose speeds are read with a noise (rad/s).

    Raises
    ------
    ParameterError
        Names, axes and spin inertias differ in number, an axis is zero, or a name is that of a joint.
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
    return Storage.wheels(model.link(model.base_link), names, directions / lengths, spin_inertias, noise)
