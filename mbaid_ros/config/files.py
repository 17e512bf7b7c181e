"""ROS parameter files without a ROS installation, read by the rules of ROS."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from mbaid_ros.core.errors import ParameterError

_SECTION = 'ros__parameters'
LARGEST_FILE = 1_000_000  # characters


class _Loader(yaml.SafeLoader):
    """The safe loader with the numbers of ROS: YAML 1.1 as PyYAML has it takes ``1e6`` for a string.

    As in ROS there are no aliases: a few lines of them can stand for gigabytes.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node."""
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError('aliases are not supported')
        return super().compose_node(parent, index)


_Loader.yaml_implicit_resolvers = {
    first: list(resolvers) for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'), list('-+.0123456789')
)


# What reading leads to: besides YAML's own errors a number with thousands of digits, an impossible date, deep nesting.
_REFUSED = (yaml.YAMLError, ValueError, RecursionError)


def load_parameter_file(path: str | Path, node_name: str) -> dict[str, object]:
    """Return what a ROS parameter file says to one node, as `build` takes it.

    Parameters
    ----------
    path : the YAML file
    node_name : name of the node, with its namespace or without: ``/arm/estimator``, ``estimator``

    Returns
    -------
    Values by dotted name; of sections that apply, a later one overrides an earlier one.

    Raises
    ------
    ParameterError
        The file cannot be read, is no ROS parameter file, or has nothing for this node.
    """
    content = read_yaml(path, 'parameter file')
    if not isinstance(content, dict):
        raise ParameterError(f"parameter file '{path}' has no section '<node name>: {_SECTION}:'")
    target = '/' + node_name.strip('/')
    sections = list(_sections(content, '', str(path)))
    values: dict[str, object] = {}
    for pattern, section in sections:
        if _matches(pattern, target):
            values.update(dotted(section))
    if not any(_matches(pattern, target) for pattern, _ in sections):
        names = ', '.join(pattern for pattern, _ in sections) or 'none'
        raise ParameterError(f"parameter file '{path}' has no section for node '{node_name}'; sections: {names}")
    return values


def read_yaml(path: str | Path, kind: str) -> object:
    """Return the content of a YAML file, its numbers read by the rules of ROS.

    Parameters
    ----------
    path : the file
    kind : what an error calls it

    Raises
    ------
    ParameterError
        The file cannot be read, or is no YAML.
    """
    text = read_text(path, kind, LARGEST_FILE)
    try:
        return yaml.load(text, _Loader)
    except _REFUSED as error:
        raise ParameterError(f"{kind} '{path}' is not YAML: {_reason(error)}") from error


def read_text(path: str | Path, kind: str, limit: int, accepted: str = '') -> str:
    """Return the content of a text file of at most so many characters.

    Parameters
    ----------
    path : the file
    kind : what an error calls it
    limit : number of characters; more of a longer file are not read
    accepted : what an error says of the files that are, if anything

    Raises
    ------
    ParameterError
        The file cannot be read, is no text, or is longer.
    """
    try:
        with Path(path).open(encoding='utf-8') as file:
            text = file.read(limit + 1)
    except OSError as error:
        raise ParameterError(f"cannot read {kind} '{path}': {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        told = f'; {accepted}' if accepted else ''
        raise ParameterError(f"{kind} '{path}' is not text in UTF-8{told}") from error
    if len(text) > limit:
        raise ParameterError(f"{kind} '{path}' has more than {limit} characters, which is the limit")
    return text


def parse_assignment(text: str) -> tuple[str, object]:
    """Return name and value of ``name:=value``, the value read as in a parameter file.

    Raises
    ------
    ParameterError
        The text is not of that form.
    """
    name, separator, value = text.partition(':=')
    if not name or not separator:
        raise ParameterError(f"'{text}' is not a parameter; accepted: name:=value")
    try:
        return name, yaml.load(value, _Loader)
    except _REFUSED as error:
        raise ParameterError(f"the value of '{name}' is not YAML: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    return 'nested too deeply' if isinstance(error, RecursionError) else ' '.join(str(error).split())


def _sections(content: Mapping[object, object], prefix: str, path: str) -> list[tuple[str, Mapping[object, object]]]:
    """Return (full name or pattern, parameters) of every section, namespaces joined to the names below them."""
    found: list[tuple[str, Mapping[object, object]]] = []
    for key, value in content.items():
        if key == _SECTION:
            if value is not None and not isinstance(value, dict):
                raise ParameterError(f"parameter file '{path}': {_SECTION} of '{prefix}' must hold 'name: value' pairs")
            found.append((prefix or '/', value or {}))
        elif isinstance(value, dict):
            found += _sections(value, f'{prefix}/{str(key).strip("/")}', path)
        else:
            raise ParameterError(
                f"parameter file '{path}': '{key}' stands outside a section '<node name>: {_SECTION}:'"
            )
    return found


def _matches(pattern: str, target: str) -> bool:
    """Tell whether a section speaks to a node: ``/*`` is one level of the name, ``/**`` any number of them."""
    if '*' not in pattern:
        # A bare name is the node of that name, whether or not the caller knows the namespace.
        return pattern == target or ('/' not in target[1:] and pattern.rsplit('/', 1)[-1] == target[1:])
    expression = re.escape(pattern).replace(r'/\*\*', '(/[^/]+)*').replace(r'\*', '[^/]*')
    return re.fullmatch(expression, target) is not None


def dotted(values: Mapping[Any, object], prefix: str = '') -> dict[str, object]:
    """Return the values of nested mappings by dotted name."""
    flat: dict[str, object] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            flat.update(dotted(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat
