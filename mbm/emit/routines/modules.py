"""The solver and the routines of generated solvers as one module of the target language, as far as it is called."""

from __future__ import annotations

from collections.abc import Iterable
from types import FunctionType

from mbm.emit.routines import agreement, forms, freedom, noises, rooms, rotations, rows, sandwich, systems, whitening
from mbm.target.from_python import module_of
from mbm.target.solver import batch, consensus_description, covariance, deficient, manifolds, workspace
from mbm.target.tree import CALL_KERNEL, Module

PARTS = (
    batch,
    consensus_description,
    covariance,
    deficient,
    manifolds,
    workspace,
    freedom,
    systems,
    whitening,
    rotations,
    rows,
    noises,
    sandwich,
    forms,
    rooms,
    agreement,
)
"""The files that have what generated texts call by its name."""


def emitted_module(called: Iterable[str]) -> Module:
    """The functions of these names with all that they call, none of them public; a kernel takes a row at a time."""
    known = {name: f for part in PARTS for name, f in vars(part).items() if isinstance(f, FunctionType)}
    found = module_of("solver", [known[name] for name in called], public=False, constants={"LANES": 1})
    return Module(name=found.name, functions=tuple(f for f in found.functions if f.name != CALL_KERNEL.name))
