"""Initial values from outside → starts in SI, each at the member of its family that its key names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from mbm.expression.units import NONE, parse_unit
from mbm.problem.naming import key_text
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Family, Problem, Unknown, UnknownKind
from mbm.report import faults
from mbm.report.elements import GEOMETRIC, number_factors
from mbm.report.initial import InitialValue, initial_values, is_document
from mbm.report.quantities import quantity_of
from mbm.report.types import Floats
from mbm.scales import Scale
from mbm.text.suggest import closest
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.estimation.run import StartsFinder


def given_starts(problem: Problem, tables: Mapping[str, Table], init: Mapping[str, object] | None) -> StartsFinder:
    """Starts by name for the solve with a key, from values by name or a result document.

    Plain numbers are in the unit that the unknown is reported in, entries with a ``unit`` in that. Values with ``keys``
    go to the members so called, in an array over all members of the solve; of a result document, members that this
    solve does not have are passed over.

    Raises:
        MbmError: a name that is no unknown, a key that is no member, a unit of another dimension, a wrong shape, a
            value of which some numbers are missing or infinite, or all are NaN.

    """
    unknowns = {unknown.name: unknown for unknown in problem.unknowns}
    alike = init is not None and _for_all_alike(init) and all(u.family is None for u in problem.unknowns)

    def starts(key: Mapping[str, CellKey]) -> Mapping[str, Floats]:
        if init is None:
            return {}
        found = {}
        for name, given in initial_values(init, key).items():
            unknown = unknowns.get(name)
            if unknown is None:
                raise MbmError(faults.bad_initial_value(name, "a value for a name that is no unknown"))
            if not is_document(init):
                if _says_nothing(init[name]):
                    continue
                _check_numbers(unknown, given.value)
            value = _in_si(problem, unknown, given)
            if given.keys is not None:
                if not is_document(init):
                    _check_keys(unknown, given.keys, tables)
                value = _by_member(unknown, given.keys, value, members(unknown, tables, key))
            if bool(np.isfinite(value).any()):
                found[name] = value
        return found

    shared = cache(lambda: starts({}))
    return (lambda _: shared()) if alike else starts


def _for_all_alike(init: Mapping[str, object]) -> bool:
    """Whether all solves get the same values: these are no document, or one of one solve."""
    solves = init.get("solves")
    return not is_document(init) or (isinstance(solves, Sequence) and len(solves) == 1)


def members(unknown: Unknown, tables: Mapping[str, Table], key: Mapping[str, CellKey]) -> tuple[CellKey, ...]:
    """The keys of the members that a family has in the solve with a ``for-each`` key, in the order of their numbers."""
    family = unknown.family
    if family is None:
        return ()
    cells = member_of_row(family, tables[family.table])
    found = dict.fromkeys(cells[row] for row in rows_of_solve(tables[family.table], key))
    return tuple(sorted(found, key=float)) if family.ordered else tuple(found)


def member_of_row(family: Family, table: Table) -> Sequence[CellKey]:
    """The key of the member that each row of a family's table belongs to."""
    return table.keys(family.column if family.column is not None else family.key)


def rows_of_solve(table: Table, key: Mapping[str, CellKey]) -> list[int]:
    """The rows of a table, from 0, that belong to the solve with a ``for-each`` key."""
    picked = np.ones(len(table), dtype=bool)
    for column, wanted in key.items():
        if column in table.columns:
            picked &= np.array([cell == wanted for cell in table.keys(column)], dtype=bool)
    return [int(row) for row in np.flatnonzero(picked)]


def _says_nothing(entry: object) -> bool:
    """Whether an entry is null, which is to say that there is no start."""
    return entry is None or (isinstance(entry, Mapping) and "value" in entry and entry["value"] is None)


def _check_numbers(unknown: Unknown, value: Floats) -> None:
    """All numbers of a member are there and finite, or none of them: then it has no start. Some member has one."""
    missing = np.isnan(value)
    if bool(np.isinf(value).any() or missing.all()):
        raise MbmError(faults.bad_initial_value(unknown.name, "not finite"))
    if not bool(missing.any()):
        return
    several = unknown.family is not None and value.ndim > len(unknown.shape)
    by_member = missing.reshape(len(value) if several else 1, -1)
    if bool((by_member.any(axis=1) & ~by_member.all(axis=1)).any()):
        raise MbmError(faults.bad_initial_value(unknown.name, "incomplete: some of its numbers are NaN or null"))


def _check_keys(unknown: Unknown, keys: tuple[CellKey, ...], tables: Mapping[str, Table]) -> None:
    """Every key is a member in some solve."""
    known = dict.fromkeys(members(unknown, tables, {}))
    strangers = [key for key in keys if key not in known]
    if unknown.family is not None and strangers:
        near = closest(str(strangers[0]), [str(key) for key in known])
        raise MbmError(faults.unknown_member(unknown.name, key_text(strangers[0]), near))


def _by_member(unknown: Unknown, keys: tuple[CellKey, ...], value: Floats, wanted: tuple[CellKey, ...]) -> Floats:
    """``value`` (given keys, …shape) as (members, …shape), NaN for members without one."""
    if unknown.family is None:
        raise MbmError(faults.bad_initial_value(unknown.name, "a family with `keys`, but it has no members"))
    if value.shape[1:] != unknown.shape:
        raise MbmError(faults.bad_initial_value(unknown.name, "a family whose values have another shape"))
    place = {key: i for i, key in enumerate(keys)}
    found = np.full((len(wanted), *unknown.shape), np.nan)
    for i, key in enumerate(wanted):
        if key in place:
            found[i] = value[place[key]]
    return found


def _in_si(problem: Problem, unknown: Unknown, given: InitialValue) -> Floats:
    """The numbers that are given, in SI."""
    scale = _scale(problem, unknown, given)
    quantity = replace(quantity_of(problem, unknown), scale=scale)
    if quantity.kind in GEOMETRIC and given.value.shape[-1:] == unknown.shape:
        return np.asarray(given.value * number_factors(quantity))
    return scale.to_si(given.value)


def _scale(problem: Problem, unknown: Unknown, given: InitialValue) -> Scale:
    """The scale of the unit that the numbers are given in."""
    quantity = quantity_of(problem, unknown)
    if given.unit is None or given.unit == quantity.unit:
        return quantity.scale
    unit = parse_unit(given.unit)
    if unit is None:
        raise MbmError(faults.bad_initial_value(unknown.name, f"in `{given.unit}`, which is no unit"))
    for component in range(unknown.size):
        wanted = problem.dimensions.get((unknown.name, component))
        if unknown.kind is UnknownKind.ANGLE:
            wanted = NONE
        if wanted is not None and wanted != unit.dimension:
            what = f"in `{given.unit}`, {unit.dimension.describe()}; it is {wanted.describe()}"
            raise MbmError(faults.bad_initial_value(unknown.name, what))
    return unit.scale
