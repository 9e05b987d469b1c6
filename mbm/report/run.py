"""All solves of a problem → Result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mbm.estimation.intervals.network import Enclosure
from mbm.estimation.run import Solutions
from mbm.estimation.search.solution import Alone, Failure, Skipped, Solution
from mbm.problem.overrides import Overrides
from mbm.problem.requests import Enclosing, GivenStarts, RandomStarts
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Consensus, Method, Problem, Request
from mbm.report.from_solution import report_of
from mbm.report.later import LaterByNumber, LaterReports
from mbm.report.options import Progress
from mbm.report.types import InputFile, Result, SolveReport
from mbm.text.types import Code, Diagnostic, MbmError
from mbm.version import __version__

if TYPE_CHECKING:
    from mbm.report.blocks import BlockReports, Kind


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
    lock: AbstractContextManager[object],
) -> Result:
    """The result of all solves, in their order; ``asked`` is `asked_options`, ``progress`` hears of each solve.

    Reports that are made later hold the ``lock`` meanwhile.

    Raises:
        MbmError: nothing was solved, since no solve could be set up with its data; with what is doubtful about these.

    """
    reports: list[Callable[[], SolveReport]] = []
    blocks: list[BlockReports] = []
    models: dict[Kind, SolveReport] = {}
    alone: dict[int, Callable[[], SolveReport]] = {}
    failures: list[Failure] = []
    done = solved = 0
    for part in solutions.parts:
        if isinstance(part, Solution | Enclosure | Failure | Skipped):
            reports.append(partial(report_of, problem, part, covariance_full=covariance_full))
            apart, count = [part], 1
        elif isinstance(part, Alone):
            alone[part.place] = partial(report_of, problem, part.solution, covariance_full=covariance_full)
            apart, count = [part.solution], 1
        else:
            from mbm.report.blocks import block_reports

            blocks.append(block_reports(problem, part, models, covariance_full=covariance_full))
            apart, count = [*part.apart.values()], len(part.which)
        done += count
        solved += count - sum(not isinstance(each, Solution | Enclosure) for each in apart)
        failures += [each for each in apart if isinstance(each, Failure)]
        if progress is not None:
            progress(done, solutions.count)
    request = problem.request
    left = solutions.count - done
    if failures and not solved and not left:
        raise MbmError(*_kinds(failures), *problem.warnings)
    return Result(
        version=__version__,
        file=file,
        problem=problem.name,
        seed=request.seed,
        solves=_joined(blocks, LaterByNumber(alone, lock)) if blocks or alone else LaterReports(reports, lock),
        options={
            "method": _method(problem),
            "max-iterations": request.max_iterations,
            "tolerance": request.tolerance,
            "coverage": request.coverage,
            **_starts_option(request.starts),
            **_robust_option(request.robust),
            **_constraints_option(problem),
            **_enclosing_option(request),
            **asked,
        },
        inputs=_inputs(raw),
        diagnostics=(*problem.warnings, *_interrupted(done, left)),
        complete=not left,
    )


def unsolved(problem: Problem, raw: Mapping[str, Table], *, file: str | None, asked: Mapping[str, object]) -> Result:
    """The result of no solve: what was read."""
    return Result(
        version=__version__,
        file=file,
        problem=problem.name,
        seed=problem.request.seed,
        solves=(),
        options=asked,
        inputs=_inputs(raw),
        diagnostics=problem.warnings,
    )


def _method(problem: Problem) -> str:
    """The method that the problem asks for; where none is named, the estimator of states."""
    if problem.sequence is None or problem.request.method is not Method.AUTO:
        return problem.request.method.value
    return problem.sequence.estimator.method.value


def _inputs(raw: Mapping[str, Table]) -> tuple[InputFile, ...]:
    """The files that tables were read from."""
    return tuple(
        InputFile(path=origin.path, sha256=origin.sha256, rows=origin.rows)
        for table in raw.values()
        for origin in table.provenance.origins_of_rows()
    )


def _kinds(failures: Sequence[Failure]) -> tuple[Diagnostic, ...]:
    """What is wrong, each kind as it was met first: many solves have it with many numbers."""
    found: dict[Code, Diagnostic] = {}
    for failure in failures:
        for diagnostic in failure.diagnostics:
            found.setdefault(diagnostic.code, diagnostic)
    return tuple(found.values())


def _joined(blocks: list[BlockReports], alone: Mapping[int, SolveReport]) -> Sequence[SolveReport]:
    from mbm.report.blocks import ManyReports

    return ManyReports(blocks, alone)


def _interrupted(done: int, left: int) -> tuple[Diagnostic, ...]:
    """The warning that ``left`` solves were not made, if any."""
    if not left:
        return ()
    from mbm.report import faults

    return (faults.interrupted(done, left),)


def _robust_option(consensus: Consensus | None) -> Mapping[str, object]:
    """How outliers are looked for; nothing where they are not."""
    if consensus is None:
        return {}
    given = {"trials": consensus.trials, "threshold": consensus.threshold, "quantile": consensus.quantile}
    return {"robust": {"kind": consensus.kind.value, **{name: x for name, x in given.items() if x is not None}}}


def _enclosing_option(request: Request) -> Mapping[str, object]:
    """What interval methods are asked for; nothing of other methods."""
    if request.method is not Method.INTERVAL:
        return {}
    asked = request.enclosing or Enclosing()
    widths = {name: [float(each.value) for each in stated] for name, stated in asked.widths.items()}
    own = {"widths": widths} if widths else {}
    return {"interval": {"contract": asked.contractor.value, "width": asked.fraction, **own, "boxes": asked.boxes}}


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
        from mbm.report.initial import initial_option

        found["init"] = initial_option(init)
    return found


def _number_or_list(values: tuple[float, ...]) -> object:
    return values[0] if len(values) == 1 else list(values)
