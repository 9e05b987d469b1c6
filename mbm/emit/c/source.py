"""The text of ``<problem>_kernels.h``, ``<problem>_solver.h`` and ``<problem>.c``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from mbm.emit.c.agreement import agreement_constants
from mbm.emit.c.cells import input_name, program_name
from mbm.emit.c.clauses import clause_functions
from mbm.emit.c.derived import derived_functions, derived_kernels
from mbm.emit.c.frame import frame_text
from mbm.emit.c.kernels import function, helpers, kernel_functions
from mbm.emit.c.layout import doubles, longs
from mbm.emit.c.ranges import range_constants
from mbm.emit.c.solve import call_kernel, solve_functions
from mbm.emit.c.tables import programs_used, table_functions
from mbm.emit.c.text import comment, opening, remark
from mbm.emit.c.unknowns import unknown_functions
from mbm.emit.foreign import told
from mbm.emit.routines.modules import called_in_c, emitted_module
from mbm.emit.system import StaticSystem
from mbm.emit.types import BlockCase, Blueprint
from mbm.machine.c import number, prelude
from mbm.machine.c import text as module_text

LONG_CHECK = """#include <limits.h>
#if LONG_MAX < 0x1000000000000
#error "consensus draws its subsets with numbers of 48 bits: `long` is too short here"
#endif
"""


def kernels_file(blueprint: Blueprint, cases: Sequence[BlockCase]) -> str:
    """The equations, and the programs of data, as functions; kernel k is that of case k."""
    parts = [kernel_functions(case) for case in cases]
    parts += derived_kernels(blueprint)
    for case in cases:
        if case.noise is not None:
            names = [input_name(v) for v in case.noise.inputs]
            parts.append(
                function(f"{case.identifier}_noise", case.noise.program, names, [f"{case.identifier}: stated noise."])
            )
    for programs, words in programs_used(blueprint):
        for position, each in enumerate(programs.cases):
            names = [input_name(v) for v in each.inputs]
            parts.append(function(program_name(programs, position), each.program, names, [told(words, ".")]))
    body = "\n".join(parts)
    doc = [told(blueprint.name, ": its equations. Everything is in SI, angles in radians.")]
    constants = _constants(blueprint)
    return "\n".join([comment(doc), "", "#include <math.h>", "", helpers(body), body, call_kernel(cases), constants])


def _constants(blueprint: Blueprint) -> str:
    lines = [
        f"static const double constant_{c.identifier} = {number(c.value)};    {remark(c.name)}"
        for c in blueprint.constants
    ]
    return "\n".join(["/* Constants of the problem. */", *lines, ""]) if lines else ""


LEAST_SQUARES = "Least squares with Marquardt's method in a trust region: losses, bounds, constraints, covariance."


def solver_file(
    blueprint: Blueprint, source: str, what: str = LEAST_SQUARES, fixed: Mapping[str, int] = MappingProxyType({})
) -> str:
    """The solver, ``what`` in words: the same for all problems, as far as the text of this one calls it.

    ``fixed`` are fields of records that always have these values, ``record.field``.
    """
    doc = [what, "The same algorithm as mbm's own native solver; arrays are described where the solver is called."]
    text = module_text(emitted_module(called_in_c(source), fixed))
    checked = [LONG_CHECK] if blueprint.agreement is not None or blueprint.ranges is not None else []
    return "\n".join([comment(doc), "", prelude(text), *checked, text])


def source_file(blueprint: Blueprint, static: StaticSystem) -> str:
    """Data → arrays of the solver → answer."""
    name = blueprint.identifier
    parts = [
        *opening(name, told(blueprint.name, ": from tables to the arrays of the solver, and back.")),
        longs("SYSTEM", static.prefix, "How the solver's description of the equations begins: what no data change."),
        longs("UNKNOWNS", static.unknowns, "Of each unknown: numbers, coordinates, family, positive, pieces."),
        doubles("LOSSES", static.losses, "Parameter and shape of each loss."),
        *(() if blueprint.agreement is None else (agreement_constants(blueprint.agreement),)),
        *(() if blueprint.ranges is None else (range_constants(blueprint.ranges),)),
        f"static const double TOLERANCE = {number(blueprint.settings.tolerance)};"
        "    /* of the next step, in standard deviations */",
        "",
        frame_text(blueprint, static),
        table_functions(blueprint),
        unknown_functions(blueprint),
        clause_functions(blueprint),
        derived_functions(blueprint),
        solve_functions(blueprint, static),
        "",
    ]
    return "\n".join(parts)
