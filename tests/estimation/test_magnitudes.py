"""How large unknowns are, as sums and functions tell, against what their equations say in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.search import starting
from mbm.estimation.starts.magnitudes import magnitudes

X = np.linspace(100.0, 1000.0, 10)


def sizes_of(monkeypatch, unknowns, form, data):
    """The magnitudes of a problem's unknowns, by name."""
    found = {}

    def spied(equations, base, missing, settings):
        told = magnitudes(equations, base, missing)
        for k in np.flatnonzero(missing):
            found[equations.layout.name(k)] = {
                each: float(getattr(told, each)[k]) for each in ("low", "high", "first", "last", "least", "most")
            }
        return original(equations, base, missing, settings)

    original = starting._drawn
    monkeypatch.setattr(starting, "_drawn", spied)
    mbm.loads(f'(problem p (data d (csv "d.csv")) (unknowns {unknowns}) (observe d (= y {form}) :sigma 1))').solve(
        data={"d": data}
    )
    return found


def test_what_an_exponential_takes_is_about_one(monkeypatch):
    found = sizes_of(monkeypatch, "(a) (k)", "(* a (exp (- (* k x))))", {"x": X, "y": np.full(10, 50.0) + X * 1e-3})
    # k x is 1 for x between 100 and 1000: k between 1e-3 and 1e-2.
    assert (found["k"]["low"], found["k"]["high"]) == pytest.approx((-3, -2), abs=1e-9)
    assert found["a"]["low"] < np.log10(50) < found["a"]["high"]


def test_what_is_added_to_a_column_lies_among_its_values(monkeypatch):
    form = "(* h (exp (- (^ (/ (- x m) w) 2))))"
    found = sizes_of(monkeypatch, "(h) (m) (w)", form, {"x": X, "y": np.exp(-(((X - 400) / 200) ** 2))})
    assert (found["m"]["first"], found["m"]["last"]) == (100, 1000)
    # From the spacing of the column, 90, to its largest value.
    assert 10 ** found["w"]["low"] == pytest.approx(90, rel=1e-9)
    assert 10 ** found["w"]["high"] == pytest.approx(1000, rel=1e-9)


def test_terms_of_a_sum_are_alike(monkeypatch):
    form = "(/ a (+ 1 (* b x) (* c (^ x 2))))"
    found = sizes_of(monkeypatch, "(a) (b) (c)", form, {"x": X, "y": 5 / (1 + 0.01 * X)})
    assert (found["b"]["low"], found["b"]["high"]) == pytest.approx((-3, -2), abs=1e-9)
    assert (found["c"]["low"], found["c"]["high"]) == pytest.approx((-6, -4), abs=1e-9)


def test_a_power_of_an_unknown_to_an_unknown(monkeypatch):
    form = "(/ (* v (^ x n)) (+ (^ k n) (^ x n)))"
    found = sizes_of(monkeypatch, "(v) (k positive) (n positive)", form, {"x": X, "y": 3 * X**2 / (300.0**2 + X**2)})
    assert found["k"]["low"] < 2.5 < found["k"]["high"]
    assert found["n"]["low"] < 0 < found["n"]["high"]


@pytest.mark.parametrize(("form", "name"), [("(* 2 pi f x)", "most"), ("(/ (* 2 pi x) f)", "least")])
def test_half_a_turn_from_row_to_row(monkeypatch, form, name):
    data = {"x": X, "y": np.sin(2 * np.pi * X / 450)}
    found = sizes_of(monkeypatch, "(a) (b) (f)", f"(+ (* a (sin {form})) (* b (cos {form})))", data)
    # 100 apart: 1/200 per unit, or a period of 200.
    assert found["f"][name] == pytest.approx(1 / 200 if name == "most" else 200, rel=1e-9)


def test_uneven_rows_tell_turns_over_their_least_step(monkeypatch):
    x = np.array([0.0, 1.0, 2.0, 2.0 + 1e-12, 2.25, 5.0, 9.0])
    data = {"x": x, "y": np.sin(7 * x)}
    found = sizes_of(monkeypatch, "(a) (b) (w)", "(+ (* a (sin (* w x))) (* b (cos (* w x))))", data)
    # The least step is 1/4; 1e-12 is rounding.
    assert found["w"]["most"] == pytest.approx(4 * np.pi, rel=1e-9)


def test_long_tables_tell_turns_from_row_to_row(monkeypatch):
    x = np.arange(1001.0)
    form = "(+ (* a (sin (* w x))) (* b (cos (* w x))))"
    found = sizes_of(monkeypatch, "(a) (b) (w)", form, {"x": x, "y": np.sin(2.5 * x)})
    assert found["w"]["most"] == pytest.approx(np.pi, rel=1e-9)


def test_rows_without_a_size_are_left_out(monkeypatch):
    data = {"x": np.append(0.0, X), "y": np.append(0.0, np.exp(-X / 300))}
    found = sizes_of(monkeypatch, "(a) (k)", "(* a (exp (- (* k x))))", data)
    assert (found["k"]["low"], found["k"]["high"]) == pytest.approx((-3, -2), abs=1e-9)
