"""Generated filters: the numbers of textbooks and of `mbm solve`, in C that allocates nothing and warns of nothing."""

from __future__ import annotations

import csv
import io
import re

import numpy as np
import pytest

import mbm
from mbm import compiler
from mbm.compiler import Inputs
from tests.emit import sequences
from tests.emit.hostile import FORMULA, KEYS, NAME, TEXT, quoted
from tests.emit.making import flags, make, run, written
from tests.estimation.sequences.kalman import filtered

noisy, plain = sequences.noisy, sequences.plain


def files(text, data):
    """The files of the filter of a text."""
    problem = mbm.loads(text)
    found = compiler.elaborated(problem.program, problem.name, Inputs(tables=data), problem.registry)
    return compiler.emitted(found, "c", problem.registry)


def hostile():
    """Names and keys of any characters."""
    rows = " ".join(f"({i} {quoted(KEYS[i % len(KEYS)])} {i * 0.5} {i})" for i in range(14))
    keys = " ".join(f"({quoted(key)} {i + 1})" for i, key in enumerate(KEYS))
    formula = quoted(FORMULA)
    text = f"""
    (problem ../../p{NAME} {quoted(TEXT)} (constants (%n{NAME} 2))
      (data t{NAME} (table (id{NAME} w{NAME}) {keys}) :key id{NAME})
      (data *d{NAME} (table (k{NAME} who{NAME} y{NAME} go{NAME}) {rows}) :with (t{NAME} who{NAME})
        :where (> y{NAME} -3))
      (unknowns (=f{NAME} :per t{NAME} :init 0 :sigma 1 :doc {quoted(TEXT)})
        (ω{NAME} :per *d{NAME}.who{NAME} :init 0 :sigma 1))
      (states :over k{NAME} (s{NAME} :init 0 :sigma 1))
      (dynamics (= (next s{NAME}) (+ s{NAME} (* 0.1 go{NAME})) :sigma %n{NAME}))
      (observe o{NAME} *d{NAME}
        (= y{NAME} (+ s{NAME} t{NAME}.w{NAME} (=f{NAME} who{NAME}) (ω{NAME} who{NAME})
          (if (= who{NAME} {formula}) 1 0))) :sigma 2)
      (constraints (<= (=f{NAME} {formula}) 5))
      (derive (s{NAME}2 (* 2 s{NAME})) (g{NAME} [(=f{NAME} {formula}) (ω{NAME} {formula})])
        (r{NAME} (if (= who{NAME} {formula}) (- y{NAME} s{NAME}) 1) :over *d{NAME}))
      (solve :method truncated-ekf))"""
    return text, {}


COVARIANCES = """
(problem covariances (data z external)
  (states :over k (x (vector 2) :init [0 0] :covariance [[0.1 0.05] [0.05 0.2]]))
  (dynamics (= (next x) (* 0.9 x) :{noise}))
  (observe z (= [y y] x) :{seen})
  (constraints (<= (x 1) (x 2)))
  (solve :method (truncated-ekf :skip 3 :iterated true)))"""
TURNING = """
(problem turning (data z external)
  (states :over k (R (rotation 3) :init (rot-z 10deg) :sigma 10deg))
  (dynamics {moves})
  (observe z (= [y 0.2 0.9] (rotate R [0 0 1])) :sigma 0.05) (solve :method {method}))"""
WALK = """
(problem filter (data frame external) (unknowns (at :init 0 :sigma 1) (innovation :init 0 :sigma 2))
  (states :over chain (filter :init 0 :sigma 1)) (dynamics (random-walk filter :sigma 3))
  (observe frame (= step (+ filter at innovation)) :sigma 5) (solve :method ekf))"""
"""Names that the generated text has for itself."""
OPEN = """
(problem nothing-known (data z external) (unknowns (g)) (states :over k (x))
  (dynamics (random-walk x :sigma 0.3)) (observe z (= y (+ x (* g k))) :sigma 0.1) (solve :method ekf))"""
THROWN = """
(problem thrown (data z external) (states :over k (h :init 0 :sigma 1) (v :init 1 :sigma 1))
  (dynamics (= (next h) (+ h (* v (dt))) :sigma 0) (= (next v) (- v 0.1) :sigma 0))
  (observe z (= y h) :sigma 0.1) (solve :method ekf))"""
UNITS = """
(problem units (data z external :columns ((k ms :unit ms) (y mm :unit mm)))
  (states :over k (x :init 0m :sigma 1m :unit cm)) (dynamics (random-walk x :sigma 3m))
  (observe z (= y x) :sigma 5mm :loss huber) (solve :method iterated-ekf))"""
TABLES = """
(problem tables (data z external) (data s (table (h w) (1 0.1) (2 0.2) (3 0.3)) :where (< h 2.5))
  (unknowns (g positive :init 1 :sigma 0.5) (c :init 2 :fixed true))
  (states :over k (x :init 0 :sigma 1 :in (-1 2)) (v :init 0.1 :sigma 0))
  (dynamics (= (next x) (+ x (* v (last s w))) :sigma (first s w)) (random-walk v :sigma 0.1))
  (observe z (= y (- (* g x (last s h)) c)) :sigma (last s w)) (solve :method truncated-ekf))"""
"""Rows of tables without steps, bounds, what is fixed or certain."""
STILL = """
(problem still (data z external)
  (states :over k (x :init 0 :sigma 1) (a :init 1 :sigma 0.1) (b :init 0.5 :sigma 0.1))
  (dynamics (random-walk x :sigma 0.1) (static a) (static b))
  (observe z (= y (+ (* a x) b)) :sigma 0.1) (constraints (= (+ (^ a 2) (^ b 2)) 1.25)) (solve :method ekf))"""
"""An equation that says the same at each step."""
LATER = (
    STILL.replace("(data z external)", "(data z external) (data c external)").replace("1.25))", "1.25 :over c))"),
    {"z": {"k": [0, 1, 2, 3, 4], "y": [1.4, 0.9, 1.2, 0.7, 1.1]}, "c": {"k": [2, 2, 4]}},
)
"""One that says the same in each row of a table, and holds from the first on."""

LATE = (
    sequences.CART.format(
        method="ekf",
        sigma="0.1",
        rest="(data still (table (h) (0.3))) (observe still (= h b) :sigma 0.1) (constraints (= b 0.2))",
    ),
    {"frames": sequences.FRAMES, "z": {"k": [3.0, 4.0], "y": [0.5, 0.7]}},
)
"""What holds from the first rows on does so at the first step, of which a table without steps has some."""

KINDS = """
(derive (high (+ x (lift at)) :over z) (kinds (if (= kind "near") (* w x) (+ x 1)) :over z)
  (lifts (* (lift name) h) :over anchors) (one (lift "a")) (both [(* x s) (lift "b")]))"""
"""At every step, for rows of a step and of no step, by kinds of rows with kernels of their own."""
PLACES = """
(derive (place (translation at)) (side (atan2 (dot [0 1] (transform at [1 0])) 1) :unit deg)
  (missed (- d (distance (translation at) [px py])) :over ranges))"""
LOST = "(derive (sum (+ x g)) (alone [x (* 2 g)]) (none (log (- x 100))))"
"""Determined where its parts are not, not determined, and without a value."""

SHAPES = {
    "iterated, members, kinds": sequences.stations("iterated-ekf", KINDS),
    "cuts": sequences.cart("truncated-ekf", "s", "(constraints (<= x 0.5) (= b 0.2))"),
    "poses": sequences.drive("ekf"),
    "keys": sequences.runs("truncated-ekf", "(constraints (<= b (+ 0.4 (first setups h))))"),
    "windows": sequences.cart("ekf", "s", "(window k :length 4 :step 1.3)"),
    "hypotheses": sequences.arm(),
    "fixed lag": sequences.drive("(smoother :lag 3)", PLACES),
    "hostile": hostile(),
}
"""What is made in each usual run."""

MORE = {
    "iterated": sequences.cart("iterated-ekf"),
    "keys and windows": sequences.runs("iterated-ekf", "(window k :length 4 :step 1.5 :min-rows 2)"),
    "keys, lag": sequences.runs("(smoother :lag 2)"),
    "windows, lag": sequences.drive("(smoother :lag 3)", "(window k :length 4 :step 2)"),
    "nothing seen at first": LATE,
    "lag 1": sequences.cart("(smoother :lag 1)", "s"),
    "lag 20": sequences.cart("(smoother :lag 20)"),
    "lag, members": sequences.stations("(smoother :lag 2)", KINDS),
    "iterated poses": sequences.drive("iterated-ekf", PLACES),
    "covariances": plain(
        COVARIANCES.format(noise="covariance [[0.02 0.01] [0.01 0.03]]", seen="covariance [[0.1 0.02] [0.02 s]]"),
        y=noisy,
        s=lambda k, g: 0.1 + g.random(len(k)),
    ),
    "information": plain(
        COVARIANCES.format(noise="information [[20 3] [3 10]]", seen="information [[10 2] [2 8]]"), y=noisy
    ),
    "rotation": plain(TURNING.format(moves="(random-walk R :sigma 5deg)", method="iterated-ekf"), y=noisy),
    "rotation with rate": plain(
        TURNING.format(
            moves="(constant-velocity R :acceleration 5deg :velocity 0deg :velocity-sigma 5deg)", method="ekf"
        ),
        y=noisy,
    ),
    "tables": plain(TABLES, y=noisy),
    "names": (WALK, {"frame": {"chain": [1, 2, 3], "step": [1, 2, 3]}}),
    "nothing known": plain(OPEN.replace("(solve", f"{LOST} (solve"), y=noisy),
    "exact": plain(THROWN, y=noisy),
    "an equation of what does not move": plain(STILL, y=noisy),
    "an equation that holds later": LATER,
    "rows that a loss leaves out": (
        UNITS.replace("huber", "tukey").replace("iterated-ekf", "(smoother :lag 1)"),
        {"z": {"ms": [1, 3, 5, 7, 9], "mm": [30.0, 500.0, 20.0, 9000.0, 10.0]}},
    ),
    "losses, lag": (
        sequences.DRIVE.format(rest="", method="(smoother :lag 3)").replace(":sigma 0.1)", ":sigma 0.1 :loss huber)"),
        sequences.drive("ekf")[1],
    ),
    "units and loss": (UNITS, {"z": {"ms": [0.1, 0.3, 0.7], "mm": [3.0, 5.0, 2.0]}}),
}


@pytest.mark.parametrize("shape", [*SHAPES, *(pytest.param(name, marks=pytest.mark.slow) for name in MORE)], ids=str)
def test_a_generated_filter_answers_as_the_solver_does(shape, tmp_path):
    folder = written(files(*{**SHAPES, **MORE}[shape]), tmp_path)
    made = make(folder, "test")
    assert made.returncode == 0, made.stdout[-500:] + made.stderr[-3000:]
    assert re.search(r"^0 of [1-9]\d* numbers differ$", made.stdout, re.MULTILINE)


def test_a_generated_filter_is_the_one_of_textbooks(tmp_path):
    """Kalman's equations with inverses in NumPy, of irregular steps, some of them with several rows or none."""
    text, data = sequences.cart("ekf", "s", "(derive (both [(+ x b) (- (* 2 (rate x)) b)]))")
    z, steps = data["z"], data["frames"]["k"] ** 1.1
    data = {"frames": {"k": steps}, "z": {**z, "k": z["k"] ** 1.1}}
    moves = []
    for dt in np.diff(steps):
        F = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
        g = np.array([0.0, dt**2 / 2, dt])
        moves.append((F, 0.3**2 * np.outer(g, g)))
    rows = []
    for at in steps:
        mine = data["z"]["k"] == at
        rows.append((np.tile([1.0, 1.0, 0.0], (mine.sum(), 1)), z["y"][mine], np.diag(z["s"][mine] ** 2)))
    means, covariances, cost = filtered(np.array([0.1, 0.0, 0.2]), np.diag([0.25, 1.0, 0.25]), moves, rows)
    folder = written(files(text, data), tmp_path)
    made = make(folder)
    assert made.returncode == 0, made.stderr[-3000:]
    shown = run("./cart", "data/frames.csv", "data/z.csv", folder=folder)
    lines = list(csv.DictReader(io.StringIO(shown.stdout)))
    # inverses of covariances lose some digits of the sixteen
    for c, name in enumerate(("b", "x", "x.rate")):
        found = [[float(line[name]), float(line[f"{name} sigma"])] for line in lines]
        np.testing.assert_allclose(found, np.stack([means[:, c], np.sqrt(covariances[:, c, c])], 1), rtol=1e-10)
    np.testing.assert_allclose(sum(float(line["innovation"]) for line in lines), cost, rtol=1e-10)
    for c, combination in enumerate(([1.0, 1.0, 0.0], [-1.0, 0.0, 2.0]), start=1):
        found = [[float(line[f"both {c}"]), float(line[f"both {c} sigma"])] for line in lines]
        sigma = np.sqrt(np.einsum("i,kij,j->k", combination, covariances, combination))
        np.testing.assert_allclose(found, np.stack([means @ combination, sigma], 1), rtol=1e-10)


DERIVED = {
    "kinds": (*sequences.stations("iterated-ekf", KINDS), "stations", ("frames", "z")),
    "places": (*sequences.drive("(smoother :lag 3)", PLACES), "drive", ("wheels", "ranges")),
}


@pytest.mark.parametrize("shape", DERIVED)
def test_derived_quantities_are_those_of_the_solver(shape, tmp_path):
    """Rows of a step, and what has a value at every step, to 1e-10; what belongs to no step is that of the last one."""
    text, data, name, tables = DERIVED[shape]
    folder = written(files(text, data), tmp_path)
    assert make(folder).returncode == 0
    shown = run(f"./{name}", *(f"data/{table}.csv" for table in tables), folder=folder)
    lines = list(csv.DictReader(io.StringIO(shown.stdout)))
    solved = mbm.loads(text).solve(data=data)
    for derived in solved.derived:
        own = [key.removesuffix(" sigma") for key in lines[0] if re.fullmatch(rf"{derived.name}( \d+)* sigma", key)]
        kept = lines[-1:] if derived.name in ("lifts", "one") else lines
        found = [[line[key], line[f"{key} sigma"]] for line in kept for key in own if line[key]]
        expected = np.stack([np.ravel(derived.value), np.ravel(derived.sigma)], 1)
        np.testing.assert_allclose(np.array(found, dtype=float), expected, rtol=1e-10, atol=1e-12)


CALLS = """
#include <math.h>
#include <stdio.h>
#include "drive.h"

static drive_filter filter, before;

static int give(double at, double wheels, long ranges, double d)
{
    const double px = 5.0, turn = 0.1;
    const double ds[9] = {d, d, d, d, d, d, d, d, d}, zeros[9] = {0.0};
    drive_rows rows = {0};
    drive_result result;
    (void)px;
    rows.at = at;
    rows.wheels_rows = wheels > 0.0;
    rows.wheels_forward = &wheels;
    rows.wheels_turn = &turn;
    rows.ranges_rows = ranges;
    rows.ranges_px = ds;
    rows.ranges_py = zeros;
    rows.ranges_d = ds;
    return drive_step(&filter, &rows, &result);
}

int main(void)
{
    drive_begin(&filter);
    printf("%d", give(0.0, 1.0, 1, 5.0));
    before = filter;
    printf(" %d", give(0.0, 1.0, 1, 5.0));
    printf(" %d", give(NAN, 1.0, 1, 5.0));
    printf(" %d", give(1.0, 1.0, DRIVE_MOST_RANGES + 1, 5.0));
    printf(" %d", give(1.0, 1.0, -1, 5.0));
    printf(" %d", give(1.0, 1.0, 1, INFINITY));
    printf(" %d", give(1.0, 0.0, 1, 5.0));
    printf(" %d", give(1.0, 1.0, 0, 5.0));
    printf(" %d", give(2.0, 1.0, 2, 5.0));
    printf(" %s\\n", drive_status_text(DRIVE_TOO_MANY_ROWS));
    return before.reals[0] == before.reals[0] ? 0 : 1;
}
"""


def test_what_is_wrong_with_rows_is_answered_and_the_step_can_be_given_again(tmp_path):
    folder = written(files(*sequences.drive("ekf")), tmp_path)
    (folder / "calls.c").write_text(CALLS, encoding="utf-8")
    sources = "calls.c", "drive.c"
    built = run("cc", "-std=c99", "-Wall", "-Werror", *flags().split(), "-o", "calls", *sources, "-lm", folder=folder)
    assert built.returncode == 0, built.stderr[-2000:]
    shown = run("./calls", folder=folder)
    header = (folder / "drive.h").read_text(encoding="utf-8")
    words = {int(number): word for word, number in re.findall(r"DRIVE_(\w+) = (\d+)[,\n]", header.partition("};")[0])}
    codes = [words[int(each)] for each in re.findall(r"\b\d+\b", shown.stdout)]
    assert codes == [
        "ESTIMATED", "OUT_OF_ORDER", "OUT_OF_ORDER", "TOO_MANY_ROWS", "TOO_MANY_ROWS", "NOT_A_NUMBER", "NO_TRANSITION",
        "ESTIMATED", "ESTIMATED",
    ]  # fmt: skip
    assert "more rows than there is room for" in shown.stdout


def test_a_filter_allocates_nothing_and_c_plus_plus_may_include_its_header(tmp_path):
    made = files(*sequences.cart("(smoother :lag 2)"))
    folder = written(made, tmp_path)
    for name in ("cart.h", "cart.c", "cart_kernels.h", "cart_solver.h"):
        text = (folder / name).read_text(encoding="utf-8")
        assert not re.search(r"\b(\w*alloc|free|printf|puts)\(|stdio|stdlib", text), name
    (folder / "with.cpp").write_text('#include "cart.h"\nint main() { return cart_status_text(0) == 0; }\n')
    checked = run("c++", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "with.cpp", folder=folder)
    assert checked.returncode == 0, checked.stderr


def test_a_test_with_a_broken_table_says_so_and_frees_what_it_read(tmp_path):
    folder = written(files(*sequences.cart("ekf", "s", "")), tmp_path)
    assert make(folder).returncode == 0
    (folder / "data" / "z.csv").write_text("k,y,s\n1\n")
    found = run("./cart_test", folder=folder)
    assert (found.returncode, "another number of fields" in found.stderr) == (2, True), found.stderr
    assert "LeakSanitizer" not in found.stderr


def test_keys_and_windows_are_sequences_of_their_own(tmp_path):
    """The program tells each step of each window of each key, as the solver does, to 1e-10."""
    text, data = sequences.runs("ekf", "(window k :length 4 :step 1.5 :min-rows 2)")
    folder = written(files(text, data), tmp_path)
    assert make(folder).returncode == 0
    shown = run("./runs", *(f"data/{table}.csv" for table in ("z", "setups", "frames")), folder=folder)
    lines = list(csv.DictReader(io.StringIO(shown.stdout)))
    told = [
        (each["run"], float(each["k end"]), *(float(each[name]) for name in ("k", "x", "x sigma"))) for each in lines
    ]
    expected = []
    for solve in mbm.loads(text).solve(data=data).solves:
        if solve.status.value != "skipped":
            steps = zip(solve["x"].keys, solve["x"].value, solve["x"].sigma, strict=True)
            expected += [(solve.key["run"], solve.key["k"], *each) for each in steps]
    assert [each[0] for each in told] == [each[0] for each in expected]
    np.testing.assert_allclose([each[1:] for each in told], [each[1:] for each in expected], rtol=1e-10)


REFUSED = {
    "batch": ("(solve :method batch)", "rows of all steps at once"),
    "smoother": ("(solve :method (smoother))", "`:method \\(smoother\\)`"),
    "derive a step": ("(derive (d (- x (first z x)))) (solve :method ekf)", "`d` names the step of a state"),
    "derive a row": ("(derive (d (- x (first z y)))) (solve :method ekf)", "`d` looks at rows of other steps"),
    "derive a motion": ("(derive (d (rot-x x))) (solve :method ekf)", "no rotations"),
    "a start of rows": ("(unknowns (v :init (first z y) :sigma 1)) (solve :method ekf)", "begins by rows"),
    "a start of each": ("(unknowns (v :init (first z y) :sigma 1)) (for-each run) (solve :method ekf)", "`v`"),
    "members of each": ("(unknowns (g :per z.run :init 0)) (for-each run) (solve :method ekf)", "the family `g`"),
    "for-each of kept rows": (
        "(data d (table (k run) (0 1)) :where (> k 0)) (for-each run) (solve :method ekf)",
        "`for-each` with",
    ),
    "windows of used rows": (
        "(observe z (= y x) :sigma 2 :when (> y 1)) (window k :length 2 :step 1) (solve :method ekf)",
        "`window` with",
    ),
    "loss": ("(observe z (= y x) :sigma 1 :loss huber) (solve :method ekf)", "a loss needs iteration"),
    "first": ("(observe z (= y (* x (first z y))) :sigma 1) (solve :method ekf)", "rows of other steps"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_filter_has_is_refused(case):
    rest, message = REFUSED[case]
    text = f"""
    (problem p (data z (table (k y run) (0 1 1) (1 2 1) (2 1 1))) (states :over k (x :init 0 :sigma 1))
      (dynamics (random-walk x :sigma 1)) (observe z (= y x) :sigma 1) {rest})"""
    with pytest.raises(mbm.MbmError, match=message):
        files(text, {})


@pytest.mark.parametrize("target", ["python", "casadi"])
def test_filters_are_written_in_c_alone(target):
    problem = mbm.loads(sequences.cart("ekf")[0])
    data = sequences.cart("ekf")[1]
    found = compiler.elaborated(problem.program, problem.name, Inputs(tables=data), problem.registry)
    with pytest.raises(mbm.MbmError, match="in C alone"):
        compiler.emitted(found, target, problem.registry)
