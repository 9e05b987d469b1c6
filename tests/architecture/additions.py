"""Made-up additions, each to as few files as CONTRIBUTING says: what is put into which file, and before what."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

OPERATION: Mapping[str, tuple[tuple[str, str], ...]] = {
    "mbm/expression/nodes.py": (('    ATANH = "atanh"', '    ERF = "erf", Operator.ERF\n'),),
    "mbm/language/vocabulary/arithmetic.py": (
        ("    _function(Operation.ATANH", '    _function(Operation.ERF, "The error function."),\n'),
    ),
}
"""The error function, as an elementary operation."""

FUNCTION = {
    "mbm/language/vocabulary/arithmetic.py": (
        (
            "FUNCTIONS: tuple",
            """def _softplus(call: Call) -> Value:
    def softplus(x: Expression) -> Expression:
        return apply(Operation.LOG, algebra.add(Number(1, NONE), apply(Operation.EXP, x)), span=call.span)

    return elementwise(softplus, call.arguments, _spans(call), call.span)


""",
        ),
        (
            "    _function(Operation.SQRT",
            '    Builtin("softplus", "(softplus x)", "log(1 + exp(x)).", 1, 1, _softplus),\n',
        ),
    ),
}
"""A function of the vocabulary that is made of others."""

LOSS = {
    "mbm/problem/kinds.py": (('    BARRON = "barron"', '    WELSCH = "welsch"\n'),),
    "mbm/solver/losses.py": (
        ("\n@dataclass", "WELSCH = 7\n"),
        ('        "barron": LossTraits', '        "welsch": LossTraits(number=WELSCH),\n'),
        (
            "    if shape == 2.0:\n        return square",
            "    if kind == WELSCH:\n        return -c2 * expm1(-t)\n",
        ),
        ("    if shape == 2.0:\n        return 1.0", "    if kind == WELSCH:\n        return exp(-t)\n"),
        ("    if shape == 2.0:\n        return 0.0", "    if kind == WELSCH:\n        return -exp(-t) / c2\n"),
    ),
}
"""ρ(s) = c² (1 − exp(−s/c²)) (Dennis and Welsch 1978)."""

METHOD = {
    "mbm/problem/types.py": (('    IPOPT = "ipopt"', '    HALFWAY = "halfway"\n'),),
    "mbm/solver/description.py": (
        ("RULES: Mapping", "HALFWAY = 3\n"),
        ('"gauss-newton": GAUSS_NEWTON', '"halfway": HALFWAY, '),
    ),
    "mbm/solver/steps.py": (
        ("from mbm.solver.description import", "from mbm.solver.description import HALFWAY\n"),
        (
            "    elif problem.rule == DOGLEG:",
            """    elif problem.rule == HALFWAY:
        if length > radius:
            for j in range(n):
                step[j] *= 0.5 * radius / length
""",
        ),
    ),
}
"""A rule of steps: the undamped step, and half the trust radius where it is longer than that."""

READER = {
    "mbm/data/readers/__init__.py": (('"g2o",', '"semicolons", '),),
    "mbm/data/readers/semicolons.py": (
        (
            "",
            '''"""Lines of numbers between semicolons, under a line with the names of the columns."""

from __future__ import annotations

from pathlib import Path

from mbm.data.content import BLANKS, read_text
from mbm.data.readers.fields import line_numbers, lines_of, number_columns, number_table
from mbm.data.types import RawTable, Reader


def read(path: Path) -> RawTable:
    """Read a file."""
    text, digest = read_text(path, between=BLANKS)
    (_, names), *lines = lines_of(text, separator=";")
    numbers = number_table(lines, tuple(names), path.as_posix())
    rows = line_numbers(number for number, _ in lines)
    return RawTable(path=path.as_posix(), sha256=digest, columns=number_columns(names, numbers), file_rows=rows)


READER = Reader(name="semicolons", extensions=(".semicolons",), read=read)
''',
        ),
    ),
}
"""A file format."""

FIELD = {
    "mbm/report/types.py": (("    log_likelihood: float | None = None", "    norm: float | None = None\n"),),
    "mbm/report/numbers.py": (
        (
            '    SummaryNumber(name="robust_cost"',
            '    SummaryNumber(name="norm", of=lambda s: s.fit.cost**0.5, columns=lambda c: c.cost**0.5),\n',
        ),
    ),
    "mbm/report/sentences.py": (
        (
            "    raw = solve.raw_residuals() if solve.residual_summaries else {}",
            """    if solve.norm is not None:
        yield f"norm of the residuals {plain(solve.norm, 4)}"
""",
        ),
    ),
}
"""A number of each solve: the norm of its residuals."""

FILES = {
    "operation": (OPERATION, 4),
    "function": (FUNCTION, 1),
    "loss": (LOSS, 2),
    "method": (METHOD, 3),
    "reader": (READER, 2),
    "field": (FIELD, 3),
}
"""The additions, with the files that each may take."""


def make(tree: Path, addition: Mapping[str, tuple[tuple[str, str], ...]]) -> None:
    """Put an addition into a copy of the sources."""
    for name, parts in addition.items():
        path = tree / name
        text = path.read_text("utf-8") if path.exists() else ""
        for before, part in parts:
            if text.count(before) != 1 and before:
                message = f"{name} has {before!r} {text.count(before)} times"
                raise ValueError(message)
            text = text.replace(before, part + before, 1)
        path.write_text(text, "utf-8")
