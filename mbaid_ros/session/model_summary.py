"""A summary of the robot description as a run uses it: bodies, target, joints, and oddities."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.body import pseudo_inertia
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.errors import listing

# An inertia counts as impossible if its smallest principal second moment is below zero by this part of the largest:
# CAD rounds a thin plate or rod by less.
_ROUNDED = 1e-2


@dataclass(frozen=True)
class ModelSummary:
    """A robot as a run uses it."""

    robot: str  # names of the robot and of its floating link
    base_link: str  # names of the robot and of its floating link
    target_link: str  # whose inertia is identified; empty if several are, or none
    chosen: bool  # whether a parameter names it
    mass: float  # of all links but the target, kg
    joints: int  # number of those that move
    without_inertia: tuple[str, ...]  # links
    bare: tuple[str, ...]  # those of them that move, or float, without any mass on their body
    impossible: tuple[str, ...]  # links whose inertia no real body has
    foreign: tuple[str, ...] = ()  # joints of the messages that the robot description lacks
    unheard: tuple[str, ...] = ()  # moving joints that no message has named so far; empty before the first message
    dropped: tuple[str, ...] = ()  # ignored parts of the robot description, a line each
    weighed: str = ''  # how the weighed mass contradicts the robot description; empty where it does not

    @property
    def lines(self) -> list[str]:
        """The summary, a line each, without the warnings."""
        beside = f" without target link '{self.target_link}'" if self.target_link else ''
        lines = [f"robot '{self.robot}': '{self.base_link}' floats, {self.joints} joints, {self.mass:.6g} kg{beside}"]
        if self.target_link and not self.chosen:
            lines.append(
                f"target link '{self.target_link}' is a guess: the last link with an inertia; target_link names another"
            )
        lines += self.dropped
        massless = [name for name in self.without_inertia if name not in self.bare]
        groups = {
            'links without inertia': massless,
            'joints of the messages that the robot description lacks': self.foreign,
            'joints of the robot description that no message has': self.unheard,
        }
        return lines + [f'{text}: {listing(names)}' for text, names in groups.items() if names]

    @property
    def warnings(self) -> list[str]:
        """Likely errors of the robot description, a line each."""
        lines = []
        if self.base_link in self.bare:
            lines.append(f"base '{self.base_link}' has no inertia in the robot description: it counts as massless")
        moving = [name for name in self.bare if name != self.base_link]
        if moving:
            lines.append(f'links that move have no inertia in the robot description: {listing(moving)}')
        if self.impossible:
            lines.append(
                f'no real body has the inertia that the robot description gives {listing(self.impossible)}: moments '
                'must be positive, none larger than the sum of the other two'
            )
        return [*lines, *([self.weighed] if self.weighed else [])]


def summarise(
    model: RobotModel,
    target_link: str = '',
    *,
    chosen: bool = True,
    heard: Collection[str] = (),
    unknown: Collection[str] = (),
    weighed: str = '',
) -> ModelSummary:
    """Return the summary of a robot.

    Parameters
    ----------
    target_link : its unknown link; empty if there are none or many
    chosen : whether a parameter names that
    heard : joints that the messages name
    unknown : further links that are identified, and need no inertia
    weighed : how the weighed mass contradicts the robot description
    """
    bodies = model.body_parameters(without=target_link)[:, 0]
    massless = [link for link in model.links if link.parameters[0] == 0.0 and link.name != target_link]
    carrying = {link.body for link in model.links if link.name == target_link or link.name in unknown}
    empty = sorted({body for body in range(len(bodies)) if bodies[body] == 0.0} - carrying)
    others = (link for link in model.links if link.name != target_link)
    return ModelSummary(
        robot=model.name,
        base_link=model.base_link,
        target_link=target_link,
        chosen=chosen,
        mass=float(np.sum(bodies)),
        joints=model.joints,
        without_inertia=tuple(link.name for link in massless),
        bare=tuple(next(link.name for link in model.links if link.body == body) for body in empty),
        impossible=tuple(link.name for link in others if _is_impossible(link.parameters)),
        foreign=tuple(sorted(set(heard) - set(model.described_joints))),
        unheard=tuple(name for name in model.independent_joints if name not in heard) if heard else (),
        dropped=model.dropped,
        weighed=weighed,
    )


def unmoved_joints(heard: Collection[str], model: RobotModel, wheels: Collection[str]) -> str:
    """Return the cause that joints which messages name do not move in a robot description; empty if all do."""
    others = [name for name in heard if name not in model.joint_names and name not in wheels]
    if not others:
        return ''
    return (
        f'joint states contain {listing(others)}, fixed or missing in the robot description: let them move there; '
        'if they are wheels, set wheels.names'
    )


def _is_impossible(parameters: Array) -> bool:
    if parameters[0] == 0.0:
        return False
    # About the centre of mass, where the second moments are smallest.
    matrix = pseudo_inertia(parameters)
    about = matrix[:3, :3] - np.outer(matrix[:3, 3], matrix[:3, 3]) / matrix[3, 3]
    moments = np.linalg.eigvalsh(about)
    return bool(moments[0] < -_ROUNDED * np.abs(moments).max())
