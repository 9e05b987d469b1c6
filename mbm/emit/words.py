"""A problem in words and equations, for the README of every generated solver."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.answers import Agreement
from mbm.emit.types import BlockShape, Blueprint, UnknownShape
from mbm.problem.types import BlockRole, NoiseKind

MOST_CASES = 3
"""Groups of rows whose equations are printed; the others differ in their static values only."""


def described(blueprint: Blueprint) -> Iterator[str]:
    """Tables, unknowns, equations, and how it is solved."""
    yield "## The problem"
    yield ""
    for table in blueprint.tables:
        columns = ", ".join(f"`{c.source}`" + (f" ({c.unit})" if c.unit else "") for c in table.columns)
        kept = "; some rows are left out by a condition" if table.where is not None else ""
        yield f"* table `{table.name}`: {columns or 'no columns'}{kept}"
    yield ""
    for unknown in blueprint.unknowns:
        yield f"* unknown {_unknown(blueprint, unknown)}"
    for constant in blueprint.constants:
        yield f"* constant `{constant.name}` = {constant.value:.17g}"
    yield ""
    for block in blueprint.blocks:
        yield from _block(block)
    for derived in blueprint.derived:
        over = f" for each row of `{derived.table}`" if derived.table is not None else ""
        unit = f", shown in {derived.unit}" if derived.unit else ""
        yield f"Derived `{derived.name}`{over}{unit}:"
        yield ""
        yield "```"
        yield from (line for case in derived.cases[:MOST_CASES] for line in case.text)
        yield "```"
        yield ""
    if blueprint.agreement is not None:
        yield from _agreement(blueprint.agreement)
    if any(reference.elsewhere is not None for reference in blueprint.references):
        yield "The problem states no start for everything, or none that leads to the answer of `mbm solve`: the test"
        yield "begins some standard deviations away from the answer (`start` in `reference.csv`). With other data, say"
        yield "where to begin."
        yield ""
    yield f"The iteration is Marquardt's in a trust region, for at most {blueprint.settings.max_iterations} iterations."
    yield ""


def _unknown(blueprint: Blueprint, unknown: UnknownShape) -> str:
    text = f"`{unknown.name}`: {unknown.kind.value}"
    if unknown.dimension:
        text += f" {unknown.dimension}"
    elif unknown.shape:
        text += f" of {' × '.join(map(str, unknown.shape))} numbers"
    if unknown.family is not None:
        family = blueprint.families[unknown.family]
        over = f"distinct value of `{family.key}`" if family.distinct else "row"
        text += f", one for each {over} of `{family.table}`"
    if unknown.unit:
        text += f", shown in {unknown.unit}"
    if blueprint.agreement is not None and blueprint.unknowns.index(unknown) in blueprint.agreement.startless:
        text += "; begins where the data say, by consensus, unless the caller says"
    elif unknown.start is None and unknown.start_range is None and unknown.lower is None:
        text += "; the problem states no start: begins at the answer for the data of `data/`, unless the caller says"
    return text + (f" ({unknown.doc})" if unknown.doc else "")


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
    over = f" for each row of `{block.table}`" if block.table is not None else ""
    only = " that a condition keeps" if block.when is not None else ""
    yield f"{block.role.value.capitalize()} `{block.name}`{over}{only}{_noise(block)}:"
    yield ""
    yield "```"
    for case in block.cases[:MOST_CASES]:
        if case.static:
            yield "where " + ", ".join(f"{value.column} = {key}" for value, key in case.static)
        yield from case.text
    if len(block.cases) > MOST_CASES:
        yield f"… and {len(block.cases) - MOST_CASES} more groups of rows with other values"
    yield "```"
    yield ""


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
