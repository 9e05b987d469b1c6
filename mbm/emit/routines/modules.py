"""The solver and the routines of generated solvers as one module of the target language, as far as it is called."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass, replace

from mbm.emit.routines import freedom, noises, rotations, rows, sandwich, systems, whitening
from mbm.target.from_python import module_of
from mbm.target.solver.modules import solver_module
from mbm.target.tree import CALL_KERNEL, Call, Module

PARTS = (freedom, systems, whitening, rotations, rows, noises, sandwich)


def emitted_module(called: Iterable[str]) -> Module:
    """The functions of these names with all that they call, none of them public; a kernel takes a row at a time."""
    solver = solver_module(lanes=1)
    routines = [function for part in PARTS for function in part.ROUTINES]
    own = [f for f in solver.functions if f.name != CALL_KERNEL.name]
    whole = module_of("routines", routines, external=own)
    by_name = {f.name: f for f in whole.functions}
    wanted: set[str] = set()
    pending = list(called)
    while pending:
        name = pending.pop()
        if name not in wanted and name in by_name:
            wanted.add(name)
            pending.extend(_calls(by_name[name]))
    kept = tuple(replace(f, public=False) for f in whole.functions if f.name in wanted and not f.external)
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
