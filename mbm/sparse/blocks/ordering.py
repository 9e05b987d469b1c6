"""An elimination order of small fill: approximate minimum degree (Amestoy, Davis and Duff 1996).

The graph of what is left is kept as a quotient graph. Node i has a list at ``places[i]``: ``elements[i]`` eliminated
nodes whose cliques it is in, then the nodes that it shares an entry of the matrix with, ``counts[i]`` numbers in all.
An eliminated node that no later one has absorbed is an *element*: its list is the clique that it left behind. Nodes
count as many times as they have columns, so that degrees are columns of the factor.
"""

from __future__ import annotations

from mbm.machine.words import Integer, Integers, distinct_arrays
from mbm.sparse.blocks.parts import Graph

GONE = -1
"""State of a node that was eliminated and absorbed; 0: it is left."""
ELEMENT = 1
"""State of an element."""


@distinct_arrays
def unlisted(node: Integer, graph: Graph) -> None:
    """Take a node out of the list of those of its degree."""
    after = graph.following[node]
    before = graph.previous[node]
    if after >= 0:
        graph.previous[after] = before
    if before >= 0:
        graph.following[before] = after
    else:
        graph.heads[graph.degrees[node]] = after


@distinct_arrays
def listed(node: Integer, graph: Graph) -> None:
    """Put a node in front of the list of those of its degree."""
    degree = graph.degrees[node]
    after = graph.heads[degree]
    graph.following[node] = after
    graph.previous[node] = -1
    if after >= 0:
        graph.previous[after] = node
    graph.heads[degree] = node


@distinct_arrays
def put_clique(pivot: Integer, stamp: Integer, begin: Integer, graph: Graph) -> Integer:
    """The neighbours of ``pivot`` behind each other from ``begin`` on in the lists; where they end, -1 beyond the room.

    They are marked by ``stamp`` in `seen`; the elements that they come from are absorbed.
    """
    states = graph.states
    seen = graph.seen
    lists = graph.lists
    room = graph.room
    own = lists[graph.places[pivot] :]
    end = begin
    seen[pivot] = stamp
    for t in range(graph.counts[pivot]):
        here = own[t]
        if t < graph.elements[pivot]:
            if states[here] == ELEMENT:
                clique = lists[graph.places[here] :]
                for s in range(graph.counts[here]):
                    node = clique[s]
                    if states[node] == 0 and seen[node] != stamp:
                        if end >= room:
                            return -1
                        seen[node] = stamp
                        lists[end] = node
                        end += 1
                states[here] = GONE
        elif states[here] == 0 and seen[here] != stamp:
            if end >= room:
                return -1
            seen[here] = stamp
            lists[end] = here
            end += 1
    return end


@distinct_arrays
def measure_elements(begin: Integer, end: Integer, tag: Integer, graph: Graph) -> None:
    """``outside[e] - tag``: columns of element e that are not in the clique ``begin … end``, for all that meet it.

    `outside` holds smaller numbers than ``tag`` before.
    """
    outside = graph.outside
    for t in range(begin, end):
        node = graph.lists[t]
        own = graph.lists[graph.places[node] :]
        for s in range(graph.elements[node]):
            element = own[s]
            if graph.states[element] == ELEMENT:
                if outside[element] < tag:
                    outside[element] = graph.cliques[element] + tag
                outside[element] -= graph.sizes[node]


@distinct_arrays
def updated_degree(node: Integer, pivot: Integer, stamp: Integer, tag: Integer, graph: Graph) -> Integer:
    """Columns that a node of the pivot's clique has for neighbours outside it at most; its list is brought up to date.

    Elements that lie within the clique are absorbed, and nodes of the clique leave the list: the pivot stands for them.
    """
    states = graph.states
    own = graph.lists[graph.places[node] :]
    many = graph.elements[node]
    kept = 0
    degree = 0
    for t in range(many):
        element = own[t]
        if states[element] == ELEMENT:
            beyond = graph.outside[element] - tag
            if beyond > 0:
                degree += beyond
                own[kept] = element
                kept += 1
            else:
                states[element] = GONE
    held = kept
    for t in range(many, graph.counts[node]):
        other = own[t]
        if states[other] == 0 and graph.seen[other] != stamp:
            degree += graph.sizes[other]
            own[held] = other
            held += 1
    # What left made room for the pivot: the first node behind the elements moves to the end.
    if held > kept:
        own[held] = own[kept]
    own[kept] = pivot
    graph.elements[node] = kept + 1
    graph.counts[node] = held + 1
    return degree


@distinct_arrays
def list_nodes(graph: Graph) -> None:
    """The degrees of all nodes of the graph, and the lists of those of equal degree, the first nodes in front."""
    for d in range(graph.columns + 1):
        graph.heads[d] = -1
    for back in range(graph.count):
        i = graph.count - 1 - back
        own = graph.lists[graph.places[i] :]
        degree = 0
        for t in range(graph.counts[i]):
            degree += graph.sizes[own[t]]
        graph.degrees[i] = degree
        listed(i, graph)


@distinct_arrays
def bounded_degree(beyond: Integer, before: Integer, inside: Integer, left: Integer) -> Integer:
    """The least of three bounds of a degree: ``inside`` the new clique and ``beyond``, or ``before`` it, or all that is
    ``left``.
    """
    degree = beyond + inside
    if degree > before + inside:
        degree = before + inside
    return left if degree > left else degree


@distinct_arrays
def order_nodes(graph: Graph, order: Integers) -> Integer:
    """The node that is eliminated at each place of ``order`` (count,); returns 1 where cliques have not enough room.

    The lists hold the neighbours of each node, ``counts[i]`` of them at ``places[i]``, each pair twice and no node by
    itself.
    """
    count = graph.count
    graph.elements = graph.work[0:]
    graph.states = graph.work[count:]
    graph.seen = graph.work[2 * count :]
    graph.outside = graph.work[3 * count :]
    graph.cliques = graph.work[4 * count :]
    graph.degrees = graph.work[5 * count :]
    graph.following = graph.work[6 * count :]
    graph.previous = graph.work[7 * count :]
    graph.heads = graph.work[8 * count :]
    degrees = graph.degrees
    free = 0
    for i in range(count):
        free += graph.counts[i]
    list_nodes(graph)
    least = 0
    left = graph.columns
    for k in range(count):
        while graph.heads[least] < 0:
            least += 1
        pivot = graph.heads[least]
        unlisted(pivot, graph)
        order[k] = pivot
        left -= graph.sizes[pivot]
        stamp = k + 1
        tag = stamp * (graph.columns + 1)
        end = put_clique(pivot, stamp, free, graph)
        if end < 0:
            return 1
        graph.states[pivot] = ELEMENT
        graph.places[pivot] = free
        graph.counts[pivot] = end - free
        for t in range(free, end):
            graph.cliques[pivot] += graph.sizes[graph.lists[t]]
        measure_elements(free, end, tag, graph)
        for t in range(free, end):
            i = graph.lists[t]
            size = graph.sizes[i]
            unlisted(i, graph)
            beyond = updated_degree(i, pivot, stamp, tag, graph)
            degrees[i] = bounded_degree(beyond, degrees[i], graph.cliques[pivot] - size, left - size)
            listed(i, graph)
            if degrees[i] < least:
                least = degrees[i]
        free = end
    return 0
