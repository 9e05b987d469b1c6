"""Other values of constants in equations that are elaborated: the same ones, where no value was asked for before.

Kernels take the constants of a problem as inputs, so that one compilation serves all values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np

from mbm.expression.algebra import UndefinedValueError, constant_value
from mbm.expression.derivative import substituted
from mbm.expression.nodes import Apply, Column, Component, Constant, Expression, Leaf, Number, Sampling, leaves, nearest
from mbm.expression.units import Dimension, Unit
from mbm.problem.elaborated import Elaborated
from mbm.problem.overrides import ConstantValue
from mbm.problem.types import Problem
from mbm.text.types import Source, Span
from mbm.values import is_frozen, replace


def with_numbers(found: Elaborated, numbers: Mapping[str, float]) -> Elaborated | None:
    """The same equations with other values of constants, by the names of their elements; not checked.

    None where these values decide more than numbers in the equations: what these are, or which rows they have.
    """
    try:
        numbers = _with_made(found.problem.constants, numbers)
    except UndefinedValueError:
        return None
    if not set(numbers).isdisjoint(found.consulted.constants):
        return None
    problem: Problem = _changed(found.problem, numbers)
    deciding = (
        found.problem.plans,
        found.problem.pairs,
        found.consulted,
        *(each.grid for each in found.problem.derived),
    )
    if any(_changed(each, numbers) is not each for each in deciding):
        return None
    # other tables than those of the equations before, of which evaluation remembers what it made of them
    return replace(found, problem=problem, tables=MappingProxyType(dict(found.tables)))


def _with_made(constants: tuple[ConstantValue, ...], numbers: Mapping[str, float]) -> Mapping[str, float]:
    """The numbers, and those of the constants that are made of them."""
    made = {name: form for each in constants for name, form in each.made}
    found = dict(numbers)

    def follow(name: str) -> bool:
        """Put in the number of a constant; whether it is another one."""
        form = made.pop(name, None)
        if name in numbers or form is None:
            return name in found
        if sum(follow(leaf.name) for leaf in leaves((form,)) if isinstance(leaf, Constant)):
            value = constant_value(_expressions((form,), found)[0])
            if value is not None:
                found[name] = nearest(value)
        return name in found

    for name in tuple(made):
        follow(name)
    return found


_WITHOUT = (str, int, float, Span, Source, Unit, Dimension, np.ndarray)
"""Values that hold no constant."""


def _changed(value: Any, numbers: Mapping[str, float]) -> Any:
    """A value of the stages with other numbers for constants; itself where it holds none of them."""
    if value is None or isinstance(value, _WITHOUT):
        return value
    if isinstance(value, Number | Constant | Column | Component | Apply):
        return _expressions((value,), numbers)[0]
    if isinstance(value, ConstantValue) and not numbers.keys().isdisjoint(value.elements):
        pairs = zip(value.elements, value.values, strict=True)
        return replace(value, values=tuple(numbers.get(name, number) for name, number in pairs))
    if isinstance(value, tuple):
        if value and all(isinstance(each, Number | Constant | Column | Component | Apply) for each in value):
            return _expressions(value, numbers)
        parts = tuple(_changed(each, numbers) for each in value)
        return parts if any(new is not old for new, old in zip(parts, value, strict=True)) else value
    if isinstance(value, Mapping):
        changed = {key: _changed(each, numbers) for key, each in value.items()}
        return MappingProxyType(changed) if any(changed[key] is not value[key] for key in value) else value
    if not is_frozen(type(value)):
        return value
    other = {each.name: _changed(getattr(value, each.name), numbers) for each in fields(value)}
    other = {name: each for name, each in other.items() if each is not getattr(value, name)}
    return replace(value, **other) if other else value


def _expressions(roots: tuple[Expression, ...], numbers: Mapping[str, float]) -> tuple[Expression, ...]:
    changed: dict[Leaf, Expression] = {}
    for leaf in leaves(roots):
        if isinstance(leaf, Constant) and leaf.name in numbers:
            changed[leaf] = replace(leaf, value=numbers[leaf.name])
        elif isinstance(leaf, Column) and leaf.sampling is not None:
            sampling: Sampling = _changed(leaf.sampling, numbers)
            if sampling is not leaf.sampling:
                changed[leaf] = replace(leaf, sampling=sampling)
    if not changed:
        return roots
    found = substituted(roots, changed)
    return found if any(new is not old for new, old in zip(found, roots, strict=True)) else roots
