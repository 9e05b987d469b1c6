"""No point of the set is ever cut off: random equations, random points that meet them with 30 digits.

There is no tolerance. Each point is looked for in the boxes that the search leaves, for contraction alone and with
bisection; the equations hold branches, angles, powers, roots and quotients, with subexpressions in common.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import mbm
from mbm.estimation.intervals.building import network
from mbm.estimation.intervals.contraction import FIXED, Boxes, contracted
from mbm.estimation.intervals.search import Aims, paved

FORMS = (
    ("(+ {a} {b})", "({a} + {b})"),
    ("(- {a} {b})", "({a} - {b})"),
    ("(* {a} {b})", "({a} * {b})"),
    ("(* {a} {a})", "({a} * {a})"),
    ("(/ {a} (+ 1 (* {b} {b})))", "({a} / (1 + {b} * {b}))"),
    ("(/ {a} {b})", "({a} / {b})"),
    ("(^ {a} 3)", "({a} ** 3)"),
    ("(^ {a} -2)", "({a} ** -2)"),
    ("(^ (abs {a}) 1.5)", "(abs({a}) ** mpf(1.5))"),
    ("(sqrt (abs {a}))", "sqrt(abs({a}))"),
    ("(log (+ 1 (abs {a})))", "log(1 + abs({a}))"),
    ("(exp (/ {a} 4))", "exp({a} / 4)"),
    ("(sin {a})", "sin({a})"),
    ("(cos (* 2 {a}))", "cos(2 * {a})"),
    ("(atan2 {a} {b})", "atan2({a}, {b})"),
    ("(atan {a})", "atan({a})"),
    ("(tanh {a})", "tanh({a})"),
    ("(cosh (/ {a} 4))", "cosh({a} / 4)"),
    ("(min {a} {b})", "min({a}, {b})"),
    ("(max {a} {b})", "max({a}, {b})"),
    ("(hypot {a} {b})", "hypot({a}, {b})"),
    ("(if (> {a} 0.5) (sqrt (- {a} 0.5)) {b})", "(sqrt({a} - mpf(0.5)) if {a} > mpf(0.5) else {b})"),
    ("(mod {a} 3)", "({a} - 3 * floor({a} / 3))"),
)
NAMES = {
    name: getattr(mpmath, name)
    for name in ("sqrt", "log", "exp", "sin", "cos", "atan2", "atan", "tanh", "cosh", "hypot", "floor", "mpf")
}


def expression(rng: np.random.Generator, depth: int) -> tuple[str, str]:
    """A form over x, y and z, and the same in Python."""
    if depth == 0 or rng.random() < 0.15:
        name = str(rng.choice(["x", "y", "z"]))
        return name, name
    form, python = FORMS[rng.integers(len(FORMS))]
    (a, pa), (b, pb) = expression(rng, depth - 1), expression(rng, depth - 1)
    return form.format(a=a, b=b), python.format(a=pa, b=pb)


def value(code: object, point: np.ndarray) -> mpmath.mpf | None:
    """The value with 30 digits; None where there is none."""
    with mpmath.workdps(30):
        try:
            found = eval(code, NAMES, dict(zip("xyz", map(mpmath.mpf, point), strict=True)))  # noqa: S307 - ours
        except (ZeroDivisionError, ValueError):
            return None
        return found if isinstance(found, mpmath.mpf) and mpmath.isfinite(found) else None


def covered(boxes: Boxes, points: np.ndarray) -> np.ndarray:
    """Whether each of the points (n, 3) lies in some box."""
    inside = (boxes.low[None] <= points[:, None]) & (points[:, None] <= boxes.high[None])
    return inside.all(axis=2).any(axis=1)


@pytest.mark.parametrize("seed", range(30))
def test_points_that_meet_all_equations_stay(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = rng.uniform(-2.5, 2.5, 3)
    equations = []
    while len(equations) < 2:
        form, python = expression(rng, 3)
        code = compile(python, "made", "eval")
        exact = value(code, truth)
        if exact is not None and abs(exact) < 1e6 and any(name in python for name in "xyz"):
            equations.append((form, code, float(exact), 0.05 * (1 + abs(float(exact)))))
    clauses = " ".join(f"(observe (= {m!r} {form}) :bound {b!r})" for form, _, m, b in equations)
    text = f"""(problem p (unknowns (x :in (-3 3)) (y :in (-3 3)) (z :in (-3 3))) {clauses}
      (solve :method (interval)))"""
    found = mbm.loads(text).compile().elaborated
    made = network(found.problem, found.tables, {})
    spread = truth + rng.normal(0, 1, (300, 3)) * 10.0 ** -rng.uniform(0, 4, (300, 1))
    points = np.vstack([truth, np.clip(spread, -3, 3), rng.uniform(-3, 3, (200, 3))])
    with mpmath.workdps(30):
        inside = np.array([
            all((v := value(code, p)) is not None and abs(v - mpmath.mpf(m)) <= mpmath.mpf(b)
                for _, code, m, b in equations)
            for p in points
        ])  # fmt: skip
    assert inside[0]
    first = contracted(made, made.low[None], made.high[None], shrink=FIXED)
    assert covered(first, points[inside]).all(), text
    aims = Aims(widths=np.full(3, 0.1), tolerances=np.full(3, 0.1), limit=300, finest=1.0, part=np.inf)
    assert covered(paved(made, first, aims, lambda: False).boxes, points[inside]).all()
