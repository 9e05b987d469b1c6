"""A filter or smoother as generated code takes it: sizes, descriptions of its equations, what it begins with."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from mbm.emit.answers import Floats
from mbm.emit.foreign import Foreign
from mbm.emit.types import BlockCase, Blueprint
from mbm.kernels.types import Kernel
from mbm.values import dataclass


class Moment(StrEnum):
    """When a group has rows: at every step as its table has them, one at the first of these, those that are known
    before at the first step, or at the first that is observed.
    """

    ALWAYS = "always"
    ONCE = "once"
    FIRST = "first"
    BEGINNING = "beginning"


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedRows:
    """Rows that are known when the filter is made, one after the other: the four arrays of `mbm.solver.description`."""

    count: int
    parameters: tuple[float, ...]
    weights: tuple[float, ...]
    index: tuple[int, ...]
    columns: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterGroup:
    """Rows of one kernel: room for ``capacity`` of them at each step; ``fixed`` are those that are no caller's.

    ``noise`` (of transitions) is the first column of their noise, and how many they have.
    """

    kernel: Kernel
    moment: Moment
    capacity: int
    fixed: FixedRows | None = None
    noise: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterSystem:
    """The equations of a step, or of a transition, as `mbm.solver.description` says: ``data`` for those that are held.

    ``sizes`` are those of the four arrays of rows; ``reals`` is the scratch that `mbm.solver.workspace.Rows` takes.
    """

    problem: tuple[int, ...]
    constants: tuple[float, ...]
    data: tuple[int, ...]
    sizes: tuple[int, int, int, int]
    reals: int
    groups: tuple[FilterGroup, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Where an unknown or a state begins among the numbers and coordinates of a step; whether it ``moves``."""

    number: int
    coordinate: int
    moves: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepReferences:
    """What ``mbm solve`` answers for the first T steps of the data of compile time.

    ``numbers`` (T, N) as they are reported, ``covariances`` (T, n, n; NaN: not determined), ``costs`` (T,). ``derived``
    has at each step of each derived quantity the values (rows, size) and their covariances (rows, size, size).
    """

    keys: Floats
    numbers: Floats
    covariances: Floats
    costs: Floats
    derived: tuple[tuple[tuple[Floats, Floats], ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterPlan:
    """A filter as plain data. N numbers and M coordinates of a step, of which n vary.

    ``chain`` is `mbm.solver.filter_records.Chain`; ``reals`` and ``integers`` are the scratch of a walk. It begins at
    ``point`` (N,) with the factor (n, n), ``open`` (m, n) has no prior. ``column`` (M,) gives each coordinate its place
    among those that vary, -1: it stays; ``pair_column`` likewise for those of a transition, in which what is of the
    step reached stands ``ahead`` numbers and coordinates behind. ``angles`` are the numbers that are one.
    ``rows`` the most rows of a table at a step, and in a sequence of those ``beside``: without steps, they have other
    rows in each. ``key`` is the steps' column, ``steps`` and ``reached`` the tables made of steps and of transitions,
    ``joined`` the tables of which transitions take columns.
    """

    method: str
    chain: Mapping[str, int]
    seen: FilterSystem
    moving: FilterSystem
    reals: int
    integers: int
    skip: float
    tolerance: float
    smooth: bool
    point: Floats
    factor: Floats
    open: Floats
    rates: tuple[int, ...]
    column: tuple[int, ...]
    pair_column: tuple[int, ...]
    ahead: tuple[int, int]
    parts: Mapping[Foreign, Part]
    angles: tuple[int, ...]
    names: tuple[Foreign, ...]
    rows: Mapping[Foreign, int]
    beside: tuple[Foreign, ...]
    key: Foreign
    steps: Foreign
    reached: Foreign
    joined: tuple[Foreign, ...]
    references: StepReferences


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowShape:
    """Windows of a file's rows, in SI, each a sequence: ``end − length < column ≤ end``.

    Ends are those of the rows of the ``observed`` tables; of these a window has at least ``least`` rows.
    """

    column: Foreign
    length: float
    step: float
    least: int
    observed: tuple[Foreign, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterBlueprint:
    """``blueprint`` has tables, links and clauses; ``cases`` are the kernels of ``plan``: of a step, of a transition.

    ``given`` are the tables that the caller gives the rows of a step of, by their names in the problem, ``beside``
    those that he gives before the first step; ``family_sizes`` the members of each family. ``files`` has the tables of
    files, with what tells one sequence from the other there: `Blueprint.for_each`, and the ``window``.
    """

    blueprint: Blueprint
    plan: FilterPlan
    seen: tuple[BlockCase, ...]
    moving: tuple[BlockCase, ...]
    given: tuple[Foreign, ...]
    beside: tuple[Foreign, ...]
    files: Blueprint
    window: WindowShape | None
    family_sizes: tuple[int, ...]
