"""Kernels, programs of data, and quantities computed from the estimates, as C functions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from mbm.emit.c.cells import Cells
from mbm.emit.c.text import bare, comment, remark, wrapped
from mbm.emit.foreign import Foreign, Word, told
from mbm.emit.identifiers import RESERVED
from mbm.emit.routines.derived import OPEN
from mbm.emit.statements import ARITHMETIC, Dialect, called, statements
from mbm.emit.system import StaticSystem, varies
from mbm.emit.types import BlockCase, Blueprint, DerivedShape
from mbm.machine.c import number
from mbm.machine.program import Operator, Program
from mbm.solver import description as at

_SPREAD = """/* The column of the coordinate at a place: -1: it stays, {open}: the data do not determine it. */
static long column_of(const struct frame *f, long place)
{{
    return f->column[place] >= 0 || f->fixed[place] ? f->column[place] : {open};
}}

/* The standard deviation of quantity `row` of those with the derivatives `slopes`, by linear propagation; negative
 * where the data do not determine it, only limits hold it, or it has no derivative at the estimates. */
static double spread_of(struct frame *f, long row, long count, const long *rows, const long *tangents,
    const long *columns, const double *slopes, double *gradient)
{{
    const long n = f->system->n;
    double variance = 0.0;
    long i, j;

    if (!gather_gradient(n, row, count, rows, tangents, columns, slopes, gradient))
        return -1.0;
    if (f->states[{deficient}] != 0 && !determines(f->system, gradient, &f->work))
        return -1.0;
{untold}    for (i = 0; i < n; i++) {{
        if (gradient[i] == 0.0)
            continue;
        if (!(f->covariance[i * n + i] >= 0.0))
            return -1.0;
        for (j = 0; j < n; j++)
            if (gradient[j] != 0.0)
                variance += gradient[i] * f->covariance[i * n + j] * gradient[j];
    }}
    if (!isfinite(variance) || held_by_limits(f->system, &f->work, gradient, row, count, rows, tangents, columns))
        return -1.0;
    return variance > 0.0 ? sqrt(variance) : 0.0;
}}
"""
_UNTOLD = """    if (is_untold(n, f->apart, f->covariances, gradient))
        return -1.0;
"""


def derived_kernels(blueprint: Blueprint) -> Iterator[str]:
    """The functions that compute the quantities and their derivatives."""
    for derived in blueprint.derived:
        for case in derived.cases:
            head = told(derived.name, ", and behind it its derivatives that are not zero everywhere.")
            yield function(
                f"{case.identifier}_derived",
                case.kernel.jacobian_program,
                case.input_names,
                [head, "", *(told("    ", line) for line in case.text)],
            )


def derived_functions(blueprint: Blueprint, static: StaticSystem) -> str:
    """One function for each quantity; it answers 0 where a row is in none of its cases."""
    if not blueprint.derived:
        return ""
    cells = Cells(blueprint)
    spread = _SPREAD.format(deficient=at.DEFICIENT, open=OPEN, untold=_UNTOLD if static.told else "")
    return "\n".join([spread, *("\n".join(_function(cells, each)) for each in blueprint.derived)])


def estimates(blueprint: Blueprint) -> str:
    """The array of the estimates: the numbers of the solver, or a copy of them as they are reported, where that may
    differ: angles in (-pi, pi], quaternions with a positive first number.
    """
    return "estimates" if any(u.angles or u.quaternions for u in blueprint.unknowns) else "point"


def capacity(cells: Cells, derived: DerivedShape) -> str:
    """Numbers that a quantity takes at most."""
    return str(derived.size) if derived.table is None else f"{derived.size} * {cells.rows(derived.table)}"


def patterns(derived: DerivedShape) -> Iterator[str]:
    """Declarations of a function that evaluates a quantity: which derivatives each case has, and room for one row."""
    for place, case in enumerate(derived.cases, start=1):
        kernel = case.kernel
        for word, values in (("rows", kernel.jacobian_rows), ("tangents", kernel.jacobian_columns)):
            listed = ", ".join(str(int(v)) for v in values) or "0"
            yield f"    static const long {word}_{place}[] = {{{listed}}};"
    wide = max((len(c.variables) + len(c.parameters) for c in derived.cases), default=0)
    outputs = max((derived.size + len(c.kernel.jacobian_rows) for c in derived.cases), default=0)
    tangents = max((len(c.tangents) for c in derived.cases), default=0)
    yield from (
        f"    double inputs[{wide + 1}], outputs[{outputs + 1}];",
        f"    long columns[{tangents + 1}], c;",
    )


def evaluated(
    case: BlockCase, variables: Iterable[str], parameters: Iterable[str], columns: Iterable[str]
) -> Iterator[str]:
    """Statements that evaluate a case of a quantity at these numbers; ``columns`` of its tangents are put, too."""
    yield from (f"inputs[{i}] = {value};" for i, value in enumerate((*variables, *parameters)))
    yield from (
        *(f"columns[{i}] = {value};" for i, value in enumerate(columns)),
        f"{case.identifier}_derived(inputs, outputs);",
    )


def found_number(derived: DerivedShape) -> str:
    """Number ``c`` of a quantity that was evaluated."""
    return "turned_to(outputs[c], 0.0)" if derived.angle else "outputs[c]"


def slopes(derived: DerivedShape, place: int) -> str:
    """What `gather_gradient` is given of case ``place`` of a quantity that was evaluated."""
    count = len(derived.cases[place].kernel.jacobian_rows)
    return f"{count}, rows_{place + 1}, tangents_{place + 1}, columns, outputs + {derived.size}"


def tests(cells: Cells, case: BlockCase) -> str:
    """The condition that the row at hand is in a case."""
    return " && ".join(cells.equals(value, key) for value, key in case.static)


def _function(cells: Cells, derived: DerivedShape) -> Iterator[str]:
    over = "once" if derived.table is None else told("for each row of `", derived.table, "`")
    filtered = derived.table is not None and cells.blueprint.table(derived.table).where is not None
    yield from (
        remark(derived.name, ", ", over, "."),
        f"static int derive_{derived.identifier}(struct frame *f)",
        "{",
        f"    const {cells.blueprint.identifier}_data *data = f->data;",
        *patterns(derived),
        f"    long {'' if derived.table is None else 'i, ' if filtered else 'row, '}used = 0;",
        "",
        "    (void)data;",
    )
    opened, closed = cells.loop(derived.table)
    yield from opened
    if filtered and not any(cells.reads(case) or varies(cells.blueprint, case) for case in derived.cases):
        yield "        (void)row;"
    for place, case in enumerate(derived.cases):
        yield from (f"        {line}" for line in _case(cells, derived, case, place))
    if any(case.static for case in derived.cases):
        yield "        return 0;"
    yield from (
        *closed,
        f"    f->derived_{derived.identifier}_count = used;",
        "    return 1;",
        "}",
        "",
    )


def _case(cells: Cells, derived: DerivedShape, case: BlockCase, place: int) -> Iterator[str]:
    test = tests(cells, case)
    held = f"f->derived_{derived.identifier}"
    variables = (f"f->{estimates(cells.blueprint)}[{cells.slot(slot, 'offsets')}]" for slot in case.variables)
    columns = (f"column_of(f, {cells.slot(slot, 'firsts')})" for slot in case.tangents)
    yield from (
        f"if ({test}) {{" if test else "{",
        *(f"    {line}" for line in evaluated(case, variables, map(cells.input, case.parameters), columns)),
        f"    for (c = 0; c < {derived.size}; c++) {{",
        f"        {held}[used * {derived.size} + c] = {found_number(derived)};",
        f"        {held}_sigma[used * {derived.size} + c] = spread_of(f, c, {slopes(derived, place)}, f->spare);",
        "    }",
        "    used++;",
        "    continue;" if test else "}",
    )
    if test:
        yield "}"


HELPERS: Mapping[str, str] = {
    "kernel_sign": "(double a) { return a > 0.0 ? 1.0 : a < 0.0 ? -1.0 : a; }",
    "kernel_square": "(double a) { return a * a; }",
    "kernel_not": "(double a) { return a == 0.0 ? 1.0 : 0.0; }",
    "kernel_less": "(double a, double b) { return a < b ? 1.0 : 0.0; }",
    "kernel_less_equal": "(double a, double b) { return a <= b ? 1.0 : 0.0; }",
    "kernel_equal": "(double a, double b) { return a == b ? 1.0 : 0.0; }",
    "kernel_not_equal": "(double a, double b) { return a != b ? 1.0 : 0.0; }",
    "kernel_and": "(double a, double b) { return a != 0.0 && b != 0.0 ? 1.0 : 0.0; }",
    "kernel_or": "(double a, double b) { return a != 0.0 || b != 0.0 ? 1.0 : 0.0; }",
    "kernel_select": "(double test, double value) { return test != 0.0 ? value : 0.0; }",
}
"""Functions that C does not have; a file holds those that it uses."""
_NAMES = {o: helper if (helper := f"kernel_{o.name.lower()}") in HELPERS else o.value for o in Operator}
DIALECT = Dialect(
    shapes={**{o: called(name, o) for o, name in _NAMES.items()}, **ARITHMETIC},
    number=number,
    reserved=RESERVED.union(name for o, name in _NAMES.items() if o not in ARITHMETIC),
)


def kernel_functions(case: BlockCase) -> str:
    """The values of a kernel, and the values with the nonzeros of their Jacobian behind them."""
    head: list[Word] = [f"{case.identifier}: what should be zero in each row.", ""]
    head += [told("    ", line) for line in case.text]
    slopes: list[Word] = [
        f"{case.identifier}: the same, and behind it the derivatives that are not zero everywhere, in the order",
        "",
    ]
    slopes += _nonzeros(case)
    values = function(f"{case.identifier}_values", case.kernel.value_program, case.input_names, head)
    jacobian = function(f"{case.identifier}_slopes", case.kernel.jacobian_program, case.input_names, slopes)
    return f"{values}\n{jacobian}"


def _nonzeros(case: BlockCase) -> Iterator[Word]:
    for row, column in zip(case.kernel.jacobian_rows, case.kernel.jacobian_columns, strict=True):
        slot = case.tangents[int(column)]
        yield told(f"    d(component {int(row) + 1}) / d(", slot.shown, f", coordinate {slot.component + 1})")


def function(name: str, program: Program, names: Sequence[Foreign], doc: Iterable[Word]) -> str:
    """A function ``void name(const double *inputs, double *outputs)``."""
    made = statements(program, names, DIALECT)
    lines = [comment(doc), f"static void {name}(const double *inputs, double *outputs)", "{"]
    for identifier, position in made.inputs:
        shown = "" if names[position] == Foreign(identifier) else f"  {remark(names[position])}"
        lines.append(f"    const double {identifier} = inputs[{position}];{shown}")
    if not made.inputs:
        lines.append("    (void)inputs;")
    lines += wrapped(f"    const double {left} = {right};" for left, right in made.assignments)
    lines.append("")
    if not made.outputs:
        lines.append("    (void)outputs;")
    lines += wrapped(f"    outputs[{i}] = {text};" for i, text in enumerate(made.outputs))
    return "\n".join([*lines, "}", ""])


def helpers(text: str) -> str:
    """The definitions of the helpers that ``text`` calls."""
    code = bare(text)
    return "".join(f"static double {name}{body}\n" for name, body in HELPERS.items() if f"{name}(" in code)


def call_kernel(cases: Sequence[BlockCase]) -> str:
    """``call_kernel``: which function a number means."""
    lines = [
        "/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */",
        "static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)",
        "{",
        "    long row;",
        "",
        "    switch (kernel) {",
    ]
    for place, case in enumerate(cases):
        wide = len(case.variables) + len(case.parameters)
        for shift, word, count in (
            (0, "values", case.kernel.outputs),
            (1, "slopes", case.kernel.outputs + len(case.kernel.jacobian_rows)),
        ):
            lines += [
                f"    case {2 * place + shift}:",
                "        for (row = 0; row < rows; row++)",
                f"            {case.identifier}_{word}(inputs + row * {wide}, outputs + row * {count});",
                "        break;",
            ]
    return "\n".join([*lines, "    default:", "        break;", "    }", "}", ""])
