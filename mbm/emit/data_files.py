"""The data and the reference numbers of compile time, as CSV files that every generated solver reads."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.emit.answers import FAILED, Floats, Reference
from mbm.emit.foreign import Foreign
from mbm.emit.types import Blueprint, GivenTable, OutputFile, TableShape
from mbm.solver.decisions import EPSILON

MOST_COVARIANCES = 60
"""Coordinates up to which all covariances are kept; beyond only the variances."""
ROUNDED_BASIS = 1e-12
"""Of the largest sigma: what a basis of the constraints' null space, rounded, makes of none."""
STATUSES = ("converged", "not-converged", "unobservable", "infeasible", "no-agreement")


def data_files(blueprint: Blueprint) -> tuple[OutputFile, ...]:
    """``data/<table>.csv`` for each table, and ``reference.csv``."""
    given = {table.name: table for table in blueprint.given}
    files = [
        OutputFile(path=f"data/{t.identifier}.csv", content=table_text(t, given[t.name]).encode())
        for t in blueprint.tables
    ]
    return (*files, OutputFile(path="reference.csv", content=_references(blueprint).encode()))


def table_text(shape: TableShape, given: GivenTable) -> str:
    """The columns that the solver reads, in the units of the file."""
    lines = [",".join(field(c.source) for c in shape.columns)]
    columns = []
    for column in shape.columns:
        held = given.columns[column.name]
        if isinstance(held, tuple):
            columns.append(list(map(field, held)))
        else:
            columns.append([repr(float(value)) for value in column.scale.from_si(np.asarray(held))])
    lines += [",".join(cells) for cells in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def field(cell: Foreign) -> str:
    """A text that is read again as it is: the only way that a `Foreign` gets into a table of the test."""
    text = cell.unescaped
    plain = text.isprintable() and text == text.strip() and text != "" and not set(text) & {",", '"'}
    return text if plain else '"' + text.replace('"', '""') + '"'


def _references(blueprint: Blueprint) -> str:
    """``allowed`` is by how much a number of a generated solver may differ from ``value``.

    ``start`` is where the test begins, where that is not where the solver begins by itself.
    """
    lines = ["solve,what,row,column,value,allowed"]
    for number, reference in enumerate(blueprint.references):
        lines += [f"{number + 1},{line}" for line in _reference(reference)]
    return "\n".join(lines) + "\n"


PROMISED = 1e-9
"""What generated solvers promise of numbers, or of their standard deviations where these are larger, …"""
EACH_WAY = 2.0
"""… unless the condition leaves less: by so much grow roundings of J's columns, each an epsilon of its length, in the
inverse of its triangle. In the covariance, its square, they are there twice."""


def _reference(reference: Reference) -> Iterator[str]:
    """The lines of a solve; none where there was nothing to solve."""
    if reference.status == FAILED:
        return
    yield f"status,0,0,{STATUSES.index(reference.status)},0"
    if reference.status != "converged":
        return
    yield from (
        f"start,{i},0,{float(value)!r},0"
        for i, value in enumerate(() if reference.elsewhere is None else reference.elsewhere)
        if np.isfinite(value)
    )
    yield f"freedom,0,0,{reference.dof},0"
    close = max(PROMISED, EACH_WAY * EPSILON * reference.condition)
    for what, row, column, value, spread in _numbers(reference):
        yield f"{what},{row},{column},{value!r},{close * max(abs(value), spread)!r}"


def _numbers(reference: Reference) -> Iterator[tuple[str, int, int, float, float]]:
    """What is compared: what it is, its place, the number, the standard deviation that differences are held against.

    Of a number that constraints make zero but for rounding that is the largest one; of a covariance it is the product
    of two, `_scales` where they are zero.
    """
    largest = float(np.max(reference.spread, initial=0.0))
    for i, (value, own) in enumerate(zip(reference.numbers.tolist(), reference.spread.tolist(), strict=True)):
        if np.isfinite(value):
            yield "number", i, 0, value, largest if own == 0.0 and abs(value) <= ROUNDED_BASIS * largest else own
    yield "cost", 0, 0, reference.cost, 1.0
    for number, (values, sigmas) in enumerate(reference.derived):
        for i, (value, own) in enumerate(zip(values.ravel().tolist(), sigmas.ravel().tolist(), strict=True)):
            if np.isfinite(value) and np.isfinite(own):
                yield "derived", number, i, value, own
                yield "derived sigma", number, i, own, abs(value) if own <= ROUNDED_BASIS * abs(value) else own
    covariance = reference.covariance
    sigma = _scales(covariance)
    for i in range(len(covariance)):
        for j in range(i + 1) if len(covariance) <= MOST_COVARIANCES else (i,):
            if np.isfinite(covariance[i, j] * sigma[i] * sigma[j]):
                yield "covariance", i, j, float(covariance[i, j]), float(sigma[i] * sigma[j])


def _scales(covariance: Floats) -> Floats:
    """Standard deviations (n,), the largest one for those of what constraints determine: zero but for rounding.

    An element of such a row is a sum of products that cancel, each about as large as the variances of the coordinates
    that the constraints tie to it: rounding is relative to these, and nothing in the element itself tells its size.
    """
    sigma: Floats = np.sqrt(np.diag(covariance))
    largest = float(np.nanmax(sigma, initial=0.0))
    return np.where(sigma <= ROUNDED_BASIS * largest, largest, sigma)
