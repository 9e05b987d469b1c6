"""Which routines consensus consists of, in the order in which they call one another."""

from __future__ import annotations

from mbm.target import chi_square, step_control
from mbm.target.from_python import module_of
from mbm.target.solver import (
    consensus,
    consensus_begin,
    consensus_description,
    consensus_draw,
    consensus_forms,
    consensus_graduate,
    consensus_improve,
    consensus_joint,
    consensus_judge,
    consensus_laws,
    consensus_order,
    consensus_planes,
    consensus_refine,
    consensus_rows,
    consensus_rules,
    consensus_scores,
    consensus_settle,
    consensus_subset,
    consensus_trials,
    consensus_units,
    equations,
    linear_algebra,
    losses,
    manifolds,
    minimal_pose,
    minimal_quartic,
    minimal_spheres,
    slopes,
    united,
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
    consensus_description,
    consensus_draw,
    consensus_order,
    consensus_scores,
    chi_square,
    consensus_laws,
    minimal_spheres,
    minimal_quartic,
    minimal_pose,
    consensus_rows,
    consensus_units,
    consensus_judge,
    consensus_rules,
    consensus_refine,
    consensus_planes,
    consensus_forms,
    consensus_subset,
    consensus_graduate,
    consensus_trials,
    consensus_begin,
    consensus_joint,
    consensus_settle,
    consensus_improve,
    consensus,
)
"""The files of consensus and what they take from the solver, those that are called before those that call them."""


def consensus_module(lanes: int) -> Module:
    """Consensus for kernels that take ``lanes`` rows at a time: beside the solver, for few problems ask it."""
    functions = [function for part in PARTS for function in part.ROUTINES]
    return module_of("consensus", functions, public=("agree_many", "agree_by_and_by"), constants={"LANES": lanes})
