"""A problem in words and equations, for the README of every generated solver."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.answers import Agreement
from mbm.emit.foreign import Foreign, Word, listed, told
from mbm.emit.markdown import code, fenced, prose
from mbm.emit.types import BlockShape, Blueprint, ColumnValue, Key, UnknownShape
from mbm.problem.types import BlockRole, Method, NoiseKind
from mbm.solver.description import MARQUARDT, RULES

METHODS = {Method.DOGLEG: "Powell's dogleg", Method.GAUSS_NEWTON: "that of Gauss and Newton"}
"""What the iterations are called that are not Marquardt's."""

MOST_CASES = 3
"""Groups of rows whose equations are printed; the others differ in their static values only."""


def described(blueprint: Blueprint) -> Iterator[str]:
    """Tables, unknowns, equations, and how it is solved."""
    yield from ("## The problem", "")
    for table in blueprint.tables:
        columns = ", ".join(code(c.source) + (f" ({prose(c.unit)})" if c.unit else "") for c in table.columns)
        kept = "; some rows are left out by a condition" if table.where is not None else ""
        yield f"* table {code(table.name)}: {columns or 'no columns'}{kept}"
    yield ""
    yield from (f"* unknown {_unknown(blueprint, unknown)}" for unknown in blueprint.unknowns)
    yield from (f"* constant {code(constant.name)} = {constant.value:.17g}" for constant in blueprint.constants)
    yield ""
    yield from described_blocks(blueprint)
    yield from described_derived(blueprint)
    if blueprint.agreement is not None:
        yield from _agreement(blueprint.agreement)
    if blueprint.ranges is not None:
        yield from (
            "The start is compared with the places that the ranges give in closed form: where one of these leads to a",
            "lower minimum, that is the answer.",
            "",
        )
    if any(reference.elsewhere is not None for reference in blueprint.references):
        yield from (
            "The problem states no start for everything, or none that leads to the answer of `mbm solve`: the test",
            "begins some standard deviations away from the answer (`start` in `reference.csv`). With other data, say",
            "where to begin.",
            "",
        )
    asked = blueprint.settings.method
    method = METHODS.get(asked, "Marquardt's" if RULES.get(asked, MARQUARDT) == MARQUARDT else code(asked))
    yield from (
        f"The iteration is {method} in a trust region, for at most {blueprint.settings.max_iterations} iterations.",
        "",
    )


def described_blocks(blueprint: Blueprint) -> Iterator[str]:
    """The clauses."""
    for block in blueprint.blocks:
        yield from _block(block)


def described_derived(blueprint: Blueprint) -> Iterator[str]:
    """The quantities computed from the estimates."""
    for derived in blueprint.derived:
        over = f" for each row of {code(derived.table)}" if derived.table is not None else ""
        unit = f", shown in {prose(derived.unit)}" if derived.unit else ""
        yield from (
            f"Derived {code(derived.name)}{over}{unit}:",
            "",
            *fenced(line for case in derived.cases[:MOST_CASES] for line in case.text),
            "",
        )


def _unknown(blueprint: Blueprint, unknown: UnknownShape) -> str:
    text = f"{code(unknown.name)}: {unknown.kind.value}"
    if unknown.dimension:
        text += f" {unknown.dimension}"
    elif unknown.shape:
        text += f" of {' × '.join(map(str, unknown.shape))} numbers"
    if unknown.family is not None:
        family = blueprint.families[unknown.family]
        over = f"distinct value of {code(family.key)}" if family.key is not None and family.distinct else "row"
        text += f", one for each {over} of {code(family.table)}"
    if unknown.unit:
        text += f", shown in {prose(unknown.unit)}"
    if blueprint.unknowns.index(unknown) in blueprint.startless:
        text += f"; begins where the data say{_by(blueprint)}, unless the caller says"
    elif unknown.falls_back and not unknown.replaced:
        text += "; the problem states no start: begins at the answer for the data of `data/`, unless the caller says"
    return text + (f" ({prose(unknown.doc)})" if unknown.doc else "")


def _by(blueprint: Blueprint) -> str:
    return ", by the ranges" if blueprint.agreement is None else ", by consensus"


def _agreement(agreement: Agreement) -> Iterator[str]:
    yield f"Before it is solved, consensus (`{agreement.kind}`; its random subsets are the same in every call) tells"
    if agreement.begins:
        yield "where the iteration begins, unless the caller says; all measurements count."
    elif agreement.kept:
        yield "which measurements agree; the others are left out. Which they are is part of the answer."
    else:
        yield "where the losses' lowest minimum is, and how large noise is that goes with a loss."
    yield ""


def _block(block: BlockShape) -> Iterator[str]:
    over = f" for each row of {code(block.table)}" if block.table is not None else ""
    only = " that a condition keeps" if block.when is not None else ""
    yield from (
        f"{block.role.value.capitalize()} {code(block.name)}{over}{only}{_noise(block)}:",
        "",
        *fenced(_equations(block)),
        "",
    )


def _equations(block: BlockShape) -> Iterator[Word]:
    for case in block.cases[:MOST_CASES]:
        if case.static:
            yield told("where ", listed(told(_cell(value), " = ", _key(key)) for value, key in case.static))
        yield from case.text
    if len(block.cases) > MOST_CASES:
        yield f"… and {len(block.cases) - MOST_CASES} more groups of rows with other values"


def _cell(value: ColumnValue) -> Word:
    return "row" if value.column is None else value.column


def _key(key: Key) -> Word:
    return key if isinstance(key, Foreign) else str(key)


def _noise(block: BlockShape) -> str:
    if block.role is BlockRole.CONSTRAINT:
        return ""
    kinds = {e.noise_kind for case in block.cases for e in case.equations}
    words = {
        NoiseKind.SIGMA: "standard deviations",
        NoiseKind.COVARIANCE: "a covariance matrix",
        NoiseKind.INFORMATION: "an information matrix",
    }
    text = ", with " + " and ".join(words[k] for k in sorted(kinds)) if kinds else ""
    if block.unknown_factor:
        text += " up to a factor that is estimated"
    if block.loss is not None:
        text += f" and the loss `{block.loss.kind.value}`"
    return text
