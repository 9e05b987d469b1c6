"""All of the solver as one module of the target language."""

from __future__ import annotations

from mbm.target import chi_square, decisions, step_control
from mbm.target.from_python import module_of
from mbm.target.solver import (
    batch,
    beginning,
    constraint_values,
    constraints,
    covariance,
    deficient,
    equations,
    linear_algebra,
    losses,
    manifolds,
    newton,
    normal_equations,
    places,
    polishing,
    pushing,
    slopes,
    steps,
    surface,
    sweeps,
    tangent,
    trials,
    trust_region,
    united,
    working,
    workspace,
)
from mbm.target.tree import Module

PARTS = (
    step_control,
    linear_algebra,
    losses,
    manifolds,
    workspace,
    united,
    equations,
    slopes,
    normal_equations,
    sweeps,
    steps,
    newton,
    places,
    trials,
    trust_region,
    beginning,
    tangent,
    decisions,
    deficient,
    covariance,
    constraint_values,
    working,
    surface,
    polishing,
    constraints,
    pushing,
    chi_square,
    batch,
)
"""The files of the solver, those that are called before those that call them."""


def solver_module(lanes: int) -> Module:
    """The solver for kernels that take ``lanes`` rows at a time."""
    functions = [function for part in PARTS for function in part.ROUTINES]
    return module_of("solver", functions, public=(*batch.PUBLIC, "chi_square_tails"), constants={"LANES": lanes})
