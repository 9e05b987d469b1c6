"""Generated solvers where the data leave something free: the rest has the standard deviations of the general path."""

from __future__ import annotations

import csv
import importlib.util
import shutil
import sys

import numpy as np
import pytest

import mbm
from tests.emit.making import make, of_text, run, written

POINTS = "(data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1) (5 12)))"
OTHERS = "(data e (table (u) (2.1) (1.9) (2.3)))"
APART = "(data d (table (x r) (0 1) (4 1.1))) (unknowns (p :init 1.5) (q :init 0.5))"
"""Circles that do not meet: what lies nearest to both is on the line of their centres, where no radius feels q."""
LINE = "(observe d (= y (+ (* a x) b c)) :sigma 0.2)"
THREE = "(unknowns (a :init 1) (b :init 0) (c :init 2))"
FOUR = "(unknowns (a :init 1) (b :init 0) (c :init 2) (q :init 1))"

TEXTS = {
    "sums": f"{POINTS} {FOUR} {LINE}",
    "unfelt": f"{POINTS} {THREE} (observe d (= y (+ (* a x) b (* 0 c))) :sigma 0.2)",
    "products": f"{POINTS} {THREE} (observe d (= y (+ (* a b x) c)) :sigma 0.2)",
    "noise": f"{POINTS} {THREE} (observe d (= y (+ (* a x) b c)) :sigma unknown)",
    "noises": f"{POINTS} {OTHERS} {THREE} (observe d (= y (+ (* a x) b c)) :sigma unknown) "
    "(observe e (= u a) :sigma unknown)",
    "loss": f"{POINTS} {THREE} (observe d (= y (+ (* a x) b c)) :sigma 0.2 :loss (huber 1))",
    "losses": f"{POINTS} {OTHERS} {THREE} (observe d (= y (+ (* a x) b c)) :sigma 0.2 :loss (huber 1)) "
    "(observe e (= u a) :sigma 0.3 :loss soft-l1)",
    "bound": f"{POINTS} (unknowns (a :init 1 :in (0 2)) (b :init 0) (c :init 2)) {LINE}",
    "equation": f"{POINTS} {FOUR} {LINE} (constraints (= (+ a q) 3))",
    "inequality": f"{POINTS} {THREE} {LINE} (constraints (<= a 2))",
    "few": "(data d (table (x y) (1 2))) (unknowns (a :init 1) (b :init 0)) (observe d (= y (+ (* a x) b)) :sigma 0.2)",
    "beside": "(data d (table (x y z) (1 2 5))) (unknowns (a :init 1) (b :init 0) (c :init 1)) "
    "(observe d (= y (+ (* a x) b)) :sigma 0.2) (observe d (= z c) :sigma 0.5)",
    "apart": f"{APART} (observe d (= r (distance [p q] [x 0])) :sigma 0.1) (derive (s (* 2 q)) (t p))",
    "apart_noise": f"{APART} (observe d (= r (distance [p q] [x 0])) :sigma unknown)",
    "apart_noises": f"{APART} {OTHERS} (observe d (= r (distance [p q] [x 0])) :sigma unknown) "
    "(observe e (= u p) :sigma unknown)",
    "apart_loss": f"{APART} (observe d (= r (distance [p q] [x 0])) :sigma 0.1 :loss (huber 1))",
    "turned_back": "(data d (table (x) (1) (0.999) (1.001))) (unknowns (a :init 0.1)) "
    "(observe d (= x (cos a)) :sigma 0.01)",
    "derived": f"{POINTS} {THREE} {LINE} (derive (s (* 2 a)) (t (+ b c)) (u b))",
}
QUICK = ("noises", "losses", "apart", "derived")
"""Whose solvers are tried in every test run: two groups of noise, two of losses, what vanishes, what is derived."""
CHOSEN = [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in TEXTS]

CLOSE = 1e-9
"""What generated solvers promise; the singular values of both paths lie far apart here."""


def solved(name):
    """What the general path makes of the problem."""
    return mbm.loads(f"(problem {name} {TEXTS[name]})").solve(backend="casadi")


def same(found, wanted) -> bool:
    """Equal standard deviations, NaN where there is none."""
    return bool(np.isclose(np.ravel(found), np.ravel(wanted), rtol=CLOSE, atol=0.0, equal_nan=True).all())


@pytest.mark.parametrize("name", CHOSEN)
def test_python(name, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    folder = written(of_text(f"(problem {name} {TEXTS[name]})", "python"), tmp_path)
    spec = importlib.util.spec_from_file_location(f"undetermined_{name}", folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = module.solve(module.read_tables([str(folder / "data" / f"{table}.csv") for table in module.COLUMNS]))
    wanted = solved(name)
    assert found["status"] == "unobservable"
    assert wanted.solves[0].status == "unobservable"
    assert found["freedom"] == wanted.solves[0].dof >= 0
    for unknown, each in found["estimates"].items():
        assert same(each["sigma"], wanted[unknown].sigma), unknown
    for quantity, each in found["derived"].items():
        assert same(each["sigma"], wanted[quantity].sigma), quantity
    assert run(sys.executable, f"test_{name}.py", folder=folder).returncode == 0


EDGES = """(problem edges (data d (table (x y) (0 0) (0 0))) (unknowns (p :init 0) (q :init 0))
  (observe d (= x p) :sigma 0.1) (observe d (= y q) :sigma 0.1)
  (derive (r (norm [p q])) (h (hypot p q)) (w (atan2 q p)) (s (sqrt p)) (a (* 3 p))))"""
"""Where distances, directions and roots of what is zero have no derivative; ``a`` has one."""


def sigmas_at_edges():
    """What the general path says, with the reason where it says nothing."""
    return {each.name: (float(each.sigma), each.reason) for each in mbm.loads(EDGES).solve().first.derived}


def test_the_general_path_has_no_deviation_without_derivative():
    found = sigmas_at_edges()
    for name in "rhws":
        assert np.isnan(found[name][0])
        assert found[name][1] == "its derivative is not finite at the estimates"
    assert found["a"] == (pytest.approx(3 * 0.1 / 2**0.5, rel=1e-12), None)


@pytest.mark.parametrize("target", ["python", "c"])
def test_generated_solvers_have_no_deviation_without_derivative(target, tmp_path):
    folder = written(of_text(EDGES, target), tmp_path)
    if target == "c":
        if shutil.which("cc") is None:
            pytest.skip("no C compiler (cc) is here")
        made = make(folder, "all", watched=False)
        assert made.returncode == 0, made.stdout + made.stderr
    command = ("./edges",) if target == "c" else (sys.executable, "edges.py")
    found = run(*command, "data/d.csv", folder=folder)
    assert found.returncode == 0
    rows = {row["name"]: row["sigma"] for row in csv.DictReader(found.stdout.splitlines())}
    assert [rows[name] for name in "rhws"] == [""] * 4
    assert float(rows["a"]) == pytest.approx(3 * 0.1 / 2**0.5, rel=CLOSE)


def test_a_turn_about_the_line_of_all_points(tmp_path, monkeypatch):
    """What is left of its derivative is rounding; the quaternions of both paths may differ by such a turn."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    text = """(problem turned (data d (table (y u v w) (0 0.1 0.2 0.3) (1 1.11 0.19 0.31) (2 2.09 0.2 0.28)))
      (unknowns (T (pose 3) :init (pose3 (euler 0.1 0.1 1.5) [0 0 0])))
      (observe d (= [u v w] (transform T [0 y 0])) :sigma 0.01))"""
    folder = written(of_text(text, "python"), tmp_path)
    spec = importlib.util.spec_from_file_location("turned", folder / "turned.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = module.solve(module.read_tables([str(folder / "data" / "d.csv")]))
    assert (found["status"], found["freedom"]) == ("unobservable", 9 - 5)
    assert np.isnan(np.diag(found["covariance"])[1]) and np.isfinite(np.diag(found["covariance"])[2:]).all()


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")
@pytest.mark.parametrize("name", CHOSEN)
def test_c(name, tmp_path):
    folder = written(of_text(f"(problem {name} {TEXTS[name]})", "c"), tmp_path)
    made = make(folder, "all", "test", watched=False)
    assert made.returncode == 0, made.stdout + made.stderr
    tables = [f"data/{table}.csv" for table in ("d", "e") if (folder / "data" / f"{table}.csv").exists()]
    found = run(f"./{name}", *tables, folder=folder)
    assert found.returncode == 1
    wanted = solved(name)
    assert f"{wanted.solves[0].dof} degrees of freedom" in found.stderr
    rows = list(csv.DictReader(found.stdout.splitlines()))
    assert rows
    for row in rows:
        sigma = float(row["sigma"]) if row["sigma"] else np.nan
        assert same(sigma, wanted[row["name"]].sigma), row["name"]


def test_the_general_path_counts_no_degree_of_freedom_below_zero():
    """By hand: one row, which determines one combination of two unknowns."""
    assert solved("few").solves[0].dof == 0


@pytest.mark.parametrize("order", ["a b c", "b c a", "c a b"])
@pytest.mark.parametrize("box", ["", ":in (-50 50)"])
def test_what_the_data_determine_is_at_the_minimum(order, box, tmp_path, monkeypatch):
    """A column that depends on those before it is left out; what its row says of the columns behind it is not."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    unknowns = " ".join(f"({name} :init 1 {box})" for name in order.split())
    text = f"(problem sums {POINTS} (unknowns {unknowns}) (observe d (= y (+ c (* (+ a b) x))) :sigma 0.2))"
    folder = written(of_text(text, "python"), tmp_path)
    spec = importlib.util.spec_from_file_location("sums", folder / "sums.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = module.solve(module.read_tables([str(folder / "data" / "d.csv")]))
    x, y = np.arange(6.0), np.array([1.1, 2.9, 5.2, 6.8, 9.1, 12.0])
    slope, height = np.polyfit(x, y, 1)
    point = dict(zip(order.split(), found["point"], strict=True))
    assert found["status"] == "unobservable"
    assert found["cost"] == pytest.approx(np.sum(((y - slope * x - height) / 0.2) ** 2), rel=1e-9)
    assert (point["a"] + point["b"], point["c"]) == pytest.approx((slope, height), rel=1e-9)


@pytest.mark.parametrize("target", ["c", "python"])
def test_folders_pass_their_own_test_where_sigmas_are_missing_or_none(target, tmp_path):
    """No redundancy, no noise to tell; a derived quantity that cannot vary has a sigma of rounding alone."""
    text = """(problem untold (data d (table (x y) (0 1.0) (1 2.0))) (unknowns (a) (b))
      (observe d (= y (+ a (* b x)))) (derive (one (norm (normalize [(+ a 1) b])))))"""
    stated = text.replace("(* b x)))", "(* b x))) :sigma 0.1").replace("untold", "told")
    for number, problem in enumerate((text, stated)):
        folder = written(of_text(problem, target), tmp_path / str(number))
        command = ("make", "test", "CFLAGS=-O0") if target == "c" else (sys.executable, next(folder.glob("test_*.py")))
        if target == "c" and shutil.which("make") is None:
            pytest.skip("no make")
        found = run(*map(str, command), folder=folder)
        assert found.returncode == 0, found.stdout + found.stderr


@pytest.mark.parametrize("target", ["c", "python"])
def test_what_only_the_sum_of_squares_leaves_free_is_refused(target):
    """Places about their only anchor may be turned, and residuals turn with them: the Jacobian does not show it."""
    text = """(problem turn (data d (table (k r) (0 4.1) (1 3.4) (2 2.9) (3 2.6)))
      (data f (table (a b c) (0 1 2) (1 2 3))) (data g (table (a b) (0 1) (1 2) (2 3)))
      (unknowns (p (vector 2) :per d.k :init [(+ -4 k) 2]))
      (observe d (= r (norm (p k))) :sigma 0.1) (observe g (= 1.1 (norm (- (p b) (p a)))) :sigma 0.1)
      (observe f (= [0 0] (+ (p a) (- (p c) (* 2 (p b))))) :sigma 0.2) {more})"""
    with pytest.raises(mbm.MbmError, match="may move together at no cost") as caught:
        of_text(text.format(more=""), target)
    assert [d.code.name for d in caught.value.diagnostics] == ["not-emitted"]
    assert of_text(text.format(more="(observe g (= a b) :sigma 1)").replace("(= a b)", "(= 2 ((p 0) 2))"), target)


AT_BOUND = """(problem at_bound (data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8)))
  (unknowns (a :init 1 :in (0 1.5)) (b :init 0) (c :init 3 :fixed true))
  (observe d (= y (+ (* a x) b)) :sigma 0.2)
  (derive (twice (* 2 a)) (both (+ a b)) (still (* 2 c))))"""
"""The slope of the line is 1.94 without the bound; with it, b is the mean of y - 1.5 x."""


@pytest.mark.parametrize("target", ["python", "c"])
def test_what_a_bound_holds_has_no_standard_deviation(target, tmp_path):
    folder = written(of_text(AT_BOUND, target), tmp_path)
    if target == "c":
        if shutil.which("cc") is None:
            pytest.skip("no C compiler (cc) is here")
        assert make(folder, "all", "test", watched=False).returncode == 0
    else:
        assert run(sys.executable, "test_at_bound.py", folder=folder).returncode == 0
    found = run(*(("./at_bound",) if target == "c" else (sys.executable, "at_bound.py")), "data/d.csv", folder=folder)
    rows = {row["name"]: row for row in csv.DictReader(found.stdout.splitlines())}
    assert [float(rows[name]["value"]) for name in ("a", "twice", "b")] == pytest.approx([1.5, 3.0, 1.75], rel=CLOSE)
    assert (rows["a"]["sigma"], rows["twice"]["sigma"], rows["still"]["sigma"]) == ("", "", "0")
    assert [float(rows[name]["sigma"]) for name in ("b", "both")] == pytest.approx([0.1, 0.1], rel=CLOSE)
