"""The solver and the routines of generated solvers as one module of the target language, as far as it is called."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace

from mbm.emit.routines import agreement, forms, freedom, noises, rooms, rotations, rows, sandwich, systems, whitening
from mbm.target.from_python import module_of
from mbm.target.solver.consensus_modules import consensus_module
from mbm.target.solver.modules import solver_module
from mbm.target.tree import CALL_KERNEL, Call, Function, Module
from mbm.values import dataclass

PARTS = (freedom, systems, whitening, rotations, rows, noises, sandwich)
AGREEING = (forms, rooms, agreement)
"""What problems with consensus take besides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Library:
    """Functions in the order in which they call one another, and the names that each of them calls."""

    functions: tuple[Function, ...]
    calls: Mapping[str, frozenset[str]]


def library(*, agreeing: bool) -> Library:
    """All that generated solvers may call, with consensus or without; a kernel takes a row at a time."""
    solver = (*solver_module(lanes=1).functions, *(consensus_module(lanes=1).functions if agreeing else ()))
    routines = [function for part in (*PARTS, *(AGREEING if agreeing else ())) for function in part.ROUTINES]
    own = {f.name: f for f in solver if f.name != CALL_KERNEL.name}
    whole = module_of("routines", routines, external=tuple(own.values()))
    return Library(functions=whole.functions, calls={f.name: frozenset(_calls(f)) for f in whole.functions})


def emitted_module(called: Iterable[str]) -> Module:
    """The functions of these names with all that they call, none of them public."""
    pending = list(called)
    found = library(agreeing="come_to_agreement" in pending)
    wanted: set[str] = set()
    while pending:
        name = pending.pop()
        if name not in wanted and name in found.calls:
            wanted.add(name)
            pending.extend(found.calls[name])
    kept = tuple(replace(f, public=False) for f in found.functions if f.name in wanted and not f.external)
    return Module(name="solver", functions=kept)


def _calls(node: object) -> Iterator[str]:
    """The names of the functions that something calls."""
    if isinstance(node, Call):
        yield node.function
    if isinstance(node, tuple):
        for each in node:
            yield from _calls(each)
    elif is_dataclass(node):
        for each in fields(node):
            yield from _calls(getattr(node, each.name))
