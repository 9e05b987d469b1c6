"""Problems of Hock and Schittkowski (1981, Lecture Notes in Economics and Mathematical Systems 187), as published.

All those whose objective is a sum of squares, or becomes one by completing squares: then ``least`` is the published
optimum plus the constant that this adds. Formulas are those of Python, and are put into the language from there.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from types import CodeType

import numpy as np

from tests.oracles.kinds import Kind

NONE = 1e30
"""The bound of what has none."""

OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "^"}


def lisp(node: ast.AST) -> str:
    """An expression of Python as a form of the language."""
    match node:
        case ast.BinOp(left, operator, right):
            return f"({OPERATORS[type(operator)]} {lisp(left)} {lisp(right)})"
        case ast.UnaryOp(ast.USub(), operand):
            return f"(- {lisp(operand)})"
        case ast.Call(ast.Name(function), (argument,)):
            return f"({function} {lisp(argument)})"
        case ast.Constant(value):
            return repr(value)
        case ast.Name(name):
            return name
    raise TypeError(ast.dump(node))


def forms(text: str) -> list[str]:
    """The forms of formulas that commas separate."""
    parsed = ast.parse(f"[{text}]", mode="eval").body
    return [lisp(each) for each in parsed.elts]


@dataclass(frozen=True, kw_only=True)
class Published:
    """``min Σ residuals²`` with ``equal = 0`` and ``above >= 0`` in a box, from ``start``; what the book says of it.

    ``minima`` are the published one, ``(least, x)``, and others that a local method may end at. ``flat``: the residuals
    do not determine everything there to first order.
    """

    residuals: str
    start: tuple[float, ...]
    minima: tuple[tuple[float, tuple[float, ...]], ...]
    equal: str = ""
    above: str = ""
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None
    flat: bool = False

    def function(self, text: str, sign: float = 1.0):
        """The formulas as a function of points (n,) that may be complex."""
        code: CodeType = compile(f"[{text}]", "<published>", "eval")
        functions = {"sqrt": np.sqrt, "exp": np.exp, "sin": np.sin}

        def values(x, tables=None):
            return sign * np.array(eval(code, functions | {f"x{i}": v for i, v in enumerate(x, start=1)}))  # noqa: S307

        return values

    def kind(self) -> Kind:
        """The problem as one of a table with a single row, so that there may be many data sets."""
        n = len(self.start)
        low = [max(v, -NONE) for v in self.lower or n * (-NONE,)]
        high = [min(v, NONE) for v in self.upper or n * (NONE,)]
        observed = " ".join(f"(= 0 {form})" for form in forms(self.residuals))
        limits = [f"(= {form} 0)" for form in forms(self.equal)] + [f"(>= {form} 0)" for form in forms(self.above)]
        return Kind(
            unknowns={
                f"x{i}": f":init {start!r}" + (f" :in ({lo!r} {hi!r})" if (lo, hi) != (-NONE, NONE) else "")
                for i, (start, lo, hi) in enumerate(zip(self.start, low, high, strict=True), start=1)
            },
            clauses=f"(observe d {observed} :sigma one) " + (f"(constraints {' '.join(limits)})" if limits else ""),
            draw=lambda _: {"d": {"one": np.ones(1)}},
            residuals=self.function(self.residuals),
            start=self.start,
            lower=None if self.lower is None else tuple(-np.inf if v == -NONE else v for v in low),
            upper=None if self.upper is None else tuple(np.inf if v == NONE else v for v in high),
            equal=self.function(self.equal) if self.equal else None,
            below=self.function(self.above, -1.0) if self.above else None,
            given=None,
        )
