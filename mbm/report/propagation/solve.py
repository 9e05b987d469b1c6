"""What the trials of one solve say of each quantity: the scalars that are reported, in their units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from mbm.equations.manifolds import numbers_of_stated
from mbm.equations.types import Indices
from mbm.estimation.uncertainty.derived import reported
from mbm.problem.types import Problem
from mbm.report.elements import difference, element_names, factors, shown_sigma, shown_values
from mbm.report.encode import numbers
from mbm.report.intervals import KINDS, IntervalKind, intervals
from mbm.report.pickled import solve_as_data
from mbm.report.types import DerivedValue, Estimate, Floats, Kind, SolveReport
from mbm.simulation.trials.drawn import Drawn
from mbm.simulation.trials.run import Sampled, validated
from mbm.text.render import as_json
from mbm.text.types import Diagnostic
from mbm.values import dataclass

Item = Estimate | DerivedValue


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """An estimate or derived quantity and its ``columns`` of the samples; ``linear`` (k, 2) are its linear intervals,
    or those that are stated where hard limits cut intervals. ``sigma`` (k,) are its linear standard deviations. NaN
    where there are none.
    """

    item: Item
    columns: slice
    names: tuple[str, ...]
    linear: Floats
    sigma: Floats

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the item's standard deviations."""
        return np.shape(shown_values(self.item))


def _items(solve: SolveReport) -> tuple[Item, ...]:
    return (*solve.estimates, *solve.derived)


def parts_of(solve: SolveReport) -> tuple[Part, ...]:
    """The items of a solve that trials speak of: directions have no coordinates that could be compared."""
    found: list[Part] = []
    place = 0
    every = [(item, intervals(item, solve.coverage)) for item in _items(solve)]
    limited, followed = (KINDS.index(kind) for kind in (IntervalKind.LIMITED, IntervalKind.PROFILE))
    limits = any(bool((told.kind == limited).any()) for _, told in every)
    for item, told in every:
        values = shown_values(item)
        if item.quantity.kind is Kind.DIRECTION:
            continue
        cut = (told.kind == limited) | (limits & (told.kind == followed))
        low, high = (values + side * told.expanded for side in (-1.0, 1.0))
        ends = np.stack([np.where(cut, told.low, low), np.where(cut, told.high, high)], axis=-1)
        columns = slice(place, place + values.size)
        place = columns.stop
        found.append(
            Part(
                item=item,
                columns=columns,
                names=element_names(item.quantity, item.keys),
                linear=ends.reshape(-1, 2),
                sigma=np.ravel(shown_sigma(item)),
            )
        )
    return tuple(found)


def scalars_of(problem: Problem, parts: tuple[Part, ...], drawn: Drawn) -> Callable[[Floats], Floats]:
    """From points (T, N) to the scalars of the ``parts`` (T, S), in their units."""
    owners = {derived.name: owner for owner, derived in enumerate(problem.derived)}

    def values(item: Item, points: Floats) -> Floats:
        count, shape = len(points), np.shape(item.value)
        if isinstance(item, Estimate):
            return points[:, drawn.equations.layout.entry(item.quantity.name).range].reshape(count, *shape)
        owner = owners[item.quantity.name]
        derived, stated = problem.derived[owner], drawn.derived_values(owner, points)
        if derived.kind is None:
            return np.asarray(reported(derived, stated)).reshape(count, *shape)
        flat = numbers_of_stated(derived.kind, derived.dimension, stated.reshape(-1, stated.shape[-1]))
        return np.asarray(flat).reshape(count, *shape)

    @np.errstate(all="ignore")
    def scalars(points: Floats) -> Floats:
        found = np.empty((len(points), parts[-1].columns.stop if parts else 0))
        for part in parts:
            item = part.item
            moved = difference(item.quantity, np.asarray(item.value), values(item, points)) / factors(item.quantity)
            found[:, part.columns] = (shown_values(item) + moved).reshape(len(points), -1)
        return found

    return scalars


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Propagation:
    """What the trials say of one quantity, in its unit, in arrays of the shape of its standard deviations.

    ``interval`` is probabilistically symmetric, ``shortest`` the shortest; both have a last axis [low, high], at the
    coverage of the solve. ``validated``: the linear interval agrees with ``interval`` to two digits of the standard
    deviation (GUM Supplement 1, clause 8); None where there is no linear interval, or too few trials tell. ``samples``
    are those of the trials that converged, along the first axis, NaN where it has no value; ``undefined`` says in how
    many it has none, and all else is of the others. ``mean`` and ``sigma`` are NaN where an input that it depends on
    has no variance.
    """

    name: str
    unit: str | None
    mean: Floats
    sigma: Floats
    median: Floats
    interval: Floats
    shortest: Floats
    validated: bool | None
    samples: Floats
    undefined: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PropagatedSolve:
    """The trials of one solve.

    ``sampled`` has the scalars of the ``parts``.
    """

    solve: SolveReport
    parts: tuple[Part, ...]
    sampled: Sampled
    diagnostics: tuple[Diagnostic, ...]

    def of(self, solve: SolveReport) -> PropagatedSolve:
        """The same trials beside another report of the same solve."""
        items = {each.quantity.name: each for each in _items(solve)}
        parts = tuple(replace(part, item=items[part.item.quantity.name]) for part in self.parts)
        return replace(self, solve=solve, parts=parts)

    def __reduce__(self) -> tuple[Any, ...]:
        """It pickles as data, as solves do."""
        kept = self.of(solve_as_data(self.solve))
        return partial(type(self), **{each.name: getattr(kept, each.name) for each in fields(kept)}), ()

    @property
    def trials(self) -> int:
        """All trials that were made."""
        return self.sampled.trials

    def __getitem__(self, name: str) -> Propagation:
        """What the trials say of a quantity.

        Raises:
            KeyError: nothing is called so.

        """
        for part in self.parts:
            if part.item.quantity.name == name:
                return self._of(part)
        raise KeyError(f"`{name}` is not among what was propagated: {', '.join(self)}")

    def __iter__(self) -> Iterator[str]:
        """The names of the estimates, then of the derived quantities."""
        return (part.item.quantity.name for part in self.parts)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the scalars, as they stand in the samples."""
        return tuple(name for part in self.parts for name in part.names)

    def agrees(self, part: Part) -> tuple[bool | None, ...]:
        """Whether the linear interval of each scalar is validated; None where it has none, or too few trials tell."""
        found = validated(part.linear, self.sampled.spreads.of(part.columns))
        return tuple(each if known else None for each, known in zip(found, self.compared(part), strict=True))

    def compared(self, part: Part) -> list[bool]:
        """Which scalars have a linear interval beside that of the trials."""
        told: list[bool] = (self.sampled.varies[part.columns] & np.isfinite(part.linear).all(axis=1)).tolist()
        return told

    def _of(self, part: Part) -> Propagation:
        told, shape = self.sampled.spreads, part.shape
        moments, agrees = np.where(self.sampled.varies[part.columns], 1.0, np.nan), self.agrees(part)
        return Propagation(
            name=part.item.quantity.name,
            unit=part.item.quantity.unit,
            mean=(moments * told.mean[part.columns]).reshape(shape),
            sigma=(moments * told.sigma[part.columns]).reshape(shape),
            median=told.median[part.columns].reshape(shape),
            interval=told.interval[part.columns].reshape(*shape, 2),
            shortest=told.shortest[part.columns].reshape(*shape, 2),
            validated=None if None in agrees else all(agrees),
            samples=self.sampled.samples[:, part.columns].reshape(-1, *shape),
            undefined=self.sampled.undefined[part.columns].reshape(shape),
        )


TOO_FEW = "too few trials to tell"
"""Whether the linear interval agrees."""


def propagation_document(found: PropagatedSolve) -> dict[str, Any]:
    """What documents say of the trials of a solve."""
    written: dict[str, Any] = {"trials": found.trials, "failed": found.sampled.failed, "coverage": found.solve.coverage}
    if found.sampled.settled is not None:
        written["settled"] = found.sampled.settled
    for part in found.parts:
        each = found[part.item.quantity.name]
        entry = {name: numbers(getattr(each, name)) for name in ("mean", "sigma", "interval", "shortest", "median")} | {
            "validated": each.validated,
            "unit": each.unit,
        }
        if bool(each.undefined.any()):
            entry["undefined"] = each.undefined.tolist()
        if not bool(np.isfinite(each.median).all()):
            entry["reason"] = part.item.reason or "it has no finite value"
        elif not bool(found.sampled.varies[part.columns].all()):
            entry["reason"] = "an input has no variance"
        elif each.validated is None:
            entry["reason"] = TOO_FEW if all(found.compared(part)) else "there is no linear interval"
        # a quantity may be called as a number of the trials is
        written[each.name if each.name not in written else f"{each.name} (quantity)"] = entry
    if found.diagnostics:
        written["diagnostics"] = [as_json(each) for each in found.diagnostics]
    return written
