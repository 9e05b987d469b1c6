"""Which columns of the tables a solver reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mbm.emit.foreign import Foreign
from mbm.emit.types import (
    BlockShape,
    Blueprint,
    ColumnValue,
    DerivedShape,
    FamilyShape,
    InputValue,
    Link,
    RowPrograms,
    UnknownShape,
)


def used_columns(
    blocks: Iterable[BlockShape | DerivedShape],
    unknowns: Iterable[UnknownShape],
    filters: Iterable[RowPrograms | None],
    links: Iterable[Link],
    families: Iterable[FamilyShape],
) -> frozenset[tuple[Foreign, Foreign]]:
    """Tables and columns that something of a blueprint reads."""
    links, families = tuple(links), tuple(families)
    values = _values(blocks, unknowns, filters)
    found = {(v.owner, v.column) for v in values if isinstance(v, ColumnValue) and v.column is not None}
    for link in links:
        if isinstance(link.cell, ColumnValue) and link.cell.column is not None:
            found.add((link.cell.owner, link.cell.column))
        if link.key is not None:
            found.add((link.target, link.key))
    found.update((family.table, family.key) for family in families if family.key is not None)
    return frozenset(found)


def counted_tables(
    blocks: Iterable[BlockShape | DerivedShape],
    unknowns: Iterable[UnknownShape],
    links: Iterable[Link],
    families: Iterable[FamilyShape],
) -> frozenset[Foreign]:
    """Tables whose rows are gone through, or counted, whether or not anything in them is read."""
    blocks, links = tuple(blocks), tuple(links)
    values = [v for v in _values(blocks, unknowns, ()) if isinstance(v, ColumnValue)]
    values += [link.cell for link in links if isinstance(link.cell, ColumnValue)]
    found = {block.table for block in blocks} | {link.table for link in links} | {link.target for link in links}
    found |= {family.table for family in families} | {value.place.table for value in values}
    return frozenset(table for table in found if table is not None)


def every_value(blueprint: Blueprint) -> Iterator[InputValue]:
    """Every cell and constant that a solver reads, keys included."""
    yield from _values((*blueprint.blocks, *blueprint.derived), blueprint.unknowns, (t.where for t in blueprint.tables))
    yield from (link.cell for link in blueprint.links if isinstance(link.cell, ColumnValue))


def _values(
    blocks: Iterable[BlockShape | DerivedShape],
    unknowns: Iterable[UnknownShape],
    filters: Iterable[RowPrograms | None],
) -> Iterator[InputValue]:
    for block in blocks:
        if isinstance(block, BlockShape):
            yield from block.distinct
            yield from _of_rows(block.when)
        for case in block.cases:
            yield from (value for value, _ in case.static)
            yield from case.parameters
            yield from () if case.noise is None else case.noise.inputs
    for unknown in unknowns:
        for programs in (unknown.start, unknown.lower, unknown.upper, unknown.fixed, *(unknown.start_range or ())):
            yield from _of_rows(programs)
    for each in filters:
        yield from _of_rows(each)


def _of_rows(programs: RowPrograms | None) -> Iterator[InputValue]:
    for case in () if programs is None else programs.cases:
        yield from (value for value, _ in case.static)
        yield from case.inputs
