"""How a sparse problem will be solved, in words."""

from __future__ import annotations

from mbm.equations.assembly import Assembled
from mbm.sparse.equations import blocked
from mbm.sparse.system import plan


def solved_how(equations: Assembled) -> str:
    """Which family is eliminated, and what is left: for `mbm explain`."""
    free = set(equations.free.tolist())
    names = [
        entry.unknown.name
        for entry in equations.layout.entries
        if any(place in free for place in range(entry.coordinates.start, entry.coordinates.stop))
    ]
    found = plan(blocked(equations).structure(), equations.backend)
    many = f"there are {equations.dimension} scalar unknowns, of which each equation touches few"
    rest = "densely" if found.fronts is None else f"by sparse Cholesky ({found.fronts.count} fronts)"
    if found.elimination is None:
        return f"{many}: all are solved {rest}"
    return f"{many}: `{names[found.elimination.family]}` is eliminated, the other {found.width} are solved {rest}"
