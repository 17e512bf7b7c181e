"""The one kernel: from samples to the momentum of the known bodies and the motion of the target link.

Nothing mixes samples: a batch is its samples to the last bit.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.kinematics import Configuration, Kinematics, Springs
from mbaid_ros.core.robot.model import Link, RobotModel, displaced, express
from mbaid_ros.core.robot.model_errors import KnownErrors
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS, Storage, about_points, momentum, regressor
from mbaid_ros.core.samples import Index, Samples


@dataclass(frozen=True)
class BodyStates:
    """N samples as the momentum equations need them, in odometry axes about the base link's origin."""

    configuration: Configuration  # poses of the bodies and joint twists
    body_twist: Array  # (N, n + 1, 6) twist of every body
    known: Array  # (N, n + 1, 10) standard parameters of the known bodies
    # rotation, position, twist: (N, 3, 3), (N, 3), (N, 6) of the target link: R, r and (u, w)
    rotation: Array
    position: Array
    twist: Array
    # storage, readings: momentum stored inside bodies, and its readings, (N, c)
    storage: Storage
    readings: Array
    # (N, n + 1, 6, 10) derivatives of the change of (P, L_b) by an orbit, by each body's standard parameters in its own
    # frame; (N, 0, 6, 10) without one
    tide: Array
    thrust: Array  # (N, f, 6, 5) derivatives of the change of (P, L_b) by thrust, by each thruster's errors

    def __getitem__(self, index: Index) -> BodyStates:
        """Return the states of a slice, mask or list of samples."""
        names = ('configuration', 'body_twist', 'known', 'rotation', 'position', 'twist', 'readings', 'tide', 'thrust')
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    @property
    def momenta(self) -> Array:
        """(P, L) of each known body, with the momentum stored in it, (N, n + 1, 6)."""
        momenta = momentum(self.known, self.body_twist)
        if self.storage.count:
            momenta[..., 3:] += self.storage.momenta(self.configuration.rotation, self.readings)
        return momenta

    @property
    def known_momentum(self) -> Array:
        """(P_k, L_k) of all known bodies, (N, 6)."""
        return np.sum(self.momenta, axis=1)

    @property
    def regressor(self) -> Array:
        """Y of the target link, (N, 6, 10): its momentum is Y (m, h, I_o)."""
        return regressor(self.rotation, self.position, self.twist)

    def regressor_of(self, link: Link) -> Array:
        """Return Y of any link, (N, 6, 10)."""
        rotation, position = self.configuration.link_pose(link)
        return regressor(rotation, position, self.body_twist[:, link.body])

    @property
    def hinge_velocity(self) -> Array:
        """Velocity v of the target link's origin, (N, 3) m/s."""
        return self.twist[:, :3] + cross(self.twist[:, 3:], self.position)


class MomentumKernel:
    """The momentum of a robot with one unknown link, or several, for batches of samples.

    Raises ModelError: An unknown link is not one of the model.

    Parameters
    ----------
    target : name of the unknown link; its inertial entry in the URDF never enters
    others : names of further unknown links (theta_u and theta_k in the paper's eqs. 6 to 14: any partition)

    Attributes
    ----------
    target, unknown : the first of the unknown links, all of them
    known : (n + 1, 10) standard parameters of the known bodies, each in its own frame
    errors : of these parameters; none by default
    storage : momentum stored inside bodies; none by default
    springs : of passive joints; none by default
    """

    def __init__(self, model: RobotModel, target: str, *others: str) -> None:
        self.model = model
        self.target = model.link(target)
        self.unknown = (self.target, *map(model.link, others))
        self.kinematics = Kinematics(model)
        self.known = model.body_parameters(without=(target, *others))
        self.errors = KnownErrors()
        self.storage = Storage()
        self.springs = Springs()

    def with_body_changes(self, change: Array) -> MomentumKernel:
        """Return a kernel whose known bodies differ by (n + 1, 10) standard parameters, each in its own frame."""
        return self._replaced(known=self.known + change)

    def with_unknown_link(self, target: str) -> MomentumKernel:
        """Return a kernel whose unknown link is another one; the one before is as the robot description has it."""
        other, before = self.model.link(target), self.target.name
        known = (
            self.known + self.model.body_parameters(without=(target,)) - self.model.body_parameters(without=(before,))
        )
        return self._replaced(target=other, unknown=(other,), known=known)

    def with_displaced_joints(self, origins: Array, tilts: Array) -> MomentumKernel:
        """Return a kernel with displaced joints: (n, 3) m, (n, 3) rad as in `ModelErrors`."""
        model = displaced(self.model, origins, tilts)
        return self._replaced(model=model, kinematics=Kinematics(model))

    def with_errors(self, errors: KnownErrors) -> MomentumKernel:
        """Return a kernel whose known bodies have these errors."""
        return self._replaced(errors=errors)

    def body_parameters(self, parameters: Array) -> Array:
        """Return the (n + 1, 10) standard parameters of all bodies, given (10,) of the target link in its frame."""
        known = self.known.copy()
        known[self.target.body] += express(parameters, self.target.rotation, self.target.position)
        return known

    def with_storage(self, storage: Storage) -> MomentumKernel:
        """Return a kernel of a robot that stores momentum inside bodies."""
        return self._replaced(storage=storage)

    def with_springs(self, springs: Springs) -> MomentumKernel:
        """Return a kernel of a robot with these passive joints."""
        return self._replaced(springs=springs)

    def _replaced(self, **changed: object) -> MomentumKernel:
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
        thrust = about_points(samples.thrust, place, THRUSTER_ERRORS)
        return replace(states, tide=about_points(samples.tide, place), thrust=thrust)

    def states_of(
        self,
        base_rotation: Array,
        joint_position: Array,
        joint_velocity: Array,
        base_twist: Array,
        readings: Array | None = None,
    ) -> BodyStates:
        """Return the states of all bodies for (N, 3, 3), (N, n), (N, n), (N, 6) in odometry axes.

        Without (N, c) readings of the stored momentum, it is zero.
        """
        count = len(joint_position)
        configuration = self.kinematics.configure(base_rotation, joint_position)
        body_twist = self.kinematics.body_twists(configuration, joint_velocity, base_twist)
        rotation, position = configuration.link_pose(self.target)
        return BodyStates(
            configuration=configuration,
            body_twist=body_twist,
            known=express(self.known, configuration.rotation, configuration.position),
            rotation=rotation,
            position=position,
            twist=body_twist[:, self.target.body],
            storage=self.storage,
            readings=np.zeros((count, self.storage.count)) if readings is None else readings,
            tide=np.zeros((count, 0, 6, 10)),
            thrust=np.zeros((count, 0, 6, THRUSTER_ERRORS)),
        )


def unknown_scale(kernel: MomentumKernel) -> Array:
    """Return the (16,) typical sizes of (m, h, I_o, P_0, L_0), by which unknowns are scaled before anything is solved.

    Mass and size of the known bodies set them; momentum is that of the whole moving at 1 m/s and 1 rad/s.
    """
    bodies = kernel.model.body_parameters(without=kernel.target.name)
    mass = max(float(np.sum(bodies[:, 0])), 1e-3)
    steps = np.concatenate((kernel.model.positions, kernel.target.position[None]))
    length = max(float(np.sum(np.linalg.norm(steps, axis=1))), 0.1)
    body = np.concatenate(([mass], np.full(3, mass * length), np.full(6, mass * length**2)))
    return np.concatenate((body, np.full(3, mass), np.full(3, mass * length)))
