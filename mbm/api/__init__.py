"""What ``import mbm`` offers, and what the command line calls: problems from text or values, solved and explained."""

from __future__ import annotations

from mbm.api.compiled import CompiledProblem
from mbm.api.files import check, expand, explain, simulate_file, solve_file
from mbm.api.problem import Problem, build, load, loads
from mbm.report.answer import Solved
from mbm.text.from_python import keyword, symbol
from mbm.text.types import MbmError

__all__ = [
    "CompiledProblem",
    "MbmError",
    "Problem",
    "Solved",
    "build",
    "check",
    "expand",
    "explain",
    "keyword",
    "load",
    "loads",
    "simulate_file",
    "solve_file",
    "symbol",
]
