"""Points that are certain to meet all demands: how far the set reaches for sure."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Mask
from mbm.estimation.intervals.arithmetic import Floats, Interval
from mbm.estimation.intervals.contraction import Sweeper, portions
from mbm.estimation.intervals.network import Network, Node
from mbm.expression.nodes import Operation
from mbm.values import dataclass

_DOMAINS = {
    Operation.SQRT: (0.0, np.inf),
    Operation.LOG: (5e-324, np.inf),
    Operation.ASIN: (-1.0, 1.0),
    Operation.ACOS: (-1.0, 1.0),
    Operation.ACOSH: (1.0, np.inf),
    Operation.ATANH: (-1.0, 1.0),
}
"""Where an operation has a value; quotients and powers of zero are looked at by what they give, which is infinite."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Values:
    """What boxes (n, N) give: whether all of each is ``inside`` of what is stated and has values (n,), and is ``sure``
    to meet the demands too; the demanded nodes row by row (n, M), the scalars of derived quantities (n, Q).
    """

    inside: Mask
    sure: Mask
    demanded: Interval
    derived: Interval


def allowed(network: Network) -> Interval:
    """What is demanded of the nodes, row by row (M,)."""
    low, high = [np.empty(0)], [np.empty(0)]
    for demand in network.demands:
        rows = max(network.nodes[demand.node].rows, demand.allowed[0].shape[1])
        low.append(np.broadcast_to(demand.allowed[0][0], (rows,)))
        high.append(np.broadcast_to(demand.allowed[1][0], (rows,)))
    return np.concatenate(low), np.concatenate(high)


@np.errstate(all="ignore")
def values(network: Network, low: Floats, high: Floats) -> Values:
    """The values over boxes, by evaluation alone; points are boxes whose ends are one."""
    parts = [_values(network, low[rows], high[rows]) for rows in portions(network, max(len(low), 1))]
    return Values(
        inside=np.concatenate([p.inside for p in parts]),
        sure=np.concatenate([p.sure for p in parts]),
        demanded=(np.concatenate([p.demanded[0] for p in parts]), np.concatenate([p.demanded[1] for p in parts])),
        derived=(np.concatenate([p.derived[0] for p in parts]), np.concatenate([p.derived[1] for p in parts])),
    )


def _values(network: Network, low: Floats, high: Floats) -> Values:
    sweeper = Sweeper(network, low, high)
    sweeper.forward(demanding=False)
    inside: Mask = np.asarray(((low >= network.low) & (high <= network.high)).all(axis=1))
    for number, node in enumerate(network.nodes):
        if not node.lenient and node.operation is not None:
            inside &= _exists(node, tuple(sweeper.extent(a) for a in node.arguments), sweeper.extent(number))
    sure = np.array(inside)
    lows, highs = [np.empty((len(low), 0))], [np.empty((len(low), 0))]
    for demand in network.demands:
        extent = sweeper.extent(demand.node)
        shape = (len(low), max(extent[0].shape[1], demand.allowed[0].shape[1]))
        lows.append(np.broadcast_to(extent[0], shape))
        highs.append(np.broadcast_to(extent[1], shape))
        sure &= ((extent[0] >= demand.allowed[0]) & (extent[1] <= demand.allowed[1])).all(axis=1)
    return Values(
        inside=inside,
        sure=sure,
        demanded=(np.concatenate(lows, axis=1), np.concatenate(highs, axis=1)),
        derived=sweeper.derived(),
    )


def _exists(node: Node, arguments: tuple[Interval, ...], value: Interval) -> Mask:
    """Whether an operation has a value everywhere in the intervals of its arguments."""
    found = (np.isfinite(value[0]) & np.isfinite(value[1])).all(axis=1)
    if node.operation in _DOMAINS:
        low, high = _DOMAINS[node.operation]
        found = found & ((arguments[0][0] >= low) & (arguments[0][1] <= high)).all(axis=1)
    if node.operation is Operation.POWER and not (node.exponent is not None and _whole(node.exponent)):
        found = found & (arguments[0][0] >= 0.0).all(axis=1)
    return np.asarray(found)


def _whole(exponent: Interval) -> bool:
    low, high = float(exponent[0][0, 0]), float(exponent[1][0, 0])
    return low == high and low.is_integer()


@np.errstate(all="ignore")
def meets(network: Network, low: Floats, high: Floats) -> Mask:
    """Whether boxes (n, N) may meet the demands (n,), as far as evaluation alone tells."""
    found = np.ones(len(low), dtype=bool)
    for rows in portions(network, len(low)):
        sweeper = Sweeper(network, low[rows], high[rows])
        sweeper.forward(demanding=True)
        found[rows] = sweeper.alive
    return found
