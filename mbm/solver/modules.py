"""The solver, consensus and filters as modules of the little language: what is called, and all that it calls."""

from __future__ import annotations

from mbm.machine.from_python import module_of
from mbm.machine.tree import Module
from mbm.solver.batch import finish_solve, go_on, place_promises, set_end, solve_many, start_solve
from mbm.solver.chi_square import chi_square_tails
from mbm.solver.consensus import consensus_in_portions, consensus_many
from mbm.solver.filter_keeping import begin_walk
from mbm.solver.filters import filter_steps
from mbm.solver.lags import lag_scores
from mbm.solver.minimal_pose import poses_of_many
from mbm.solver.noise_roots import roots_of_covariances
from mbm.solver.smoother_all import smooth_all, spread_along
from mbm.solver.smoother_cuts import renew_cuts
from mbm.solver.smoother_growing import growing_answers, growing_steps
from mbm.solver.smoother_lag import carry_on, lag_end, lag_steps
from mbm.solver.spheres import places_of_many
from mbm.solver.tables import evaluate_rows


def solver_module(lanes: int) -> Module:
    """The solver for kernels that take ``lanes`` rows at a time."""
    solving = (start_solve, go_on, set_end, finish_solve, solve_many, place_promises)
    roots = (*solving, chi_square_tails, places_of_many, poses_of_many, lag_scores)
    return module_of("solver", roots, constants={"LANES": lanes})


def consensus_module(lanes: int) -> Module:
    """Consensus likewise: beside the solver, for few problems ask it."""
    return module_of("consensus", (consensus_many, consensus_in_portions), constants={"LANES": lanes})


def lags_module(lanes: int) -> Module:
    """What tells correlated residuals, alone: it is made to run fast in less than a tenth of a second."""
    return module_of("lags", (lag_scores,), constants={"LANES": lanes})


def filters_module(lanes: int) -> Module:
    """Filters and smoothers likewise."""
    lagging = (lag_steps, lag_end, carry_on, growing_steps, growing_answers)
    roots = (begin_walk, filter_steps, smooth_all, spread_along, renew_cuts, *lagging, roots_of_covariances)
    return module_of("filters", roots, constants={"LANES": lanes})


def tables_module(lanes: int) -> Module:
    """What evaluates kernels over tables."""
    return module_of("tables", (evaluate_rows,), constants={"LANES": lanes})
