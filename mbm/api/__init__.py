"""What ``import mbm`` offers, and what the command line calls; each name is loaded when it is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mbm.api.compiled import CompiledProblem
    from mbm.api.files import (
        budget_file,
        check,
        design_file,
        expand,
        explain,
        propagate_file,
        sequences,
        simulate_file,
        solve_file,
        trajectory_file,
    )
    from mbm.api.problem import Problem, build, load, loads
    from mbm.api.viewing import view_file
    from mbm.report.answer import Solved
    from mbm.report.solve import Solve
    from mbm.text.from_python import keyword, symbol
    from mbm.text.types import MbmError

_ROOMS = (
    ("mbm.api.compiled", ("CompiledProblem",)),
    ("mbm.api.files", ("budget_file", "check", "design_file", "expand", "explain", "propagate_file", "sequences")),
    ("mbm.api.files", ("simulate_file", "solve_file", "trajectory_file")),
    ("mbm.api.problem", ("Problem", "build", "load", "loads")),
    ("mbm.api.viewing", ("view_file",)),
    ("mbm.report.answer", ("Solved",)),
    ("mbm.report.solve", ("Solve",)),
    ("mbm.text.from_python", ("keyword", "symbol")),
    ("mbm.text.types", ("MbmError",)),
)
__all__ = ["CompiledProblem", "MbmError", "Problem", "Solve", "Solved", "budget_file", "build", "check", "expand"]
__all__ += ["explain", "keyword", "load", "loads", "propagate_file", "simulate_file", "solve_file", "symbol"]
__all__ += ["design_file", "sequences", "trajectory_file", "view_file"]


def __getattr__(name: str) -> Any:
    for room, names in _ROOMS:
        if name in names:
            return getattr(import_module(room), name)
    raise AttributeError(f"module `mbm.api` has no attribute `{name}`")
