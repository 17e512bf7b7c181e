"""The tree of links and joints, and which link of it floats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from mbaid_ros.core.errors import listing
from mbaid_ros.core.robot.urdf_document import refuse

GROUND = 'world'  # the root that URDF has by custom for what the robot stands on
_LOOSE = ('floating', 'planar')  # joints that a robot floats on


@dataclass(frozen=True)
class Branch:
    """The joint that carries a link.

    Attributes
    ----------
    joint, kind : its name and type
    parent : name of the link that it is on
    """

    joint: str
    kind: str
    parent: str


def read_tree(robot: ET.Element, links: Sequence[str]) -> tuple[dict[str, Branch], list[str]]:
    """Return what carries each link that is carried, and what is wrong with the joints' ends."""
    known, branches, problems = set(links), dict[str, Branch](), list[str]()
    for joint in robot.findall('joint'):
        name = joint.get('name', '')
        ends = {}
        for role in ('parent', 'child'):
            element = joint.find(role)
            ends[role] = element.get('link', '') if element is not None else ''
            if ends[role] not in known:
                problems.append(f"joint '{name}' names {role} link '{ends[role]}', which is not defined")
        if ends['child'] in branches:
            problems.append(f"link '{ends['child']}' has two parent joints; the robot must be a tree")
        branches[ends['child']] = Branch(name, joint.get('type', ''), ends['parent'])
    return branches, problems


def floating_link(links: Sequence[str], branches: Mapping[str, Branch], massive: set[str], wanted: str) -> str:
    """Return the link that floats: the one that is wanted, or else the root, or what a ground without mass carries.

    Parameters
    ----------
    links : names, in the order of the document
    branches : what carries each link
    massive : names of the links that have mass
    wanted : name of a link; empty where none is

    Raises
    ------
    ModelError
        There is no such link, no tree, or nothing that floats.
    """
    roots = [name for name in links if name not in branches]
    tied = set(links).difference(*(carried(root, branches) for root in roots))
    if tied:
        refuse(f'joints tie links in a loop: {listing(sorted(tied))}; the robot must be a tree')
    if wanted:
        if wanted not in links:
            refuse(f"parameter 'base_link' is '{wanted[:60]}', which is no link; links: {listing(links)}")
        return wanted
    if len(roots) != 1:
        refuse(
            f'the robot description must have one root link, not {len(roots)}: {listing(roots)}; parameter base_link '
            'says which floats'
        )
    return _off_the_ground(roots[0], branches, massive)


def carried(base: str, branches: Mapping[str, Branch]) -> set[str]:
    """Return a link and all that it carries."""
    children: dict[str, list[str]] = {}
    for child, branch in branches.items():
        children.setdefault(branch.parent, []).append(child)
    reached, waiting = {base}, [base]
    while waiting:
        new = [child for child in children.get(waiting.pop(), []) if child not in reached]
        reached.update(new)
        waiting += new
    return reached


def _off_the_ground(root: str, branches: Mapping[str, Branch], massive: set[str]) -> str:
    """Return the root, or the link that it carries where the root is the ground that the robot floats over."""
    on = {child: branch for child, branch in branches.items() if branch.parent == root}
    loose = root not in massive and len(on) == 1 and next(iter(on.values())).kind in _LOOSE
    if root != GROUND and not loose:
        return root
    if len(on) != 1:
        refuse(
            f"root link '{root}' carries {listing(on)}; one of them floats, or the link that parameter base_link names"
        )
    child, branch = next(iter(on.items()))
    if branch.kind not in {'fixed', *_LOOSE}:
        refuse(
            f"joint '{branch.joint}' ties '{child}' to root link '{root}' by a {branch.kind} joint; accepted: a fixed "
            'or floating one, or parameter base_link, which says what floats'
        )
    return child
