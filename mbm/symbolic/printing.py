"""Equations for people: plain text or LaTeX, with names for what occurs more than once."""

from __future__ import annotations

import re
from collections.abc import Sequence

import sympy
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.printing.latex import LatexPrinter
from sympy.printing.str import StrPrinter

from mbm.symbolic.conversion import Called
from mbm.symbolic.types import ResidualBlock
from mbm.text.shown import one_line
from mbm.values import dataclass

LEAST_SIZE = 3
"""Operations that a repeated subexpression has before it gets a name of its own."""

MOST_LEVELS = 40
"""Levels of operations in one line."""


@dataclass(frozen=True, slots=True)
class PrintedEquations:
    """Lines ``t1 = …`` of named subexpressions, and one line for each component."""

    definitions: tuple[str, ...]
    components: tuple[str, ...]


def printed(block: ResidualBlock, *, latex: bool) -> PrintedEquations:
    """The equations of a block; a component of a residual is what should be zero."""
    taken = {s.name for s in (*block.variable_symbols, *block.parameter_symbols)}
    definitions, components = named_subexpressions(block.expressions, taken)
    show = _latex if latex else _plain
    return PrintedEquations(
        definitions=tuple(f"{show(symbol)} = {show(value)}" for symbol, value in definitions),
        components=tuple(show(c) for c in components),
    )


def _plain(node: sympy.Basic) -> str:
    return str(_PlainPrinter({"order": "none", "full_prec": False}).doprint(node))


def _latex(node: sympy.Basic) -> str:
    named = {symbol: latex_name(symbol.name) for symbol in node.free_symbols}
    return str(_Printer({"order": "none", "symbol_names": named}).doprint(node))


class _PlainPrinter(StrPrinter):  # type: ignore[misc]
    def _print_Called(self, expr: Called) -> str:  # noqa: N802 - SymPy's name
        function, index, _, *arguments = expr.args
        return f"{one_line(function.name)}({', '.join(map(self.doprint, arguments))}){index.name}"


class _Printer(LatexPrinter):  # type: ignore[misc]  # SymPy has no types
    """SymPy's printer asks each kind of function to print itself with an exponent, but cases cannot."""

    def _print_Piecewise(self, expr: sympy.Piecewise, exp: str | None = None) -> str:  # noqa: N802 - SymPy's name
        cases = str(super()._print_Piecewise(expr))
        return cases if exp is None else f"\\left({cases}\\right)^{{{exp}}}"

    def _print_Called(self, expr: Called, exp: str | None = None) -> str:  # noqa: N802 - SymPy's name
        function, index, _, *arguments = expr.args
        call = f"{latex_name(function.name)}\\left({', '.join(map(self.doprint, arguments))}\\right){index.name}"
        return call if exp is None else f"{{{call}}}^{{{exp}}}"


def latex_name(name: str) -> str:
    """A name in a formula of LaTeX: as SymPy writes it where that is safe, else upright, and no command in it is one.

    The names of a problem, and the keys of a table, may hold what TeX would carry out, e.g. ``$`` or ``%``.
    """
    if _PLAIN_NAME.fullmatch(name):
        shown = str(sympy.latex(sympy.Symbol(name)))
        if not _CHANGED.search(shown) and shown.count("'") == name.count("'"):
            return shown
    return "\\mathrm{" + "".join(map(_in_formula, one_line(name))) + "}"


_PLAIN_NAME = re.compile(r"""[^\W_]+([_.][^\W_]+)*('\d*)?(\[("?[^\W_]*"?|\d+(,\d+)*)\](\.[a-z]+)?)*""")
"""Words, dots and indices; underscores, after which SymPy writes an index, between words only."""

_CHANGED = re.compile(r"\\left|\\[A-Za-z]+\{")
"""What SymPy makes of names that end in ``hat``, ``bm``, ``abs`` …: accents and signs in place of the end."""

_IN_TEXT = {
    "\\": "\\textbackslash{}",
    "^": "\\textasciicircum{}",
    "~": "\\textasciitilde{}",
    "<": "\\textless{}",
    ">": "\\textgreater{}",
    **{special: "\\" + special for special in "{}$&#%_"},
}


def _in_formula(character: str) -> str:
    """A character of an upright name: what has a meaning of its own, there or in formulas, stands as text."""
    if character.isalnum() or character in "[],.'\"":
        return character
    return f"\\mbox{{{_IN_TEXT.get(character, character)}}}"


def named_subexpressions(
    expressions: Sequence[sympy.Expr], taken: set[str]
) -> tuple[list[tuple[sympy.Symbol, sympy.Expr]], list[sympy.Expr]]:
    """``expressions`` with symbols for subexpressions, and those symbols' values.

    A subexpression gets a symbol if it is repeated and has some size, or stands on too many levels: nobody can read
    those, and SymPy's printers call themselves for each.
    """
    order, uses, sizes = _survey(expressions)
    definitions: list[tuple[sympy.Symbol, sympy.Expr]] = []
    replaced: dict[sympy.Basic, sympy.Basic] = {}
    levels: dict[sympy.Basic, int] = {}
    with sympy.evaluate(False):
        for node in order:
            made = _rebuilt(node, [replaced[a] for a in node.args]) if node.args else node
            levels[node] = 1 + max((levels[a] for a in node.args), default=0)
            repeated = uses[node] > 1 and sizes[node] >= LEAST_SIZE
            if node.args and (repeated or levels[node] >= MOST_LEVELS) and isinstance(node, sympy.Expr):
                levels[node] = 1
                symbol = _symbol(len(definitions) + 1, taken)
                definitions.append((symbol, made))
                made = symbol
            replaced[node] = made
    return definitions, [replaced[e] for e in expressions]


def _rebuilt(node: sympy.Basic, arguments: list[sympy.Basic]) -> sympy.Basic:
    """``node`` with other arguments; piecewise values past SymPy's constructors, as they were made."""
    if isinstance(node, ExprCondPair):
        return sympy.Tuple.__new__(ExprCondPair, *arguments)
    if isinstance(node, sympy.Piecewise):
        return sympy.Basic.__new__(sympy.Piecewise, *arguments)
    return node.func(*arguments)


def _symbol(number: int, taken: set[str]) -> sympy.Symbol:
    name = f"t{number}"
    while name in taken:
        name += "'"
    taken.add(name)
    return sympy.Symbol(name, real=True)


def _survey(
    expressions: Sequence[sympy.Expr],
) -> tuple[list[sympy.Basic], dict[sympy.Basic, int], dict[sympy.Basic, int]]:
    """Every node once, arguments first; how often each is used; how many operations each takes (bounded)."""
    order: list[sympy.Basic] = []
    uses: dict[sympy.Basic, int] = {}
    sizes: dict[sympy.Basic, int] = {}
    for expression in expressions:
        uses[expression] = uses.get(expression, 0) + 1
        stack = [(expression, False)]
        while stack:
            node, ready = stack.pop()
            if ready:
                order.append(node)
                sizes[node] = min(10**6, sum(sizes[a] for a in node.args) + (1 if node.args else 0))
                continue
            if node in sizes:
                continue
            sizes[node] = 0
            stack.append((node, True))
            for argument in reversed(node.args):
                uses[argument] = uses.get(argument, 0) + 1
                if argument not in sizes:
                    stack.append((argument, False))
    return list(dict.fromkeys(order)), uses, sizes
