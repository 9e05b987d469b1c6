"""How states are told: documents, tables, CSV files, starts from documents, what is not determined, explanations."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

import mbm
from mbm.cli.main import run

TEXT = """(problem walk
  (data gps (table (t x y a) (0 0.1 1 0.1) (1 1.2 2 0.2) (2 1.9 2 0.2) (4 4.1 4 0.3)))
  (states :over t
    (p (vector 2) :init [0 0] :sigma 10 :unit cm)
    (T (pose 2) :init (pose2 0 0 0) :sigma 1)
    (b :init 0 :sigma 1))
  (dynamics (constant-velocity p :acceleration 0.5 :velocity-sigma 3) (random-walk T :sigma 0.1) (static b))
  (observe gps (= [x y] (+ p b)) :sigma 0.3)
  (observe turned gps (= a (heading T)) :sigma 1)
  (derive (height (p 2)) (speed (norm (rate p))))
  (constraints (<= (p 1) 3.5)))
"""


@pytest.fixture
def walk(tmp_path):
    path = tmp_path / "walk.mbm"
    path.write_text(TEXT)
    return path


def document(path, *options):
    target = path.with_suffix(".json")
    assert run(["solve", str(path), "--json", str(target), *options]) == 0
    return json.loads(target.read_text())["solves"][0]


def test_the_document_has_states_by_step(walk):
    solve = document(walk)
    p, pose, b = (solve["estimates"][name] for name in ("p", "T", "b"))
    for each in (p, pose, b, solve["derived"]["height"]):
        assert each["over"] == "t"
        assert each["keys"] == [0, 1, 2, 4]
        assert "per" not in each
    assert p["unit"] == "cm"
    assert np.shape(p["value"]) == np.shape(p["sigma"]) == (4, 2)
    assert np.shape(pose["sigma"]) == (4, 3)
    assert {"angle", "matrix", "translation"} <= set(pose["value"][0])
    assert len(set(b["value"])) == 1
    assert solve["covariance"]["names"][:3] == ["p@0[1]", "p@0[2]", "p@1[1]"]
    assert "p.rate@4[2]" in solve["covariance"]["names"]
    assert "T@1.trans[2]" in solve["covariance"]["names"]
    assert solve["derived_covariance"]["names"][:5] == ["height@0", "height@1", "height@2", "height@4", "speed@0"]
    (constraint,) = solve["constraints"]
    assert constraint["over"] == "steps of t"
    assert constraint["rows"] == 4
    assert set(solve["residuals"]) == {"gps", "turned"}
    assert np.array(p["value"])[:, 1] / 100 == pytest.approx(solve["derived"]["height"]["value"], rel=1e-12)


def test_a_document_is_a_start(walk):
    first = document(walk)
    again = document(walk, "--init", str(walk.with_suffix(".json")))
    assert np.allclose(first["estimates"]["p"]["value"], again["estimates"]["p"]["value"], rtol=1e-9)


def test_a_start_may_be_for_all_steps_or_for_each(walk):
    given = walk.with_name("start.json")
    for value in ([1.0, 2.0], {"keys": [4, 2, 1, 0], "value": [[4, 4], [2, 2], [1, 1], [0, 0]]}):
        given.write_text(json.dumps({"p": value}))
        assert document(walk, "--init", str(given))["status"] == "converged"
    given.write_text(json.dumps({"p": {"keys": [7], "value": [[4, 4]]}}))
    assert run(["solve", str(walk), "--init", str(given)]) == 2


def test_estimates_as_csv_name_their_step(walk):
    target = walk.with_suffix(".csv")
    assert run(["solve", str(walk), "--estimates", str(target)]) == 0
    with target.open(newline="") as stream:
        rows = {row["scalar"]: row for row in csv.DictReader(stream)}
    assert rows["p@4[2]"]["key"] == "4"
    assert rows["p@4[2]"]["component"] == "[2]"
    assert rows["T@0.rot[1]"]["component"] == "rot[1]"


def test_python_has_arrays_over_the_steps(walk):
    result = mbm.load(walk).solve()
    assert result["p"].value.shape == result["p"].sigma.shape == (4, 2)
    assert list(result["p"].keys) == [0, 1, 2, 4]
    assert result["b"].value.shape == (4,)
    assert list(result["speed"].keys) == [0, 1, 2, 4]


def test_the_table_is_readable(walk, capsys):
    assert run(["solve", str(walk)]) == 0
    shown = capsys.readouterr().out
    assert "p@4[2]" in shown
    text = TEXT.replace(
        "(data gps (table (t x y a) (0 0.1 1 0.1) (1 1.2 2 0.2) (2 1.9 2 0.2) (4 4.1 4 0.3)))", "(data gps external)"
    )
    t = np.arange(300.0)
    long = mbm.loads(text).solve(data={"gps": {"t": t, "x": 0 * t, "y": 0 * t, "a": 0 * t}})
    assert len(str(long).splitlines()) < 200


def test_what_is_not_determined_is_named_by_step():
    text = """(problem walk (data odo (table (t d) (1 1.0) (2 1.1) (3 0.9) (0 0)))
      (states :over t (p :init 0)) (dynamics (= (next p) (+ p d) :sigma 0.1)))"""
    solve = mbm.loads(text).solve().solves[0]
    assert solve.status == "unobservable"
    (direction,) = solve.observability.unobservable
    assert set(direction.coefficients) == {"p@0", "p@1", "p@2", "p@3"}
    assert len(set(np.round(list(direction.coefficients.values()), 9))) == 1


def test_explain_tells_the_steps(walk, capsys):
    assert run(["explain", str(walk)]) == 0
    shown = capsys.readouterr().out
    assert "4 steps from 0 to 4: the values of t in gps" in shown
    assert "p and p.rate: (constant-velocity p :acceleration 0.5 :velocity-sigma 3)" in shown
    assert "estimated by batch" in shown


@pytest.mark.parametrize(
    ("target", "why"), [("c", "by `:method batch`"), ("python", "for `python`"), ("casadi", "for `casadi`")]
)
def test_states_are_not_compiled(walk, tmp_path, target, why, capsys):
    assert run(["compile", str(walk), "--target", target, "-o", str(tmp_path / "out")]) == 2
    assert f"error[not-emitted]: a problem with `states` {why} cannot be compiled" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_command_line_chooses_the_method(walk, capsys):
    for method, filtered in (("ekf", True), ("batch", False)):
        run(["solve", str(walk), "--method", method, "--json", "-"])
        assert (json.loads(capsys.readouterr().out)["solves"][0]["method"] == "ekf") == filtered


@pytest.mark.parametrize(("time", "stated", "unit"), [("s", "", "rad/s"), ("s", ":unit deg", "rad/s"), ("1", "", None)])
def test_the_rate_of_an_angle_is_in_rad_by_the_unit_of_the_steps(time, stated, unit):
    text = f"""(problem p (data d (table (t b) (0 0.1) (1 0.2) (2 0.3)) :columns ((t :unit {time}) (b :unit rad)))
      (states :over d.t (a angle :init 0 :sigma 1 {stated}))
      (dynamics (constant-velocity a :acceleration 0.1 :velocity-sigma 1)) (observe d (= b a) :sigma 0.01))"""
    rate = mbm.loads(text).solve()["a.rate"]
    assert rate.unit == unit
    # 0.1 rad in each step, and the prior is weak
    assert rate.value == pytest.approx(0.1, abs=1e-3)
