"""All solves of a problem → Result."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Consensus, GivenStarts, Overrides, Problem, RandomStarts
from mbm.report import faults
from mbm.report.blocks import BlockReports, ManyReports, block_reports, report_of
from mbm.report.initial import initial_option
from mbm.report.options import Progress
from mbm.report.types import InputFile, Result, SolveReport
from mbm.solution.many.types import Block
from mbm.solution.run import Solutions
from mbm.version import __version__


@np.errstate(all="ignore")  # overflow and NaN are results here: they are found, and reported, where they matter
def result_of(
    problem: Problem,
    raw: Mapping[str, Table],
    solutions: Solutions,
    *,
    file: str | None,
    asked: Mapping[str, object],
    covariance_full: bool,
    progress: Progress | None,
) -> Result:
    """The result of all solves, in their order; ``asked`` is `asked_options`, ``progress`` hears of each solve."""
    reports: list[SolveReport] = []
    blocks: list[BlockReports] = []
    done = 0
    for part in solutions.parts:
        if isinstance(part, Block):
            blocks.append(block_reports(problem, part, covariance_full=covariance_full))
            done += len(part.which)
        else:
            reports.append(report_of(problem, part, covariance_full=covariance_full))
            done += 1
        if progress is not None:
            progress(done, solutions.count)
    request = problem.request
    left = solutions.count - done
    return Result(
        version=__version__,
        file=file,
        problem=problem.name,
        seed=request.seed,
        solves=ManyReports(blocks) if blocks else tuple(reports),
        options={
            "method": request.method.value,
            "max-iterations": request.max_iterations,
            "tolerance": request.tolerance,
            **_starts_option(request.starts),
            **_robust_option(request.robust),
            **_constraints_option(problem),
            **asked,
        },
        inputs=tuple(
            InputFile(path=t.provenance.path, sha256=t.provenance.sha256, rows=t.provenance.rows) for t in raw.values()
        ),
        diagnostics=(*problem.warnings, *((faults.interrupted(done, left),) if left else ())),
        complete=not left,
    )


def _robust_option(consensus: Consensus | None) -> Mapping[str, object]:
    """How outliers are looked for; nothing where they are not."""
    if consensus is None:
        return {}
    given = {"trials": consensus.trials, "threshold": consensus.threshold}
    return {"robust": {"kind": consensus.kind.value, **{name: x for name, x in given.items() if x is not None}}}


def _constraints_option(problem: Problem) -> Mapping[str, object]:
    """How constraints are met; nothing where there are none."""
    bound = any(block.role is BlockRole.CONSTRAINT for block in problem.blocks)
    return {"constraints": problem.request.constraints.value} if bound else {}


def _starts_option(starts: RandomStarts | GivenStarts | None) -> Mapping[str, object]:
    if starts is None:
        return {}
    if isinstance(starts, RandomStarts):
        return {"starts": {"random": starts.count, **({} if starts.seed is None else {"seed": starts.seed})}}
    return {"starts": {"given": len(starts.starts)}}


def asked_options(
    backend: str, overrides: Overrides, paths: Mapping[str, str], init: Mapping[str, object] | None
) -> Mapping[str, object]:
    """What the caller asked for beyond the file, as the document's ``options`` hold it; nothing that was not given.

    ``set`` holds texts as typed, and numbers in SI; ``init`` see `initial_option`.
    """
    found: dict[str, object] = {"backend": backend}
    if overrides:
        found["set"] = {
            o.name: o.text if o.text is not None else _number_or_list(o.values or ()) for o in overrides.values()
        }
    if paths:
        found["data"] = dict(paths)
    if init is not None:
        found["init"] = initial_option(init)
    return found


def _number_or_list(values: tuple[float, ...]) -> object:
    return values[0] if len(values) == 1 else list(values)
