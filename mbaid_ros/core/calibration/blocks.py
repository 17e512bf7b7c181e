"""What a calibration is about, as one vector with one covariance: links, joints, mount of the odometry.

All of it is linear in independent normal numbers: those of the target link's prior, then those of the catalogue. The
filter sees combinations of them (in a plane, fewer than there are); the rest stays at its prior exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.calibration.passes import Passed
from mbaid_ros.core.calibration.prior import Prior
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Thruster
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.trajectory.filter.prior_sizes import PriorSizes
from mbaid_ros.core.trajectory.state import BODY
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.unknowns.carried import Carried, in_plane_map
from mbaid_ros.core.unknowns.catalogue import Uncertainty, catalogue
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.joint_placements import JointPlacements
from mbaid_ros.core.unknowns.known_bodies import masses
from mbaid_ros.core.unknowns.odometry_mount import OdometryMount
from mbaid_ros.core.unknowns.thrusters import Thrusters

OF_A_JOINT = ('zero', 'origin_x', 'origin_y', 'origin_z', 'tilt_1', 'tilt_2')
OF_THE_MOUNT = ('turn_x', 'turn_y', 'turn_z', 'x', 'y', 'z')


@dataclass(frozen=True, eq=False)
class Normals:
    """A Gaussian of the independent normal numbers that the prior is made of.

    Attributes
    ----------
    prior : of the links, the target link first
    joints : number n
    unknowns : all there are, as the catalogue has them: the other links first
    belief : of ten numbers for the target link, then of the unknowns'; the first columns of its factor, as many as
        there are numbers, are what no window sees
    """

    prior: Prior
    joints: int
    unknowns: tuple[Unknown, ...]
    belief: Carried

    @staticmethod
    def before(prior: Prior, kernel: MomentumKernel, uncertainty: Uncertainty) -> Normals:
        """Return what is known before the data."""
        unknowns = catalogue(kernel, uncertainty)
        numbers = 10 + sum(unknown.count for unknown in unknowns)
        return Normals(prior, kernel.model.joints, unknowns, Carried.nothing(numbers))

    def after(self, passed: Passed, own: Variables, detector: PlaneDetector) -> Normals:
        """Return what is known after a pass over all data.

        Parameters
        ----------
        passed : with the mean and factor of what the motions share
        own : variables of a motion
        detector : PlaneDetector
        """
        body = own.gather[own.head : own.own, BODY]
        seen = (
            in_plane_map(unknown, unknown.in_plane(detector)) if detector.planar else np.eye(unknown.count)
            for unknown in self.unknowns
        )
        combined = block_diag(body @ self.prior.roots[0], *seen)
        back = np.linalg.pinv(combined, rcond=1e-12)
        before = np.concatenate((body @ self.prior.mean[:10], np.zeros(len(combined) - len(body))))
        rest = np.eye(combined.shape[1]) - back @ combined if detector.planar else np.zeros((combined.shape[1],) * 2)
        factor = np.concatenate((rest, back @ passed.factor), axis=1)
        return Normals(self.prior, self.joints, self.unknowns, Carried(back @ (passed.mean - before), factor))

    @cached_property
    def sizes(self) -> PriorSizes:
        """How many times as far off as declared the numbers look, kind by kind."""
        first = self.prior.links[0].name
        causes = [f'link:{first}'] * 10
        causes += [cause for unknown in self.unknowns for cause in unknown.causes]
        parts = [*masses([first], self.prior.roots[0]), *(part for unknown in self.unknowns for part in unknown.parts)]
        factor = self.belief.factor
        return PriorSizes.of(self.belief.mean, factor @ factor.T, causes, parts)

    def as_far_off(self) -> Normals:
        """Return what is known where they may be so (docs/trajectory.md, eq. 7); what no window sees stays."""
        mean, factor = self.belief.mean, self.belief.factor
        seen = factor[:, len(mean) :]
        return replace(self, belief=Carried(mean, np.concatenate((factor, self.sizes.beside(seen @ seen.T)), axis=1)))

    @cached_property
    def carried(self) -> Carried:
        """What is known of the unknowns, whatever the target link is."""
        return Carried(self.belief.mean[10:], self.belief.factor[10:])

    @property
    def links(self) -> Carried:
        """What is known of the links' numbers, ten each."""
        count = len(self.prior.mean)
        return Carried(self.belief.mean[:count], self.belief.factor[:count])

    @property
    def of_the_robot(self) -> Carried:
        """What is known of links, joints, mount, wheels and thrusters: all but the last numbers, those of sensors."""
        of_the_run = (unknown for unknown in self.unknowns if unknown.read and not isinstance(unknown, OdometryMount))
        count = len(self.belief.mean) - sum(unknown.count for unknown in of_the_run)
        return Carried(self.belief.mean[:count], self.belief.factor[:count])

    def thrusters(self) -> tuple[Thruster, ...]:
        """Return by how much thrusters are off their commands."""
        found: list[Thruster] = []
        place = 10
        for unknown in self.unknowns:
            numbers = slice(place, place + unknown.count)
            place = numbers.stop
            if isinstance(unknown, Thrusters):
                stds = np.linalg.norm(unknown.factor @ self.belief.factor[numbers], axis=1)
                found += Thruster.all_of(unknown.frames, unknown.factor @ self.belief.mean[numbers], stds)
        return tuple(found)

    def blocks(self) -> tuple[Array, Array]:
        """Return values (10 k + 6 n + 6,) and covariance of the links' standard parameters, joints and mount.

        A joint has zero (rad or m), displacement of its frame (m) and two tilts of its axis (rad), in its own axes; the
        mount a rotation vector (rad) and a position (m): all of them beside the robot description.
        """
        size = len(self.prior.mean)
        rows = np.zeros((size + 6 * self.joints + 6, len(self.belief.mean)))
        rows[:size, :size] = block_diag(*self.prior.roots)
        place = 10
        for unknown in self.unknowns:
            columns = slice(place, place + unknown.count)
            place = columns.stop
            if isinstance(unknown, JointPlacements):
                rows[size:-6, columns] = unknown.factor
            elif isinstance(unknown, OdometryMount):
                rows[-6:, columns] = unknown.factor
        values, factor = rows @ self.belief.mean, rows @ self.belief.factor
        values[:size] += self.prior.mean
        return values, factor @ factor.T
