"""What ``mbm view`` does: a picture of models, or of a solved problem, as bytes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbm import compiler
from mbm.api.arguments import threads
from mbm.api.compilation import compilation_of
from mbm.api.files import inputs_of
from mbm.api.problem import Problem, opened
from mbm.report.figures import require_matplotlib
from mbm.report.view.models import solids_of_definitions, solids_of_forms
from mbm.report.view.wishes import Wishes, model_panels, page_bytes, problem_panels
from mbm.text.types import Diagnostic
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.report.options import SolveOptions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A picture in bytes; ``notes`` say in words what was left out, ``doubts`` what speaks against trusting it."""

    content: bytes
    notes: tuple[str, ...] = ()
    doubts: tuple[Diagnostic, ...] = ()
    trusted: bool = True


def view_file(path: str | Path, options: SolveOptions, wishes: Wishes, ending: str) -> Picture:
    """The picture of a file in the format ``ending``, such as ``.png``.

    Models are drawn where `wishes` names them, or the file has no problem; else the problem is solved, as `solve_file`
    does, and its images, scene or map are drawn.

    Raises:
        MbmError: the problem, the data or the call is wrong, or there is nothing to draw.

    """
    require_matplotlib()
    problem = opened(path, sandbox=options.sandbox)
    registry, program = problem.registry, problem.program
    if wishes.models:
        solids = solids_of_forms(program, registry.vocabulary(), registry.limits, wishes.models)
    elif not problem.names:
        solids = solids_of_definitions(program, registry.vocabulary(), registry.limits, dict(options.set))
    else:
        return _of_problem(problem.named(options.problem) if options.problem else problem, options, wishes, ending)
    if options.loaded is not None:
        options.loaded()
    return Picture(content=page_bytes(model_panels(solids).panels, ending))


def _of_problem(problem: Problem, options: SolveOptions, wishes: Wishes, ending: str) -> Picture:
    inputs, settings = inputs_of(options), replace(options, workers=threads(options.workers))
    made = compilation_of(problem, inputs, options.backend.value)
    if options.loaded is not None:
        options.loaded()
    viewed = compiler.viewed(
        made.elaborated, made.kernels, problem.program, inputs, settings, made.cache, problem.registry, wishes.solve
    )
    found, report = problem_panels(viewed, wishes), viewed.report
    return Picture(
        content=page_bytes(found.panels, ending),
        notes=found.notes if report.status.trusted else (report.message, *found.notes),
        doubts=report.diagnostics,
        trusted=report.status.trusted,
    )
