"""What may have changed the momentum, in the words of every method."""

from __future__ import annotations

from typing import Literal

from mbaid_ros.core.geometry import Array

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


def changed_by(text: str, mass: float | None, centre: Array) -> str:
    """Return that a target has changed, with by how much.

    Parameters
    ----------
    text : what has happened
    mass : kg; None where it cannot have changed
    centre : (3,) m, of the centre of mass, target link's frame
    """
    along = ', '.join(f'{value:+.3g}' for value in centre)
    heavier = '' if mass is None else f', the mass by {mass:+.3g} kg'
    return f'{text}; the centre of mass has changed by ({along}) m{heavier}'
