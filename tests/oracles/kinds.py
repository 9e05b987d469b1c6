"""What a kind of random problem is: what the language says of it, and the same written out with NumPy."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from tests.oracles.numerics import Statement

Tables = Mapping[str, Mapping[str, np.ndarray]]
SETS = 6
"""Data sets of a kind in a test run: more than the eight from which on mbm solves those of `for-each` together."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a path says: estimates (N,), standard deviations (n,); None: not said.

    What a bound holds has the standard deviation NaN; 0 says a generated solver, which prints numbers alone.
    ``derived`` (k, 2) are derived quantities with their standard deviations.
    """

    values: np.ndarray
    sigmas: np.ndarray | None
    status: str
    cost: float | None = None
    dof: int | None = None
    factors: np.ndarray | None = None
    derived: np.ndarray | None = None


def one(**columns: np.ndarray) -> Tables:
    """The columns of the only table."""
    return {"d": columns}


def _as_it_is(answer: Answer) -> Answer:
    return answer


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Random problems that differ in their data only.

    ``unknowns`` are names with what the language says of each, ``clauses`` the rest of the problem, with the unknowns
    in braces, and ``{over}`` behind the sides of constraints; ``draw`` makes the tables of a data set. ``residuals``
    (m,) are whitened with the stated noise, priors included, of points x (n,) and tables; ``start`` is the stated one.
    ``equal``, ``below`` as in `Statement`.
    ``groups`` are the tables whose noise is unknown, each with a factor of its own, among so many ``noises``.
    ``scatters`` says that the problem may be a member of a large one: its noise is stated, and no rule looks at all its
    rows together. ``many``: there may be several minima; ``elsewhere`` are points that lead to others. ``moved``
    (points and steps) and ``apart`` (steps between points) are for what is no vector; ``true`` are measured values
    (k,) to start with, whose true values are further arguments of ``residuals``. ``options`` are those of data clauses;
    what has a key is the same in all data sets. ``keys`` are the columns, by table, that give measured values with
    errors to rows: members of a large problem have values of their own.
    ``given`` are the columns that change values only, neither noise nor members; None: data sets differ in more.
    ``told`` makes of an answer what is compared: where the data leave something free, what they do determine.
    ``solve`` are options of the solve clause that are part of the problem. ``calls``: the clauses call functions in
    Python.
    """

    unknowns: Mapping[str, str]
    clauses: str
    draw: Callable[[np.random.Generator], Tables]
    residuals: Callable[[np.ndarray, Tables], np.ndarray]
    start: tuple[float, ...]
    loss: Callable[[np.ndarray], np.ndarray] | None = None
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None
    equal: Callable[[np.ndarray], np.ndarray] | None = None
    below: Callable[[np.ndarray], np.ndarray] | None = None
    groups: tuple[str, ...] = ()
    noises: int = 1
    scatters: bool = False
    many: bool = False
    elsewhere: tuple[tuple[float, ...], ...] = ()
    moved: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    apart: Callable[[np.ndarray, np.ndarray], np.ndarray] = np.subtract
    true: Callable[[Tables], np.ndarray] | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)
    given: tuple[str, ...] | None = ("d.x", "d.y")
    told: Callable[[Answer], Answer] = _as_it_is
    solve: str = ""
    calls: bool = False

    def text(self, more: str = "", *, per: str | None = None) -> str:
        """The problem; ``per``: with one member of each unknown for each value of that column of the first table."""
        tables = list(self.draw(np.random.default_rng(0)))
        family = f" :per {tables[0]}.{per}" if per else ""
        unknowns = " ".join(f"({name}{family} {stated})" for name, stated in self.unknowns.items())
        names = {name: f"({name} {per})" if per else name for name in self.unknowns}
        clauses = self.clauses.format(**names, over=" :over sets" if per else "")
        data = " ".join(f"(data {table} external {self.options.get(table, '')})" for table in tables)
        if clauses.count(":over sets"):
            data += " (data sets external)"
        if self.solve:
            more = (
                more.replace("(solve", f"(solve {self.solve}") if "(solve" in more else f"{more} (solve {self.solve})"
            )
        return f"(problem p {data} (unknowns {unknowns}) {clauses} {more})"

    def statement(self, tables: Tables, factors: np.ndarray, base: np.ndarray | None = None) -> Statement:
        """What SciPy minimises, with ``factors`` of the noise of each group; about ``base`` where points are moved."""
        start = np.array(self.start, dtype=float)
        if base is not None:
            start = np.zeros(len(self.apart(base, base)))
        elif self.true is not None:
            start = np.concatenate([start, self.true(tables)])
        scale = self.scale(tables, factors)
        return Statement(
            residuals=lambda x: self.residuals(x if base is None else self.moved(base, x), tables) / scale,
            start=start,
            loss=self.loss,
            lower=None if self.lower is None else np.array(self.lower),
            upper=None if self.upper is None else np.array(self.upper),
            equal=self.equal,
            below=self.below,
        )

    @property
    def components(self) -> bool:
        """Whether there are several noises, one of them unknown: else one unknown factor changes no weights."""
        return bool(self.groups) and self.noises > 1

    def rows(self, tables: Tables) -> list[np.ndarray]:
        """The residuals of each group, which come first, in the order of the groups."""
        ends = np.cumsum([0] + [len(next(iter(tables[name].values()))) for name in self.groups])
        return [np.arange(first, end) for first, end in pairwise(ends)]

    def scale(self, tables: Tables, factors: np.ndarray) -> np.ndarray | float:
        """The factor of each residual (m,)."""
        if not self.components:
            return 1.0
        found = np.ones(len(self.residuals(np.array(self.start, dtype=float), tables)))
        for factor, rows in zip(factors, self.rows(tables), strict=True):
            found[rows] = factor
        return found


def drawn(name: str, kind: Kind, sets: int = SETS, seed: int = 1) -> list[Tables]:
    """The data sets of a kind, the same in every run."""
    own = int.from_bytes(hashlib.sha256(f"{name} {seed}".encode()).digest()[:8], "big")
    return [kind.draw(np.random.default_rng([own, number])) for number in range(sets)]
