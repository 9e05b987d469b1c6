"""Problems solved for their pictures, as `mbm view` does."""

from __future__ import annotations

from pathlib import Path

from mbm import compiler
from mbm.api import load
from mbm.api.compilation import Origin, compilation_of
from mbm.api.problem import Problem, loads
from mbm.compiler import Inputs
from mbm.report.options import SolveSettings
from mbm.report.view.answers import Viewed

PROBLEMS = Path(__file__).parents[3] / "problems"


def solved(problem: Problem, number: int = 1) -> Viewed:
    inputs = Inputs()
    origin = Origin(reading=problem.reading, registry=problem.registry, file=problem.file, name=problem.name)
    made = compilation_of(origin, inputs, "auto")
    return compiler.viewed(
        made.elaborated, made.kernels, problem.program, inputs, SolveSettings(), made.cache, problem.registry, number
    )


def of_folder(folder: str, name: str) -> Viewed:
    return solved(load(PROBLEMS / folder / f"{folder}.mbm").named(name))


def of_text(text: str) -> Viewed:
    return solved(loads(text))
