"""By how much a robot differs from its URDF, and what the estimator is told of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.data import LEVELS, drawn, kernel
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model_errors import ModelErrors, body_sizes, relative_factor
from mbaid_ros.simulation.true_robot import ErrorSizes

LEVEL = 'mid'
NOISE = LEVELS[LEVEL]
# The defaults of the estimator's parameters.
DEFAULT = ErrorSizes(0.01, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3)
_PARAMETERS = {
    'links_relative_std': 'known_links.relative_std',
    'zero_std': 'known_joints.zero_std',
    'origin_std': 'known_joints.origin_std',
    'axis_std': 'known_joints.axis_std',
    'mount_position_std': 'odometry_mount.position_std',
    'mount_orientation_std': 'odometry_mount.orientation_std',
}
# By name in the tables, the fields of ErrorSizes.
BLOCKS = {
    'links': ('links_relative_std',),
    'zeros': ('zero_std',),
    'origins': ('origin_std',),
    'axes': ('axis_std',),
    'mount': ('mount_position_std', 'mount_orientation_std'),
}
# Of the ladder: a field, and the unit of its steps.
DEFECTS = {
    'links': ('links_relative_std', 'per mille'),
    'zeros': ('zero_std', 'mrad'),
    'origins': ('origin_std', 'mm'),
    'axes': ('axis_std', 'mrad'),
    'mount, position': ('mount_position_std', 'mm'),
    'mount, orientation': ('mount_orientation_std', 'mrad'),
}
STEPS = (0.1, 0.3, 1.0, 3.0)
PLANAR = ('table1',)
# The ways in which a body is off: as `relative_factor` has it, by one factor, or each of its numbers by itself.
AS_DECLARED, WHOLE, APART = 'as declared', 'as a whole', 'each number by itself'
# Of a robot whose joints turn about z: m, h_x, h_y, I_zz.
_IN_PLANE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Variant:
    """One row of a table.

    Attributes
    ----------
    robot : name of a URDF of config/
    name : what is off and what is told, in words
    sizes : that robots are drawn with
    told : that the estimator takes them to be drawn with
    spatial : whether a planar robot's errors may lead out of its plane
    links : in which way they are off: AS_DECLARED, WHOLE or APART
    """

    robot: str
    name: str
    sizes: ErrorSizes
    told: ErrorSizes
    spatial: bool = False
    links: str = AS_DECLARED

    def errors(self, seed: int) -> ModelErrors:
        """Return those of the robot of a seed: those of a planar one leave it planar, as a table does that it is on."""
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
        """Return (n + 1, 10) errors of the bodies that are as declared, in the way that is wanted."""
        if self.links == AS_DECLARED:
            return drawn_ones
        changed = np.zeros_like(drawn_ones)
        for body, known in enumerate(kernel(self.robot).known):
            if known[0] > 0.0:
                std = self.sizes.links_relative_std
                numbers = np.linalg.solve(relative_factor(known, std), drawn_ones[body])
                changed[body] = std * (numbers[0] * known if self.links == WHOLE else numbers * body_sizes(known))
        return changed

    @property
    def file_name(self) -> str:
        """Name of a file with its runs."""
        return f'{self.robot}-{self.name}.npz'.replace(' ', '_').replace(',', '')


def settings(sizes: ErrorSizes) -> dict[str, object]:
    """Return the estimator's parameters that declare such robots, with the sensors' noise."""
    declared: dict[str, object] = {_PARAMETERS[name]: value for name, value in vars(sizes).items()}
    return declared | {f'noise.{name}': value for name, value in vars(NOISE).items()}


def scaled(sizes: ErrorSizes, factor: float) -> ErrorSizes:
    """Return all sizes, larger or smaller."""
    return ErrorSizes(**{name: factor * value for name, value in vars(sizes).items()})


def block(name: str) -> ErrorSizes:
    """Return one block's default size, the others exact."""
    return ErrorSizes(**{field: getattr(DEFAULT, field) for field in BLOCKS[name]})


def monte_carlo(robot: str) -> Iterator[Variant]:
    """Yield what is drawn of a robot: all blocks, one at a time, and with priors that are wrong."""
    yield Variant(robot, 'all', DEFAULT, DEFAULT)
    for name in BLOCKS:
        yield Variant(robot, name, block(name), block(name))
    yield Variant(robot, 'all, priors twice as large', DEFAULT, scaled(DEFAULT, 2.0))
    yield Variant(robot, 'all, priors half as large', DEFAULT, scaled(DEFAULT, 0.5))
    for way in (WHOLE, APART):
        yield Variant(robot, f'all, links off {way}', DEFAULT, DEFAULT, links=way)
    if robot in PLANAR:
        yield Variant(robot, 'all, out of the plane too', DEFAULT, DEFAULT, spatial=True)


def ladder(robot: str) -> Iterator[tuple[str, float, Variant]]:
    """Yield defects one at a time, with the step each is drawn with; the estimator knows nothing of that."""
    for name, (field, unit) in DEFECTS.items():
        for step in STEPS:
            sizes = ErrorSizes(**{field: 1e-3 * step})
            yield f'{name}, {unit}', step, Variant(robot, f'ladder {name} {step:g}', sizes, DEFAULT)
