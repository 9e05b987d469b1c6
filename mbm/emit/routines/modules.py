"""The solver and the routines of generated solvers as one module of the target language, as far as it is called."""

from __future__ import annotations

import ast
import pkgutil
import re
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from types import FunctionType, MappingProxyType

from mbm import solver
from mbm.emit import routines
from mbm.machine.from_python import module_of
from mbm.machine.tree import CALL_KERNEL, Module
from mbm.machine.unused import without_unused


@cache
def known() -> Mapping[str, FunctionType]:
    """What generated texts may call, by name: the functions of the solver and of the routines beside it."""
    files = [
        f"{room.__name__}.{each.name}" for room in (solver, routines) for each in pkgutil.iter_modules(room.__path__)
    ]
    return {
        name: f
        for file in files
        for name, f in vars(import_module(file)).items()
        if isinstance(f, FunctionType) and f.__module__ == file
    }


def called_in_c(text: str) -> tuple[str, ...]:
    """Those that a C text calls, in alphabetical order."""
    code = re.sub(r'/\*.*?\*/|"(?:\\.|[^"\\])*"', "", text, flags=re.DOTALL)
    return tuple(sorted(set(re.findall(r"\b\w+(?=\()", code)) & known().keys()))


def called_in_python(text: str) -> tuple[str, ...]:
    """Those that a Python text names."""
    names = {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
    return tuple(sorted(names & known().keys()))


def emitted_module(called: Iterable[str], fixed: Mapping[str, int] = MappingProxyType({})) -> Module:
    """The functions of these names with all that they call, none of them public; a kernel takes a row at a time.

    ``fixed`` are fields of records that always have these values, ``record.field``.
    """
    found = module_of("solver", [known()[name] for name in called], public=False, constants={"LANES": 1, **fixed})
    functions = tuple(f for f in found.functions if f.name != CALL_KERNEL.name)
    made = Module(name=found.name, functions=functions, records=found.records)
    return without_unused(made) if fixed else made
