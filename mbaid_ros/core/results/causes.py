"""What may have changed the momentum, in the words of every method."""

from __future__ import annotations

from typing import Literal

PULSE = 'thrust pulse or contact'
SYMPTOM = 'one of too many jumps for a pulse: something else is wrong'


def constant_force(axes: Literal['inertial', 'body']) -> str:
    """Return what a force and torque may be that are constant in inertial or in the base's axes."""
    likely = (
        'inertial axes: a tilted table, drag, a leak or gravity in orbit'
        if axes == 'inertial'
        else 'base axes: a leak or thrust'
    )
    return f'a force or torque that is constant in {likely}'
