"""Initial values from plain JSON and from documents."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from mbm.report.document import document
from mbm.report.encode import encode
from mbm.report.initial import initial_values
from mbm.report.types import Result
from mbm.text.types import MbmError


def test_plain_values() -> None:
    values = initial_values({"p": [1, 1.5, 2], "h": 0.7, "M": [[1, 2], [3, 4]]}, {})
    assert values["p"].value.tolist() == [1.0, 1.5, 2.0]
    assert values["h"].value.shape == ()
    assert values["M"].value.shape == (2, 2)
    assert values["h"].unit is None


def test_a_document_gives_its_estimates(tag_result: Result) -> None:
    """Written and read again; the division by the factor is one rounding, hence 1e-15."""
    values = initial_values(json.loads(encode(document(tag_result))), {})
    assert values["p"].unit == "mm"
    assert values["p"].value.tolist() == pytest.approx([1200.0, 800.0, 740.0], rel=1e-15)
    assert values["offset"].keys == ("left", "right")
    assert values["offset"].value.tolist() == [0.25, 0.5]


def test_the_solve_of_the_same_key_counts(epochs: Result) -> None:
    written = json.loads(encode(document(epochs)))
    assert initial_values(written, {"epoch": 3.0})["x"].value == -10.5
    assert initial_values(written, {"epoch": 4.0}) == {}


@pytest.mark.parametrize(
    ("written", "value", "unit"),
    [("5mm", 5.0, "mm"), (" -2.5e-3 m/s", -2.5e-3, "m/s"), ("7", 7.0, None), (".5degC", 0.5, "degC")],
)
def test_a_text_is_a_number_with_its_unit(written: str, value: float, unit: str | None) -> None:
    found = initial_values({"x": written}, {})["x"]
    assert (float(found.value), found.unit) == (value, unit)


def test_null_becomes_nan() -> None:
    assert math.isnan(initial_values({"x": {"value": None}}, {})["x"].value)


def test_a_number_among_rotations_is_a_row_of_one() -> None:
    """Whether the unknown has rows like that is for the problem to say."""
    found = initial_values({"x": [{"angle": 1, "translation": [1, 2]}, None]}, {})["x"].value
    assert found.shape[0] == 2
    assert all(math.isnan(number) for number in found[1])
    with pytest.raises(MbmError, match="bad-initial-values"):
        initial_values({"x": [{"angle": 1, "translation": [1, 2]}, 0]}, {})


@pytest.mark.parametrize(
    "given",
    [
        [1, 2],
        {"p": "five"},
        {"p": [1, [2, 3]]},
        {"p": {"sigma": 1}},
        {"p": {"value": [1, 2], "keys": ["a"]}},
        {"p": True},
        {"solves": [1]},
    ],
)
def test_what_is_no_initial_value_is_said(given: Any) -> None:
    with pytest.raises(MbmError) as caught:
        initial_values(given, {}, "start.json")
    assert caught.value.diagnostics[0].code.name == "bad-initial-values"
