"""The frame of a solve in C: where the arrays of one data set stand in the workspace that the caller gives. How much
memory the parts of a solve take.
"""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.agreement import agreement_fields, agreement_room, range_fields, range_room
from mbm.emit.c.cells import Cells
from mbm.emit.c.derived import capacity, estimates
from mbm.emit.c.text import remark
from mbm.emit.foreign import Foreign, told
from mbm.emit.reading import every_value
from mbm.emit.routines.noises import FOUND
from mbm.emit.routines.untold import ASSUMPTIONS
from mbm.emit.system import StaticSystem, kinds_of_units, weights_width
from mbm.emit.types import BlockShape, Blueprint, Choice, ColumnValue, InputValue
from mbm.problem.types import BlockRole
from mbm.solver import description as at
from mbm.solver.loss_pools import SUMS


def row_scratch(blueprint: Blueprint) -> tuple[int, int]:
    """Reals that a row wants: those that do not depend on n, and those for each of n."""
    plain = lines = 0
    for _, case in blueprint.cases:
        outputs = case.kernel.outputs
        own = len(case.variables) + len(case.parameters) + 2 * outputs + len(case.kernel.jacobian_rows)
        plain, lines = max(plain, own), max(lines, 2 * outputs)
    return plain, lines


def lossy(blueprint: Blueprint) -> bool:
    """Whether some clause has a loss."""
    return any(block.loss is not None for block in blueprint.blocks)


def spare_size(blueprint: Blueprint, static: StaticSystem) -> str:
    """Reals of scratch besides the solver's, as C text with ``n``."""
    plain, lines = row_scratch(blueprint)
    matrices = f"4 * n * n + {SUMS} + " if lossy(blueprint) else ""
    vectors = 2 if static.told else 0
    return f"{matrices}{FOUND + plain} + {lines + vectors} * n"


def outputs_capacity(blueprint: Blueprint, static: StaticSystem) -> int:
    """Numbers that the kernels put out at a time, at most."""
    chunk = static.prefix[at.Problem.chunk]
    return max(chunk // c.kernel.outputs * (c.kernel.outputs + len(c.kernel.jacobian_rows)) for _, c in blueprint.cases)


_HEAD = """/* Arrays of one data set, taken from the caller's workspace one after the other; nothing is allocated. */
struct arena {
    double *reals;
    long reals_used;
    long *integers;
    long integers_used;
};

static double *reals_of(struct arena *a, long count)
{
    double *found = a->reals != NULL ? a->reals + a->reals_used : NULL;
    a->reals_used += count;
    return found;
}

static long *integers_of(struct arena *a, long count)
{
    long *found = a->integers != NULL ? a->integers + a->integers_used : NULL;
    a->integers_used += count;
    return found;
}
"""


def frame_text(blueprint: Blueprint, static: StaticSystem) -> str:
    """The struct and the function that lays it out."""
    cells = Cells(blueprint)
    return "\n".join([_HEAD, *_struct(blueprint, static), "", *_layout(blueprint, static, cells), ""])


def ends(blueprint: Blueprint) -> tuple[tuple[Foreign, Choice], ...]:
    """Tables whose first or last row something reads."""
    found: dict[tuple[Foreign, Choice], None] = {}
    values: list[InputValue] = list(every_value(blueprint))
    for value in values:
        if isinstance(value, ColumnValue) and value.place.choice is not Choice.HERE:
            found[value.place.table, value.place.choice] = None
    return tuple(found)


def _struct(blueprint: Blueprint, static: StaticSystem) -> Iterator[str]:
    count, kernels = len(blueprint.unknowns), len(blueprint.cases)
    yield from (
        "struct frame {",
        f"    const {blueprint.identifier}_data *data;",
        f"    long members[{count}];        /* of each unknown; 1 without a family */",
        f"    long offsets[{count + 1}];        /* where the numbers of each unknown begin */",
        f"    long firsts[{count + 1}];         /* where its coordinates begin */",
        f"    long data_numbers[{at.DATA_HEAD + at.DATA_BLOCK * kernels}];      /* of `data_set` */",
    )
    for table in blueprint.tables:
        if table.where is not None:
            yield from (
                f"    long *kept_of_{table.identifier};    /* the rows that the problem keeps */",
                f"    long kept_of_{table.identifier}_count;",
            )
    yield from (f"    long {choice.value}_of_{blueprint.table(name).identifier};" for name, choice in ends(blueprint))
    for link in blueprint.links:
        what = told("row of `", link.target, "`") if link.family is None else "member"
        yield f"    long *{link.identifier};    {remark('the ', what, ' that each row names')}"
    for family in blueprint.families:
        yield from (
            f"    long *{family.identifier};    {remark('a row of `', family.table, '` for each member')}",
            f"    long {family.identifier}_count;",
        )
    yield from (
        "    long *chosen, *fixed, *used, *column, *index, *columns, *sides, *coordinates;",
        "    struct problem *system;",
        "    struct work work;",
        "    struct data_set *data_set;    /* as the solver wants it */",
        "    long parameters_used, weights_used, index_used, columns_used;",
        "    double *parameters, *weights, *scratch, *start, *lower, *upper, *constants, *point, *sigma;",
        "    double *triangle, *covariance, *multipliers, *spare;",
    )
    if estimates(blueprint) != "point":
        yield "    double *estimates;    /* the numbers of `point` as they are reported */"
    for derived in blueprint.derived:
        yield from (
            f"    double *derived_{derived.identifier}, *derived_{derived.identifier}_sigma;",
            f"    long derived_{derived.identifier}_count;",
        )
    if blueprint.agreement is not None:
        yield from agreement_fields()
    if blueprint.ranges is not None:
        yield from range_fields()
    if static.told:
        yield from (
            f"    double *covariances;    /* {1 + ASSUMPTIONS}: as it is, and with more of what nothing tells */",
            f"    double apart[{ASSUMPTIONS}];",
        )
    yield from (
        f"    double kappa[{2 * max(kinds_of_units(blueprint), 1)}];    /* by kind of unit: κ, its worth */",
        "    double results[8];",
        "    long states[8];",
        "};",
    )


def _layout(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    count = len(blueprint.unknowns)
    yield from (
        "/* Lays out a frame for the rows of `data`: the most that can be needed. */",
        f"static void lay_out(struct frame *f, const {blueprint.identifier}_data *data, struct arena *a)",
        "{",
        "    long n, numbers, residuals = 4, inputs = 0, weights = 0, multipliers = 0, i;",
        "    long parameters = 0, index = 0, columns = 0, chosen = 1;",
        "    struct problem header = {0};",
        "",
        "    f->data = data;",
        *(
            f"    f->kept_of_{table.identifier} = integers_of(a, {cells.rows(table.name)});"
            for table in blueprint.tables
            if table.where is not None
        ),
    )
    for link in blueprint.links:
        rows = "1" if link.table is None else cells.rows(link.table)
        yield f"    f->{link.identifier} = integers_of(a, {rows});"
    yield from (
        f"    f->{family.identifier} = integers_of(a, {cells.rows(family.table)});" for family in blueprint.families
    )
    for number, unknown in enumerate(blueprint.unknowns):
        rows = "1" if unknown.family is None else cells.rows(blueprint.families[unknown.family].table)
        yield f"    f->members[{number}] = {rows};"
    yield from (
        f"    place_unknowns(UNKNOWNS, {count}, f->members, f->offsets, f->firsts);",
        f"    numbers = f->offsets[{count}];",
        f"    n = f->firsts[{count}];",
    )
    for block in blueprint.blocks:
        yield from _capacities(block, cells)
    yield from (
        *_arrays(blueprint, static),
        "    f->multipliers = reals_of(a, multipliers + 1);",
        "    header.numbers = numbers;",
        "    header.n = n;",
        "    header.most_multipliers = multipliers;",
        "    header.most_residuals = residuals;",
        "    header.most_inputs = inputs;",
        "    header.most_weights = weights + 2 * multipliers;",
        f"    header.chunk = {static.prefix[at.Problem.chunk]};",
        f"    header.most_outputs = {outputs_capacity(blueprint, static)};",
    )
    if blueprint.agreement is not None:
        yield from agreement_room(blueprint, blueprint.agreement, len(static.prefix))
    if blueprint.ranges is not None:
        yield from range_room(blueprint, blueprint.ranges)
    yield from (
        "    f->work.reals = reals_of(a, work_reals(&header));",
        f"    f->spare = reals_of(a, {spare_size(blueprint, static)});",
    )
    for derived in blueprint.derived:
        yield from (
            f"    f->derived_{derived.identifier}{suffix} = reals_of(a, {capacity(cells, derived)} + 1);"
            for suffix in ("", "_sigma")
        )
    yield from (
        "    f->work.integers = integers_of(a, work_integers(&header));",
        "    f->parameters_used = f->weights_used = f->index_used = f->columns_used = 0;",
        f"    for (i = 0; i < {at.DATA_HEAD + at.DATA_BLOCK * len(blueprint.cases)}; i++)",
        "        f->data_numbers[i] = 0;",
        "    f->data_set = (struct data_set *)f->data_numbers;",
        "}",
    )


def _arrays(blueprint: Blueprint, static: StaticSystem) -> Iterator[str]:
    # no column of a problem is empty: arrays of a size of at least one keep the pointers good
    yield from (
        f"    f->{name} = integers_of(a, {size} + 1);"
        for name, size in (("chosen", "chosen"), ("index", "index"), ("columns", "columns"))
    )
    yield from (
        *(f"    f->{name} = integers_of(a, n + 1);" for name in ("fixed", "used", "column", "sides", "coordinates")),
        f"    f->system = (struct problem *)integers_of(a, {len(static.prefix)} + (2 + {at.PIECE}) * n);",
        "    f->parameters = reals_of(a, parameters + 1);",
        "    f->weights = reals_of(a, weights + 1);",
        f"    f->scratch = reals_of(a, {_widest_matrix(blueprint)});",
        "    f->start = reals_of(a, numbers);",
        "    f->point = reals_of(a, numbers);",
    )
    if estimates(blueprint) != "point":
        yield "    f->estimates = reals_of(a, numbers);"
    yield from (
        *(f"    f->{name} = reals_of(a, n);" for name in ("lower", "upper", "sigma")),
        f"    f->constants = reals_of(a, {at.BOUNDS_AT + len(static.losses)} + 2 * n);",
        "    f->triangle = reals_of(a, (n + 1) * (n + 1));",
        "    f->covariance = reals_of(a, n * n);",
    )
    if static.told:
        yield f"    f->covariances = reals_of(a, {1 + ASSUMPTIONS} * n * n);"


def _capacities(block: BlockShape, cells: Cells) -> Iterator[str]:
    """What the rows of a clause take at most: each is in one case, so that the widest counts."""
    rows = "1" if block.table is None else cells.rows(block.table)

    def widest(of: Iterator[int]) -> int:
        return max(of, default=0)

    yield f"    {remark(block.name)}"
    if block.table is not None:
        yield f"    chosen = chosen < {rows} ? {rows} : chosen;"
    outputs = widest(c.kernel.outputs for c in block.cases)
    variables = widest(len(c.variables) for c in block.cases)
    yield from (
        f"    parameters += {rows} * {widest(len(c.parameters) for c in block.cases)};",
        f"    residuals += {rows} * {outputs};",
        f"    inputs += {rows} * {widest(len(c.variables) + len(c.parameters) for c in block.cases)};",
        # rows that share their unknowns share one line of places, one for each case
        f"    index += ({rows} + {len(block.cases)}) * {variables};",
        f"    columns += ({rows} + {len(block.cases)}) * {widest(len(c.tangents) for c in block.cases)};",
    )
    if block.role is BlockRole.CONSTRAINT:
        yield f"    multipliers += {rows} * {outputs};"
    else:
        yield f"    weights += {rows} * {widest(weights_width(c) for c in block.cases)};"


def _widest_matrix(blueprint: Blueprint) -> int:
    sizes = [e.last - e.first for _, case in blueprint.cases for e in case.equations]
    return max(sizes, default=1) ** 2
