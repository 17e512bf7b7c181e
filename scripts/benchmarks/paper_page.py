"""The page docs/paper-claims.md: what the paper says, what is measured, and by which setting."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.pages import provenance, table

NAMES = ('m', 'x_c', 'y_c', 'Izz')
AGREEMENT = 0.1  # largest relative difference of settling times
SPATIAL_LIMIT = 1e-6  # relative error without noise
_MAIN, _PREVIOUS, _FIRST = 'main', 'difference, previous sample', 'difference, first sample'
Setting = tuple[str, float]

# Seconds until each parameter stays within 1 %, from an implementation that shares no code with this one.
INDEPENDENT: dict[Setting, tuple[float, ...]] = {
    (_MAIN, 100.0): (3.4, 3.9, 3.6, 4.7),
    (_MAIN, 50.0): (4.5, 5.3, 4.8, 6.9),
    (_MAIN, 10.0): (8.9, 12.3, 11.4, 13.3),
    (_PREVIOUS, 100.0): (3.3, 6.5, 9.2, 10.0),
    (_PREVIOUS, 50.0): (13.3, 14.9, 12.5, 15.0),
    (_PREVIOUS, 10.0): (19.4, 30.2, 17.3, 30.3),
    (_FIRST, 100.0): (5.3, 5.9, 6.1, 7.0),
    (_FIRST, 50.0): (6.8, 7.7, 7.8, 9.1),
    (_FIRST, 10.0): (10.2, 11.6, 11.3, 13.2),
}


@dataclass(frozen=True)
class Measured:
    """Everything the page shows.

    Attributes
    ----------
    settling : s until m, x_c, y_c, Izz stay within 1 %, by form and rate (Hz)
    inertia_begins : s until Izz stays within 50 %
    scaled : s until all stay within 1 %, with unknowns scaled to order one
    spatial : largest relative error of the ten parameters after 60 s at 100 Hz, by robot and form
    difference : the same of method difference
    ranks : rank and number of columns of the momentum of all bodies
    """

    settling: dict[Setting, tuple[float, ...]]
    inertia_begins: dict[Setting, float]
    scaled: dict[Setting, float]
    spatial: dict[str, dict[str, float]]
    difference: dict[str, float]
    ranks: dict[str, tuple[int, int]]


def text(measured: Measured) -> str:
    """Return the tables for a terminal."""
    return '\n\n'.join((_settling(measured), _claims(measured), _exact(measured)))


def page(measured: Measured) -> str:
    """Return the page as Markdown."""
    return '\n'.join(
        (
            _INTRODUCTION.format(provenance=provenance(command='scripts/paper_table.py')),
            _claims(measured),
            _SETTLING,
            _settling(measured),
            _SCALING.format(longest=max(measured.scaled.values())),
            _exact(measured),
            '',
        )
    )


def _seconds(values: tuple[float, ...]) -> str:
    return ' / '.join(f'{value:.1f}' for value in values)


def _settling(measured: Measured) -> str:
    rows = [
        [f'{form}, {rate:g} Hz', _seconds(values), _seconds(INDEPENDENT[form, rate])]
        for (form, rate), values in measured.settling.items()
    ]
    return table(['form, samples', 'm / x_c / y_c / Izz, s', 'independent implementation'], rows)


def _by_rate(measured: Measured, form: str, pick: slice) -> str:
    rates = sorted({rate for _, rate in measured.settling}, reverse=True)
    return ', '.join(f'{max(measured.settling[form, rate][pick]):.1f} s at {rate:g} Hz' for rate in rates)


def _differences(measured: Measured, pick: slice) -> str:
    previous, first = (_by_rate(measured, form, pick) for form in (_PREVIOUS, _FIRST))
    return f'{previous} (previous sample); {first} (first sample)'


def _inertia(measured: Measured) -> str:
    begins = measured.inertia_begins[_PREVIOUS, 50.0]
    at_50, at_100 = (measured.settling[_PREVIOUS, rate][3] for rate in (50.0, 100.0))
    return (
        f'at 50 Hz within 50 % after {begins:.1f} s, within 1 % after {at_50:.1f} s; '
        f'at 100 Hz within 1 % after {at_100:.1f} s'
    )


def _ranks(measured: Measured) -> str:
    (planar, planar_columns), (rank, columns) = measured.ranks['table1'], measured.ranks['servicer7']
    return (
        f'with known total momentum, rank {planar} of {planar_columns} columns for Table 1, {rank} of {columns} for '
        'seven joints in space'
    )


def _claims(measured: Measured) -> str:
    previous, main = (max(measured.settling[form, 100.0]) for form in (_PREVIOUS, _MAIN))
    everything, without_inertia = slice(0, 4), slice(0, 3)
    linear = max(measured.difference.values())
    rows = [
        [
            'main form: all parameters in less than 10 s',
            _by_rate(measured, _MAIN, everything),
            'holds from 50 Hz up',
        ],
        [
            'difference form: mass and CoM in less than 20 s',
            _differences(measured, without_inertia),
            'holds from 50 Hz up; at any rate against the first sample',
        ],
        [
            'the inertia begins after about 15 s and takes about 5 s',
            _inertia(measured),
            'the same order, earlier; a matter of the rate and of the covariance at the start',
        ],
        [
            'all parameters of the debris in less than 20 s (abstract)',
            _differences(measured, everything),
            'holds from 50 Hz up; at any rate against the first sample',
        ],
        [
            'the difference form takes longer than the main form',
            f'{previous:.1f} s against {main:.1f} s at 100 Hz',
            'holds at every rate',
        ],
        [
            'only the terms of the inertia are differenced, those of the CoM are not',
            "the CoM's terms in the angular equations are differenced too (eq. 25)",
            "does not hold; the CoM's terms in the linear equations are as in eq. 22",
        ],
        [
            'momentum is not linear in the centre of mass',
            f'linear in mass, first moment and inertia about the hinge: method `difference` finds them to {linear:.0e}',
            "a matter of the parameters: it holds for the inertia about the CoM, not about the link's origin",
        ],
        [
            'the inertia parameters of all elements can be identified',
            _ranks(measured),
            'combinations of them can; no body of a chain by itself',
        ],
    ]
    return table(['claim', 'measured', 'by which setting'], rows, words=True)


def _exact(measured: Measured) -> str:
    rows = [
        [f'{robot}, {form}', f'{error:.0e}']
        for robot, by_form in measured.spatial.items()
        for form, error in by_form.items()
    ]
    rows += [[f'{robot}, method `difference`', f'{error:.0e}'] for robot, error in measured.difference.items()]
    return table(['robot, form', 'largest relative error'], rows)


_INTRODUCTION = """\
# The paper's claims

The case of the paper: Table 1, passive joints, no noise, total linear momentum zero; its recursive least squares with
P0 = 1e6 I, a forgetting factor of 0.99 and one step a sample, on the equations 22 and 25 as corrected. {provenance}
"""

_SETTLING = """
## Time to settle

Seconds until the mass, the CoM's coordinates and the inertia stay within 1 %, beside those of an implementation that
shares no code with this one. They are the recursion's; `replay` publishes a value once the start of the
recursion makes less than a fiftieth of it, at most 3 % later.
"""

_SCALING = """
These seconds are mostly the prior: a variance of 1e6 is large for 1/m, which is of size 1e-3, and small for Izz, of
size 3e3. With every unknown scaled to order one, all forms at all rates settle within {longest:.1f} s.

## Without noise in space

Sixty seconds at 100 Hz; the largest error of the ten parameters (of the four in the plane for Table 1).
"""
