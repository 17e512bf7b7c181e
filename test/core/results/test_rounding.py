"""Numbers to the digits that their standard deviations are worth."""

from __future__ import annotations

import math

import pytest

from mbaid_ros.core.results.parameters import rounded


@pytest.mark.parametrize(
    ('value', 'std', 'shown'),
    [
        (162.0, 0.03, ('162.000', '0.059')),
        (934.4470123, 0.117, ('934.45', '0.23')),
        (2.3, 8e-5, ('2.300000', '0.000157')),
        (0.099, 0.0996, ('0.10', '0.20')),
        (12345.678, 1234.0, ('12300', '2400')),
        (-1e-9, 0.01, ('0.000', '0.020')),
        (1e-6, 1.2e-9, ('1.0000e-06', '2.4e-09')),
        (-3.2e9, 4.5e7, ('-3.200e+09', '8.8e+07')),
        (1e-12, 1e-9, ('0', '2.0e-09')),
        (1.0, 0.0, ('1', '0')),
        (162.0, math.nan, ('162', '-')),
        (math.nan, 1.0, ('-', '-')),
        (math.inf, 1.0, ('-', '-')),
    ],
)
def test_two_digits_of_the_standard_deviation_decide(value: float, std: float, shown: tuple[str, str]) -> None:
    assert rounded(value, std, '-') == shown


@pytest.mark.parametrize('exponent', range(-12, 13))
def test_what_is_left_off_is_less_than_a_tenth_of_the_standard_deviation(exponent: int) -> None:
    for std in (1.0e0, 1.04, 3.7, 9.94, 9.96):
        size = std * 10.0**exponent
        for value in (123.456 * size, -0.7071 * size, 1e7 * size):
            shown, band = map(float, rounded(value, size))
            assert abs(shown - value) <= 0.0501 * size + 1e-15 * abs(value)
            assert band == pytest.approx(1.96 * size, rel=0.03)
