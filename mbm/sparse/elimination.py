"""Schur elimination: a family of which no two members meet is solved for member by member, and leaves the equations.

With ``A = L Lᵀ`` the diagonal blocks of the family, ``W`` its coupling to the rest and ``Y = L⁻¹ W``, the rest obeys
``S = B - YᵀY`` (Brown 1958; Triggs, McLauchlan, Hartley and Fitzgibbon 2000).

``Y`` is stored member by member as panels (size, columns that the member meets), one after the other in one array. A
*link* is the part of a panel that belongs to one block of the rest.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.sparse.normal import Normal, NormalPattern
from mbm.values import dataclass

WORTH = 8
"""A family is eliminated if it has at least so many members …"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cross:
    """The blocks between the eliminated family and another one, at members ``i`` (eliminated) and ``j``.

    ``flipped``: their rows are the other family's. ``places``: where the first row of each stands in ``Y``.
    """

    pair: tuple[int, int]
    flipped: bool
    i: Indices
    j: Indices
    shape: tuple[int, int]
    places: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Links:
    """All links, by member, then by column.

    Those of member m are ``begins[m] … begins[m + 1]``, its panel has ``lengths[m]`` columns. Link l is of member
    ``members[l]`` and has ``wides[l]`` columns, from the column ``columns[l]`` of the rest on; its first row is at
    ``places[l]``. Block i of the rest has its first column at ``heads[i]``, is ``sizes[i]`` wide, and has the links
    ``order[starts[i]:starts[i + 1]]``.
    """

    begins: Indices
    lengths: Indices
    members: Indices
    columns: Indices
    wides: Indices
    places: Indices
    heads: Indices
    sizes: Indices
    starts: Indices
    order: Indices

    @property
    def blocks(self) -> Indices:
        """The block of the rest (links,) of each link."""
        return np.asarray(np.searchsorted(self.heads, self.columns))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elimination:
    """``family``, with members of ``size`` columns, goes.

    ``rest`` (columns,) gives the place of each padded column among the ``width`` others, -1 in the family; ``Y`` has
    ``numbers`` numbers.
    """

    family: int
    size: int
    crosses: tuple[Cross, ...]
    rest: Indices
    width: int
    links: Links
    numbers: int

    def couplings(self, normal: Normal) -> list[Floats]:
        """``W`` as blocks (blocks, size of the family, size of the other), one array for each cross."""
        found = []
        for cross in self.crosses:
            blocks = normal.blocks[cross.pair]
            found.append(blocks.transpose(0, 2, 1) if cross.flipped else blocks)
        return found

    def coupled(self) -> tuple[Indices, Indices]:
        """The blocks (i ≤ j) of the rest that ``YᵀY`` fills."""
        from scipy.sparse import csr_array, triu

        links = self.links
        shape = (len(links.begins) - 1, len(links.heads))
        ones = csr_array((np.ones(len(links.columns)), links.blocks, links.begins), shape=shape)
        found = triu(ones.T @ ones).tocoo()
        return found.row.astype(np.int64), found.col.astype(np.int64)


def eliminable(pattern: NormalPattern) -> int | None:
    """The largest family of which no two members meet; None where it is not worth while.

    It should outweigh the rest of the unknowns: else the order of elimination in sparse Cholesky does as well.
    """
    families = pattern.structure.families
    best, size = None, 0
    for number, family in enumerate(families):
        pair = pattern.pairs[number, number]
        if len(pair.i) == family.members and family.members >= WORTH and family.members * family.size > size:
            best, size = number, family.members * family.size
    return best if 2 * size >= pattern.structure.columns else None


def elimination(pattern: NormalPattern, family: int) -> Elimination:
    """The places of everything once ``family`` is gone."""
    families = pattern.structure.families
    gone = families[family]
    rest = np.full(pattern.structure.columns, -1, dtype=np.int64)
    kept = np.ones(len(rest), dtype=bool)
    kept[gone.columns] = False
    width = int(kept.sum())
    rest[kept] = np.arange(width)
    found = []
    for (left, right), pair in pattern.pairs.items():
        if left == right or family not in (left, right) or not len(pair.i):
            continue
        flipped = right == family
        ends = (pair.j, pair.i) if flipped else (pair.i, pair.j)
        found.append(((left, right), flipped, *ends, families[left if flipped else right]))
    none = np.zeros(0, dtype=np.int64)
    members = np.concatenate([none, *(i for _, _, i, _, _ in found)])
    columns = np.concatenate([none, *(rest[other.first] + j * other.size for _, _, _, j, other in found)])
    wides = np.concatenate([none, *(np.full(len(j), other.size) for _, _, _, j, other in found)])
    others = [f for n, f in enumerate(families) if n != family]
    heads = np.concatenate([none, *(rest[f.first] + np.arange(f.members) * f.size for f in others)])
    sizes = np.concatenate([none, *(np.full(f.members, f.size) for f in others)])
    links, places = _links(gone.members, gone.size, (members, columns, wides), heads, sizes, width)
    crosses, reached = [], 0
    for key, flipped, i, j, other in found:
        own = places[reached : reached + len(i)]
        crosses.append(Cross(pair=key, flipped=flipped, i=i, j=j, shape=(gone.size, other.size), places=own))
        reached += len(i)
    return Elimination(
        family=family,
        size=gone.size,
        crosses=tuple(crosses),
        rest=rest,
        width=width,
        links=links,
        numbers=gone.size * int(wides.sum()),
    )


def _links(
    count: int, size: int, given: tuple[Indices, Indices, Indices], heads: Indices, sizes: Indices, width: int
) -> tuple[Links, Indices]:
    """The links from members, columns and widths in any order, and the place in ``Y`` of each in the order given."""
    order = np.argsort(given[0] * max(width, 1) + given[1], kind="stable")
    members, columns, wides = (each[order] for each in given)
    begins = np.searchsorted(members, np.arange(count + 1))
    ends = np.concatenate([[0], np.cumsum(wides)])
    lengths = np.diff(ends[begins])
    places = size * ends[begins[members]] + ends[:-1] - ends[begins[members]]
    blocks = np.searchsorted(heads, columns)
    by_block = np.argsort(blocks, kind="stable")
    links = Links(
        begins=begins,
        lengths=lengths,
        members=members,
        columns=columns,
        wides=wides,
        places=places,
        heads=heads,
        sizes=sizes,
        starts=np.searchsorted(blocks[by_block], np.arange(len(heads) + 1)),
        order=by_block,
    )
    given_places = np.empty_like(places)
    given_places[order] = places
    return links, given_places
