"""The one kernel: from samples to what the known bodies' momentum is and how the target link moves."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.array_record import Index
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.kinematics import Configuration, Kinematics
from mbaid_ros.core.robot.model import Link, RobotModel, express
from mbaid_ros.core.robot.model_errors import KnownErrors, displaced
from mbaid_ros.core.robot.momentum import Storage, momentum, regressor
from mbaid_ros.core.robot.orbit import OF_A_THRUSTER, about
from mbaid_ros.core.samples import Samples


@dataclass(frozen=True)
class BodyStates:
    """N samples as the momentum equations need them, in odometry axes about the base link's origin.

    Attributes
    ----------
    configuration : poses of the bodies and joint twists
    body_twist : (N, n + 1, 6) twist of every body
    known : (N, n + 1, 10) standard parameters of the known bodies
    rotation, position, twist : (N, 3, 3), (N, 3), (N, 6) of the target link: R, r and (u, w)
    storage, readings : what stores momentum inside bodies, and what is read of it, (N, c)
    tide : (N, n + 1, 6, 10) what an orbit has changed (P, L_b) by, by each body's standard parameters in its own frame;
        (N, 0, 6, 10) without one
    thrust : (N, f, 6, 5) what thrust has changed (P, L_b) by, by how much each thruster is off its command
    """

    configuration: Configuration
    body_twist: Array
    known: Array
    rotation: Array
    position: Array
    twist: Array
    storage: Storage
    readings: Array
    tide: Array
    thrust: Array

    def __getitem__(self, index: Index) -> BodyStates:
        """Return the states of a slice, mask or list of samples."""
        return BodyStates(
            self.configuration[index],
            self.body_twist[index],
            self.known[index],
            self.rotation[index],
            self.position[index],
            self.twist[index],
            self.storage,
            self.readings[index],
            self.tide[index],
            self.thrust[index],
        )

    @property
    def momenta(self) -> Array:
        """(P, L) of each known body, what is stored in it included, (N, n + 1, 6)."""
        momenta = momentum(self.known, self.body_twist)
        if self.storage.count:
            momenta[..., 3:] += self.storage.momenta(self.configuration.rotation, self.readings)
        return momenta

    @property
    def known_momentum(self) -> Array:
        """(P_k, L_k) of all known bodies, what is stored in any included, (N, 6)."""
        return np.sum(self.momenta, axis=1)

    @property
    def regressor(self) -> Array:
        """Y of the target link, (N, 6, 10): its momentum is Y (m, h, I_o)."""
        return regressor(self.rotation, self.position, self.twist)

    def regressor_of(self, link: Link) -> Array:
        """Return Y of any link, (N, 6, 10)."""
        rotation, position = self.configuration.link(link)
        return regressor(rotation, position, self.body_twist[:, link.body])

    @property
    def hinge_velocity(self) -> Array:
        """Velocity v of the target link's origin, (N, 3) m/s."""
        return self.twist[:, :3] + cross(self.twist[:, 3:], self.position)


class MomentumKernel:
    """The momentum of a robot with one unknown link, or several, for batches of samples.

    Parameters
    ----------
    model : RobotModel
    target : str
        Name of the unknown link. Its inertial entry in the URDF never enters.
    others : str
        Names of further unknown links (theta_u and theta_k in the paper's eqs. 6 to 14: any partition of the bodies).

    Attributes
    ----------
    target : the first of the unknown links
    unknown : all of them
    known : (n + 1, 10) standard parameters of the known bodies, each in its own frame
    errors : how far these may be off; none where nothing is said
    storage : what stores momentum inside bodies; nothing does where nothing is said

    Raises
    ------
    ModelError
        An unknown link is not one of the model.
    """

    def __init__(self, model: RobotModel, target: str, *others: str) -> None:
        self.model = model
        self.target = model.link(target)
        self.unknown = (self.target, *map(model.link, others))
        self.kinematics = Kinematics(model)
        self.known = model.body_parameters(without=(target, *others))
        self.errors = KnownErrors()
        self.storage = Storage()

    def corrected(self, change: Array) -> MomentumKernel:
        """Return a kernel whose known bodies differ by (n + 1, 10) standard parameters, each in its own frame."""
        return self._with(known=self.known + change)

    def displaced(self, origins: Array, tilts: Array) -> MomentumKernel:
        """Return a kernel whose joints are elsewhere: (n, 3) m, (n, 3) rad as in `ModelErrors`."""
        model = displaced(self.model, origins, tilts)
        return self._with(model=model, kinematics=Kinematics(model))

    def with_uncertainty(self, errors: KnownErrors) -> MomentumKernel:
        """Return a kernel whose known bodies may be off by these errors."""
        return self._with(errors=errors)

    def with_target(self, parameters: Array) -> Array:
        """Return the (n + 1, 10) standard parameters of all bodies, of (10,) those of the target link in its frame."""
        known = self.known.copy()
        known[self.target.body] += express(parameters, self.target.rotation, self.target.position)
        return known

    def storing(self, storage: Storage) -> MomentumKernel:
        """Return a kernel of a robot that stores momentum inside bodies."""
        return self._with(storage=storage)

    def _with(self, **changed: object) -> MomentumKernel:
        other = copy(self)
        vars(other).update(changed)
        return other

    def states(self, samples: Samples) -> BodyStates:
        """Return the states of all bodies at N samples."""
        twist = np.concatenate((samples.base_linear_velocity, samples.base_angular_velocity), axis=-1)
        motion = (samples.base_rotation, samples.joint_position, samples.joint_velocity, twist)
        states = self.states_of(*motion, samples.stored)
        if not samples.tide.shape[1] and not samples.thrust.shape[1]:
            return states
        place = samples.base_position
        return replace(states, tide=about(samples.tide, place), thrust=about(samples.thrust, place, OF_A_THRUSTER))

    def states_of(
        self,
        base_rotation: Array,
        joint_position: Array,
        joint_velocity: Array,
        base_twist: Array,
        readings: Array | None = None,
    ) -> BodyStates:
        """Return the states of all bodies for (N, 3, 3), (N, n), (N, n), (N, 6) in odometry axes.

        Without (N, c) readings of what stores momentum, nothing is stored.
        """
        configuration = self.kinematics.configure(base_rotation, joint_position)
        body_twist = self.kinematics.body_twists(configuration, joint_velocity, base_twist)
        rotation, position = configuration.link(self.target)
        return BodyStates(
            configuration=configuration,
            body_twist=body_twist,
            known=express(self.known, configuration.rotation, configuration.position),
            rotation=rotation,
            position=position,
            twist=body_twist[:, self.target.body],
            storage=self.storage,
            readings=np.zeros((len(joint_position), self.storage.count)) if readings is None else readings,
            tide=np.zeros((len(joint_position), 0, 6, 10)),
            thrust=np.zeros((len(joint_position), 0, 6, OF_A_THRUSTER)),
        )
