"""The QoS profiles that publishers offered, as bags store them: YAML of several versions."""

from __future__ import annotations

from typing import Any

import yaml
from rosbags.interfaces import Qos
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from mbaid_ros import limits
from mbaid_ros.core.errors import DataError

_MERGE = 'tag:yaml.org,2002:merge'


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc] # faster where it is installed
    """The safe loader without merged mappings, a few lines of which take minutes."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Refuse what would merge a mapping into another."""
        if any(key.tag == _MERGE for key, _ in node.value):
            raise yaml.YAMLError('merge keys (<<) are not supported')


def parse_yaml(text: str) -> Any:
    """Return what YAML of a bag says.

    Raises
    ------
    DataError
        A bound is exceeded.
    ReaderError
        It is no YAML.
    """
    try:
        _check_size(text)
        return yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise ReaderError(f'not YAML: {" ".join(str(error).split())}') from error


def _check_size(text: str) -> None:
    """Refuse what takes long to load, or is nested so deeply that libyaml ends the process."""
    depth = 0
    for count, event in enumerate(yaml.parse(text, _Loader)):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > limits.YAML_DEPTH:
            raise DataError(f'YAML of a bag is nested more than {limits.YAML_DEPTH} deep, which is the limit')
        if count > limits.YAML_VALUES:
            raise DataError(f'YAML of a bag has more than {limits.YAML_VALUES} values, which is the limit')


def parse_profiles(given: str | list[Any]) -> list[Qos]:
    """Return the profiles of a topic.

    Raises
    ------
    ReaderError
        They are none.
    """
    if isinstance(given, str) and len(given) > limits.PROFILE_CHARACTERS:
        raise DataError(f'QoS profiles of {len(given)} characters; at most {limits.PROFILE_CHARACTERS} are accepted')
    items = parse_yaml(given) if isinstance(given, str) else given
    try:
        return parse_qos(items or [])
    except (TypeError, ValueError, LookupError, AttributeError) as error:
        raise ReaderError(f'QoS profiles that are none: {error}') from error
