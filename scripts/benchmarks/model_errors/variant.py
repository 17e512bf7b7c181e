"""The errors of a robot's URDF, and the priors that the estimator has of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.data import NOISE, drawn, kernel
from benchmarks.frame import declared
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model_errors import ModelErrors, relative_factor
from mbaid_ros.core.robot.momentum import body_sizes
from mbaid_ros.simulation.true_robot import ErrorSizes

# The defaults of the estimator's parameters.
DEFAULT = ErrorSizes(0.01, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3)
# By block, the fields of ErrorSizes and the parameters that declare them.
BLOCKS = {
    'links': {'links_relative_std': 'known_links.relative_std'},
    'zeros': {'zero_std': 'known_joints.zero_std'},
    'origins': {'origin_std': 'known_joints.origin_std'},
    'axes': {'axis_std': 'known_joints.axis_std'},
    'mount': {
        'mount_position_std': 'odometry_mount.position_std',
        'mount_orientation_std': 'odometry_mount.orientation_std',
    },
}
PLANAR = ('table1',)
# Distributions of a body's errors: that of `relative_factor`, one common factor, or each number by itself.
AS_DECLARED, WHOLE, APART = 'as declared', 'as a whole', 'each number by itself'
# Of a robot whose joints turn about z: m, h_x, h_y, I_zz.
_IN_PLANE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Variant:
    """One row of a table."""

    robot: str  # name of a URDF of config/
    name: str  # errors and priors, in words
    sizes: ErrorSizes  # that robots are drawn with
    believed: ErrorSizes  # the priors
    spatial: bool = False  # whether a planar robot's errors may lead out of its plane
    links: str = AS_DECLARED  # distribution of their errors

    def errors(self, seed: int) -> ModelErrors:
        """Return the errors of a seed; those of a planar robot keep it in its plane, as the table under it does."""
        errors = drawn(self.robot, self.sizes, seed)
        errors = replace(errors, bodies=self._bodies(errors.bodies))
        if self.robot not in PLANAR or self.spatial:
            return errors
        return replace(
            errors,
            bodies=errors.bodies * _IN_PLANE,
            origins=errors.origins * np.array([1.0, 1.0, 0.0]),
            tilts=np.zeros_like(errors.tilts),
            mount=errors.mount * np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0]),
        )

    def _bodies(self, drawn_ones: Array) -> Array:
        """Return (n + 1, 10) errors of the bodies with another distribution."""
        if self.links == AS_DECLARED:
            return drawn_ones
        changed = np.zeros_like(drawn_ones)
        for body, known in enumerate(kernel(self.robot).known):
            if known[0] > 0.0:
                std = self.sizes.links_relative_std
                numbers = np.linalg.solve(relative_factor(known, std), drawn_ones[body])
                changed[body] = std * (numbers[0] * known if self.links == WHOLE else numbers * body_sizes(known))
        return changed


def settings(sizes: ErrorSizes) -> dict[str, object]:
    """Return the estimator's parameters that declare such robots, with the sensors' noise."""
    names = {field: name for block in BLOCKS.values() for field, name in block.items()}
    return {**{names[field]: value for field, value in vars(sizes).items()}, **declared(NOISE)}


def monte_carlo(robot: str) -> Iterator[Variant]:
    """Yield the variants of a robot: all blocks, one at a time, and with wrong priors."""
    yield Variant(robot, 'all', DEFAULT, DEFAULT)
    for name, fields in BLOCKS.items():
        block = ErrorSizes(**{field: getattr(DEFAULT, field) for field in fields})
        yield Variant(robot, name, block, block)
    for words, factor in (('twice', 2.0), ('half', 0.5)):
        priors = ErrorSizes(**{field: factor * value for field, value in vars(DEFAULT).items()})
        yield Variant(robot, f'all, priors {words} as large', DEFAULT, priors)
    for way in (WHOLE, APART):
        yield Variant(robot, f'all, links off {way}', DEFAULT, DEFAULT, links=way)
    if robot in PLANAR:
        yield Variant(robot, 'all, out of the plane too', DEFAULT, DEFAULT, spatial=True)
