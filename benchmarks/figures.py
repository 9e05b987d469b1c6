"""A line of the table of figures: what mbm needs, what a peer needs for the same, and what was to be reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.machine import machine, show


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One comparison.

    ``ratio``: the peer's figure over ours, above 1 where mbm needs less; None where there is none to form.
    ``asked`` is what was to be reached, ``reached`` whether it is (None: nothing was asked of this line). ``compared``
    says how the answers were found to be the same. ``quoted``: the peer was not run here, its figure was published.
    """

    work: str
    ours: str
    peer: str = ""
    theirs: str = ""
    ratio: float | None = None
    asked: str = ""
    reached: bool | None = None
    compared: str = ""
    quoted: bool = False

    def cells(self) -> list[str]:
        """The line as texts."""
        peer = f"{self.peer} (quoted)" if self.quoted else self.peer
        ratio = "" if self.ratio is None else shown(self.ratio)
        reached = {None: "", True: "yes", False: "**no**"}[self.reached]
        return [self.work, self.ours, peer, self.theirs, ratio, self.asked, reached, self.compared]


HEADS = ["work", "mbm", "peer", "its figure", "ratio", "asked", "reached", "answers"]


def shown(ratio: float) -> str:
    """A ratio with two or three digits."""
    return f"{ratio:.0f}" if ratio >= 20 else f"{ratio:.1f}" if ratio >= 2 else f"{ratio:.2f}"


def duration(seconds: float) -> str:
    """A time with three digits, in the unit that suits it."""
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")):
        if seconds >= size or unit == "ns":
            number = seconds / size
            return f"{number:.{0 if number >= 100 else 1 if number >= 10 else 2}f} {unit}"
    raise AssertionError


def show_figures(figures: Sequence[Figure]) -> None:
    """The machine and the lines, for one benchmark by itself."""
    print(machine())
    show(HEADS, [figure.cells() for figure in figures])
