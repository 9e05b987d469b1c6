"""Estimates and derived values → their scalars, named and in the unit that is shown."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from mbm.report.types import DerivedValue, Estimate, Key, Kind, Mask, Quantity, SolveReport


@dataclass(frozen=True, slots=True, kw_only=True)
class Scalar:
    """One number of an estimate, in the quantity's unit; ``sigma`` is NaN where there is none, 0 where ``fixed``.

    ``quantity`` and ``estimate`` tell where it comes from; ``derived`` values are computed from the estimates.
    """

    name: str
    value: float
    sigma: float
    quantity: Quantity
    fixed: bool = False
    at_bound: bool = False
    derived: bool = False
    reason: str | None = None


def key_text(key: Key) -> str:
    """A key as names of covariance rows write it: texts in quotes, whole numbers without a point."""
    return json.dumps(plain_key(key), ensure_ascii=False)


def plain_key(key: Key) -> str | int | float | None:
    """A key as JSON has it: whole numbers as integers, None in place of NaN and infinity."""
    if isinstance(key, str):
        return key
    number = float(key)
    if not math.isfinite(number):
        return None
    return int(number) if number.is_integer() and abs(number) < 2**53 else number


def element_names(quantity: Quantity, keys: tuple[Key, ...] | None = None) -> tuple[str, ...]:
    """``p``, ``p[1]``, ``theta[2,1]``, ``q["waist"]``, ``cam["left"][3]``: the names of all scalars, row by row."""
    members = [quantity.name] if keys is None else [f"{quantity.name}[{key_text(key)}]" for key in keys]
    if not quantity.shape:
        return tuple(members)
    indices = [",".join(map(str, index)) for index in product(*(range(1, n + 1) for n in quantity.shape))]
    return tuple(f"{member}[{index}]" for member in members for index in indices)


def scalars(item: Estimate | DerivedValue) -> Iterator[Scalar]:
    """The scalars of an estimate or a derived value, in the order of `element_names`."""
    quantity = item.quantity
    names = element_names(quantity, item.keys)
    values = np.ravel(item.value) / quantity.factor
    sigmas = np.full(len(names), np.nan) if item.sigma is None else np.ravel(item.sigma) / quantity.factor
    estimate = item if isinstance(item, Estimate) else None
    fixed = _flags(estimate.fixed if estimate else None, len(names))
    held = _flags(estimate.at_bound if estimate else None, len(names))
    for i, name in enumerate(names):
        yield Scalar(
            name=name,
            value=float(values[i]),
            sigma=0.0 if fixed[i] else math.nan if held[i] else float(sigmas[i]),
            quantity=quantity,
            fixed=fixed[i],
            at_bound=held[i],
            derived=estimate is None,
            reason=item.reason,
        )


def solve_scalars(solve: SolveReport) -> Iterator[Scalar]:
    """The scalars of all estimates of a solve, then those of its derived values."""
    for estimate in solve.estimates:
        yield from scalars(estimate)
    for value in solve.derived:
        yield from scalars(value)


def unit_text(quantity: Quantity) -> str:
    """The unit as people read it: ``rad`` for an angle that states none, empty where none is known."""
    return quantity.unit or ("rad" if quantity.kind is Kind.ANGLE else "")


def _flags(mask: Mask | None, size: int) -> list[bool]:
    return [False] * size if mask is None else [bool(flag) for flag in np.ravel(mask)]
