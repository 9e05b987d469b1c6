"""What is asked of the Python files of mbm: each is parsed once."""

from __future__ import annotations

import ast
import functools
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = tuple(sorted((ROOT / "mbm").rglob("*.py")))


@dataclass(frozen=True)
class Facts:
    """Functions with their lines; the lines of assertions; names that are imported, by module; constants and values."""

    functions: tuple[tuple[str, int], ...]
    assertions: tuple[int, ...]
    imports: tuple[tuple[str, tuple[str, ...]], ...]
    relative: bool
    constants: frozenset[tuple[str, str]]


@functools.cache
def facts(path: Path) -> Facts:
    """All trees together would take 250 MB."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions, assertions, imports, relative = [], [], [], False
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                functions.append((node.name, (node.end_lineno or node.lineno) - node.lineno + 1))
            case ast.Assert():
                assertions.append(node.lineno)
            case ast.ImportFrom():
                relative |= node.level > 0
                if node.module is not None:
                    imports.append((node.module, tuple(each.name for each in node.names)))
            case ast.Import():
                imports.extend((each.name, ()) for each in node.names)
    return Facts(tuple(functions), tuple(assertions), tuple(imports), relative, _constants(tree))


def _constants(tree: ast.Module) -> frozenset[tuple[str, str]]:
    """Names in capitals that a file gives a literal value at its top level, with the values; numbers as floats."""
    found = set()
    for node in tree.body:
        match node:
            case ast.Assign(targets=[target], value=value):
                pairs = [(target, value)]
                if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                    pairs = list(zip(target.elts, value.elts, strict=False))
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                pairs = [(target, value)]
            case _:
                continue
        for name, literal in pairs:
            if isinstance(name, ast.Name) and name.id.isupper():
                try:
                    known = ast.literal_eval(literal)
                except ValueError:
                    continue
                plain = isinstance(known, int | float) and not isinstance(known, bool)
                found.add((name.id, repr(float(known) if plain else known)))
    return frozenset(found)
