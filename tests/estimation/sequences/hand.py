"""The two-finger hand of ``reference/hand`` as two local problems: all 36 numbers are states, sizes are static ones."""

from __future__ import annotations

import json

import numpy as np

ANGLES = [f"th{i}{j}" for i in (1, 2) for j in range(4)]
MOVING = ["wx", "wy", "q0", "q1", "q2", "q3", *ANGLES]
LINES = [(f"{i}{j}", f"(p {i} {j - 1})", f"(p {i} {j})") for i in (1, 2) for j in (1, 2, 3)]
LINES += [("palmL", "(corner 0 -1)", "(corner 1 -1)"), ("palmR", "(corner 0 1)", "(corner 1 1)")]
LINES += [("palmTop", "(corner 1 -1)", "(corner 1 1)")]

MODEL = """
(defun turned (v)
  [(+ (* (+ (^ q0 2) (^ q1 2) (- (^ q2 2)) (- (^ q3 2))) (v 1)) (* 2 (- (* q1 q2) (* q0 q3)) (v 2))
      (* 2 (+ (* q1 q3) (* q0 q2)) (v 3)))
   (+ (* 2 (+ (* q1 q2) (* q0 q3)) (v 1)) (* (+ (^ q0 2) (- (^ q1 2)) (^ q2 2) (- (^ q3 2))) (v 2))
      (* 2 (- (* q2 q3) (* q0 q1)) (v 3)))])
(defun seen (v) (+ (turned v) [wx wy]))
(defun base (finger) (if (= finger 1) [rh 0 (/ rw -2)] [rh 0 (/ rw 2)]))
(defun along (finger j)
  (reduce + (map (lambda (k) (cond ((= finger 1) (cond ((= k 1) th11) ((= k 2) th12) (true th13)))
                                   (true (cond ((= k 1) th21) ((= k 2) th22) (true th23))))) (range 1 j))))
(defun size (finger j)
  (cond ((= finger 1) (cond ((= j 1) r11) ((= j 2) r12) (true r13)))
        (true (cond ((= j 1) r21) ((= j 2) r22) (true r23)))))
(defun reach (finger j)
  (reduce + (map (lambda (k) [(* (size finger k) (cos (along finger k))) (* (size finger k) (sin (along finger k)))])
                 (range 1 j)) [0 0]))
(defun spread (finger) (if (= finger 1) th10 th20))
(defun p (finger j)
  (let ((d (reach finger j)) (a (spread finger)))
    (seen (+ [(* (cos a) (d 1)) (d 2) (* (- (sin a)) (d 1))] (base finger)))))
(defun corner (out side) (seen [(* out rh) 0 (* side rw 0.5)]))
(defun direction-of (a b) (atan2 (- (b 2) (a 2)) (- (b 1) (a 1))))
(defun offset-of (a b) (let ((t (direction-of a b))) (- (* (a 2) (cos t)) (* (a 1) (sin t)))))
"""


def settings(folder):
    """``inputs.json``."""
    return json.loads((folder / "inputs.json").read_text())


def rows_text(inputs, constraints=True):
    """The rows of a frame, and the constraints in the order of the reference."""
    made = ["(observe o (= [wx_ wy_] [wx wy]) :sigma 1)"]
    made += [f"(observe o (= [tip{i}x tip{i}y] (p {i} 3)) :sigma 1)" for i in (1, 2)]
    for name, a, b in LINES:
        made.append(f"(observe o (= alpha{name} (direction-of {a} {b})) :sigma {inputs['sd'][6]!r})")
        made.append(f"(observe o (= rho{name} (offset-of {a} {b})) :sigma 1)")
    if constraints:
        limits = []
        for each in inputs["constraints"]:
            terms = " ".join(f"(* {factor!r} {name})" for name, factor in each["phi"].items())
            limits.append(f"(<= (+ {terms} 0) {each['b']!r})")
        made.append(f"(constraints {' '.join(limits)})")
    return "\n  ".join(made)


def hand_text(inputs, still=(), constraints=True):
    """The problem of a frame; the unknowns named ``still`` come first."""
    names = [*still, *(name for name in inputs["state"] if name not in still)]
    unknowns = " ".join(f"({name} :init 0)" for name in names)
    rows = rows_text(inputs, constraints)
    return f"(problem hand (data o external)\n{MODEL}  (unknowns {unknowns})\n  {rows}\n  (for-each k))"


def moves_text(inputs, still=()):
    """The problem of a transition: constant velocity, white acceleration; sizes that are states stay as they are."""
    names = [name for name in inputs["state"] if name not in still]
    sizes = [name for name in names if name not in MOVING and not name.startswith("d_")]
    unknowns = " ".join(f"({name} :init 0)" for name in [*still, *names, *(f"{name}.n" for name in names)])
    rows = [f"(= {name}.n (+ {name} d_{name})) (= d_{name}.n d_{name})" for name in MOVING]
    rows += [f"(= {name}.n {name})" for name in sizes]
    return (
        f"(problem moves (data steps external)\n  (unknowns {unknowns})\n"
        f"  (observe steps {' '.join(rows)} :sigma 1)\n  (for-each k))"
    )


def spreads(inputs, still=()):
    """The noise of the transitions of 55 frames: of an acceleration half goes into the position."""
    rows = 36 - len(still)
    found = np.zeros((rows, len(MOVING)))
    for i, sd in enumerate(inputs["acc_sd"]):
        found[2 * i : 2 * i + 2, i] = (sd / 2, sd)
    return np.tile(found, (54, 1, 1))


def sequence_text(inputs, mean, covariance, method, constraints=True):
    """The same in the language of sequences: ``mean`` and ``covariance`` by name and in the order of the reference."""
    place = inputs["state"].index
    q = [place(f"q{i}") for i in range(4)]
    stated = "[" + " ".join("[" + " ".join(repr(float(covariance[i, j])) for j in q) + "]" for i in q) + "]"

    def known(name):
        return f":init {float(mean[name])!r} :sigma {float(np.sqrt(covariance[place(name), place(name)]))!r}"

    plain = [name for name in MOVING if not name.startswith("q")]
    states = " ".join(f"({name} {known(name)})" for name in plain)
    sizes = " ".join(f"({name} {known(name)})" for name in inputs["state"][28:])
    moved = " ".join(
        f"(constant-velocity {name} :acceleration {inputs['acc_sd'][place(name)]!r} :velocity 0"
        f" :velocity-sigma {float(np.sqrt(covariance[14 + place(name), 14 + place(name)]))!r})"
        for name in plain
    )
    spin = float(np.sqrt(covariance[14 + q[0], 14 + q[0]]))
    return f"""(problem hand (data o external)
  (unknowns {sizes})
  (states :over k {states} (q (vector 4) :init [{" ".join(repr(float(mean[f"q{i}"])) for i in range(4))}]
    :covariance {stated}))
  (define (q0 (q 1)) (q1 (q 2)) (q2 (q 3)) (q3 (q 4)))
{MODEL}
  (dynamics {moved} (constant-velocity q :acceleration {inputs["acc_sd"][2]!r} :velocity 0 :velocity-sigma {spin!r}))
  {rows_text(inputs, constraints)}
  (solve :method {method}))"""


def table(path):
    """Columns of a CSV file, by name."""
    names = path.read_text().splitlines()[0].split(",")
    numbers = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    return dict(zip(names, numbers.T, strict=True))


def observed(folder, shift=0.0):
    """The observations as the problem of a frame has them."""
    found = {name: column + shift for name, column in table(folder / "obs_A.csv").items() if name != "frame"}
    found["wx_"], found["wy_"] = found.pop("wx"), found.pop("wy")
    return {"k": np.arange(len(found["wx_"])), **found}
