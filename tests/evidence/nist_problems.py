"""NIST StRD sets as problem files: models written by hand in the language, data and starts from the reference set."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.estimation.nist import ReferenceSet
from tests.evidence.material import write_problem

EXPONENTIALS = "(+ (* b1 (exp (* (- b2) x))) (* b3 (exp (* (- b4) x))) (* b5 (exp (* (- b6) x))))"
GAUSS = "(+ (* b1 (exp (* (- b2) x))) (* b3 (exp (- (^ (/ (- x b4) b5) 2)))) (* b6 (exp (- (^ (/ (- x b7) b8) 2)))))"
CHWIRUT = "(/ (exp (* (- b1) x)) (+ b2 (* b3 x)))"
CUBICS = "(/ (+ b1 (* b2 x) (* b3 (^ x 2)) (* b4 (^ x 3))) (+ 1 (* b5 x) (* b6 (^ x 2)) (* b7 (^ x 3))))"
FORMULAS = {
    "Bennett5": "(* b1 (^ (+ b2 x) (/ -1 b3)))",
    "BoxBOD": "(* b1 (- 1 (exp (* (- b2) x))))",
    "Chwirut1": CHWIRUT,
    "Chwirut2": CHWIRUT,
    "DanWood": "(* b1 (^ x b2))",
    "Eckerle4": "(* (/ b1 b2) (exp (* -1/2 (^ (/ (- x b3) b2) 2))))",
    "ENSO": """(+ b1 (* b2 (cos (/ (* 2 pi x) 12))) (* b3 (sin (/ (* 2 pi x) 12)))
         (* b5 (cos (/ (* 2 pi x) b4))) (* b6 (sin (/ (* 2 pi x) b4)))
         (* b8 (cos (/ (* 2 pi x) b7))) (* b9 (sin (/ (* 2 pi x) b7))))""",
    "Gauss1": GAUSS,
    "Gauss2": GAUSS,
    "Gauss3": GAUSS,
    "Hahn1": CUBICS,
    "Kirby2": "(/ (+ b1 (* b2 x) (* b3 (^ x 2))) (+ 1 (* b4 x) (* b5 (^ x 2))))",
    "Lanczos1": EXPONENTIALS,
    "Lanczos2": EXPONENTIALS,
    "Lanczos3": EXPONENTIALS,
    "MGH09": "(/ (* b1 (+ (^ x 2) (* x b2))) (+ (^ x 2) (* x b3) b4))",
    "MGH10": "(* b1 (exp (/ b2 (+ x b3))))",
    "MGH17": "(+ b1 (* b2 (exp (* (- x) b4))) (* b3 (exp (* (- x) b5))))",
    "Misra1a": "(* b1 (- 1 (exp (* (- b2) x))))",
    "Misra1b": "(* b1 (- 1 (^ (+ 1 (/ (* b2 x) 2)) -2)))",
    "Misra1c": "(* b1 (- 1 (^ (+ 1 (* 2 b2 x)) -0.5)))",
    "Misra1d": "(/ (* b1 b2 x) (+ 1 (* b2 x)))",
    "Nelson": "(- b1 (* b2 x1 (exp (* (- b3) x2))))",
    "Rat42": "(/ b1 (+ 1 (exp (- b2 (* b3 x)))))",
    "Rat43": "(/ b1 (^ (+ 1 (exp (- b2 (* b3 x)))) (/ 1 b4)))",
    "Roszman1": "(- b1 (* b2 x) (/ (atan (/ b3 (- x b4))) pi))",
    "Thurber": CUBICS,
}
LOGARITHMIC = frozenset({"Nelson"})
"""Sets whose response is fitted as its logarithm; the reference set holds the logarithm already."""


def problem_text(reference: ReferenceSet, start: int) -> str:
    """A file that says the model and one of the two starts, and nothing about how to solve."""
    starts = " ".join(f"(b{i} :init {float(v)!r})" for i, v in enumerate(reference.starts[start], 1))
    measured = "(log y)" if reference.name in LOGARITHMIC else "y"
    return f"""(problem {reference.name}
  (data d (csv "d.csv"))
  (unknowns {starts})
  (observe d (= {measured} {FORMULAS[reference.name]}) :sigma unknown))
"""


def problem_file(reference: ReferenceSet, start: int, folder: Path) -> Path:
    """The problem and its data, as files."""
    if reference.name in LOGARITHMIC:
        columns = {"y": np.exp(reference.y).tolist(), "x1": reference.x[0].tolist(), "x2": reference.x[1].tolist()}
    else:
        columns = {"y": reference.y.tolist(), "x": reference.x.tolist()}
    return write_problem(folder, problem_text(reference, start), {"d": columns})
