"""Kinds of random problems whose formulas are functions in Python: what SciPy says of them stays the same."""

from __future__ import annotations

from dataclasses import replace

from tests.oracles.kinds import Kind

MODULE = "tests.oracles.functions"
DIFFERENCED = {
    "(+ {c} (* {a} (exp (* -1 {k} x))))": ("decay", "{a} {k} {c} x", 1),
    "(exp (+ (* {a} x) {b}))": ("growth", "{a} {b} x", 1),
    "(+ (* {a} {a}) (* {b} {b}))": ("squares", "{a} {b}", 1),
    "(* {a} {b})": ("product", "{a} {b}", 1),
    "(* {a} {k})": ("product", "{a} {k}", 1),
    "(distance {p} [x y])": ("distance", "{p} [x y]", 1),
    "(distance {p} [masts.x masts.y])": ("distance", "{p} [masts.x masts.y]", 1),
    "(+ {a} (* {b} x))": ("line", "{a} {b} x", 1),
    "(+ {a} (* {b} (exp (* 0.3 x))))": ("bent", "{a} {b} x", 1),
    "(- {a} (* {b} z))": ("line", "{a} (- {b}) z", 1),
    "(+ {a} {b} (* {c} x))": ("free", "{a} {b} {c} x", 1),
    "(+ ({o} sensor) (* {b} x))": ("line", "({o} sensor) {b} x", 1),
    "(* {a} (exp (* {b} x)))": ("power", "{a} {b} x", 1),
    "(rotate {R} [x y z])": ("turned", "{R} [x y z]", 3),
}
"""Formulas of the catalogue, and the function of one row that has each: its name, arguments, and size."""

BATCHES = {"decay": "decays", "growth": "growths", "distance": "distances", "power": "powers", "turned": "turns"}
"""Functions of all rows, with a Jacobian, in place of those of one."""


def called(kind: Kind, *, batches: bool) -> Kind:
    """The kind with its formulas as calls; ``batches``: of functions of all rows with Jacobians, where there are."""
    clauses = kind.clauses
    for formula, (name, arguments, size) in DIFFERENCED.items():
        options = f":size {size}"
        if batches and name in BATCHES:
            name = BATCHES[name]
            options += f' :batch true :jacobian "{MODULE}:slopes_of_{name}"'
        clauses = clauses.replace(formula, f'(external "{MODULE}:{name}" {arguments} {options})')
    assert "external" in clauses
    return replace(kind, clauses=clauses, calls=True)
