"""Generated solvers with unknown noise that is nothing, or that nothing tells: what depends on it has no sigma."""

from __future__ import annotations

import csv
import importlib.util
import shutil
import sys

import numpy as np
import pytest
from scipy.optimize import minimize

import mbm
from tests.emit.making import make, of_text, run, written

NEEDS_COMPILER = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

LABORATORIES = """(data d (table (run lab x u) {rows}))
  (unknowns (m :init 10) (e :per d.lab :init 0))
  (observe d (= x (+ m (e lab))) :sigma u) (observe dark d (= 0 (e lab)) :sigma (unknown 0.1){more})
  (derive (own (+ m (e 1))) (apart (- (e 1) (e 2))) (twice (* 2 m)))"""
ALIKE = "(1 1 10.01 0.1) (1 2 10.12 0.1) (1 3 9.99 0.1) (1 4 10.0 0.1)"
DIFFERENT = "(2 1 10.01 0.1) (2 2 10.92 0.1) (2 3 9.39 0.1) (2 4 10.0 0.1)"
EQUAL = "(1 1 10 0.1) (1 2 10 0.1) (1 3 10 0.1) (1 4 10 0.1)"
LARGE = "(2 1 1.001e10 1e8) (2 2 1.092e10 1e8) (2 3 9.39e9 1e8) (2 4 1e10 1e8)"
LINE = "(data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1) (5 10.7)))"
TEXTS = {
    "nothing": LABORATORIES.format(rows=ALIKE, more=""),
    "some": LABORATORIES.format(rows=DIFFERENT, more=""),
    "equal": LABORATORIES.format(rows=EQUAL, more=""),
    "large": LABORATORIES.format(rows=LARGE, more=""),
    "each": LABORATORIES.format(rows=f"{ALIKE} {DIFFERENT}", more="") + " (for-each run)",
    "lossy": LABORATORIES.format(rows=ALIKE, more=")(observe m (= 10.2 m) :sigma 0.2 :loss (huber 0.5)"),
    "held": LABORATORIES.format(rows=ALIKE, more="") + " (constraints (= m 10.03))",
    "bounded": LABORATORIES.replace(":per d.lab", ":per d.lab :in (-1 0.00001)").format(rows=ALIKE, more=""),
    "days": """(data d (table (day y) (1 8.9) (1 10) (1 11) (2 9) (2 10) (2 11.1) (3 9.1) (3 10) (3 11)))
      (unknowns (m :init 10) (e :per d.day :init 0)) (observe d (= y (+ m (e day))) :sigma unknown)
      (observe days d.day (= 0 (e day)) :sigma unknown) (derive (twice (* 2 m)) (apart (- (e 1) (e 2))))""",
    "unchecked": f"""{LINE} (data q (table (z) (3.1)))
      (unknowns (a :init 1) (b :init 0) (c :init 2)) (observe d (= y (+ (* a x) b)) :sigma 0.2)
      (observe q (= z (+ c b)) :sigma (unknown 0.3)) (derive (top (+ (* 6 a) b)) (sum (+ c b)) (more (+ c a)))""",
    "both": f"""{LINE} (data q (table (z) (3.1))) (data w (table (k v) (1 0.1) (2 -0.1) (3 0.05)))
      (unknowns (a :init 1) (b :init 0) (c :init 2) (o :per w.k :init 0))
      (observe d (= y (+ (* a x) b)) :sigma 0.2) (observe q (= z (+ c b)) :sigma (unknown 0.3))
      (observe w (= v (o k)) :sigma 1) (observe dark w (= 0 (o k)) :sigma (unknown 2))
      (derive (sum (+ c (o 1))) (other (+ a (o 2))))""",
    "exact": f"""{LINE} (data q (table (z) (3) (3) (3))) (unknowns (a :init 1) (b :init 0) (c :init 2))
      (observe d (= y (+ (* a x) b)) :sigma 0.2) (observe q (= z (+ c b)) :sigma (unknown 0.3))
      (derive (top (+ (* 6 a) b)) (sum (+ c b)) (more (+ c a)))""",
    "loop": """(data d (table (p q r y) (-1 1 0 1.2) (0 -1 1 0.7) (-1 0 1 1.9)))
      (unknowns (a :init 10) (b :init 10) (c :init 10)) (observe mark (= 10 a) :sigma 0.01)
      (observe d (= y (+ (* p a) (* q b) (* r c))) :sigma unknown) (derive (rise (- c a)))""",
    "whole": """(data d (table (x y) (1 1.2) (2 1.9) (3 2.6) (4 3.3))) (unknowns (a :init 1) (b :init 0))
      (observe d (= y (+ a (* b x))) :sigma unknown) (derive (top (+ a (* 5 b))))""",
    "faint": """(data d (table (x y) (-0.736 -0.39908) (-0.624 -0.12584) (0.0395 1.32518) (0.9383 2.83952)
      (1.9295 4.83942) (2.1982 5.30638))) (data e (table (u) (2.98158))) (unknowns (a :init 0) (b :init 0))
      (observe d (= y (+ a (* b x))) :sigma unknown) (observe e (= u (+ a b)) :sigma unknown)""",
    "sharp": f"""{LINE} (data q (table (z) (1.1) (1.1) (1.1))) (unknowns (a :init 1) (b :init 0))
      (observe d (= y (+ (* a x) b)) :sigma 0.2) (observe q (= z b) :sigma (unknown 0.3)) (derive (top (* 6 b)))""",
}
MISSING = {
    "nothing": {"e", "apart"},
    "some": set(),
    "equal": {"e", "apart"},
    "large": set(),
    "lossy": {"e", "apart"},
    "held": {"e", "apart", "own"},
    "bounded": {"e", "apart"},
    "days": {"e", "apart"},
    "unchecked": {"c", "sum", "more"},
    "both": {"c", "o", "sum"},
    "exact": {"c", "sum", "more"},
    "loop": {"b", "c", "rise"},
    "sharp": {"b", "top"},
    "whole": set(),
    "faint": set(),
}
"""What is due to noise that nothing tells, read off the equations: the mean of alike laboratories is not, nor is what
the noise that is nothing is only a part of, beside a slope or a mean that is not held.
"""

CLOSE = 1e-9
"""What generated solvers promise."""


def _text(name: str) -> str:
    return f"(problem {name} {TEXTS[name]})"


def _same(found, wanted, name) -> bool:
    """Equal, NaN where there is none; where there are bounds 0 for what they hold (the document has none for it)."""
    found, wanted = np.ravel(found), np.ravel(wanted)
    agreed = np.isclose(found, wanted, rtol=CLOSE, atol=0.0, equal_nan=True)
    return bool((agreed | ((found == 0.0) & np.isnan(wanted) & (name == "bounded"))).all())


@pytest.mark.parametrize("name", MISSING)
def test_what_depends_on_noise_that_nothing_tells_has_no_sigma(name):
    found = mbm.loads(_text(name)).solve().solves[0]
    assert {each for each in found if np.isnan(found[each].sigma).any()} == MISSING[name]


@pytest.mark.parametrize("name", TEXTS)
def test_python(name, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    folder = written(of_text(_text(name), "python"), tmp_path)
    spec = importlib.util.spec_from_file_location(f"noises_{name}", folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    tables = module.read_tables([str(folder / "data" / f"{table}.csv") for table in module.COLUMNS])
    wanted = mbm.loads(_text(name)).solve()
    for (_, found), solve in zip(module.solve_each(tables), wanted.solves, strict=True):
        for each, values in {**found["estimates"], **found["derived"]}.items():
            assert _same(values["sigma"], solve[each].sigma, name), each
        own, matrix = found["covariance"], np.asarray(solve.record.covariance.matrix)
        assert (np.isnan(own) == (np.isnan(matrix) & (own != 0.0))).all()
    assert run(sys.executable, f"test_{name}.py", folder=folder).returncode == 0


@NEEDS_COMPILER
@pytest.mark.parametrize(
    "name", [n if n in ("each", "both") else pytest.param(n, marks=pytest.mark.slow) for n in TEXTS]
)
def test_c(name, tmp_path):
    folder = written(of_text(_text(name), "c"), tmp_path)
    made = make(folder, "all", "test", watched=False)
    assert made.returncode == 0, made.stdout + made.stderr
    tables = [f"data/{each}.csv" for each in ("d", "q", "w") if (folder / "data" / f"{each}.csv").exists()]
    rows = list(csv.DictReader(run(f"./{name}", *tables, folder=folder).stdout.splitlines()))
    solves = mbm.loads(_text(name)).solve().solves
    counts: dict[str, int] = {}
    for row in rows:
        name_of = row["name"].split("[")[0]
        number = counts.get(name_of, 0)
        counts[name_of] = number + 1
        wanted = np.concatenate([np.ravel(solve[name_of].sigma) for solve in solves])
        assert _same(float(row["sigma"]) if row["sigma"] else np.nan, wanted[number], name), row


def test_one_row_whose_noise_is_faint_beside_others(tmp_path, monkeypatch):
    """Its noise, a fifteenth of the others', is where the restricted likelihood is largest; NumPy finds that."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    folder = written(of_text(_text("faint"), "python"), tmp_path)
    spec = importlib.util.spec_from_file_location("faint", folder / "faint.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    tables = module.read_tables([str(folder / "data" / f"{table}.csv") for table in ("d", "e")])
    found = module.solve(tables)
    slopes = np.vstack([np.column_stack([np.ones(6), tables["d"]["x"]]), [1.0, 1.0]])
    values = np.append(tables["d"]["y"], tables["e"]["u"])

    def weighted(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        weights = np.exp(-2.0 * np.repeat(logs, [6, 1]))
        normal = slopes.T @ (weights[:, None] * slopes)
        estimates = np.linalg.solve(normal, slopes.T @ (weights * values))
        residuals = values - slopes @ estimates
        likelihood = np.linalg.slogdet(normal)[1] - np.log(weights).sum() + weights @ np.square(residuals)
        return estimates, np.sqrt(np.diag(np.linalg.inv(normal))), float(likelihood)

    best = minimize(lambda logs: weighted(logs)[2], np.log([0.1, 0.01]), method="Nelder-Mead", tol=1e-12)
    estimates, sigmas, _ = weighted(best.x)
    assert 0.002 < np.exp(best.x[1]) < 0.02
    assert found["status"] == "converged"
    for name, value, sigma in zip("ab", estimates, sigmas, strict=True):
        assert abs(found["estimates"][name]["value"].item() - value) < 1e-5 * sigma
        assert abs(found["estimates"][name]["sigma"].item() / sigma - 1.0) < 1e-5  # the simplex ends 1e-6 off


@pytest.mark.parametrize(
    ("language", "command", "file", "loop"),
    [
        ("python", (sys.executable, "faint.py"), "faint.py", "number < {}:"),
        pytest.param("c", ("./faint",), "faint_solver.h", "number < {}L)", marks=NEEDS_COMPILER),
    ],
)
def test_noise_that_does_not_settle_is_said(language, command, file, loop, tmp_path):
    """Three rounds of a sequence that takes more; `mbm solve` says the same of as many (`tests/noise`)."""
    folder = written(of_text(_text("faint"), language), tmp_path)

    def said() -> str:
        if language == "c":
            made = make(folder, "all", watched=False)
            assert made.returncode == 0, made.stdout + made.stderr
        return run(*command, "data/d.csv", "data/e.csv", folder=folder).stderr

    assert "still changed" not in said()
    text = (folder / file).read_text(encoding="utf-8")
    assert text.count(loop.format(200)) == 1
    (folder / file).write_text(text.replace(loop.format(200), loop.format(3)), encoding="utf-8")
    assert "unknown noise still changed" in said()
