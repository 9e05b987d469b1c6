"""What elaboration hands on: a problem, the tables it was elaborated against, and which of their values decided it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from mbm.problem.tables import Table
from mbm.problem.types import Problem, RowValues
from mbm.text.types import Diagnostic
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.language.session import ReadFile


@dataclass(frozen=True, slots=True, kw_only=True)
class Grouping:
    """Rows of ``table`` were told apart by their values in ``columns``, among those that ``when`` keeps (None: all).

    ``filtered`` is false for what was decided before the table's ``:where`` took rows away: that condition itself.
    """

    table: str
    columns: tuple[str, ...]
    when: RowValues | None = None
    filtered: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Consulted:
    """Which values of the tables the equations were made for: with others, they may be others, or wrong.

    ``keyed`` are the tables of families of which a member was named by its key. ``everything``: no account was kept.
    ``constants`` are the names of numbers of constants whose values decided something.
    """

    groupings: tuple[Grouping, ...] = ()
    keyed: tuple[str, ...] = ()
    everything: bool = False
    constants: tuple[str, ...] = ()

    @property
    def nothing(self) -> bool:
        """Whether the equations are the same for any rows of the same columns."""
        return not (self.groupings or self.keyed or self.everything)


@dataclass(frozen=True, slots=True, kw_only=True)
class Elaborated:
    """A problem with the tables it was elaborated against, and the starts (SI) that were given from outside.

    ``lasting`` are those of the problem's warnings that hold for any tables, ``read`` the files that its forms name.
    """

    problem: Problem
    raw: Mapping[str, Table]
    tables: Mapping[str, Table]
    starts: Mapping[str, tuple[float, ...]]
    consulted: Consulted
    lasting: tuple[Diagnostic, ...]
    read: tuple[ReadFile, ...] = ()
