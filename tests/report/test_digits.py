"""Digits by hand: two of sigma (GUM 7.2.6), the value to the same place."""

from __future__ import annotations

from math import inf, nan

import pytest

from mbm.report.digits import measured, plain


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (1.23456, 0.00123, "1.2346 ± 0.0012"),
        (238.94212918, 2.7070075241, "238.9 ± 2.7"),
        (12345.678, 1234.0, "12300 ± 1200"),
        (9.99996, 0.0996, "10.00 ± 0.10"),
        (-0.0001, 0.2, "0.00 ± 0.20"),
        (0.001, 50.0, "0 ± 50"),
        (1.0, 25.4, "1 ± 25"),
        (99999999.0, 25.0, "99999999 ± 25"),
        (5.5015643181e-4, 7.2668688436e-6, "(5.502 ± 0.073)e-04"),
        (6.02e23, 1e20, "(6.0200 ± 0.0010)e+23"),
        (0.0, 1e-9, "(0.0 ± 1.0)e-09"),
        (1.5, 1e-18, "1.5 ± 1.0e-18"),
        (1.5, 0.0, "1.5 ± 0"),
        (3.0, nan, "3 ± ?"),
        (3.0, inf, "3 ± ?"),
        (nan, 1.0, "undefined"),
        (1e-310, 1e-311, "1.00000e-310 ± 1.0e-311"),
    ],
)
def test_value_and_sigma(value: float, sigma: float, text: str) -> None:
    assert str(measured(value, sigma)) == text


def test_values_alone_keep_their_power_of_ten() -> None:
    assert measured(1.2346e-7, 1.2e-9).alone == "1.235e-07"
    assert measured(1.5, 0.25).alone == "1.50"


def test_exact_values_have_no_sigma() -> None:
    assert str(measured(800.0, nan, exact=True)) == "800"
    assert str(measured(0.0254, 0.0, exact=True)) == "0.0254"


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 6, "0"),
        (1 / 3, 6, "0.333333"),
        (1234567.0, 3, "1234567"),
        (1e7, 6, "1e+07"),
        (1.25e-9, 6, "1.25e-09"),
        (0.467, 2, "0.47"),
        (nan, 6, "undefined"),
    ],
)
def test_plain(value: float, digits: int, text: str) -> None:
    assert plain(value, digits) == text
