"""A function of numbers, written in the restricted Python, for arrays of any shape: the same text, element by element.

Branches on integers are taken when the text is read; of branches on numbers both are computed, and each element has
what its own branch gives. There are no loops in such a function, and nothing is stored.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import cache
from itertools import count
from types import CodeType
from typing import Any

import numpy as np

from mbm.machine.definitions import Definitions
from mbm.machine.numpy_functions import function_of
from mbm.machine.program import LIBRARY

NAMES: Mapping[str, Any] = {
    **{operator.value: function_of(operator) for operator in LIBRARY},
    **{name: getattr(np, name) for name in ("isfinite", "where", "logical_and", "logical_or", "logical_not")},
    "max": lambda a, b: np.where(a > b, a, b),
    "min": lambda a, b: np.where(a < b, a, b),
    "float": float,
}
"""The intrinsic functions of solvers as NumPy has them; ``max`` and ``min`` treat NaN as they do everywhere."""


def elementwise(source: Callable[..., Any]) -> Callable[..., Any]:
    """The function for arrays, which are broadcast. Its parameters of the type `Integer` are single numbers.

    Raises:
        TypeError: it has a loop, stores something, or has an intrinsic function that is not in `NAMES`.
    """
    kinds = _integers(source)

    def whole(*arguments: Any) -> Any:
        integers = tuple(each for each, known in zip(arguments, kinds, strict=True) if known)
        reals = [each for each, known in zip(arguments, kinds, strict=True) if not known]
        with np.errstate(all="ignore"):  # of the branches that are not taken
            found = _for_integers(source, integers)(*reals)
        if np.shape(found) == np.shape(reals[0]):
            return found
        shape = np.broadcast_shapes(*map(np.shape, reals))
        return found if np.shape(found) == shape else np.full(shape, found)

    return whole


@cache
def _for_integers(source: Callable[..., Any], integers: tuple[int, ...]) -> Callable[..., Any]:
    """The function of its reals alone, as NumPy computes it."""
    names: dict[str, Any] = dict(NAMES)
    name = _Text(names, _definitions()).function(source, integers)
    found: Callable[..., Any] = names[name]
    return found


@cache
def _definitions() -> Definitions:
    """Each file is read once in a process."""
    return Definitions()


class _Text:
    """Writes functions for arrays; ``names`` is what they know, themselves included. Local to one call."""

    def __init__(self, names: dict[str, Any], definitions: Definitions) -> None:
        self._names = names
        self._definitions = definitions
        self._numbers = count()

    def function(self, source: Callable[..., Any], integers: tuple[int, ...]) -> str:
        """The name of the function for such integers, which is written where it is not known."""
        name = "_".join([source.__name__, *map(str, integers)])
        if name not in self._names:
            tree = self._definitions.of(source)
            given = iter(integers)
            known: dict[str, object] = {}
            reals = []
            for parameter in tree.args.args:
                if source.__annotations__[parameter.arg] == "Integer":
                    known[parameter.arg] = next(given)
                else:
                    reals.append(parameter.arg)
            body = _Body(self, {**source.__globals__, **known}, source)
            lines = body.lines(tree.body[1:] if ast.get_docstring(tree) else tree.body, reals)
            exec(_compiled(f"def {name}({', '.join(reals)}):\n" + "\n".join(f"    {x}" for x in lines)), self._names)  # noqa: S102 - our own text
        return name

    def fresh(self) -> str:
        """A name that nothing has yet."""
        return f"branch_{next(self._numbers)}"


@cache
def _compiled(text: str) -> CodeType:
    return compile(text, "<elementwise>", "exec")


class _Body(ast.NodeTransformer):
    """Turns expressions of one function into those of arrays; ``known`` are its integers and the constants around."""

    def __init__(self, text: _Text, known: Mapping[str, object], source: Callable[..., Any]) -> None:
        self._text = text
        self._known = known
        self._source = source

    def lines(self, body: list[ast.stmt], names: list[str]) -> list[str]:
        """The rest of the function, where ``names`` have values."""
        found: list[str] = []
        names = list(names)
        for place, statement in enumerate(body):
            match statement:
                case ast.Assign(targets=[ast.Name(id=name)]):
                    found.append(f"{name} = {self._written(statement.value)}")
                    names += [] if name in names else [name]
                case ast.AugAssign(target=ast.Name(id=name)):
                    value = ast.BinOp(ast.Name(name), statement.op, statement.value)
                    found.append(f"{name} = {self._written(value)}")
                case ast.Return(value=value) if value is not None:
                    return [*found, f"return {self._written(value)}"]
                case ast.If():
                    return found + self._branched(statement, body[place + 1 :], names)
                case _:
                    raise TypeError(f"{self._source.__name__}: {ast.unparse(statement)}")
        raise TypeError(self._source.__name__)

    def _branched(self, branch: ast.If, rest: list[ast.stmt], names: list[str]) -> list[str]:
        known = self._decided(branch.test)
        if known is not None:
            return self.lines([*(branch.body if known else branch.orelse), *rest], names)
        found, calls = [], []
        for body in (branch.body, branch.orelse):
            name = self._text.fresh()
            found += [f"def {name}({', '.join(names)}):", *(f"    {x}" for x in self.lines([*body, *rest], names))]
            calls.append(f"{name}({', '.join(names)})")
        return [*found, f"return where({self._written(branch.test)}, {calls[0]}, {calls[1]})"]

    def _decided(self, test: ast.expr) -> bool | None:
        """What a comparison of integers comes to; None: it is one of numbers."""
        match test:
            case ast.Compare(left=left, ops=[ast.Eq() | ast.NotEq() as op], comparators=[right]):
                first, second = self._integer(left), self._integer(right)
                if first is not None and second is not None:
                    return (first == second) is isinstance(op, ast.Eq)
        return None

    def _integer(self, node: ast.expr) -> int | None:
        match node:
            case ast.Constant(value=value):
                return value if isinstance(value, int) else None
            case ast.Name(id=name):
                known = self._known.get(name)
                return known if isinstance(known, int) else None
        return None

    def _written(self, node: ast.expr) -> str:
        return ast.unparse(self.visit(deepcopy(node)))  # which is changed, and may be written again

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Constants by their values."""
        value = self._known.get(node.id)
        return ast.Constant(value) if isinstance(value, int | float) else node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        """``not`` of arrays."""
        operand: ast.expr = self.visit(node.operand)
        return _call("logical_not", operand) if isinstance(node.op, ast.Not) else ast.UnaryOp(node.op, operand)

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        """``and`` and ``or`` of arrays."""
        name = "logical_and" if isinstance(node.op, ast.And) else "logical_or"
        found: ast.expr = self.visit(node.values[0])
        for other in node.values[1:]:
            found = _call(name, found, self.visit(other))
        return found

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        """``a if c else b`` of arrays."""
        return _call("where", *map(self.visit, (node.test, node.body, node.orelse)))

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Intrinsic functions by their names, others of the restricted Python for the integers they are given."""
        if not isinstance(node.func, ast.Name):
            raise TypeError(ast.unparse(node))
        arguments = [self.visit(each) for each in node.args]
        source = self._known.get(node.func.id)
        if node.func.id in NAMES:
            return _call(node.func.id, *arguments)
        kinds = _integers(source) if callable(source) else ()
        if not callable(source) or len(kinds) != len(arguments):
            raise TypeError(ast.unparse(node))
        integers = [self._integer(argument) for argument, known in zip(arguments, kinds, strict=True) if known]
        name = self._text.function(source, tuple(each for each in integers if each is not None))
        return _call(name, *(a for a, known in zip(arguments, kinds, strict=True) if not known))


def _integers(source: Callable[..., Any]) -> tuple[bool, ...]:
    """Which parameters have the type `Integer`."""
    return tuple(text == "Integer" for name, text in source.__annotations__.items() if name != "return")


def _call(name: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(ast.Name(name), list(arguments), [])
