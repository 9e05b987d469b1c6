"""Values of a planned experiment, in the units of the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mbm.text.types import Diagnostic
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignWish:
    """What is asked of a design.

    ``quantity`` is what is to be accurate (None: all estimates), ``criterion`` ``A``, ``c`` or ``D`` (None: ``c`` of
    one number, ``A`` of several in one unit, else ``D``), ``choose`` and ``budget`` bound the set of candidates
    (None: they do not), ``repeats`` allows one several times, ``sigma`` is a wanted standard deviation, in the unit
    of the quantity or with one, and ``observation`` the clause that the candidates belong to (None: the one whose
    table has their columns). ``solve`` says which of many is planned, from 1.
    """

    quantity: str | None = None
    criterion: str | None = None
    choose: int | None = None
    budget: float | None = None
    repeats: bool = False
    sigma: float | str | None = None
    observation: str | None = None
    seed: int = 1
    solve: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedSigma:
    """A number that is estimated or derived: ``value`` at the point, ``sigma`` to expect (None: not determined)."""

    name: str
    value: float | None
    sigma: float | None
    unit: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RowWorth:
    """A row (None: the equation has no table) of a clause, and what the ``quantity`` loses without it.

    ``growth`` is its standard deviation without the row over that with it; None: it is not determined without it.
    """

    clause: str
    row: int | None
    quantity: str
    growth: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A row of the table of candidates (from 1), its cells, and its ``cost`` (1 where none is stated).

    ``determined``: with it, everything asked for is. ``sigma`` is then to be expected (of several numbers the root of
    their mean square; None where their units differ), ``gain`` by which factor it shrinks (of different units the
    geometric mean; None: it was not determined before), and ``observable``: it determines something that was not.
    ``repeats`` is how often it must be measured to reach the wanted standard deviation (None: never, or none is
    wanted).
    """

    row: int
    cells: Mapping[str, Any]
    cost: float
    determined: bool
    sigma: float | None
    gain: float | None
    observable: bool
    repeats: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenSet:
    """Which rows of the candidates to measure, how often each, what that costs, and the standard deviation to expect.

    ``sigmas`` has those of each number of the quantity; ``objective`` is what the criterion makes small (the logarithm
    of the determinant; None: something is not determined); ``exhaustive``: all sets were compared.
    """

    criterion: str
    rows: tuple[int, ...]
    counts: tuple[int, ...]
    cost: float
    determined: bool
    sigma: float | None
    sigmas: tuple[float | None, ...]
    objective: float | None
    exhaustive: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Planned:
    """The accuracy to expect of an experiment, and what to measure next.

    ``key`` tells the solve from others of the problem. ``point`` says where the model was linearised: ``given``,
    ``estimates`` or ``start``. ``quantity`` is what was asked for, ``unit`` its unit; without candidates it is
    ``determined`` with the standard deviation ``sigma`` (of several numbers the root of their mean square; None where
    their units differ); ``free`` are sentences about what is not determined. ``candidates`` stand in the order of their
    table.
    """

    problem: str
    key: Mapping[str, str | float]
    point: str
    expected: tuple[ExpectedSigma, ...]
    worth: tuple[RowWorth, ...]
    free: tuple[str, ...]
    quantity: str | None
    unit: str | None
    determined: bool
    sigma: float | None
    wanted: float | None
    candidates: tuple[Candidate, ...]
    chosen: ChosenSet | None
    notes: tuple[Diagnostic, ...]

    @property
    def observable(self) -> bool:
        """Everything that is estimated, or asked for, is determined without candidates."""
        return self.determined if self.quantity is not None else not self.free
