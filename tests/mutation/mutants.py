"""Small changes of a source file: another comparison or number, a condition turned round, a statement gone."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass

COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<=",
    ast.LtE: "<",
    ast.Gt: ">=",
    ast.GtE: ">",
    ast.Eq: "!=",
    ast.NotEq: "==",
    ast.Is: "is not",
    ast.IsNot: "is",
    ast.In: "not in",
    ast.NotIn: "in",
}
OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.FloorDiv: "*",
    ast.Mod: "*",
    ast.Pow: "*",
    ast.BitAnd: "|",
    ast.BitOr: "&",
    ast.MatMult: "*",
}
REMOVED = (ast.Expr, ast.AugAssign, ast.Raise, ast.Continue, ast.Break, ast.Return)
"""Statements that may be taken away; without an assignment the name would be missing, which every test sees."""


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """``old`` at ``start`` (in characters) becomes ``new``; ``function`` is the line where its function begins."""

    file: str
    line: int
    start: int
    old: str
    new: str
    function: int | None

    def applied(self, text: str) -> str:
        """The whole file with the change."""
        return text[: self.start] + self.new + text[self.start + len(self.old) :]

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {' '.join(self.old.split())!r} -> {self.new!r}"


def mutants_of(file: str, text: str) -> list[Mutant]:
    """All changes of a file, in the order of their places."""
    found = _Finder(file, text)
    found.visit(ast.parse(text))
    return sorted(found.mutants, key=lambda mutant: mutant.start)


class _Finder(ast.NodeVisitor):
    def __init__(self, file: str, text: str) -> None:
        self.mutants: list[Mutant] = []
        self._file = file
        self._text = text
        lines = text.splitlines(keepends=True)
        self._starts = [0]
        for line in lines:
            self._starts.append(self._starts[-1] + len(line))
        self._lines = lines
        self._function: int | None = None

    def _offset(self, line: int, column: int) -> int:
        """The offset in characters of a place; columns of the syntax tree count bytes."""
        return self._starts[line - 1] + len(self._lines[line - 1].encode()[:column].decode())

    def _ends(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        line, column = node.end_lineno or node.lineno, node.end_col_offset or 0
        return self._offset(node.lineno, node.col_offset), self._offset(line, column)

    def _add(self, line: int, start: int, old: str, new: str) -> None:
        if new != old:  # `return None` has nothing to be replaced by
            mutant = Mutant(file=self._file, line=line, start=start, old=old, new=new, function=self._function)
            self.mutants.append(mutant)

    def _between(self, left: ast.expr, right: ast.expr, new: str) -> None:
        """The operator between two operands; brackets around these stay where they are."""
        start, end = self._ends(left)[1], self._ends(right)[0]
        gap = self._text[start:end]
        old = gap.strip(" \n\t()\\")
        if old and "#" not in gap:
            self._add(left.lineno, start + gap.index(old), old, new)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Decorators and annotations are left alone: what they say is not computed with."""
        outer, self._function = self._function, self._function or node.lineno
        for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
            self.visit(default)
        for statement in node.body[1 if ast.get_docstring(node) is not None else 0 :]:
            self.visit(statement)
        self._function = outer

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body[1 if ast.get_docstring(node) is not None else 0 :]:
            self.visit(statement)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_If(self, node: ast.If) -> None:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return
        self._negate(node.test)
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._negate(node.test)
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self.generic_visit(node)

    def _negate(self, test: ast.expr) -> None:
        if isinstance(test, ast.Compare | ast.UnaryOp):
            return  # these are turned round by themselves
        start, end = self._ends(test)
        self._add(test.lineno, start, self._text[start:end], f"not ({self._text[start:end]})")

    def visit_Compare(self, node: ast.Compare) -> None:
        operands = (node.left, *node.comparators)
        for left, operator, right in zip(operands, node.ops, operands[1:], strict=False):
            self._between(left, right, COMPARISONS[type(operator)])
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in OPERATORS and not isinstance(node.left, ast.JoinedStr):
            self._between(node.left, node.right, OPERATORS[type(node.op)])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        new = "or" if isinstance(node.op, ast.And) else "and"
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._between(left, right, new)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        start = self._ends(node)[0]
        operand = self._ends(node.operand)[0]
        old = self._text[start:operand]
        if isinstance(node.op, ast.Not | ast.USub | ast.Invert) and "(" not in old:
            self._add(node.lineno, start, old, "")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        start, end = self._ends(node)
        old = self._text[start:end]
        if isinstance(node.value, bool):
            self._add(node.lineno, start, old, str(not node.value))
        elif isinstance(node.value, int | float):
            new = str(node.value + 1) if isinstance(node.value, int) else repr(2 * node.value or 1.0)
            self._add(node.lineno, start, old, new)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Texts are not changed: places inside of them are not those of the file."""

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.generic_visit(node)

    def generic_visit(self, node: ast.AST) -> None:
        if isinstance(node, REMOVED) and self._function is not None and not self._is_text(node):
            start, end = self._ends(node)
            new = "return None" if isinstance(node, ast.Return) else "pass"
            if not (isinstance(node, ast.Return) and node.value is None):
                self._add(node.lineno, start, self._text[start:end], new)
        super().generic_visit(node)

    @staticmethod
    def _is_text(node: ast.AST) -> bool:
        return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant | ast.Yield | ast.YieldFrom)


def functions_of(text: str) -> Iterator[tuple[int, int]]:
    """First and last lines of the outermost functions and methods of a file."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            yield node.lineno, node.end_lineno or node.lineno
