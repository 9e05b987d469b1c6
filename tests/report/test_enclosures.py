"""Guaranteed bounds in documents, tables, CSV files and from Python."""

from __future__ import annotations

import csv
import json
from decimal import Decimal
from io import StringIO

import numpy as np
import pytest

import mbm
from mbm.cli.main import run
from mbm.report.digits import enclosed
from mbm.report.exports import write_estimates

TEXT = """(problem p
  (data t (table (k v) ("a" 1) ("b" 2)) :key k)
  (unknowns (x :in (0.1m 9m) :unit cm) (c :per t :in (0 9)) (u (vector 2) :in (0 1)) (a angle :in (90deg 270deg)))
  (observe (= 4m^2 (* x x)) :bound 1m^2) (observe t (= v (c k)) :bound 0.5) (observe (= -1 (cos a)) :bound 0.5)
  (derive (y (* 2 x)) (w (log (- (u 1) 5))) (z (sign (- (u 1) 0.5))))
  (solve :method (interval :width 100%)))"""


@pytest.fixture(scope="module")
def result():
    return mbm.loads(TEXT).solve()


def test_bounds_take_the_place_of_sigma(result) -> None:
    solve = result.document()["solves"][0]
    low, high = 100 * np.sqrt([3, 5])
    assert solve["estimates"]["x"] == {
        "value": pytest.approx((low + high) / 2),
        "bounds": pytest.approx([low, high], rel=1e-14),
        "unit": "cm",
    }
    assert np.shape(solve["estimates"]["c"]["bounds"]) == (2, 2)
    assert solve["estimates"]["u"]["bounds"] == [[0, 1], [0, 1]]
    assert solve["derived"]["z"]["bounds"] == [-1, 1]
    assert solve["derived"]["w"] == {"value": None, "bounds": [None, None], "unit": None, "reason": "it is not bounded"}
    assert (solve["method"], solve["boxes"], solve["covariance"], solve["cost"]) == ("interval-hc4", 1, None, None)
    assert solve["reasons"]["cost"] == "interval methods fit nothing"
    json.dumps(solve, allow_nan=False)
    asked = result.document()["options"]["interval"]
    assert asked == {"contract": "hc4", "width": 1.0, "boxes": 50_000}


def test_bounds_are_rounded_outwards_in_other_units(result) -> None:
    """100 √3 lies within the bounds in cm: their decimals are exact."""
    low, high = result.document()["solves"][0]["estimates"]["x"]["bounds"]
    assert Decimal(low) <= 100 * Decimal(3).sqrt()
    assert Decimal(high) >= 100 * Decimal(5).sqrt()


def test_python_has_them_by_name(result) -> None:
    assert result["c"].bounds.shape == (2, 2)
    assert np.isnan(result["c"].sigma).all()
    assert abs(result["a"].value) == pytest.approx(np.pi)
    assert list(result.table().columns)[3:6] == ["x", "x.low", "x.high"]


def test_tables_print_them_rounded_outwards(result) -> None:
    text = str(result)
    assert "[173.2, 223.7]     cm" in text
    assert "[2.09, 4.19]     rad  = [119, 241] deg" in text
    assert "guaranteed bounds: 1 box examined" in text


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.12, 0.22, "[0.120, 0.220]"),
        (1.23456789, 1.23461234, "[1.2345678, 1.2346124]"),
        (-1.0, 1.0, "[-1.00, 1.00]"),
        (3.0, 3.0, "[3, 3]"),
        (1.2345e-9, 2.3456e-9, "[1.23e-09, 2.35e-09]"),
        (123456.7, 987654.3, "[123456, 987655]"),
        (-2e20, 3e20, "[-2.00e+20, 3.00e+20]"),
        (-1e308, 1e308, "[-1e+308, 1e+308]"),  # their width is no double
    ],
)
def test_digits(low: float, high: float, text: str) -> None:
    assert enclosed(low, high) == text


def test_csv(tmp_path) -> None:
    file, out = tmp_path / "p.mbm", tmp_path / "out.csv"
    file.write_text(TEXT)
    assert run(["solve", str(file), "--csv", str(out), "--quiet"]) == 0
    with out.open(newline="") as stream:
        row = next(csv.DictReader(stream))
    assert float(row["x.low"]) <= 100 * np.sqrt(3) <= float(row["x"]) <= float(row["x.high"])
    assert row["w.low"] == ""
    assert "x.sigma" not in row
    stream = StringIO()
    write_estimates(mbm.loads(TEXT).solve().result, stream)
    rows = list(csv.DictReader(StringIO(stream.getvalue())))
    assert [float(rows[0][end]) for end in ("low", "high")] == pytest.approx(100 * np.sqrt([3, 5]))


def test_pictures_draw_them(result) -> None:
    """A bar for each scalar, in parts where the set is in pieces; of many solves, from bound to bound over the key."""
    (panel,) = result.plot().axes
    assert panel.get_title() == "guaranteed bounds"
    scalars = 9 - 1  # one derived quantity is not bounded
    assert len(panel.patches) == scalars
    assert any("x  [173.2, 223.7] cm" in text.get_text() for text in panel.texts)
    two = mbm.loads("(problem p (unknowns (x :in (-3 3))) (observe (= 4 (* x x)) :bound 1) (solve :method (interval)))")
    bars = two.solve().plot().axes[0].patches
    inner = np.sqrt(3 / 5)
    drawn = sorted((b.get_x(), b.get_width()) for b in bars)
    np.testing.assert_allclose(drawn, [(0, (1 - inner) / 2), ((1 + inner) / 2, (1 - inner) / 2)], atol=1e-6)
    many = mbm.loads("""(problem p (data t (table (k v) (1 1) (2 3))) (unknowns (x :in (0 9)))
      (observe t (= v x) :bound 0.5) (for-each k) (solve :method (interval)))""").solve()
    (axes,) = many.plot().axes
    assert axes.get_title() == "x: guaranteed bounds"


def test_the_command_ends_with_the_status_of_the_set(tmp_path, capsys) -> None:
    file = tmp_path / "p.mbm"
    file.write_text("(problem p (unknowns (x :in (0 1))) (observe (= 5 x) :bound 1) (solve :method (interval)))")
    assert run(["solve", str(file)]) == 1
    assert "no values meet all observations within their bounds" in capsys.readouterr().out
    assert run(["explain", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "noise: stated bounds" in printed
    assert "HC4" in printed
    assert run(["check", str(file)]) == 0
    for command in (["compile", "--target", "c", "-o"], ["simulate", "-o"]):
        assert run([command[0], str(file), *command[1:], str(tmp_path / "out")]) == 2
        assert "bound" in capsys.readouterr().err
    assert run(["view", str(file), "-o", str(tmp_path / "a.svg")]) == 2
