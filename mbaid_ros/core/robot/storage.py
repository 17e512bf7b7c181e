"""Momentum that is stored inside a body: reaction wheels that are no joints of the robot, control-moment gyros.

A rotor is part of the body that it turns in, inertia included. Turning in it at a speed s about an axis a it has the
angular momentum J s a on top, J its spin inertia: a couple, the same about any point. Where a flight computer tells the
momentum itself, the three axes of a frame serve in the same way, with J = 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.robot.model import Link


@dataclass(frozen=True, eq=False)
class Storage:
    """What stores momentum, each with a reading of its own: c of them.

    Attributes
    ----------
    bodies : (c,) indices of the moving bodies that they are in
    axes : (c, 3) unit vectors in the axes of these bodies
    inertias : (c,) kg m^2 about these axes, of what is read as a speed (rad/s); 1 of what is read as momentum (N m s)
    noises : (c,) standard deviation of one reading
    names : c, of each
    """

    bodies: tuple[int, ...] = ()
    axes: Array = field(default_factory=lambda: np.zeros((0, 3)))
    inertias: Array = field(default_factory=lambda: np.zeros(0))
    noises: Array = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()

    @staticmethod
    def wheels(link: Link, names: Sequence[str], axes: Array, inertias: Sequence[float], noise: float) -> Storage:
        """Return wheels with (w, 3) unit axes in a link's frame, whose speeds are read with a noise (rad/s)."""
        bodies, noises = (link.body,) * len(names), np.full(len(names), noise)
        return Storage(bodies, axes @ link.rotation.T, np.array(inertias, dtype=float), noises, tuple(names))

    @staticmethod
    def told(link: Link, noise: float) -> Storage:
        """Return what is read as a momentum in the axes of a link's frame, with a noise (N m s)."""
        return Storage((link.body,) * 3, link.rotation.T.copy(), np.ones(3), np.full(3, noise), ('x', 'y', 'z'))

    def __add__(self, other: Storage) -> Storage:
        """Return both, one after the other."""
        return Storage(
            self.bodies + other.bodies,
            np.concatenate((self.axes, other.axes)),
            np.concatenate((self.inertias, other.inertias)),
            np.concatenate((self.noises, other.noises)),
            self.names + other.names,
        )

    @property
    def count(self) -> int:
        """Number c."""
        return len(self.bodies)

    def changed(self, inertias: Array) -> Storage:
        """Return the same with spin inertias that differ by (c,)."""
        return replace(self, inertias=self.inertias + inertias)

    def directions(self, rotation: Array) -> Array:
        """Return the (N, c, 3) axes in odometry axes, of bodies with (N, n + 1, 3, 3) axes."""
        return rotate(rotation[:, list(self.bodies)], self.axes)

    def columns(self, rotation: Array) -> Array:
        """Return what a reading of one makes of the momentum, (N, 6, c)."""
        columns = np.zeros((len(rotation), 6, self.count))
        columns[:, 3:] = np.swapaxes(self.inertias[:, None] * self.directions(rotation), 1, 2)
        return columns

    def momenta(self, rotation: Array, readings: Array) -> Array:
        """Return the angular momentum that is stored in each body, (N, n + 1, 3) N m s, odometry axes.

        Parameters
        ----------
        rotation : (N, n + 1, 3, 3) of all bodies
        readings : (N, c)
        """
        stored = np.zeros(rotation.shape[:-1])
        each = (self.inertias * readings)[..., None] * self.directions(rotation)
        for place, body in enumerate(self.bodies):
            stored[:, body] += each[:, place]
        return stored
