"""All solves of a problem → Result; starts given from outside → SI."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mbm.expression.units import parse_unit
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.report import faults
from mbm.report.from_solution import failure_report, quantity_of, solve_report
from mbm.report.initial import initial_values
from mbm.report.options import Progress
from mbm.report.types import Floats, InputFile, Result
from mbm.solution.run import Solutions
from mbm.solution.solution import Failure
from mbm.text.types import MbmError
from mbm.version import __version__


@np.errstate(all="ignore")  # overflow and NaN are results here: they are found, and reported, where they matter
def result_of(
    problem: Problem,
    raw: Mapping[str, Table],
    solutions: Solutions,
    *,
    file: str | None,
    covariance_full: bool,
    progress: Progress | None,
) -> Result:
    """The result of all solves, in their order; ``progress`` hears of each."""
    reports = []
    for solution in solutions.each:
        if isinstance(solution, Failure):
            reports.append(failure_report(solution))
        else:
            reports.append(solve_report(problem, solution, covariance_full=covariance_full))
        if progress is not None:
            progress(len(reports), solutions.count)
    request = problem.request
    return Result(
        version=__version__,
        file=file,
        problem=problem.name,
        seed=request.seed,
        solves=tuple(reports),
        options={
            "method": request.method.value,
            "max-iterations": request.max_iterations,
            "tolerance": request.tolerance,
        },
        inputs=tuple(
            InputFile(path=t.provenance.path, sha256=t.provenance.sha256, rows=t.provenance.rows) for t in raw.values()
        ),
        diagnostics=problem.warnings,
    )


def given_starts(
    problem: Problem, init: Mapping[str, object] | None
) -> Callable[[Mapping[str, CellKey]], Mapping[str, Floats]]:
    """Starts in SI by name for the solve with a key, from values by name or a result document.

    Plain numbers are in the unit that the unknown is reported in; entries of a document carry theirs.
    """
    factors = {u.name: quantity_of(problem, u).factor for u in problem.unknowns}

    def starts(key: Mapping[str, CellKey]) -> Mapping[str, Floats]:
        if init is None:
            return {}
        found = {}
        for name, given in initial_values(init, key).items():
            if name not in factors:
                raise MbmError(faults.bad_initial_value(name, "a value for a name that is no unknown"))
            unit = parse_unit(given.unit) if given.unit is not None else None
            factor = unit.factor if unit is not None else factors[name]
            value = np.asarray(given.value * factor, dtype=np.float64)
            if bool(np.isfinite(value).all()):
                found[name] = value
        return found

    return starts
