"""The document against CONTRACT §2, written out by hand as a structural schema, and value by value."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbm.report.document import document
from mbm.report.encode import encode, to_bytes
from mbm.report.types import (
    Estimate,
    FreeDirection,
    Observability,
    Quantity,
    Result,
    SolveReport,
    SolveStatus,
)
from mbm.scales import Scale

NUMBER = (int, float)
OPTIONAL_NUMBER = (int, float, type(None))
OPTIONAL_TEXT = (str, type(None))

DIAGNOSTIC = {
    "severity": str,
    "code": str,
    "message": str,
    "file": OPTIONAL_TEXT,
    "line": OPTIONAL_NUMBER,
    "column": OPTIONAL_NUMBER,
    "length": OPTIONAL_NUMBER,
    "hint": OPTIONAL_TEXT,
}
SOLVE = {
    "key": dict,
    "status": str,
    "message": str,
    "method": OPTIONAL_TEXT,
    "iterations": int,
    "evaluations": int,
    "seconds": NUMBER,
    "cost": OPTIONAL_NUMBER,
    "dof": OPTIONAL_NUMBER,
    "sigma0": OPTIONAL_NUMBER,
    "chi2_p": OPTIONAL_NUMBER,
    "estimates": dict,
    "covariance": (dict, type(None)),
    "derived": dict,
    "derived_covariance": (dict, type(None)),
    "observability": (dict, type(None)),
    "noise": dict,
    "residuals": dict,
    "constraints": [],
    "priors": [{"name": str, "value": NUMBER, "mean": NUMBER, "sigma": NUMBER, "residual": NUMBER}],
    "alternatives": [],
    "starts": type(None),
    "diagnostics": [DIAGNOSTIC],
}
DOCUMENT = {
    "mbm": str,
    "file": OPTIONAL_TEXT,
    "problem": str,
    "status": str,
    "seed": (int, type(None)),
    "options": dict,
    "inputs": [{"path": str, "sha256": OPTIONAL_TEXT, "rows": int}],
    "diagnostics": [DIAGNOSTIC],
    "solves": [SOLVE],
}
MAY_STAND_BESIDE = {"reason", "reasons"}


def check(value: Any, schema: Any, where: str = "$") -> None:
    """The value has the keys of the schema, in its order, and no other key but the optional ones."""
    if isinstance(schema, dict):
        assert isinstance(value, dict), where
        assert [key for key in value if key not in MAY_STAND_BESIDE] == list(schema), where
        for key, inner in schema.items():
            check(value[key], inner, f"{where}.{key}")
    elif isinstance(schema, list):
        assert isinstance(value, list), where
        for i, entry in enumerate(value):
            check(entry, schema[0], f"{where}[{i}]")
    else:
        assert isinstance(value, schema), where


def reread(result: Result) -> dict[str, Any]:
    """The document by way of its text, as a program sees it; NaN and infinity would not be read."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} in the document")

    loaded: dict[str, Any] = json.loads(encode(document(result)), parse_constant=refuse)
    return loaded


def test_has_the_structure_of_the_contract(tag_result: Result, epochs: Result) -> None:
    check(reread(tag_result), DOCUMENT)
    check(reread(epochs), DOCUMENT)


def test_header(tag_result: Result) -> None:
    written = reread(tag_result)
    assert written["mbm"] == "0.1.0"
    assert written["status"] == "ok"
    assert written["seed"] == 1
    assert written["options"] == {"method": "lm", "tolerance": 1e-10}
    assert written["inputs"] == [{"path": "ranges.csv", "sha256": "ab" * 32, "rows": 48}]


def test_vector_in_its_unit(tag_result: Result) -> None:
    """1.2 m = 1200 mm exactly in doubles; 12.3 mm is not exact, hence a relative 1e-15."""
    estimate = reread(tag_result)["solves"][0]["estimates"]["p"]
    assert estimate["value"] == pytest.approx([1200.0, 800.0, 740.0], rel=1e-15)
    assert estimate["sigma"] == pytest.approx([1.0, 1.1, 12.3], rel=1e-15)
    assert estimate["unit"] == "mm"


def test_covariance_has_the_units_of_sigma(tag_result: Result) -> None:
    """Diagonal = sigma², mixed entries scale by one factor only: 2e-7 m·rad = 2e-4 mm·rad. Rounding: 1e-14."""
    covariance = reread(tag_result)["solves"][0]["covariance"]
    assert covariance["names"] == ["p[1]", "p[2]", "p[3]", "psi"]
    matrix = covariance["matrix"]
    assert [matrix[i][i] for i in range(3)] == pytest.approx([1.0, 1.21, 151.29], rel=1e-14)
    assert matrix[0][3] == matrix[3][0] == pytest.approx(2e-4, rel=1e-14)
    assert matrix[2][3] is None
    assert "null" in covariance["reason"]


def test_family_has_keys_and_null_with_a_reason(tag_result: Result) -> None:
    family = reread(tag_result)["solves"][0]["estimates"]["offset"]
    assert family == {
        "per": "receivers",
        "keys": ["left", "right"],
        "value": [0.25, 0.5],
        "sigma": [0.01, None],
        "unit": "m",
        "reason": "no row has receiver right",
    }


def test_fixed_number_is_exact(tag_result: Result) -> None:
    fixed = reread(tag_result)["solves"][0]["estimates"]["k0"]
    assert fixed == {"value": 800.0, "sigma": 0.0, "unit": None, "fixed": True}


def test_angle_without_unit_is_in_rad(tag_result: Result) -> None:
    assert reread(tag_result)["solves"][0]["estimates"]["psi"] == {"value": 0.5, "sigma": 0.002, "unit": "rad"}


def test_derived_over_a_table(tag_result: Result) -> None:
    """Keys that are whole numbers are written as such."""
    text = encode(document(tag_result))
    assert '"keys": [1, 2]' in text
    assert reread(tag_result)["solves"][0]["derived"]["height"]["over"] == "corners"


def test_array_is_nested() -> None:
    array = Estimate(
        quantity=Quantity(name="theta", shape=(2, 2), unit="deg", scale=Scale(math.pi / 180)),
        value=np.radians([[10.0, 20.0], [30.0, 40.0]]),
        sigma=np.radians([[1.0, 1.0], [1.0, 2.0]]),
        fixed=np.array([[False, False], [False, True]]),
    )
    solve = SolveReport(status=SolveStatus.CONVERGED, message="", estimates=(array,))
    result = Result(version="0", file=None, problem="hand", seed=None, solves=(solve,))
    theta = reread(result)["solves"][0]["estimates"]["theta"]
    assert theta["value"][0] == pytest.approx([10.0, 20.0], rel=1e-15)
    assert theta["value"][1] == pytest.approx([30.0, 40.0], rel=1e-15)
    assert theta["sigma"][1][1] == 0.0
    assert theta["fixed"] == [[False, False], [False, True]]


def test_held_at_a_bound_has_no_sigma() -> None:
    held = Estimate(
        quantity=Quantity(name="h"),
        value=np.array(0.8),
        sigma=np.array(0.0),
        fixed=np.array(False),
        at_bound=np.array(True),
    )
    solve = SolveReport(status=SolveStatus.CONVERGED, message="", estimates=(held,))
    result = Result(version="0", file=None, problem="desk", seed=None, solves=(solve,))
    written = reread(result)["solves"][0]["estimates"]["h"]
    assert written["sigma"] is None
    assert written["at_bound"] is True
    assert written["reason"] == "held at its bound"


def test_all_digits_come_back() -> None:
    """The shortest decimal text of a double gives the double back (IEEE 754): equality, no tolerance."""
    values = [0.1, 1 / 3, math.pi * 1e-300, 5e-324, 1.7976931348623157e308, -(2.0**-1074)]
    vector = Estimate(
        quantity=Quantity(name="v", shape=(6,)), value=np.array(values), sigma=None, fixed=np.zeros(6, dtype=bool)
    )
    solve = SolveReport(status=SolveStatus.CONVERGED, message="", estimates=(vector,))
    result = Result(version="0", file=None, problem="digits", seed=None, solves=(solve,))
    written = reread(result)["solves"][0]["estimates"]["v"]
    assert written["value"] == values
    assert written["sigma"] == [None] * 6
    assert written["reason"] == "no standard deviation was computed"


def test_every_null_of_a_failed_solve_has_its_reason(epochs: Result) -> None:
    failed = reread(epochs)["solves"][1]
    assert failed["status"] == "not-converged"
    assert set(failed["reasons"]) == {"cost", "dof", "sigma0", "chi2_p"}
    assert failed["cost"] is None


def test_chi2_without_stated_noise_says_why(tag: SolveReport, tag_result: Result) -> None:
    reasons = {"chi2_p": "the noise is estimated from the residuals"}
    unknown = replace(tag, chi2_p=None, noise={"ranges": 0.004}, reasons=reasons)
    written = reread(replace(tag_result, solves=(unknown,)))["solves"][0]
    assert written["chi2_p"] is None
    assert written["reasons"] == reasons
    assert written["noise"] == {"ranges": 0.004}


def test_free_direction_in_the_units_of_the_estimates(tag: SolveReport, tag_result: Result) -> None:
    """1 m along p[1] is 1000 mm."""
    free = FreeDirection(sentence="`p` and `psi` move", unknowns=("p", "psi"), coefficients={"p[1]": 1.0, "psi": 0.5})
    found = Observability(rank=3, dimension=4, condition=math.inf, unobservable=(free,))
    solve = replace(tag, status=SolveStatus.UNOBSERVABLE, observability=found)
    written = reread(replace(tag_result, solves=(solve,)))
    assert written["status"] == "attention"
    observability = written["solves"][0]["observability"]
    assert observability["unobservable"][0]["coefficients"] == {"p[1]": 1000.0, "psi": 0.5}
    assert observability["condition"] is None
    assert observability["reason"]


def test_status_of_the_document(epochs: Result) -> None:
    assert document(epochs)["status"] == "attention"
    assert document(replace(epochs, solves=epochs.solves[:1]))["status"] == "ok"
    assert document(replace(epochs, solves=()))["status"] == "attention"


def test_equal_results_give_equal_texts(tag_result: Result) -> None:
    assert encode(document(tag_result)) == encode(document(tag_result))


def test_options_become_what_json_has() -> None:
    options = {"sandbox": Path("a/b"), "init": {"p": (1, 2.5)}, "tolerance": math.inf, "seed": None}
    result = Result(version="0", file=None, problem="p", seed=None, solves=(), options=options)
    assert reread(result)["options"] == {
        "sandbox": "a/b",
        "init": {"p": [1, 2.5]},
        "tolerance": None,
        "seed": None,
    }


def test_encode_keeps_short_things_on_a_line_and_breaks_long_ones() -> None:
    assert encode({"a": [1, 2], "b": {}}) == '{"a": [1, 2], "b": {}}\n'
    long = encode({"a": list(range(100))})
    assert json.loads(long) == {"a": list(range(100))}
    assert max(len(line) for line in long.splitlines()) <= 110
    assert len(long.splitlines()) < 10


def test_encode_refuses_nan() -> None:
    with pytest.raises(ValueError, match="Out of range"):
        encode([math.nan])


def test_odd_file_names_stay_json() -> None:
    """A lone surrogate stands for a byte that is no UTF-8; JSON spells it as an escape."""
    assert json.loads(to_bytes(encode(["caf\udce9", "µ"]))) == ["caf\udce9", "µ"]
