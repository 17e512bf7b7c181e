"""The parameters of a node, declared from the dataclass that describes them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from mbaid_ros.config.parameters import (
    ParameterSpec,
    build,
    named_specifications,
    specification,
    specification_of,
    specifications,
    values_of,
)

T = TypeVar('T')

_SMALLEST_INTEGER, _LARGEST_INTEGER = -(2**63), 2**63 - 1


def declare_parameters(node: Node, cls: type[T], *, settable: bool = False) -> T:
    """Declare every parameter of a dataclass on a node and return an instance with the values given to the node.

    rclpy ignores an override whose name is not declared, and does not take a whole number for a double. Here the first
    is an error and the second is accepted, by the rules that `replay` and `simulate` apply to parameter files.

    Parameters
    ----------
    node : Node
    cls : type
        A dataclass of parameters.
    settable : bool
        Whether also those can be set that are read but once.

    Raises
    ------
    ParameterError
        An override has an unknown name, or a value that is not accepted.
    """
    # rclpy has no public way to the overrides of undeclared parameters, and a misspelt name stays undeclared.
    overrides = node._parameter_overrides  # noqa: SLF001
    known = specifications(cls)
    given = {name: override.value for name, override in overrides.items()}
    # An empty list comes without a type, hence without a value.
    empty = {name for name, value in given.items() if value is None and name in known and 'array' in known[name].type}
    config = build(cls, given | dict.fromkeys(empty, ()))
    values = values_of(config)
    of_things = tuple(named_specifications(cls).values())
    for name, value in values.items():
        spec = specification(name, known, of_things)
        if value == ():
            _declare_empty_list(node, spec, settable=settable)
        else:
            plain = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(spec.name, plain, _descriptor(spec, settable=settable), ignore_override=True)
    return config


def changed(node: Node, cls: type[T], parameters: Sequence[Parameter]) -> T:
    """Return what the parameters of a node would be with some set to other values.

    Raises
    ------
    ParameterError
        A value is not accepted.
    """
    known, of_things = specifications(cls), tuple(named_specifications(cls).values())
    declared = cast('dict[str, Parameter]', node.get_parameters_by_prefix(''))  # those of ROS itself among them
    own = (name for name in declared if specification_of(name, known, of_things))
    values = {name: declared[name].value for name in own}
    values |= {parameter.name: parameter.value for parameter in parameters if parameter.name in values}
    return build(cls, values)


def _declare_empty_list(node: Node, spec: ParameterSpec, *, settable: bool) -> None:
    """Declare a list by its type: rclpy takes an empty one for a list of bytes."""
    kind = Parameter.Type[spec.type.upper()]
    # Declared by type, a parameter has no value; it can be given one before it becomes read-only.
    node.declare_parameter(spec.name, kind, ignore_override=True)
    node.set_parameters([Parameter(spec.name, kind, [])])  # type: ignore[no-untyped-call]
    descriptor = _descriptor(spec, settable=settable)
    descriptor.name, descriptor.type = spec.name, kind.value
    node.set_descriptor(spec.name, descriptor)


def _descriptor(spec: ParameterSpec, *, settable: bool) -> ParameterDescriptor:
    when = 'is configured' if settable else 'starts'
    constraints = f'{spec.accepted}; read when the node {when}' if spec.read_only else spec.accepted
    descriptor = ParameterDescriptor(
        description=spec.description, additional_constraints=constraints, read_only=spec.read_only and not settable
    )
    if spec.minimum is None and spec.maximum is None:
        return descriptor
    # A minimum that is itself not accepted, or the range of each number of a list, is told in words only.
    if spec.type == 'double':
        low = -math.inf if spec.minimum is None else float(spec.minimum)
        high = math.inf if spec.maximum is None else float(spec.maximum)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif spec.type == 'integer':
        low_integer = _SMALLEST_INTEGER if spec.minimum is None else int(spec.minimum)
        high_integer = _LARGEST_INTEGER if spec.maximum is None else int(spec.maximum)
        descriptor.integer_range = [IntegerRange(from_value=low_integer, to_value=high_integer, step=0)]
    return descriptor
