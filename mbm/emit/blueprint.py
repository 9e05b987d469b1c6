"""Elaborated problem + kernels → Blueprint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mbm.emit.answers import Answers
from mbm.emit.foreign import Foreign
from mbm.emit.identifiers import (
    CASE_FORMS,
    CONSTANT_FORM,
    DERIVED_CASE_FORMS,
    DERIVED_FORMS,
    PROBLEM_FORMS,
    TABLE_FORMS,
    TAKEN,
    UNKNOWN_FORMS,
    Identifiers,
    identifier,
)
from mbm.emit.places import Places
from mbm.emit.reading import counted_tables, used_columns
from mbm.emit.statements import program_of
from mbm.emit.types import (
    BlockCase,
    BlockShape,
    Blueprint,
    CaseProgram,
    ColumnValue,
    ConstantShape,
    DerivedShape,
    EquationShape,
    GivenTable,
    RowPrograms,
    SlotPlace,
    SolverSettings,
    TableColumn,
    TableShape,
    UnknownShape,
)
from mbm.expression.nodes import ColumnMember, Expression, Member
from mbm.expression.units import scale_of
from mbm.kernels.types import Kernel, KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.kinds import Relation
from mbm.problem.manifold import Manifold, Piece
from mbm.problem.naming import PRIOR
from mbm.problem.types import (
    Block,
    BlockRole,
    Derived,
    Equation,
    Loss,
    Problem,
    Request,
    RowValues,
    Unknown,
    UnknownKind,
)
from mbm.scales import SI
from mbm.symbolic.printing import printed
from mbm.symbolic.types import Purpose, ResidualBlock, Slot, SymbolicModel

LossScale = Callable[[Loss, int], float]
"""The parameter of a loss for residuals of so many components."""


def blueprint(
    found: Elaborated,
    model: SymbolicModel,
    kernels: KernelSet,
    answers: Answers,
    loss_scale: LossScale,
    version: str,
) -> Blueprint:
    """The solver of a problem as plain data; `refusals` says which problems have one."""
    return Drafting(found, model, kernels, answers, loss_scale).whole(version)


class Drafting:
    """One blueprint under construction; what generated text makes of the names of problems and of kernels."""

    problem_forms: tuple[str, ...] = PROBLEM_FORMS
    case_forms: tuple[str, ...] = CASE_FORMS
    derived_forms: tuple[str, ...] = DERIVED_FORMS

    def __init__(
        self,
        found: Elaborated,
        model: SymbolicModel,
        kernels: KernelSet,
        answers: Answers,
        loss_scale: LossScale,
        taken: frozenset[str] = TAKEN,
    ) -> None:
        self.found = found
        self.problem: Problem = found.problem
        self.references = answers.references
        self.answers = answers
        self.loss_scale = loss_scale
        self.names = Identifiers(taken)
        self.name = self.names.made(self.problem.name, *self.problem_forms, words=frozenset())
        self.places = Places(found, self.names)
        self.pairs: dict[tuple[Purpose, int], list[tuple[Kernel, ResidualBlock]]] = {}
        for kernel, block in zip(kernels.kernels, model.blocks, strict=True):
            self.pairs.setdefault((kernel.purpose, kernel.owner), []).append((kernel, block))
        self.position = {u.name: i for i, u in enumerate(self.problem.unknowns)}

    def whole(self, version: str) -> Blueprint:
        """The blueprint."""
        problem = self.problem
        unknowns = self._unknowns()
        blocks = self.clauses()
        derived = tuple(self._derived(i, each) for i, each in enumerate(problem.derived))
        filters = {
            plan.name: None if plan.where is None else self._rows(plan.where, f"{identifier(plan.name)}_kept")
            for plan in problem.plans
        }
        constants = tuple(
            ConstantShape(name=Foreign(element), identifier=self.names.made(element, CONSTANT_FORM), value=float(value))
            for constant in problem.constants
            for element, value in zip(constant.elements, constant.values, strict=True)
        )
        links = tuple(self.places.links.values())
        families = tuple(self.places.families.values())
        used = used_columns((*blocks, *derived), unknowns, tuple(filters.values()), links, families)
        counted = counted_tables((*blocks, *derived), unknowns, links, families)
        tables = tuple(self._table(plan.name, filters[plan.name], used, counted) for plan in problem.plans)
        return Blueprint(
            name=Foreign(problem.name),
            identifier=self.name,
            version=version,
            doc=Foreign(problem.doc),
            tables=tuple(t for t in tables if t.columns),
            links=links,
            families=families,
            constants=constants,
            unknowns=unknowns,
            blocks=blocks,
            derived=derived,
            for_each=tuple(map(Foreign, problem.request.for_each)),
            settings=_settings(problem.request),
            references=self.references,
            given=tuple(self._given(t, plan.name) for t, plan in zip(tables, problem.plans, strict=True)),
            whole=self.answers.whole,
            agreement=self.answers.agreement,
            ranges=self.answers.ranges,
        )

    def clauses(self) -> tuple[BlockShape, ...]:
        """The clauses that the solver takes."""
        return tuple(self.clause(i, block) for i, block in enumerate(self.problem.blocks))

    def _table(
        self,
        name: str,
        where: RowPrograms | None,
        used: frozenset[tuple[Foreign, Foreign]],
        counted: frozenset[Foreign],
    ) -> TableShape:
        """A table with the columns that the solver reads, and those that tell the solves apart; one to count rows."""
        raw = self.found.raw[name]
        wanted = {column for column in raw.columns if (Foreign(name), Foreign(column)) in used}
        wanted.update(self.problem.request.for_each)
        if Foreign(name) in counted and wanted.isdisjoint(raw.columns):
            wanted.update(list(raw.columns)[:1])
        table = self.names.made(name, *TABLE_FORMS)
        columns = []
        for column in raw.columns.values():
            if column.name not in wanted:
                continue
            columns.append(
                TableColumn(
                    name=Foreign(column.name),
                    identifier=self.names.made(column.name, f"data.{table}_{{name}}", words=frozenset()),
                    source=Foreign(raw.provenance.source_columns.get(column.name, column.name)),
                    is_text=column.is_text,
                    unit=Foreign(column.unit or ""),
                    scale=scale_of(column.unit),
                )
            )
        return TableShape(name=Foreign(name), identifier=table, columns=tuple(columns), where=where)

    def _given(self, table: TableShape, name: str) -> GivenTable:
        raw = self.found.raw[name]
        wanted = {column.name for column in table.columns}
        columns = {
            Foreign(each): raw.numbers(each) if held.texts is None else tuple(map(Foreign, held.texts))
            for each, held in raw.columns.items()
            if Foreign(each) in wanted
        }
        return GivenTable(name=table.name, columns=columns)

    def _rows(self, values: RowValues, name: str) -> RowPrograms:
        table = None if values.table is None else self.places.own_table(values.table)
        cases = range(len(values.cases))
        return RowPrograms(
            identifier=self.names.made(name, "function.{name}", *(f"function.{{name}}_{k + 1}" for k in cases)),
            table=None if table is None else Foreign(table),
            width=len(values.cases[0].values) if values.cases else 0,
            cases=tuple(self._case(table, case.static, case.values) for case in values.cases),
        )

    def _case(
        self, table: str | None, static: tuple[tuple[str, str | float], ...], roots: tuple[Expression, ...]
    ) -> CaseProgram:
        inputs, program = program_of(roots, self.places.leaf(table))
        return CaseProgram(static=self.places.static(table, static), inputs=inputs, program=program)

    def _unknowns(self) -> tuple[UnknownShape, ...]:
        found, first = [], 0
        for unknown in self.problem.unknowns:
            members = 1 if unknown.family is None else len(self.found.tables[unknown.family.rows])
            found.append(self._unknown(unknown, first))
            first += members * unknown.size
        return tuple(found)

    def _unknown(self, unknown: Unknown, first: int) -> UnknownShape:
        def rows(values: RowValues | None, word: str) -> RowPrograms | None:
            return None if values is None else self._rows(values, f"{word}_of_{identifier(unknown.name)}")

        lower, upper = rows(unknown.start_lower, "least_start"), rows(unknown.start_upper, "greatest_start")
        known = self.references[0] if self.references else None
        begun = () if unknown.family is not None or known is None else known.start
        replaced = unknown.name in self.found.starts  # what was given from outside becomes numbers
        fallback = tuple(float(v) for v in begun[first : first + unknown.size])
        shape = UnknownShape(
            name=Foreign(unknown.name),
            identifier=self.names.made(unknown.name, *UNKNOWN_FORMS),
            kind=unknown.kind,
            dimension=unknown.dimension,
            shape=unknown.shape,
            size=unknown.size,
            freedom=unknown.freedom,
            pieces=tuple((p.label, number, coordinate) for p, number, coordinate in unknown.manifold.spans()),
            angles=tuple(number for number, angle in enumerate(unknown.manifold.number_angles()) if angle),
            positive=unknown.kind is UnknownKind.POSITIVE,
            family=None if unknown.family is None else self.places.family(unknown.family).number,
            start=None if replaced else rows(unknown.start, "start"),
            start_range=None if replaced or lower is None or upper is None else (lower, upper),
            replaced=replaced,
            fallback=fallback,
            lower=rows(unknown.lower, "least"),
            upper=rows(unknown.upper, "greatest"),
            bounded=_bounded(unknown.manifold),
            fixed=rows(unknown.fixed, "fixed"),
            unit=Foreign("" if unknown.unit is None else unknown.unit.symbol),
            scale=SI if unknown.unit is None else unknown.unit.scale,
            doc=Foreign(unknown.doc),
        )
        return replace(shape, start_range=None) if shape.falls_back else shape

    def clause(self, number: int, block: Block) -> BlockShape:
        """A clause with its kernels."""
        identifier = self.names.made(block.name, "function.{name}_rows", *self.case_forms)
        mine = self.pairs.get((Purpose.EQUATION, number), ())
        distinct: tuple[ColumnValue, ...] = ()
        table = None if block.table is None else self.places.own_table(block.table)
        if block.table is not None and table is not None:
            distinct = tuple(self.places.cell(table, name) for name in block.distinct)
            distinct += self.places.distinct(block.table)
        return BlockShape(
            name=Foreign(block.name.removeprefix(PRIOR)),
            identifier=identifier,
            role=block.role,
            table=None if table is None else Foreign(table),
            when=None if block.when is None else self._rows(block.when, f"{identifier}_when"),
            distinct=distinct,
            cases=tuple(
                self._equations(replace(block, table=table), identifier, kernel, symbolic) for kernel, symbolic in mine
            ),
            unknown_factor=block.unknown_factor,
            factor=Foreign(block.factor_name.removeprefix(PRIOR)),
            loss=block.loss,
        )

    def _equations(self, block: Block, name: str, kernel: Kernel, symbolic: ResidualBlock) -> BlockCase:
        case = block.cases[kernel.case]
        many = len(block.cases) > 1
        noise = tuple(n for equation in case.equations for n in equation.noise)
        shapes, first = [], 0
        for equation in case.equations:
            shapes.append(self._equation(block, equation, first))
            first = shapes[-1].last
        lines = printed(symbolic, latex=False)
        sign = "=" if block.role is not BlockRole.CONSTRAINT or shapes[0].equality else ">="
        return BlockCase(
            identifier=self.names.made(f"{name}_{kernel.case + 1}", *self.case_forms) if many else name,
            kernel=kernel,
            static=self.places.static(block.table, case.static),
            variables=tuple(self.place(s, block.table) for s in kernel.variables),
            tangents=tuple(self.place(s, block.table) for s in kernel.tangents),
            parameters=tuple(self.places.parameter(p, block.table) for p in kernel.parameters),
            equations=tuple(shapes),
            noise=self._case(block.table, case.static, noise) if block.role is not BlockRole.CONSTRAINT else None,
            input_names=tuple(Foreign(s.name) for s in (*symbolic.variable_symbols, *symbolic.parameter_symbols)),
            text=tuple(map(Foreign, (*lines.definitions, *(f"0 {sign} {line}" for line in lines.components)))),
        )

    def _derived(self, number: int, derived: Derived) -> DerivedShape:
        identifier = self.names.made(derived.name, *self.derived_forms)
        mine = self.pairs.get((Purpose.DERIVED, number), ())
        return DerivedShape(
            name=Foreign(derived.name),
            identifier=identifier,
            table=None if derived.table is None else Foreign(derived.table),
            size=len(derived.cases[0].values) if derived.cases else 0,
            angle=derived.turns,
            cases=tuple(self._value(derived, identifier, kernel, symbolic) for kernel, symbolic in mine),
            unit=Foreign("" if derived.unit is None else derived.unit.symbol),
            scale=SI if derived.unit is None else derived.unit.scale,
        )

    def _value(self, derived: Derived, name: str, kernel: Kernel, symbolic: ResidualBlock) -> BlockCase:
        case, many = derived.cases[kernel.case], len(derived.cases) > 1
        lines = printed(symbolic, latex=False)
        return BlockCase(
            identifier=self.names.made(f"{name}_{kernel.case + 1}" if many else name, *DERIVED_CASE_FORMS),
            kernel=kernel,
            static=self.places.static(derived.table, case.static),
            variables=tuple(self.place(s, derived.table) for s in kernel.variables),
            tangents=tuple(self.place(s, derived.table) for s in kernel.tangents),
            parameters=tuple(self.places.parameter(p, derived.table) for p in kernel.parameters),
            equations=(),
            noise=None,
            input_names=tuple(Foreign(s.name) for s in (*symbolic.variable_symbols, *symbolic.parameter_symbols)),
            text=tuple(map(Foreign, (*lines.definitions, *(f"{derived.name} = {line}" for line in lines.components)))),
        )

    def _equation(self, block: Block, equation: Equation, first: int) -> EquationShape:
        size = len(equation.components)
        return EquationShape(
            first=first,
            last=first + size,
            noise_kind=equation.noise_kind,
            loss_scale=0.0 if block.loss is None else self.loss_scale(block.loss, size),
            equality=equation.relation is Relation.ZERO,
        )

    def place(self, slot: Slot, table: str | None) -> SlotPlace:
        """Where an input or tangent of a kernel stands."""
        return SlotPlace(
            unknown=self.position[slot.unknown],
            component=slot.component,
            member=self.places.member(slot.unknown, slot.member, table),
            shown=Foreign(slot.unknown if slot.member is None else f"{slot.unknown}[{_shown(slot.member)}]"),
        )


def _shown(member: Member) -> str:
    """The column or the key that names a member."""
    return member.column if isinstance(member, ColumnMember) else f'"{member.key}"'


def _bounded(manifold: Manifold) -> tuple[int, ...]:
    """The coordinates that bounds are stated for: of plain numbers, but not the angle of a plane pose."""
    plain = tuple(c for piece, _, c in manifold.spans() if piece is Piece.NUMBER)
    return plain[1:] if len(plain) > 1 and manifold.labels and plain[0] == 0 else plain


def _settings(request: Request) -> SolverSettings:
    return SolverSettings(
        method=request.method,
        constraints=request.constraints,
        max_iterations=request.max_iterations,
        tolerance=request.tolerance,
    )
