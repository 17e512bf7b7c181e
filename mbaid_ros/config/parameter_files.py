"""ROS parameter files and robot descriptions without a ROS installation, read by the rules of ROS."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from mbaid_ros import limits
from mbaid_ros.errors import ModelError, ParameterError
from mbaid_ros.files import read_text, read_xml
from mbaid_ros.parameters import dotted

_SECTION = 'ros__parameters'
_STANDARD = 'tag:yaml.org,2002:'  # the expansion of !!


class _Loader(yaml.SafeLoader):
    """The safe loader with the numbers of ROS: YAML 1.1 as PyYAML has it takes ``1e6`` for a string.

    As in ROS there are no aliases, of which a few lines can stand for gigabytes, and no merged mappings; nor tags, with
    which any text claims to be of any type. Numbers have a bound on their digits: one of many can be read in
    hexadecimal, but no longer be written.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node."""
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError('aliases are not supported')
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if tag := getattr(event, 'tag', None):
            raise yaml.YAMLError(f'tags ({tag.replace(_STANDARD, "!!")}) are not supported')
        return super().compose_node(parent, index)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Refuse keys that merge a mapping into another."""
        if any(key.tag == 'tag:yaml.org,2002:merge' for key, _ in node.value):
            raise yaml.YAMLError('merge keys (<<) are not supported')

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Return a whole number."""
        return int(super().construct_yaml_int(_short(node)))

    def construct_yaml_float(self, node: yaml.ScalarNode) -> float:
        """Return a number."""
        return float(super().construct_yaml_float(_short(node)))


def _short(node: yaml.ScalarNode) -> yaml.ScalarNode:
    """Return the node of a number, unless that has too many digits."""
    if len(str(node.value)) > limits.DIGITS:
        raise yaml.YAMLError(f'a number of {len(str(node.value))} characters; at most {limits.DIGITS} are accepted')
    return node


_Loader.yaml_implicit_resolvers = {
    first: list(resolvers) for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'), list('-+.0123456789')
)
_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)
_Loader.add_constructor('tag:yaml.org,2002:float', _Loader.construct_yaml_float)


# Errors of reading: besides YAML's own, those of an impossible date or number, and of deep nesting.
_REFUSED = (yaml.YAMLError, ValueError, OverflowError, RecursionError)


def load_parameter_file(path: str | Path, *node_names: str) -> dict[str, object]:
    """Return the parameters of one node, or of several in one, in a ROS parameter file, for `build`.

    Raises ParameterError: The file cannot be read, is no ROS parameter file, or has nothing for this node.

    Parameters
    ----------
    path : the YAML file
    node_names : full names of the node, ``/arm/estimator``; without a slash in any namespace; a later one overrides

    Returns
    -------
    Values by dotted name; of sections that apply, a later one overrides an earlier one.
    """
    content = read_yaml(path, 'parameter file')
    if not isinstance(content, dict):
        raise ParameterError(f"parameter file '{path}' has no section '<node name>: {_SECTION}:'")
    sections = list(_sections(content, '', str(path)))
    values: dict[str, object] = {}
    places = [place for name in node_names for place, (pattern, _) in enumerate(sections) if _matches(pattern, name)]
    for place in dict.fromkeys(places):
        values.update(dotted(sections[place][1]))
    if not places:
        names = ', '.join(pattern for pattern, _ in sections) or 'none'
        raise ParameterError(
            f"parameter file '{path}' has no section for node '{node_names[-1]}'; sections: {names}; accepted: /** or "
            f'{node_names[-1]}'
        )
    return values


def read_yaml(path: str | Path, kind: str) -> object:
    """Return the content of a YAML file, its numbers read by the rules of ROS.

    Raises ParameterError: The file cannot be read, or is no YAML.

    Parameters
    ----------
    path : the file
    kind : its name in errors
    """
    text = read_text(path, kind, limits.YAML_CHARACTERS)
    try:
        return yaml.load(text, _Loader)
    except _REFUSED as error:
        raise ParameterError(f"{kind} '{path}' is not YAML: {_reason(error)}") from error


def parse_assignment(text: str) -> tuple[str, object]:
    """Return name and value of ``name:=value``, the value read as in a parameter file.

    Raises ParameterError: The text is not of that form.
    """
    name, separator, value = text.partition(':=')
    if not name or not separator:
        raise ParameterError(f"'{text}' is not a parameter; accepted: name:=value")
    try:
        return name, yaml.load(value, _Loader)
    except _REFUSED as error:
        raise ParameterError(f"the value of '{name}' is not YAML: {_reason(error)}") from error


def given_parameters(arguments: argparse.Namespace, *node_names: str) -> dict[str, object]:
    """Return the parameters of an executable's arguments: of its file for nodes of these names, then those of -p.

    Raises ParameterError: The file cannot be used, or -p.
    """
    values = load_parameter_file(arguments.params, *node_names) if arguments.params else {}
    return values | dict(map(parse_assignment, arguments.assignments))


def _reason(error: Exception) -> str:
    return 'nested too deeply' if isinstance(error, RecursionError) else ' '.join(str(error).split())


def _sections(content: Mapping[object, object], prefix: str, path: str) -> list[tuple[str, Mapping[object, object]]]:
    """Return (full name or pattern, parameters) of every section, namespaces joined to the names below them."""
    found: list[tuple[str, Mapping[object, object]]] = []
    for key, value in content.items():
        if key == _SECTION:
            if value is not None and not isinstance(value, dict):
                raise ParameterError(f"parameter file '{path}': {_SECTION} of '{prefix}' must have 'name: value' pairs")
            found.append((prefix or '/', value or {}))
        elif isinstance(value, dict):
            found += _sections(value, f'{prefix}/{str(key).strip("/")}', path)
        else:
            raise ParameterError(
                f"parameter file '{path}': '{key}' stands outside a section '<node name>: {_SECTION}:'"
            )
    return found


def _matches(pattern: str, target: str) -> bool:
    """Return whether a section is a node's: ``/*`` is one level of the name, ``/**`` any number of them."""
    if '*' not in pattern:
        return pattern == target or pattern.rsplit('/', 1)[-1] == target
    levels = (
        '(?:/[^/]+)*' if part == '**' else '/' + '[^/]*'.join(map(re.escape, re.split(r'\*+', part)))
        for part in pattern[1:].split('/')
    )
    return re.fullmatch(''.join(levels), '/' + target.strip('/')) is not None


def read_robot_description(path: str | Path) -> str:
    """Return the text of a URDF file.

    Raises ModelError: The file cannot be read, is not text, or is too long.
    """
    return read_xml(path, 'robot description', limits.URDF_CHARACTERS, ModelError)
