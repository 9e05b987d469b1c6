"""Diagnostics of temperatures on scales with a zero of their own (degC, degF) and of their differences."""

from __future__ import annotations

from mbm.expression.nodes import Constant, Number
from mbm.text.types import Code, Diagnostic, Span

TEMPERATURE_AND_DIFFERENCE = Code(
    "temperature-and-difference",
    "A temperature in degC or degF, which is kept in kelvin (`20degC` is 293.15 K), stands for a difference of"
    " temperatures, such as a standard deviation; or a difference for a temperature. `0.1degC` is 273.25 K.",
    "Write differences in K, or in degR, which is a difference of one degree Fahrenheit: `:sigma 0.1K`, `(+ t 5K)`. The"
    " difference of two temperatures, `(- t 20degC)`, is one.",
)


def temperature_for_difference(place: Span | None, literal: Number | Constant) -> Diagnostic:
    """A temperature that was written, such as ``0.1degC``, where a difference is wanted."""
    text = literal.name if isinstance(literal, Constant) else "" if place is None else place.text
    kelvin = f"{float(literal.value):.12g}K"
    difference = next((f"{text.removesuffix(u)}{d}" for u, d in _DIFFERENCES if text.endswith(u)), None)
    hint = "take the difference of two temperatures" if difference is None else f"write the difference: `{difference}`"
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place, hint=hint,
        message=f"`{text}` is the temperature {kelvin}, and here a difference of temperatures is wanted",
    )  # fmt: skip


_DIFFERENCES = (("degC", "K"), ("°C", "K"), ("degF", "degR"), ("°F", "degR"))


def temperature_without_unit(place: Span | None, literal: Number | Constant) -> Diagnostic:
    """A number without a unit beside a temperature in degC: it would be in kelvin."""
    number = f"{float(literal.value):.12g}"
    what = f"`{literal.name}`" if isinstance(literal, Constant) else number
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message=f"{what} has no unit, and would be {number} K beside temperatures in degC or degF",
        hint=f"write the unit: `{number}degC`, `{number}K`",
    )  # fmt: skip


def difference_for_temperature(place: Span | None) -> Diagnostic:
    """A difference where a temperature is wanted."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message="this is a difference or a multiple of temperatures, and a temperature is wanted",
        hint="add it to a temperature: `(+ 20degC …)`",
    )  # fmt: skip


def zero_counts(place: Span | None, what: str) -> Diagnostic:
    """What is stated in degC stands for a difference, or for several temperatures."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message=f"{what} is a temperature in degC or degF, and here a difference of temperatures is wanted",
        hint="state it in K if it is a difference, or take one: `(- t 0degC)`; a number beside it has a unit: `0degC`",
    )  # fmt: skip


def reported_difference(place: Span | None, name: str, unit: str) -> Diagnostic:
    """A derived difference of temperatures that is to be reported in degC."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message=f"`{name}` is a difference, a multiple or a root mean square of temperatures, and {unit} counts from a "
        "zero of its own",
        hint="report it in K: `:unit K`",
    )  # fmt: skip


def no_temperature(place: Span | None, name: str, kind: str) -> Diagnostic:
    """A pose in degC."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place, message=f"`{name}` is a {kind}, and no temperature",
        hint="state a length, or none",
    )  # fmt: skip
