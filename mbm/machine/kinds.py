"""Types of values of the little language: numbers, arrays, records and arrays of records."""

from __future__ import annotations

from enum import Enum
from typing import TypeAlias

from mbm.values import dataclass

LANES = 4
"""Rows of a kernel's block; `mbm.solver.modules` reads the solver with another number where that is asked for."""


class Type(Enum):
    """Numbers, and pointers to them (constant: what they point to is only read)."""

    REAL = "real"
    INTEGER = "integer"
    REALS = "reals"
    INTEGERS = "integers"
    CONSTANT_REALS = "constant reals"
    CONSTANT_INTEGERS = "constant integers"

    @property
    def element(self) -> Type:
        """What a pointer points to."""
        if self in (Type.REALS, Type.CONSTANT_REALS):
            return Type.REAL
        if self in (Type.INTEGERS, Type.CONSTANT_INTEGERS):
            return Type.INTEGER
        raise TypeError(self)

    @property
    def is_pointer(self) -> bool:
        """Whether it is an array."""
        return self not in (Type.REAL, Type.INTEGER)


class Held(Enum):
    """How a record holds a member.

    VALUE: a number, a pointer or a reference that may be assigned. SIZED: a pointer that `lay_out` sets. TABLE: an
    array whose offset from the beginning of the record the slot holds. BEHIND: one that begins where the record ends.
    INSIDE: another record.
    """

    VALUE = "value"
    SIZED = "sized"
    TABLE = "table"
    BEHIND = "behind"
    INSIDE = "inside"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Member:
    """A field of a record; it begins at a slot of eight bytes. ``size`` is the text of an expression, where SIZED."""

    name: str
    type: Kind
    held: Held
    slot: int
    size: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record:
    """The type of a record; values are references to one. ``slots`` are its numbers, pointers and references."""

    name: str
    doc: str
    members: tuple[Member, ...]
    slots: int

    @property
    def is_pointer(self) -> bool:
        """It is no array."""
        return False

    @property
    def element(self) -> Kind:
        """It has no elements."""
        raise TypeError(self.name)

    @property
    def number(self) -> Type | None:
        """The type of all its numbers where it is *flat*: a view on an array of numbers; None where it is not."""
        only: Kind | None = None
        for member in self.members:  # the first that differs ends it: printers ask at every access
            kind = Type.INTEGER if member.held in (Held.TABLE, Held.BEHIND) else member.type
            if only not in (None, kind):
                return None
            only = kind
        return only if only is Type.INTEGER or only is Type.REAL else None

    def member(self, name: str) -> Member | None:
        """A field by its name."""
        return next((each for each in self.members if each.name == name), None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Records:
    """The type of an array of flat records, one behind the other."""

    element: Record

    @property
    def is_pointer(self) -> bool:
        """It is an array."""
        return True


Kind: TypeAlias = Type | Record | Records
