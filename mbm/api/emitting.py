"""What ``mbm compile`` does: a problem as the files of a solver that needs no mbm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mbm import compiler
from mbm.api.problem import opened
from mbm.compiler import Inputs
from mbm.problem.overrides import Override

if TYPE_CHECKING:
    from mbm.emit.types import OutputFile
    from mbm.report.options import SolveOptions


def emit_file(path: str | Path, options: SolveOptions, target: str) -> tuple[OutputFile, ...]:
    """The files of a solver for a problem; ``target`` is ``c``, ``python`` or ``casadi``.

    Of ``options`` count the problem's name, constants and starts, the files of tables, initial values, and the sandbox.
    The data decide nothing but the test that comes with the solver, and where it begins if neither the problem nor the
    initial values say.

    Raises:
        MbmError: the problem or its data are wrong, or it has something that generated solvers do not have.

    """
    problem = opened(path, sandbox=options.sandbox)
    inputs = Inputs(
        paths={name: str(given) for name, given in options.data.items()},
        overrides={name: Override(name=name, text=text) for name, text in options.set},
        sandbox=options.sandbox,
    )
    found = compiler.elaborated(problem.program, options.problem, inputs, problem.registry)
    return compiler.emitted(found, target, problem.registry, options.init)
