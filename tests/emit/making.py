"""Generated solvers in folders."""

from __future__ import annotations

import functools
import subprocess
from pathlib import Path

import mbm
from mbm import compiler
from mbm.api.problem import Problem
from mbm.compiler import Inputs
from mbm.emit.types import OutputFile

PROBLEMS = Path(__file__).parents[2] / "problems"


def emitted(problem: Problem, target: str) -> tuple[OutputFile, ...]:
    """The files for a problem."""
    found = compiler.elaborated(problem.program, problem.name, Inputs(), problem.registry)
    return compiler.emitted(found, target, problem.registry)


@functools.cache
def of_text(text: str, target: str) -> tuple[OutputFile, ...]:
    """The files for the only problem of a text; the same text always gives the same files."""
    return emitted(mbm.loads(text), target)


def written(files: tuple[OutputFile, ...], folder: Path) -> Path:
    """The folder with the files."""
    for file in files:
        place = folder / file.path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(file.content)
    return folder


def run(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command in a folder."""
    return subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
