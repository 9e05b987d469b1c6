"""Angles in degrees, minutes and seconds of arc."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

import mbm
from mbm.text.formatter import format_text
from mbm.text.printer import print_form
from mbm.text.reader import read
from mbm.text.types import MbmError, Source


def degrees(text):
    (form,) = read(Source("a.mbm", text))
    assert form.unit == "deg"
    return form.value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12d30m15s", Fraction(12) + Fraction(30, 60) + Fraction(15, 3600)),
        ("12d30m15.5s", Fraction(12) + Fraction(30, 60) + Fraction(155, 36000)),
        ("-0d30m", Fraction(-1, 2)),
        ("+359d59m59.999s", 360 - Fraction(1, 3600000)),
        ("7d00m00s", 7),
        ("0d0m1.s", Fraction(1, 3600)),
    ],
)
def test_they_are_degrees(text, value):
    assert degrees(text) == value
    (again,) = read(Source("b.mbm", print_form(read(Source("a.mbm", text))[0])))
    assert (again.value, again.unit) == (value, "deg")


@pytest.mark.parametrize("text", ["12d60m", "12d30m60s", "12d30m75.5s"])
def test_sixty_minutes_are_a_degree_more(text):
    with pytest.raises(MbmError, match="60 minutes or seconds"):
        read(Source("a.mbm", text))


@pytest.mark.parametrize("text", ["12d30.5m", "1.5d30m", "12d30m15s20", "12d-30m", "1/2d30m"])
def test_what_is_no_angle_is_none(text):
    try:
        (form,) = read(Source("a.mbm", text))
    except MbmError:
        return
    assert form.unit != "deg"


def test_days_metres_and_seconds_are_what_they_were():
    forms = read(Source("a.mbm", "12d 30m 15s 2d^2 3m/s"))
    assert [form.unit for form in forms] == ["d", "m", "s", "d^2", "m/s"]


def test_the_layout_keeps_what_was_written():
    assert "12d30m15.50s" in format_text(Source("a.mbm", "(defconst a 12d30m15.50s)\n"))


def test_a_direction_from_readings():
    result = mbm.loads("""(problem p (data d (table (a) (12d30m14s) (12d30m16s))) (unknowns (x angle :unit deg))
      (observe d (= (angle a) x) :sigma 0d0m2s))""").solve()
    assert result["x"].value == pytest.approx(12.5 + 15 / 3600, abs=1e-12)
    assert result["x"].sigma == pytest.approx(2 / 3600 / math.sqrt(2), rel=1e-9)
