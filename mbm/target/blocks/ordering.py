"""An elimination order of small fill: approximate minimum degree (Amestoy, Davis and Duff 1996).

The graph of what is left is kept as a quotient graph. Node i has a list at ``places[i]``: ``elements[i]`` eliminated
nodes whose cliques it is in, then the nodes that it shares an entry of the matrix with, ``counts[i]`` numbers in all.
An eliminated node that no later one has absorbed is an *element*: its list is the clique that it left behind. Nodes
count as many times as they have columns, so that degrees are columns of the factor.
"""

from __future__ import annotations

from mbm.target.words import ConstantIntegers, Integer, Integers, distinct_arrays

GONE = -1
"""State of a node that was eliminated and absorbed; 0: it is left."""
ELEMENT = 1
"""State of an element."""


@distinct_arrays
def unlisted(node: Integer, degree: Integer, heads: Integers, following: Integers, previous: Integers) -> None:
    """Take a node out of the list of those of its degree."""
    after = following[node]
    before = previous[node]
    if after >= 0:
        previous[after] = before
    if before >= 0:
        following[before] = after
    else:
        heads[degree] = after


@distinct_arrays
def listed(node: Integer, degree: Integer, heads: Integers, following: Integers, previous: Integers) -> None:
    """Put a node in front of the list of those of its degree."""
    after = heads[degree]
    following[node] = after
    previous[node] = -1
    if after >= 0:
        previous[after] = node
    heads[degree] = node


@distinct_arrays
def put_clique(
    pivot: Integer,
    stamp: Integer,
    begin: Integer,
    room: Integer,
    places: ConstantIntegers,
    counts: ConstantIntegers,
    elements: ConstantIntegers,
    states: Integers,
    seen: Integers,
    lists: Integers,
) -> Integer:
    """The neighbours of ``pivot`` behind each other from ``begin`` on in ``lists``; where they end, -1 beyond ``room``.

    They are marked by ``stamp`` in ``seen``; the elements that they come from are absorbed.
    """
    end = begin
    seen[pivot] = stamp
    for t in range(counts[pivot]):
        here = lists[places[pivot] + t]
        if t < elements[pivot]:
            if states[here] == ELEMENT:
                for s in range(counts[here]):
                    node = lists[places[here] + s]
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
def measure_elements(
    begin: Integer,
    end: Integer,
    tag: Integer,
    sizes: ConstantIntegers,
    places: ConstantIntegers,
    elements: ConstantIntegers,
    states: ConstantIntegers,
    cliques: ConstantIntegers,
    lists: ConstantIntegers,
    outside: Integers,
) -> None:
    """``outside[e] - tag``: columns of element e that are not in the clique ``begin … end``, for all that meet it.

    ``cliques[e]`` are the columns of an element; ``outside`` holds smaller numbers than ``tag``.
    """
    for t in range(begin, end):
        node = lists[t]
        for s in range(elements[node]):
            element = lists[places[node] + s]
            if states[element] == ELEMENT:
                if outside[element] < tag:
                    outside[element] = cliques[element] + tag
                outside[element] -= sizes[node]


@distinct_arrays
def updated_degree(
    node: Integer,
    pivot: Integer,
    stamp: Integer,
    tag: Integer,
    sizes: ConstantIntegers,
    places: ConstantIntegers,
    outside: ConstantIntegers,
    seen: ConstantIntegers,
    counts: Integers,
    elements: Integers,
    states: Integers,
    lists: Integers,
) -> Integer:
    """Columns that a node of the pivot's clique has for neighbours outside it at most; its list is brought up to date.

    Elements that lie within the clique are absorbed, and nodes of the clique leave the list: the pivot stands for them.
    """
    place = places[node]
    many = elements[node]
    kept = 0
    degree = 0
    for t in range(many):
        element = lists[place + t]
        if states[element] == ELEMENT:
            beyond = outside[element] - tag
            if beyond > 0:
                degree += beyond
                lists[place + kept] = element
                kept += 1
            else:
                states[element] = GONE
    held = kept
    for t in range(many, counts[node]):
        other = lists[place + t]
        if states[other] == 0 and seen[other] != stamp:
            degree += sizes[other]
            lists[place + held] = other
            held += 1
    # What left made room for the pivot: the first node behind the elements moves to the end.
    if held > kept:
        lists[place + held] = lists[place + kept]
    lists[place + kept] = pivot
    elements[node] = kept + 1
    counts[node] = held + 1
    return degree


@distinct_arrays
def list_nodes(
    count: Integer,
    columns: Integer,
    sizes: ConstantIntegers,
    places: ConstantIntegers,
    counts: ConstantIntegers,
    lists: ConstantIntegers,
    degrees: Integers,
    heads: Integers,
    following: Integers,
    previous: Integers,
) -> None:
    """The degrees of all nodes of the graph, and the lists of those of equal degree, the first nodes in front."""
    for d in range(columns + 1):
        heads[d] = -1
    for back in range(count):
        i = count - 1 - back
        degree = 0
        for t in range(counts[i]):
            degree += sizes[lists[places[i] + t]]
        degrees[i] = degree
        listed(i, degree, heads, following, previous)


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
def order_nodes(
    count: Integer,
    columns: Integer,
    sizes: ConstantIntegers,
    room: Integer,
    places: Integers,
    counts: Integers,
    lists: Integers,
    work: Integers,
    order: Integers,
) -> Integer:
    """The node that is eliminated at each place of ``order`` (count,); returns 1 where cliques have not enough room.

    The ``columns`` of all nodes are the sum of ``sizes``. ``lists`` has room for ``room`` numbers: first the neighbours
    of each node, ``counts[i]`` of them at ``places[i]``, each pair twice and no node by itself. ``work`` has room for
    ``8 · count + columns + 1`` numbers, the first ``5 · count`` of them zero.
    """
    elements = work[0:]
    states = work[count:]
    seen = work[2 * count :]
    outside = work[3 * count :]
    cliques = work[4 * count :]
    degrees = work[5 * count :]
    following = work[6 * count :]
    previous = work[7 * count :]
    heads = work[8 * count :]
    free = 0
    for i in range(count):
        free += counts[i]
    list_nodes(count, columns, sizes, places, counts, lists, degrees, heads, following, previous)
    least = 0
    left = columns
    for k in range(count):
        while heads[least] < 0:
            least += 1
        pivot = heads[least]
        unlisted(pivot, least, heads, following, previous)
        order[k] = pivot
        left -= sizes[pivot]
        stamp = k + 1
        tag = stamp * (columns + 1)
        end = put_clique(pivot, stamp, free, room, places, counts, elements, states, seen, lists)
        if end < 0:
            return 1
        states[pivot] = ELEMENT
        places[pivot] = free
        counts[pivot] = end - free
        for t in range(free, end):
            cliques[pivot] += sizes[lists[t]]
        measure_elements(free, end, tag, sizes, places, elements, states, cliques, lists, outside)
        for t in range(free, end):
            i = lists[t]
            unlisted(i, degrees[i], heads, following, previous)
            beyond = updated_degree(i, pivot, stamp, tag, sizes, places, outside, seen, counts, elements, states, lists)
            degrees[i] = bounded_degree(beyond, degrees[i], cliques[pivot] - sizes[i], left - sizes[i])
            listed(i, degrees[i], heads, following, previous)
            if degrees[i] < least:
                least = degrees[i]
        free = end
    return 0
