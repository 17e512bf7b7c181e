"""The numbers of a robot description: each checked where it stands, so that an error can name it."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

from mbaid_ros import limits
from mbaid_ros.core.robot.urdf_document import refuse


def number(what: str, element: ET.Element | None, key: str, name: str = '') -> float:
    """Return the finite number that an attribute holds."""
    text = element.get(key, '') if element is not None else ''
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        refuse(f"{what} {name or key} '{text}'; a finite number is accepted")
    return value


def number_or(default: float, what: str, element: ET.Element | None, key: str) -> float:
    """Return the finite number that an attribute holds, a default where it is not there."""
    return number(what, element, key) if element is not None and key in element.attrib else default


def quantity(what: str, element: ET.Element | None, key: str, name: str = '') -> float:
    """Return a number of bounded size: a mass, or an element of an inertia."""
    value = number(what, element, key, name)
    if abs(value) > limits.QUANTITY:
        refuse(f'{what} {name or key} {value:g}; at most {limits.QUANTITY:g} is accepted')
    return value


def triple(what: str, element: ET.Element | None, key: str, default: str = '0 0 0') -> tuple[float, ...]:
    """Return three numbers of bounded size, the default's where the attribute is not there."""
    text = element.get(key, default) if element is not None else default
    try:
        values = tuple(float(part) for part in text.split())
    except ValueError:
        values = ()
    if len(values) != 3 or not all(map(math.isfinite, values)):
        refuse(f"{what} {key} '{text}'; three finite numbers are accepted")
    if max(map(abs, values)) > limits.LENGTH:
        refuse(f"{what} {key} '{text}'; numbers up to {limits.LENGTH:g} are accepted")
    return values
