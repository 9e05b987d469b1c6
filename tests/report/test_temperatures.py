"""One problem in K, degC and degF: every output says the same temperatures, and differences have no zero anywhere."""

from __future__ import annotations

import csv
import io
import json
import sys
from shutil import which

import numpy as np
import pytest

import mbm
from mbm.api.files import emit_file
from mbm.report.options import SolveOptions
from tests.emit.making import make, run, written as written_files

ZEROS = {"K": (1.0, 0.0), "degC": (1.0, 273.15), "degF": (5 / 9, 459.67 * 5 / 9)}
"""SI per unit, and the zero in kelvin: NIST SP 811, appendix B.8."""
READINGS = ((-40.1, -120.0), (-19.7, -79.6), (0.2, -39.4), (20.3, 0.7), (39.8, 39.4), (60.4, 81.0))
CLOSE = 1e-9
"""Kelvin: solves from the same start in units that differ by rounding."""

TEXT = """(problem p
  (constants (t0 {20}))
  (data d (table (t v k) {rows}) :columns ((v :unit mV)))
  (data e (table (r) ({31}) ({31.4}) ({30.8}) ({31.2})))
  (unknowns (s :unit mV/K :init 2mV/K) (x :unit {unit} :init {25} :in ({0} {100})))
  (observe d (= v (* s (- t t0))) :sigma 0.3mV)
  (observe e (= r x) :sigma 0.2K)
  (derive (y (+ x 1K) :unit {unit}) (mt (mean d t) :unit {unit}) (rise (- x t0))
    (band (+ t0 (/ (* s (- T t0)) 2mV/K)) :over (grid T {0} {50} 5) :unit {unit})
    (back (+ t0 (/ v s)) :over d :unit {unit})))"""
TEMPERATURES = ("x", "y", "mt", "band", "back")


class Places(dict):
    """Temperatures given in degrees Celsius, in another unit."""

    def __missing__(self, key):
        return written(self["unit"], float(key))


def written(unit, celsius):
    return f"{shown(unit, celsius + 273.15):.13g}{unit}"


def shown(unit, kelvin):
    factor, zero = ZEROS[unit]
    return (np.asarray(kelvin) - zero) / factor


def kelvin(unit, value):
    factor, zero = ZEROS[unit]
    return np.asarray(value, dtype=float) * factor + zero


def text(unit, template=TEXT):
    rows = " ".join(f"({written(unit, t)} {v} {1 + i % 2})" for i, (t, v) in enumerate(READINGS))
    found = template.replace("{rows}", rows)
    for celsius in ("-50", "0", "20", "25", "30.8", "31.2", "31.4", "31", "50", "100"):
        found = found.replace("{" + celsius + "}", written(unit, float(celsius)))
    return found.replace("{unit}", unit)


@pytest.fixture(scope="module")
def reference():
    return mbm.loads(text("K")).solve()


@pytest.fixture(scope="module", params=["degC", "degF"])
def unit(request):
    return request.param


@pytest.fixture(scope="module")
def result(unit):
    return mbm.loads(text(unit)).solve()


def test_kelvin_are_those_of_the_closed_form(reference):
    """The mean of four readings, and the slope through the origin of differences from 20 degC."""
    assert reference["x"].value == pytest.approx(273.15 + np.mean([31, 31.4, 30.8, 31.2]), abs=CLOSE)
    assert reference["x"].sigma == pytest.approx(0.1, rel=1e-9)
    t, v = np.array(READINGS).T
    assert reference["s"].value == pytest.approx(((t - 20) @ v) / ((t - 20) @ (t - 20)), rel=1e-9)


@pytest.mark.parametrize("name", TEMPERATURES)
def test_estimates_intervals_and_si(unit, result, reference, name):
    ours, theirs, factor = result[name], reference[name], ZEROS[unit][0]
    assert ours.unit == unit
    np.testing.assert_allclose(kelvin(unit, ours.value), theirs.value, atol=CLOSE, rtol=0)
    np.testing.assert_allclose(kelvin(unit, ours.interval(0.9)), theirs.interval(0.9), atol=CLOSE, rtol=0)
    for difference in ("sigma", "U"):
        np.testing.assert_allclose(getattr(ours, difference) * factor, getattr(theirs, difference), rtol=1e-8)
    assert ours.si.unit == "K"
    np.testing.assert_allclose(ours.si.value, theirs.value, atol=CLOSE, rtol=0)
    np.testing.assert_allclose(ours.si.sigma, theirs.sigma, rtol=1e-8)


def test_differences_stay_in_kelvin(result, reference):
    assert result["rise"].unit == "K"
    assert result["rise"].value == pytest.approx(float(reference["rise"].value), abs=CLOSE)


def test_document_and_tables(unit, result, reference, tmp_path):
    ours, theirs = (json.loads(each.to_json())["solves"][0] for each in (result, reference))
    factor = ZEROS[unit][0]
    assert kelvin(unit, ours["estimates"]["x"]["value"]) == pytest.approx(theirs["estimates"]["x"]["value"], abs=CLOSE)
    assert ours["estimates"]["x"]["sigma"] * factor == pytest.approx(theirs["estimates"]["x"]["sigma"], rel=1e-8)
    assert ours["derived"]["band"]["keys"] == pytest.approx(shown(unit, theirs["derived"]["band"]["keys"]), abs=1e-10)
    place = ours["covariance"]["names"].index("x")
    scaled = ours["covariance"]["matrix"][place][place] * factor**2
    assert scaled == pytest.approx(theirs["covariance"]["matrix"][place][place], rel=1e-8)
    assert ours["residuals"]["e"]["rms_unit"]["unit"] == unit
    raw = ours["residuals"]["e"]["rms_unit"]["value"] * factor
    assert raw == pytest.approx(theirs["residuals"]["e"]["rms_unit"]["value"], rel=1e-8)
    first, second = (each.table() for each in (result, reference))
    assert kelvin(unit, first["x"][0]) == pytest.approx(second["x"][0], abs=CLOSE)
    assert float(shown(unit, 304.25)) == pytest.approx(float(result["x"].value), abs=1e-8)
    assert f"{float(result['x'].value):.2f}"[:5] in str(result)


def test_budget(unit, result, reference):
    factor = ZEROS[unit][0]
    ours, theirs = (each.budget("x", by_row=True) for each in (result, reference))
    assert kelvin(unit, ours.value) == pytest.approx(theirs.value, abs=CLOSE)
    for mine, its in zip(ours.rows, theirs.rows, strict=True):
        assert mine.share == pytest.approx(its.share, abs=1e-9)
        assert mine.contribution * factor == pytest.approx(its.contribution, rel=1e-8, abs=1e-12)
        if its.unit == "K" and its.value is not None:
            assert mine.unit == unit
            assert kelvin(unit, mine.value) == pytest.approx(its.value, abs=CLOSE)
            assert mine.u * factor == pytest.approx(its.u, rel=1e-8)


def test_an_uncertain_constant_is_shown_as_it_is_written(unit):
    constant = TEXT.replace("(t0 {20})", "(t0 {20} :sigma 0.1K)")
    ours, theirs = (mbm.loads(text(u, constant)).solve().budget("rise") for u in (unit, "K"))
    mine, its = (next(r for r in each.rows if r.input == "t0") for each in (ours, theirs))
    assert (mine.unit, its.unit) == (unit, "K")
    assert kelvin(unit, mine.value) == pytest.approx(its.value, abs=CLOSE)
    assert mine.u * ZEROS[unit][0] == pytest.approx(its.u, rel=1e-9)
    assert mine.contribution == pytest.approx(its.contribution, rel=1e-6)


@pytest.mark.parametrize("given", [20, 293.15, 0.0])
def test_a_plain_number_for_a_constant_with_a_zero_is_refused(unit, given):
    """As for `--set`: in SI it would be kelvin, which few mean by 20. A constant in K takes it."""
    problem = mbm.loads(text(unit))
    with pytest.raises(mbm.MbmError, match="has no unit, and would be in kelvin"):
        problem.solve(constants={"t0": given})
    reference = mbm.loads(text("K")).solve(constants={"t0": 300.0})
    found = problem.solve(constants={"t0": "300K"})
    assert found["rise"].value == pytest.approx(float(reference["rise"].value), abs=CLOSE)


def test_predictions_take_and_give_the_unit(unit, result, reference):
    at = np.array([281.0, 300.0])
    ours, theirs = result.predict("band", shown(unit, at)), reference.predict("band", at)
    np.testing.assert_allclose(kelvin(unit, ours["T"]), at, atol=CLOSE, rtol=0)
    for name in ("value", "low", "high"):
        np.testing.assert_allclose(kelvin(unit, ours[name]), theirs[name], atol=CLOSE, rtol=0)
    np.testing.assert_allclose(np.array(ours["sigma"]) * ZEROS[unit][0], theirs["sigma"], rtol=1e-8)


def test_starts_and_data_from_python(unit):
    """Data and starts are in the units of the file; a document of an earlier solve is a start in any unit."""
    problem = mbm.loads(text(unit))
    readings = shown(unit, np.array([300.0, 302.0]))
    one = problem.solve(data={"e": {"r": readings}}, init={"x": float(shown(unit, 290.0))})
    assert kelvin(unit, one["x"].value) == pytest.approx(301.0, abs=CLOSE)
    start = json.loads(mbm.loads(text("K")).solve().to_json())
    again = problem.solve(init=start)
    assert kelvin(unit, again["x"].value) == pytest.approx(304.25, abs=CLOSE)
    assert again.iterations <= 2
    compiled = problem.compile()
    assert kelvin(unit, compiled.solve(data={"e": {"r": readings}})["x"].value) == pytest.approx(301.0, abs=CLOSE)


def test_estimators(unit):
    estimator = mbm.loads(text(unit)).compile().estimator("e.r")
    given = shown(unit, np.array([[300.0, 302.0, 301.0, 299.0], [310.0, 311.0, 312.0, 313.0]]))
    one, many = estimator(given[0]), estimator.many(given)
    place = list(one.names).index("x")
    assert kelvin(unit, one.values[place]) == pytest.approx(300.5, abs=CLOSE)
    np.testing.assert_allclose(kelvin(unit, many.values[:, place]), [300.5, 311.5], atol=CLOSE, rtol=0)
    np.testing.assert_allclose(np.sqrt(many.covariance[:, place, place]) * ZEROS[unit][0], 0.1, rtol=1e-8)


def test_batches(unit):
    """`for-each` and windows: one problem for each key."""
    template = """(problem p (data d (table (t v k) {rows})) (unknowns (m :unit {unit}))
      (observe d (= t m) :sigma 0.2K) (for-each k))"""
    ours = mbm.loads(text(unit, template)).solve()
    t = np.array([each[0] for each in READINGS])
    np.testing.assert_allclose(
        kelvin(unit, [each["m"].value for each in ours.solves]),
        273.15 + np.array([t[::2].mean(), t[1::2].mean()]),
        atol=CLOSE,
    )
    document = json.loads(ours.to_json())
    assert kelvin(unit, document["solves"][1]["estimates"]["m"]["value"]) == pytest.approx(
        273.15 + t[1::2].mean(), abs=CLOSE
    )


def test_bounds_of_interval_methods(unit):
    template = """(problem p (data e (table (r) ({31}) ({31.4}))) (unknowns (x :unit {unit} :in ({-50} {100})))
      (observe e (= r x) :bound 1K) (solve :method (interval)))"""
    found = mbm.loads(text(unit, template)).solve()["x"]
    low, high = kelvin(unit, found.bounds)
    assert low == pytest.approx(273.15 + 30.4, abs=1e-6)
    assert high == pytest.approx(273.15 + 32.0, abs=1e-6)


def test_simulated_data_are_in_the_units_of_the_file(unit, reference):
    values = json.loads(mbm.loads(text(unit)).solve().to_json())
    ours = mbm.loads(text(unit)).simulate(at=values, seed=3)
    theirs = mbm.loads(text("K")).simulate(at=json.loads(reference.to_json()), seed=3)
    np.testing.assert_allclose(kelvin(unit, ours["e"]["r"]), theirs["e"]["r"], atol=1e-7, rtol=0)


def test_monte_carlo_and_design(unit):
    ours, theirs = (mbm.loads(text(u)).propagate(trials=200, seed=1) for u in (unit, "K"))
    mine, its = (each.document()["solves"][0]["propagation"]["x"] for each in (ours, theirs))
    assert kelvin(unit, mine["mean"]) == pytest.approx(its["mean"], abs=1e-7)
    assert mine["sigma"] * ZEROS[unit][0] == pytest.approx(its["sigma"], rel=1e-6)
    np.testing.assert_allclose(kelvin(unit, mine["interval"]), its["interval"], atol=1e-7)


def test_filters_and_streams(unit, tmp_path):
    template = """(problem p
      (data r (table (k t) (1 {20}) (2 {25}) (3 {31}) (4 {31.4})))
      (states :over k (x :unit {unit} :init {20} :sigma 2K))
      (dynamics (random-walk x :sigma 1K))
      (observe r (= t x) :sigma 0.5K)
      (solve :method ekf))"""
    ours, theirs = (mbm.loads(text(u, template)).solve() for u in (unit, "K"))
    np.testing.assert_allclose(kelvin(unit, ours["x"].value), theirs["x"].value, atol=CLOSE, rtol=0)
    np.testing.assert_allclose(ours["x"].sigma * ZEROS[unit][0], theirs["x"].sigma, rtol=1e-9)
    stream = mbm.loads(text(unit, template)).compile().stream()
    for k, celsius in enumerate((20.0, 25.0, 31.0, 31.4)):
        step = stream.step({"r": {"k": k + 1, "t": float(shown(unit, celsius + 273.15))}})
    assert kelvin(unit, step["x"].value) == pytest.approx(float(theirs["x"].value[-1]), abs=1e-8)
    if which("cc") is not None:
        (tmp_path / "p.mbm").write_text(text(unit, template), encoding="utf-8")
        folder = written_files(emit_file(tmp_path / "p.mbm", SolveOptions(), "c"), tmp_path / "out")
        assert make(folder, "p", watched=False).returncode == 0
        last = run("./p", "data/r.csv", folder=folder).stdout.split()[-1].split(",")
        assert kelvin(unit, float(last[2])) == pytest.approx(float(theirs["x"].value[-1]), abs=1e-8)
        assert float(last[3]) * ZEROS[unit][0] == pytest.approx(float(theirs["x"].sigma[-1]), rel=1e-8)
    wrong = template.replace("random-walk x :sigma 1K", "random-walk x :sigma 1degC")
    with pytest.raises(mbm.MbmError, match="difference of temperatures"):
        mbm.loads(text(unit, wrong)).solve()


@pytest.mark.parametrize(
    "target", ["python", pytest.param("c", marks=pytest.mark.skipif(not which("cc"), reason="cc"))]
)
def test_generated_solvers_read_and_print_the_unit(unit, target, tmp_path):
    path = tmp_path / "p.mbm"
    grid = next(line for line in TEXT.splitlines() if "(grid " in line)
    path.write_text(text(unit, TEXT.replace(grid, "").replace("(mt (mean d t) :unit {unit})", "")), encoding="utf-8")
    folder = written_files(emit_file(path, SolveOptions(), target), tmp_path / "out")
    tables = [f"data/{each.name}" for each in sorted((folder / "data").glob("*.csv"))]
    if target == "c":
        assert make(folder, "p", watched=False).returncode == 0
    command = ["./p"] if target == "c" else [sys.executable, "p.py"]
    printed = run(*command, *tables, folder=folder)
    assert printed.returncode == 0, printed.stderr
    rows = {row[0]: row for row in csv.reader(io.StringIO(printed.stdout))}
    assert kelvin(unit, float(rows["x"][1])) == pytest.approx(304.25, abs=1e-8)
    assert float(rows["x"][2]) * ZEROS[unit][0] == pytest.approx(0.1, rel=1e-8)
    assert rows["x"][3] == rows["back[1]"][3] == unit
    cells = list(csv.reader((folder / "data" / "e.csv").read_text(encoding="utf-8").splitlines()))
    assert kelvin(unit, [float(row[0]) for row in cells[1:]]) == pytest.approx(
        [304.15, 304.55, 303.95, 304.35], abs=1e-9
    )


BESIDE = """(problem p (constants (t0 20)) (data d (table (t y) (20 1) (25 1.5) (30 2.1)) :columns ((t :unit {unit})))
  (unknowns (a) (b)) (observe d (= y (+ a (* b {value}))) :sigma 1))"""


@pytest.mark.parametrize("value", ["(- t 20)", "(+ t 273.15)", "(/ 1K (+ 5 t))", "(- t t0)", "(+ (* 2 t) (* 2 t0))"])
def test_plain_numbers_are_not_added_to_temperatures(unit, value):
    with pytest.raises(mbm.MbmError, match=r"has no unit, and would be (20|273\.15|5) K"):
        mbm.loads(BESIDE.replace("{unit}", unit).replace("{value}", value)).solve()


@pytest.mark.parametrize("value", ["(- t 20K)", "(- t 20degC)", "(- (- t 20degC) 5)", "(+ t 0)", "(* 2 t)"])
def test_what_is_added_with_a_unit_or_to_a_difference_stays(unit, value):
    mbm.loads(BESIDE.replace("{unit}", unit).replace("{value}", value)).solve()


def test_plain_numbers_beside_kelvin_are_kelvin():
    """As everywhere beside a column in an SI unit: at t = 20, 25 and 30 K the line through the three means."""
    found = mbm.loads(BESIDE.replace("{unit}", "K").replace("{value}", "(- t t0)")).solve()
    slope, intercept = np.polyfit([0.0, 5.0, 10.0], [1.0, 1.5, 2.1], 1)
    assert (found["b"].value, found["a"].value) == pytest.approx((slope, intercept), rel=1e-9)


EQUATED = """(problem p (data d (table (t) (20) (25) (30)) :columns ((t :unit {unit})))
  (unknowns {x} (z)) (observe d (= t x) :sigma 1K) (observe (= x z) :sigma 1K) {more})"""


@pytest.mark.parametrize(
    ("x", "more"),
    [
        ("(x :init 20 :sigma 2)", ""),
        ("(x :in (0K 20))", ""),
        ("(x :prior (normal 20 2))", ""),
        ("(x)", "(observe (= x 20) :sigma 1K)"),
        ("(x)", "(constraints (< x 20))"),
        ("(x)", "(constraints (< z 20))"),
        ("(x)", "(derive (r (- z 20)))"),
    ],
)
def test_unknowns_equated_with_temperatures_are_some(unit, x, more):
    with pytest.raises(mbm.MbmError, match="20 has no unit, and would be 20 K"):
        mbm.loads(EQUATED.replace("{unit}", unit).replace("{x}", x).replace("{more}", more)).solve()


def test_unknowns_equated_with_temperatures_take_units(unit):
    more = "(derive (r (- x 20degC)) (warmer (+ z 5K) :unit degC))"
    file = EQUATED.replace("{x}", "(x :init 293K :in (-20degC 400K))").replace("{more}", more)
    found = mbm.loads(file.replace("{unit}", unit)).solve()
    assert float(found["x"].si.value) == pytest.approx(kelvin(unit, 25), abs=CLOSE)
    assert found["r"].value == pytest.approx(kelvin(unit, 25) - 293.15, abs=CLOSE)
    assert found["warmer"].value == pytest.approx(kelvin(unit, 25) - 268.15, abs=CLOSE)


def test_differences_of_temperatures_take_plain_numbers(unit):
    """An unknown that is a difference starts at a plain 2, as one in K does."""
    file = """(problem p (data d (table (t) (20) (25) (30)) :columns ((t :unit {unit})))
      (unknowns (x :init 2)) (observe d (= (- t 293.15K) x) :sigma 1K) (observe d (= t (+ 20degC x)) :sigma 1K))"""
    found = mbm.loads(file.replace("{unit}", unit)).solve()
    assert found["x"].value == pytest.approx(kelvin(unit, 25) - 293.15, abs=CLOSE)
