"""Advice in words: the single joint that helps most, and the uncertainty that no motion of the joints reduces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.planning.goal import Wanted
from mbaid_ros.planning.information import Grid
from mbaid_ros.planning.limits import BaseLimits
from mbaid_ros.planning.motions import Motions
from mbaid_ros.planning.splines import Splines

_LENGTH = 10.0  # s, of a joint's motion there and back
_TURN, _SLIDE = np.radians(20.0), 0.2  # rad, m, that it takes where its limits allow
_WAY = 8  # speeds of a way there, and as many of the way back
_AND_BACK = np.repeat([1.0, -1.0], _WAY)
_MOSTLY = 0.5  # share of a variance, from which one cause is reported
_LITTLE = 0.95  # of a standard deviation that a motion leaves, from which it improves nothing to speak of


def single_joint(motions: Motions, wanted: Wanted, base: BaseLimits) -> str:
    """Return the single joint whose motion there and back improves the worst parameter most.

    Empty where everything is known as well as is wanted.
    """
    information, model = motions.information, motions.knowledge.layout.kernel.model
    if wanted.ratio(information.relative) <= 1.0:
        return ''
    alone = replace(motions, splines=Splines(2 * _WAY, _LENGTH))
    there = alone.splines.basis(np.array([0.5 * _LENGTH]))[0] @ _AND_BACK
    independent = model.transmission.independent
    size = np.where(np.array(model.prismatic)[independent], _SLIDE, _TURN)
    moved = np.flatnonzero(motions.limits.moved)
    speeds: Array = np.zeros((len(moved), 2 * _WAY, len(size)))
    # Towards the middle of its range: there is more room.
    limits = motions.limits
    bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    centre = np.full(len(size), np.inf)
    centre[bounded] = 0.5 * (limits.lower[bounded] + limits.upper[bounded])
    towards = size / there * np.where(motions.start > centre, -1.0, 1.0)
    speeds[np.arange(len(moved)), :, moved] = towards[moved, None] * _AND_BACK
    speeds = alone.gentle(alone.within(speeds), base)
    after = alone.relative(speeds, alone.coarse)
    worst = int(np.argmax(np.where(wanted.asked, information.relative / wanted.relative, -np.inf)))
    best = int(np.argmin(after[:, worst]))
    joint = int(moved[best])
    amount = abs(float(speeds[best, 0, joint])) * there
    turn = f'{amount:.2g} m' if model.prismatic[independent[joint]] else f'{np.degrees(amount):.2g} deg'
    before, then = (f'{100.0 * value:.3g} %' for value in (information.relative[worst], after[best, worst]))
    if after[best, worst] > _LITTLE * information.relative[worst]:
        instead = beyond_motion(alone, speeds[best], alone.coarse, wanted)
        return f'no single joint improves {PARAMETERS[worst]}, known to {before}' + (f': {instead}' if instead else '')
    return (
        f'of single joints {model.independent_joints[joint]} improves {PARAMETERS[worst]} most: {turn} there and back '
        f'in {_LENGTH:g} s reduce it from {before} to {then}'
    )


def beyond_motion(motions: Motions, speeds: Array, grid: Grid, wanted: Wanted) -> str:
    """Return the main source of the uncertainty that a motion (K, k) leaves, if it is no sensor's noise.

    Empty if the motion reaches the wanted precision, or no cause dominates the rest.
    """
    position, rate = motions.joints(speeds[None], grid.half_steps)
    base = motions.floating.moved(position, rate, grid.spacing)
    seen = (position[::2], rate[::2])
    after = motions.information.after(grid, seen, base)[0]
    if wanted.ratio(after) <= 1.0:
        return ''
    worst = int(np.argmax(np.where(wanted.asked, after / wanted.relative, -np.inf)))
    causes, shares = motions.information.shares(grid, seen, base)
    if not causes or shares[worst].max() < _MOSTLY:
        return ''
    cause = int(np.argmax(shares[worst]))
    return (
        f'{100.0 * shares[worst, cause]:.0f} % of the variance that the motion leaves of {PARAMETERS[worst]} comes '
        f'from {causes[cause]}: better known by calibrating or weighing it than by moving more'
    )
