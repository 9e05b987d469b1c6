"""The text of a generated Python module."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mbm.emit.answers import Agreement
from mbm.emit.c.cells import input_name
from mbm.emit.c.frame import lossy, row_scratch
from mbm.emit.c.tables import programs_used
from mbm.emit.foreign import Foreign, Word, told
from mbm.emit.python.kernels import derived_function, function, kernel_functions, rows_function
from mbm.emit.python.program import PROGRAM, SHOWING
from mbm.emit.python.rows import clause_functions, finding, set_up
from mbm.emit.python.runtime import HEAD, TAIL
from mbm.emit.python.text import WIDTH, docstring, literal, optional, remark
from mbm.emit.routines.derived import OPEN
from mbm.emit.routines.modules import called_in_python, emitted_module
from mbm.emit.routines.noises import SCATTER, SQUARES, TOLD
from mbm.emit.routines.untold import ASSUMPTIONS
from mbm.emit.system import StaticSystem, kinds_of_units
from mbm.emit.types import Blueprint
from mbm.machine.program import Operator
from mbm.machine.python import PRELUDE, text as module_text
from mbm.problem.types import NoiseKind
from mbm.scales import SI, Scale
from mbm.solver import consensus_records as c, description
from mbm.solver.range_maps import RangeMaps
from mbm.solver.workspace import MOST_PLACES, SCRATCH

_DESCRIPTION = (
    "HEADER", "BLOCK", "PIECE", "BOUNDS_AT", "DATA_HEAD", "DATA_BLOCK", "RESULTS",
    "COST", "PLAIN_COST", "STATES", "REASON", "STEPS", "EVALUATIONS", "FREEDOM",
    "DEFICIENT", "SMALL_OFFSET", "ONE_STEP", "NOT_FINITE_AT_START", "INFEASIBLE",
)  # fmt: skip
_ERROR_FUNCTION = '''error_function = np.vectorize(math.erf, otypes=[float])
"""erf, which NumPy does not have."""
'''


def module(blueprint: Blueprint, static: StaticSystem) -> str:
    """All of it, in the order in which Python wants it."""
    parts = ["\n".join([*_doc(blueprint), "", HEAD.rstrip()]), *_tables(blueprint), *_constants(blueprint, static)]
    every = (*(c for _, c in blueprint.cases), *(c for d in blueprint.derived for c in d.cases))
    programs = [c.kernel.jacobian_program for c in every]
    if any(i.operator is Operator.ERF for p in programs for i in p.instructions):
        parts.append(_ERROR_FUNCTION.rstrip())
    for _, case in blueprint.cases:
        parts.append(kernel_functions(case))
        if case.noise is not None:
            names = [input_name(v) for v in case.noise.inputs]
            parts.append(
                function(f"{case.identifier}_noise", case.noise.program, names, [f"{case.identifier}: stated noise."])
            )
    parts += [derived_function(each.name, case) for each in blueprint.derived for case in each.cases]
    parts += [rows_function(blueprint, each, words) for each, words in programs_used(blueprint)]
    agreeing = blueprint.agreement is not None
    last = [
        finding(blueprint),
        *set_up(blueprint),
        *clause_functions(blueprint),
        *_lists(blueprint),
        TAIL,
        AGREE if agreeing else NOTHING,
        PLAIN if blueprint.ranges is None else BESIDE,
        SHOWING,
        PROGRAM,
    ]
    solver = module_text(emitted_module(called_in_python("\n".join(last))))
    parts += [PRELUDE.rstrip(), solver.rstrip(), *last]
    return "\n\n\n".join(p.strip("\n") for p in parts) + "\n"


def _doc(blueprint: Blueprint) -> Iterator[str]:
    lines: list[Word] = [told(blueprint.name, ": ", blueprint.doc) if blueprint.doc else blueprint.name]
    lines += [
        "",
        f"Written by mbm {blueprint.version}; needs NumPy only. Everything is in SI, angles in radians.",
        "`solve(tables)` solves; `python <this file> TABLE.csv …` prints `name,value,sigma,unit`.",
    ]
    yield from (line.removeprefix("    ") for line in docstring(lines))


def _tables(blueprint: Blueprint) -> Iterator[str]:
    lines = ["COLUMNS: dict[str, dict[str, tuple[bool, str, float, float]]] = {"]
    for table in blueprint.tables:
        lines += [
            f"    {literal(table.name)}: {{",
            *[
                f"        {literal(c.name)}: ({c.is_text}, {literal(c.source)}, {c.scale.factor!r}, {c.scale.zero!r}),"
                + (f"  {remark(c.unit)}" if c.unit else "")
                for c in table.columns
            ],
            "    },",
        ]
    lines += [
        "}",
        '"""Tables and columns: whether it holds texts, its name in files, its unit in SI: factor, zero."""',
    ]
    yield "\n".join(lines)
    shapes = [None if u.family is None else blueprint.families[u.family] for u in blueprint.unknowns]
    families = ["None" if s is None else f"({s.identifier!r}, {literal(s.table)}, {optional(s.key)})" for s in shapes]
    shown = [_shown(*((u.unit, u.scale) if not u.dimension else (Foreign(""), SI))) for u in blueprint.unknowns]
    turned = [bool(u.dimension) for u in blueprint.unknowns]
    derived = [", ".join(_shown(d.unit, d.scale)) for d in blueprint.derived]
    yield "\n".join(
        [
            *_assigned("KEYS", map(literal, blueprint.for_each), "Columns that tell the data sets apart."),
            *_assigned("NAMES", [literal(u.name) for u in blueprint.unknowns], "The unknowns."),
            *_assigned(
                "ANGLES",
                [(u, n, each.size) for u, each in enumerate(blueprint.unknowns) for n in each.angles],
                "Unknowns that hold angles: which of them, which of its numbers, of how many.",
            ),
            *_assigned(
                "QUATERNIONS",
                [(u, n, each.size) for u, each in enumerate(blueprint.unknowns) for n in each.quaternions],
                "Unknowns that hold quaternions: which of them, which of its numbers, of how many.",
            ),
            *_assigned("FAMILIES", families, "Where their members stand: name, table, key; None: there is one."),
            *_assigned("DERIVED_SHOWN", [f"({each})" for each in derived], "Unit, its factor and its zero in SI."),
            *_assigned(
                "SHOWN",
                [f"({', '.join(each)}, {whether})" for each, whether in zip(shown, turned, strict=True)],
                "Unit, its factor and zero in SI, and whether numbers are no coordinates.",
            ),
        ]
    )


def _shown(unit: Foreign, scale: Scale) -> tuple[str, str, str]:
    return literal(unit), repr(scale.factor), repr(scale.zero)


def _assigned(name: str, values: Iterable[object], doc: str) -> list[str]:
    """A tuple of what is written already, or of numbers, with its documentation."""
    items = [str(v) for v in values]
    text = ", ".join(items) + ("," if len(items) == 1 else "")
    line = f"{name} = ({text})"
    if len(line) > WIDTH:
        line = "\n".join([f"{name} = (", *_filled(items), ")"])
    return [line, f'"""{doc}"""']


def _filled(items: list[str]) -> Iterator[str]:
    """Items on lines as long as may be, none on two."""
    line = "   "
    for item in items:
        if len(line) + len(item) + 2 > WIDTH and line.strip():
            yield line
            line = "   "
        line += f" {item},"
    yield line


def _constants(blueprint: Blueprint, static: StaticSystem) -> Iterator[str]:
    yield "CONSTANTS = {" + ", ".join(f"{literal(c.name)}: {c.value!r}" for c in blueprint.constants) + "}"
    lines = _assigned("_SYSTEM", static.prefix, "How the solver's description of the equations begins.")
    lines += _assigned("_UNKNOWNS", static.unknowns, "Of each unknown: numbers, coordinates, family, positive, pieces.")
    lines += _assigned("_LOSSES", static.losses, "Parameter and shape of each loss.")
    lines += [
        "SYSTEM = np.array(_SYSTEM, dtype=np.int64)",
        "UNKNOWNS = np.array(_UNKNOWNS, dtype=np.int64)",
        "LOSSES = np.array(_LOSSES, dtype=float)",
        f"TOLERANCE = {blueprint.settings.tolerance!r}",
        f"LOSSY = {lossy(blueprint)}",
        f"SCALED = {static.scaled}",
        f"SPARE = {row_scratch(blueprint)!r}",
        f"KINDS = {max(kinds_of_units(blueprint), 1)}",
        *_assigned("NOISY", map(literal, static.noises), "Unknown noise."),
        f"TOLD = {static.told * TOLD}",
    ]
    yield "\n".join(lines)
    values = [(name, getattr(description, name)) for name in _DESCRIPTION]
    values += [
        ("MULTIPLIERS", description.Problem.most_multipliers),
        ("N", description.Problem.n),
        ("LANES", 1),
        ("DATA_COUNT", description.DataSet.count),
    ]
    values += [("DATA_COLUMNS", description.DataBlock.columns), ("DATA_ROWS", description.DataBlock.rows)]
    values += [("SCATTER", SCATTER), ("SQUARES", SQUARES), ("ASSUMPTIONS", ASSUMPTIONS), ("OPEN", OPEN)]
    if blueprint.agreement is None:
        yield "KEPT = False"
    else:
        values += PLACES.items()
        made = agreement_constants(blueprint, blueprint.agreement)
        yield "\n".join(f'{name} = {value}\n"""{doc}"""' for name, value, doc in made)
    if blueprint.ranges is not None:
        made = range_constants(blueprint, blueprint.ranges)
        yield "\n".join(f'{name} = {value}\n"""{doc}"""' for name, value, doc in made)
    yield "\n".join(["# places in the arrays of the solver, and its reasons", *(f"{n} = {v}" for n, v in values)])


def _lists(blueprint: Blueprint) -> Iterator[str]:
    lines = ["KERNELS: tuple[tuple[Callable[..., None], int, int], ...] = ("]
    for _, case in blueprint.cases:
        wide, outputs = len(case.variables) + len(case.parameters), case.kernel.outputs
        lines += [
            f"    ({case.identifier}_values, {wide}, {outputs}),",
            f"    ({case.identifier}_jacobian, {wide}, {outputs + len(case.kernel.jacobian_rows)}),",
        ]
    yield "\n".join([*lines, ")", '"""Function, inputs and outputs of each kernel."""'])
    lines = ["SET_UP = (" + ", ".join(f"set_up_{u.identifier}" for u in blueprint.unknowns) + ",)", "CASES = ("]
    clauses = {id(block): number for number, block in enumerate(blueprint.blocks)}
    for block, case in blueprint.cases:
        lines.append(f"    ({clauses[id(block)]}, {block.identifier}_rows, {case.identifier}_assemble),")
    held = [")", '"""Clause, its rows, and what makes arrays of them, for each kernel."""', "DERIVED: Derivations = ("]
    for derived in blueprint.derived:
        held.append(f"    ({literal(derived.name)}, {optional(derived.table)}, {derived.size}, {derived.angle}, (")
        for case in derived.cases:
            rows, columns = case.kernel.jacobian_rows.tolist(), case.kernel.jacobian_columns.tolist()
            held.append(f"        ({case.identifier}_assemble, {case.identifier}_derived, {rows}, {columns}),")
        held.append("    )),")
    lines += [
        *held,
        ")",
        '"""Derived quantities: name, table, size, whether an angle, how each case is computed."""',
    ]
    kinds = (NoiseKind.COVARIANCE, NoiseKind.INFORMATION)
    lines += ["MATRIX_WEIGHTS = {" + ", ".join(f"{k.value!r}: weights_of_{k.value}" for k in kinds) + "}"]
    yield "\n".join(lines)


NOTHING = '''def agree_on(p: Prepared, factors: Array) -> None:
    """No consensus is asked for: all rows count, and the start is the one stated."""
'''
AGREE = '''def agree_on(p: Prepared, factors: Array) -> dict[str, Any] | None:
    """Consensus: where the solve begins and which rows count, in place; what there is to say of them."""
    startless = any(name not in p.given for name in STARTLESS_ONES)
    if BEGINS and not startless:
        return None
    if p.free > 1 and not connected(p.system, p.data, p.columns, integers(p.free)):
        raise DataError("no equation connects all unknowns, or they are more than 60: consensus is not for them")
    rules, wide, states = RULES.copy(), p.system.copy(), integers(ANSWERS)
    side_by_side(p.system, len(p.system), wide)
    scalars = set_room(wide, p.data, rules)
    rules[STARTLESS] = int(startless)
    known = reals(rules[MOST_UNITS] * rules[FORM_WIDTH])
    work = ConsensusWork()
    with np.errstate(all="ignore"):
        if rules[FORM]:
            known_units(p.system, p.work.rows, rules, MAP_PLACES, MAPS, SIGN, known)
        work.rules, work.levels, work.forms, work.verdict = rules, LEVELS, known, states
        work.reals, work.integers = reals(consensus_reals(rules)), integers(consensus_integers(rules))
        units = begin_by_consensus(int(KEPT), scalars, p.system, wide, p.work, work, p.start)
        take_agreement(int(KEPT), p.system, p.work.rows, work, p.start, p.kappa, factors)
    if startless and not states[AGREED]:
        raise DataError("the data give no start: state one")
    return {
        "units": int(units),
        "inliers": int(states[INLIERS]),
        "ambiguous": bool(states[AMBIGUOUS]),
        "inside": work.units.inlier[:units] == 1 if units else np.zeros(0, dtype=bool),
    }
'''
PLACES = {
    "STARTLESS": c.Rules.startless,
    "MOST_UNITS": c.Rules.most_units,
    "FORM": c.Rules.form,
    "FORM_WIDTH": c.Rules.form_width,
    "ANSWERS": c.ANSWERS,
    "AGREED": c.Verdict.agreed,
    "INLIERS": c.Verdict.inliers,
    "AMBIGUOUS": c.Verdict.ambiguous,
}
"""Places in the arrays of consensus, by their names in the text."""


def agreement_constants(blueprint: Blueprint, agreement: Agreement) -> Iterator[tuple[str, str, str]]:
    """Names, values and documentation of what consensus is asked for."""
    startless = [literal(u.name) for i, u in enumerate(blueprint.unknowns) if i in agreement.startless]
    doc = f"What consensus ({agreement.kind}) is asked for, without room for rows."
    yield "RULES", f"np.array({list(agreement.rules)!r}, dtype=np.int64)", doc
    doc = "Of each kind of unit: median, limit and reach of its squared norm."
    yield "LEVELS", f"np.array({list(agreement.levels)!r})", doc
    doc = "Of each kind of unit: where its map begins, -1: it has none."
    yield "MAP_PLACES", f"np.array({list(agreement.map_places) or [0]!r}, dtype=np.int64)", doc
    doc = "From the data of a row to what the closed form for subsets wants."
    yield "MAPS", f"np.array({list(agreement.maps) or [0.0]!r})", doc
    yield "SIGN", repr(agreement.sign), "That of lines of sight."
    yield "KEPT", repr(agreement.kept), "Whether rows that do not agree are left out."
    yield "BEGINS", repr(agreement.begins), "Whether nothing is asked for but a start where none is given."
    yield (
        "STARTLESS_ONES",
        f"({''.join(f'{name}, ' for name in startless)})",
        "Unknowns that begin where the data say, unless a start is given.",
    )


PLAIN = '''def solve_first(p: Prepared) -> None:
    """The solve from the start."""
    solve_alone(p.system, p.data, p.start, p.work)
'''
BESIDE = '''def solve_first(p: Prepared) -> None:
    """The solve from the start, or where the ranges lead if that is lower, or if no start is stated."""
    form, units = RangeForm(), 1 + sum(
        int(p.data[DATA_HEAD + DATA_BLOCK * b + DATA_ROWS]) for b in range(len(CASES))
    ) * len(RANGE_MAP_PLACES)
    ranges = form.ranges
    ranges.d, ranges.offset, ranges.even = RANGE_KIND
    ranges.spheres, ranges.weights, ranges.scratch = (
        reals((ranges.d + 3) * units), reals(units), reals(RANGE_SCRATCH)
    )
    form.rooted, form.held, form.stated = RANGE_ROOTED, RANGE_HELD, RANGE_STATED
    form.places, form.map_places, form.maps = RANGE_PLACES, RANGE_MAP_PLACES, RANGE_MAPS
    form.fixed_count, form.fixed, form.values = len(RANGE_FIXED), RANGE_FIXED, RANGE_VALUES
    numbers = p.offsets[len(NAMES)]
    form.found, form.point, form.other = reals(RANGE_FOUND), reals(numbers), reals(numbers)
    if any(name not in p.given for name in STARTLESS_ONES) and not begin_at_ranges(
        p.system, p.start, form, p.work
    ):
        raise DataError("the data give no start: state one")
    solve_from(p.system, p.data, 0, p.start, form, p.work)
'''


def range_constants(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[tuple[str, str, str]]:
    """Names, values and documentation of what ranges say of the start."""
    startless = [literal(u.name) for i, u in enumerate(blueprint.unknowns) if i in ranges.startless]
    kind = f"({ranges.dimension}, {int(ranges.offset)}, {int(ranges.even)})"
    yield "RANGE_KIND", kind, "Dimensions, whether an offset is unknown, whether its sign is open."
    yield "RANGE_ROOTED", str(int(ranges.rooted)), "Whether the maps give the root of what is added."
    yield "RANGE_STATED", str(int(ranges.stated)), "Whether the noise is stated."
    doc = "Where what the ranges give stands among the numbers."
    yield "RANGE_PLACES", f"np.array({list(ranges.places)!r}, dtype=np.int64)", doc
    doc = "Of each kind of unit: where its map begins, -1: it is no range."
    yield "RANGE_MAP_PLACES", f"np.array({list(ranges.map_places)!r}, dtype=np.int64)", doc
    doc = "From the data of a row to station, length, addition and slope."
    yield "RANGE_MAPS", f"np.array({list(ranges.maps)!r})", doc
    yield "RANGE_FIXED", f"np.array({list(ranges.fixed)!r}, dtype=np.int64)", "Numbers that are not estimated …"
    yield "RANGE_HELD", str(int(ranges.held)), "Whether the maps hold only for numbers as they were."
    doc = "… and what they were."
    yield "RANGE_VALUES", f"np.array({list(ranges.values)!r}, dtype=float)", doc
    yield "RANGE_SCRATCH", str(SCRATCH), "Numbers of scratch."
    yield "RANGE_FOUND", str(MOST_PLACES * len(ranges.places)), "Numbers of the places that fit."
    yield (
        "STARTLESS_ONES",
        f"({''.join(f'{name}, ' for name in startless)})",
        "Unknowns that begin where the data say, unless a start is given.",
    )
