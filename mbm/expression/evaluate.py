"""Numbers for expressions: all rows of a table at once, with NumPy. For data-only forms (weights, filters, starts)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nodes import Apply, Expression, External, Leaf, Number, Operation, Outlined, nearest, postorder
from mbm.machine.numpy_functions import function_of

Values: TypeAlias = NDArray[np.float64] | float
Lookup: TypeAlias = Callable[[Leaf], Values]
Calls: TypeAlias = Callable[[External | Outlined, tuple[Values, ...]], tuple[Values, ...]]
"""What calls functions in Python: the numbers of one, each (rows,) or one for all, from those of its arguments."""

_TWO_PI = 2 * np.pi


def _wrap(a: Values) -> Values:
    return a - _TWO_PI * np.ceil(a / _TWO_PI - 0.5)


def _comparison(function: Callable[..., Any]) -> Callable[..., Values]:
    """A comparison with a missing number is undecided: NaN."""

    def compare(a: Values, b: Values) -> Values:
        undecided = np.isnan(a) | np.isnan(b)
        return np.asarray(np.where(undecided, np.nan, function(a, b)), dtype=np.float64)

    return compare


def _and(a: Values, b: Values) -> Values:
    """False decides; else what is undecided stays so."""
    return np.asarray(np.where((np.asarray(a) == 0) | (np.asarray(b) == 0), 0.0, np.add(a, b) / 2), dtype=np.float64)


def _or(a: Values, b: Values) -> Values:
    """True decides; else what is undecided stays so."""
    return np.asarray(np.where((np.asarray(a) == 1) | (np.asarray(b) == 1), 1.0, np.add(a, b)), dtype=np.float64)


def _choose(test: Values, then: Values, other: Values) -> Values:
    chosen = np.where(np.asarray(test) != 0, then, other)
    return np.asarray(np.where(np.isnan(test), np.nan, chosen), dtype=np.float64)


_FUNCTIONS: Mapping[Operation, Callable[..., Values]] = {
    **{each: function_of(each.operator) for each in Operation if each.operator is not None},
    Operation.MINIMUM: np.minimum,
    Operation.MAXIMUM: np.maximum,
    Operation.WRAP: _wrap,
    Operation.AS_ANGLE: np.positive,
    Operation.HELD: np.positive,
    Operation.IF: _choose,
    Operation.LESS: _comparison(np.less),
    Operation.LESS_EQUAL: _comparison(np.less_equal),
    Operation.EQUAL: _comparison(np.equal),
    Operation.NOT: lambda a: 1.0 - a,
    Operation.AND: _and,
    Operation.OR: _or,
    Operation.FINITE: lambda a: np.asarray(np.isfinite(a), dtype=np.float64),
}
"""A missing number counts otherwise in comparisons and choices than it does in straight-line programs."""


def evaluate(roots: tuple[Expression, ...], lookup: Lookup, calls: Calls | None = None) -> tuple[Values, ...]:
    """The values of ``roots``; ``lookup`` gives a number or an array of shape (rows,) for each leaf.

    Forms without unknowns call no functions in Python and need no ``calls``. Numbers are in SI; conditions are 0.0 or
    1.0, or NaN where a missing number leaves them undecided. Values outside a domain are NaN or infinite, as IEEE 754
    has it: the caller says where they may not stand.
    """
    values: dict[int, Values] = {}
    called: dict[tuple[External | Outlined, tuple[int, ...]], tuple[Values, ...]] = {}
    with np.errstate(all="ignore"):
        for node in postorder(roots):
            if isinstance(node, Apply) and node.output is not None:
                if calls is None:
                    raise TypeError(node.output.external.function)
                key = (node.output.external, tuple(id(a) for a in node.arguments))
                if key not in called:
                    called[key] = calls(node.output.external, tuple(values[id(a)] for a in node.arguments))
                values[id(node)] = called[key][node.output.index]
            elif isinstance(node, Apply):
                values[id(node)] = _FUNCTIONS[node.operation](*(values[id(a)] for a in node.arguments))
            elif isinstance(node, Number):
                values[id(node)] = nearest(node.value)
            else:
                values[id(node)] = lookup(node)
    return tuple(values[id(root)] for root in roots)
