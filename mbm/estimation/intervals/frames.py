"""Sequences by interval methods, frame by frame: boxes of states go forward and back through what joins them.

A frame has what is demanded of the states of one step, and of how they follow from those before. Its network is that
of the whole problem with the rows of this step alone. Boxes are contracted in each frame, from the first to the last
and back, until nothing changes: the fixed point is that of all demands together (the order of contractions does not
matter: Apt 1999), in time that grows with the steps. Set membership of Jaulin and others (2001).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.types import Indices
from mbm.estimation.intervals.arithmetic import Floats
from mbm.estimation.intervals.contraction import FIXED, contracted, evaluated
from mbm.estimation.intervals.network import Demand, Network, Node
from mbm.estimation.intervals.search import Paving
from mbm.values import dataclass

MOST_PASSES = 100
"""Passes over all frames: constants that all frames share may be narrowed in each."""

GAIN = 1e-9
"""A pass that takes less than this part of every side is the last."""

OF_NO_STEP = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """The demands of one step, each with its rows (r,) at it."""

    demands: tuple[tuple[Demand, Indices], ...]


def framed(network: Network, stopped: Callable[[], bool]) -> Paving:
    """The box of all states and constants, contracted; none where some frame has no values that meet its demands."""
    frames = frames_of(network)
    low, high = network.low.copy(), network.high.copy()
    examined, reached = 0, False
    for _ in range(MOST_PASSES):
        before = low.copy(), high.copy()
        for frame in chain(frames, reversed(frames[:-1])):
            examined += 1
            if not _contracted(network, frame, low, high):
                return Paving(boxes=evaluated(network, low[None][:0], high[None][:0]), examined=examined, reached=True)
        if stopped():
            break
        if not bool(_narrowed(before, (low, high)).any()):
            reached = True
            break
    return Paving(boxes=evaluated(network, low[None], high[None]), examined=examined, reached=reached)


def _narrowed(before: tuple[Floats, Floats], after: tuple[Floats, Floats]) -> Floats:
    """Whether a pass took more than `GAIN` of each side (N,), or made it finite."""
    with np.errstate(invalid="ignore"):
        width, left = before[1] - before[0], after[1] - after[0]
        part = np.where(width > 0.0, (width - left) / width, 0.0) > GAIN
    bounded = np.isfinite(after[0]) & ~np.isfinite(before[0]) | np.isfinite(after[1]) & ~np.isfinite(before[1])
    return np.asarray(np.where(np.isfinite(width), part, bounded))


def frames_of(network: Network) -> tuple[Frame, ...]:
    """The frames of a sequence, in the order of its steps; what mentions no state that moves is in the first."""
    step_of = _steps(network.layout)
    count = int(step_of.max(initial=0)) + 1
    found: list[list[tuple[Demand, Indices]]] = [[] for _ in range(count)]
    latest: dict[int, Indices] = {}
    for number, node in enumerate(network.nodes):
        latest[number] = _latest(node, [latest[a] for a in node.arguments], step_of)
    for demand in network.demands:
        rows = max(network.nodes[demand.node].rows, demand.allowed[0].shape[1])
        steps = np.maximum(np.broadcast_to(latest[demand.node], (rows,)), 0)
        order = np.argsort(steps, kind="stable")
        for part in np.split(order, np.flatnonzero(np.diff(steps[order])) + 1):
            found[int(steps[part[0]])].append((demand, part))
    return tuple(Frame(demands=tuple(each)) for each in found)


def _steps(found: Layout) -> Indices:
    """The step (N,) of each number of a state that moves, `OF_NO_STEP` of others."""
    result = np.full(len(found.start), OF_NO_STEP, dtype=np.int64)
    for entry in found.entries:
        if entry.unknown.is_state and entry.steps is None:
            result[entry.range] = np.repeat(np.arange(entry.members), entry.unknown.size)
    return result


def _latest(node: Node, arguments: list[Indices], step_of: Indices) -> Indices:
    """The latest step (rows,) that a node depends on in each row."""
    if node.places is not None:
        return step_of[node.places]
    steps = np.full(node.rows, OF_NO_STEP, dtype=np.int64)
    for each in arguments:
        steps = np.maximum(steps, each)
    return steps


def _contracted(network: Network, frame: Frame, low: Floats, high: Floats) -> bool:
    """Narrow the numbers (N,) that a frame speaks of, in place; whether any are left."""
    if not frame.demands:
        return True
    small, places = _network(network, frame, low, high)
    boxes = contracted(small, small.low[None], small.high[None], shrink=FIXED)
    if not len(boxes):
        return False
    low[places], high[places] = boxes.low[0], boxes.high[0]
    return True


def _network(network: Network, frame: Frame, low: Floats, high: Floats) -> tuple[Network, Indices]:
    """The network of a frame over its own numbers, and where these stand among all."""
    nodes: list[Node] = []
    made: dict[tuple[int, bytes], int] = {}
    demands = []
    for demand, rows in frame.demands:
        for number in _below(network, demand.node):
            key = (number, rows.tobytes() if network.nodes[number].rows > 1 else b"")
            if key not in made:
                made[key] = len(nodes)
                nodes.append(_sliced(network, number, rows, made))
        node = network.nodes[demand.node]
        allowed = demand.allowed
        if allowed[0].shape[1] > 1:
            allowed = allowed[0][:, rows], allowed[1][:, rows]
        demands.append(
            replace(demand, node=made[demand.node, rows.tobytes() if node.rows > 1 else b""], allowed=allowed)
        )
    places = np.unique(
        np.concatenate([np.empty(0, dtype=np.int64), *(n.places for n in nodes if n.places is not None)])
    )
    local = tuple(n if n.places is None else replace(n, places=np.searchsorted(places, n.places)) for n in nodes)
    small = replace(
        network,
        nodes=local,
        demands=tuple(demands),
        wanted=(),
        low=low[places],
        high=high[places],
        free=network.free[places],
        full_turn=network.full_turn[places],
    )
    return small, places


def _below(network: Network, root: int) -> Iterator[int]:
    """The nodes that a node depends on, arguments before what uses them, itself the last."""
    wanted, left = {root}, [root]
    while left:
        for argument in network.nodes[left.pop()].arguments:
            if argument not in wanted:
                wanted.add(argument)
                left.append(argument)
    return iter(sorted(wanted))


def _sliced(network: Network, number: int, rows: Indices, made: dict[tuple[int, bytes], int]) -> Node:
    """A node with some of its rows, on the ``made`` ones of its arguments."""
    node = network.nodes[number]
    arguments = tuple(made[a, rows.tobytes() if network.nodes[a].rows > 1 else b""] for a in node.arguments)
    if node.rows == 1:
        return replace(node, arguments=arguments)
    known = None if node.known is None else (node.known[0][:, rows], node.known[1][:, rows])
    places = None if node.places is None else node.places[rows]
    return replace(node, rows=len(rows), known=known, places=places, arguments=arguments)
