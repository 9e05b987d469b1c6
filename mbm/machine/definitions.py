"""The texts of Python functions, as trees of Python's grammar."""

from __future__ import annotations

import ast
import linecache
from collections.abc import Callable, Iterable


class Definitions:
    """Finds definitions and reads each file once, which is much faster than `inspect`; local to one call."""

    def __init__(self) -> None:
        self._files: dict[str, ast.Module] = {}

    def of(self, function: Callable[..., object]) -> ast.FunctionDef:
        """The definition of a function that is written with ``def``."""
        code = function.__code__
        if code.co_filename not in self._files:
            self._files[code.co_filename] = ast.parse("".join(linecache.getlines(code.co_filename)))
        whole = self._files[code.co_filename]
        found = _beginning(whole.body, code.co_firstlineno) or _beginning(ast.walk(whole), code.co_firstlineno)
        if found is None:
            raise ValueError(function.__qualname__)
        return found


def _beginning(nodes: Iterable[ast.AST], line: int) -> ast.FunctionDef | None:
    """The function among ``nodes`` that begins in a line, as Python has it: with its first decorator."""
    for node in nodes:
        if isinstance(node, ast.FunctionDef):
            first = node.decorator_list[0].lineno if node.decorator_list else node.lineno
            if first == line:
                return node
    return None
