"""The dense solvers by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.solution.solvers.dogleg import DOGLEG
from mbm.solution.solvers.gauss_newton import GAUSS_NEWTON
from mbm.solution.solvers.linear import LINEAR
from mbm.solution.solvers.marquardt import MARQUARDT
from mbm.solution.solvers.standing import STANDING
from mbm.solution.types import Solver

SOLVERS: Mapping[str, Solver] = MappingProxyType(
    {solver.name: solver for solver in (LINEAR, MARQUARDT, DOGLEG, GAUSS_NEWTON, STANDING)}
)
