"""Records of restricted Python (see `from_python`): what `record` makes of a class, and how memory is shared out.

Each annotation of the class is a field: `Real`, `Integer`, an array, ``Reference[R]`` to another record, or a record
that lies inside. ``sized(…)`` is an array that `lay_out` takes from a larger one; its size is an expression of the
integers of a record that describes all sizes. ``table()`` is one of integers or of flat records whose offset from the
beginning of the record the field holds, ``behind()`` one that begins where the record ends.

A record of nothing but integers and tables, or of nothing but reals, is *flat*: an instance is a view on an array of
numbers (`view`), and the class has the place of each field, ``array[Block.outputs]``. Others hold what they are given.
"""

from __future__ import annotations
import __future__

import linecache
import re
import sys
from collections.abc import Callable, Mapping
from ctypes import addressof, c_char
from functools import cache
from inspect import get_annotations
from types import MappingProxyType
from typing import Annotated, Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from mbm.machine.kinds import Held
from mbm.machine.words import Integers, Reals
from mbm.values import dataclass

R = TypeVar("R")
Reference: TypeAlias = Annotated[R, "reference"]
"""A field that refers to another record."""

EIGHT = 8
"""Bytes of a number in machine code."""

_ARRAYS: Mapping[str, str] = MappingProxyType({"Reals": "reals", "Integers": "integers"})


class Records(Generic[R]):
    """An array of flat records."""

    __slots__ = ("_kind", "_numbers")

    def __init__(self, kind: type[R], numbers: NDArray[Any]) -> None:
        """The records from the beginning of ``numbers`` on."""
        self._kind = kind
        self._numbers = numbers

    def __getitem__(self, number: int) -> R:
        return view(self._kind, self._numbers[number * slots_of(self._kind) :])


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A field as its class states it; ``text`` is the annotation."""

    name: str
    text: str
    held: Held
    slot: int
    size: str


@dataclass(frozen=True, slots=True)
class _Stated:
    """What is said of an array instead of a value."""

    held: Held
    size: str = ""


def sized(size: str) -> Any:
    """An array of as many numbers as the expression says."""
    return _Stated(Held.SIZED, size)


def table() -> Any:
    """An array whose offset the field holds."""
    return _Stated(Held.TABLE)


def behind() -> Any:
    """An array that begins where the record ends."""
    return _Stated(Held.BEHIND)


def record(cls: type[R]) -> type[R]:
    """A class decorator: the class as a record."""
    plans: list[Plan] = []
    slots = 0
    for name, text in get_annotations(cls).items():
        stated = cls.__dict__.get(name)
        inner = named(cls, text)
        if stated is None:
            stated = _Stated(Held.VALUE if inner is None or text.startswith(("Reference", "Records")) else Held.INSIDE)
        plans.append(Plan(name=name, text=text, held=stated.held, slot=slots, size=stated.size))
        slots += slots_of(inner) if stated.held is Held.INSIDE and inner is not None else stated.held is not Held.BEHIND
    tables = (Held.TABLE, Held.BEHIND)
    kinds = {"Integer" if plan.held in tables else plan.text for plan in plans}
    made: dict[str, Any] = {"__doc__": cls.__doc__, "__module__": cls.__module__, "__qualname__": cls.__qualname__}
    made |= {"__plans__": tuple(plans), "__count__": slots}
    if kinds in ({"Integer"}, {"Real"}):
        made |= {plan.name: _Slot(plan, slots) for plan in plans}
        return type(cls.__name__, (_Flat,), {**made, "__slots__": ()})
    return type(cls.__name__, (_Struct,), {**made, "__slots__": tuple(plan.name for plan in plans)})


class _Flat:
    """A view on an array of numbers."""

    __slots__ = ("_numbers",)
    _numbers: NDArray[Any]


class _Struct:
    """Numbers, arrays, references and records, each under its name."""

    __slots__ = ()

    def __init__(self) -> None:
        for plan in plans_of(type(self)):
            inner = named(type(self), plan.text) if plan.held is Held.INSIDE else None
            numbers = {"Real": 0.0, "Integer": 0}
            setattr(self, plan.name, numbers.get(plan.text) if inner is None else inner())


class _Slot:
    """A field of a flat record: of the class its place, of an instance what it holds."""

    def __init__(self, plan: Plan, end: int) -> None:
        self._plan = plan
        self._end = end

    def __get__(self, owner: _Flat | None, cls: type) -> Any:
        plan = self._plan
        if owner is None:
            return plan.slot
        numbers = owner._numbers
        if plan.held is Held.VALUE:
            return numbers[plan.slot]
        found = numbers[self._end if plan.held is Held.BEHIND else numbers[plan.slot] :]
        inner = named(cls, plan.text)
        return found if inner is None else Records(inner, found)

    def __set__(self, owner: _Flat, value: float) -> None:
        owner._numbers[self._plan.slot] = value


def plans_of(cls: type) -> tuple[Plan, ...]:
    """The fields of a record."""
    found: tuple[Plan, ...] = vars(cls)["__plans__"]
    return found


def is_record(value: object) -> bool:
    """Whether a value is the class of a record."""
    return isinstance(value, type) and issubclass(value, _Flat | _Struct)


def name_of(cls: type) -> str:
    """The name of a record in texts."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()


def slots_of(cls: type) -> int:
    """Numbers, pointers and references of a record, with those of the records inside."""
    found: int = vars(cls)["__count__"]
    return found


@cache
def slots_by_name(kind: type) -> Mapping[str, int]:
    """The place of each field in a record, also of one that holds where a table is."""
    return MappingProxyType({plan.name: plan.slot for plan in plans_of(kind)})


def slot(kind: type, name: str) -> int:
    """The place of a field."""
    return slots_by_name(kind)[name]


def named(cls: type, text: str) -> type | None:
    """The record that the annotation of a field of ``cls`` names; None: none."""
    found = vars(sys.modules[cls.__module__]).get(text.rpartition("[")[2].rstrip("]"))
    return found if isinstance(found, type) and is_record(found) else None


def view(kind: type[R], numbers: NDArray[Any]) -> R:
    """A flat record that begins where an array does."""
    found = object.__new__(kind)
    vars(_Flat)["_numbers"].__set__(found, numbers)
    return found


def lay_out(record: object, sizes: object, reals: Reals, integers: Integers) -> None:
    """Let the sized arrays of a record, and of the records inside, be parts of two arrays, by the ``sizes``."""
    arrays = {"reals": reals, "integers": integers}
    kind: Any = type(record)
    layout(kind, _class(sizes))(record, sizes, *(arrays[name] for name in arrays_of(kind)))


def reals_in(kind: Any, sizes: object) -> int:
    """Reals that `lay_out` shares out."""
    return int(need(kind, _class(sizes), "reals")(sizes))


def integers_in(kind: Any, sizes: object) -> int:
    """Integers likewise."""
    return int(need(kind, _class(sizes), "integers")(sizes))


def _class(value: object) -> Any:
    return type(value)


@cache
def layout(kind: Any, sizes: Any) -> Callable[..., None]:
    """The function that `lay_out` stands for, in restricted Python itself."""
    name, arrays = f"{name_of(kind)}_by_{name_of(sizes)}", arrays_of(kind)
    given = "".join(f", {array}: {array.title()}" for array in arrays)
    lines = [f"def lay_out_{name}(record: {kind.__name__}, sizes: {sizes.__name__}{given}) -> None:"]
    lines += [f'    """Share out the arrays of a {name_of(kind)}."""', *(f"    {array}_used = 0" for array in arrays)]
    called: dict[str, object] = {}
    for plan in plans_of(kind):
        inner = named(kind, plan.text)
        if plan.held is Held.SIZED:
            array = _ARRAYS[plan.text]
            lines.append(f"    record.{plan.name} = {array}[{array}_used:]")
            lines.append(f"    {array}_used += {_of_sizes(plan.size)}")
        elif plan.held is Held.INSIDE and inner is not None and arrays_of(inner):
            within = arrays_of(inner)
            own = layout(inner, sizes)
            called[own.__name__] = own
            parts = "".join(f", {array}[{array}_used:]" for array in within)
            lines.append(f"    {own.__name__}(record.{plan.name}, sizes{parts})")
            lines += [f"    {array}_used += {_of_sizes(_need(inner, array))}" for array in within]
    return _function(f"lay_out_{name}", lines, {kind.__name__: kind, sizes.__name__: sizes, **called})


@cache
def need(kind: Any, sizes: Any, array: str) -> Callable[..., int]:
    """The function that `reals_in` and `integers_in` stand for."""
    name = f"{array}_in_{name_of(kind)}_by_{name_of(sizes)}"
    lines = [f"def {name}(sizes: {sizes.__name__}) -> Integer:", f'    """Room for a {name_of(kind)}."""']
    return _function(name, [*lines, f"    return {_of_sizes(_need(kind, array))}"], {sizes.__name__: sizes})


def arrays_of(kind: type) -> tuple[str, ...]:
    """Which of the two arrays a record takes something of."""
    return tuple(array for array in _ARRAYS.values() if _need(kind, array) != "0")


def _need(kind: type, array: str) -> str:
    """What a record takes of an array, as an expression."""
    found = []
    for plan in plans_of(kind):
        inner = named(kind, plan.text)
        if plan.held is Held.SIZED and _ARRAYS[plan.text] == array:
            found.append(plan.size)
        elif plan.held is Held.INSIDE and inner is not None and _need(inner, array) != "0":
            found.append(_need(inner, array))
    return " + ".join(found) or "0"


def _of_sizes(size: str) -> str:
    return re.sub(r"[a-z]\w*", r"sizes.\g<0>", size)


def _function(name: str, lines: list[str], known: Mapping[str, object]) -> Callable[..., Any]:
    """A function of a text, which is kept where the texts of files are."""
    file, text = f"<{name}>", "\n".join(lines) + "\n"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    names = dict(known)
    exec(compile(text, file, "exec", __future__.annotations.compiler_flag, dont_inherit=True), names)  # noqa: S102
    found: Callable[..., Any] = names[name]  # type: ignore[assignment]
    return found


def blank(kind: type, integers: int = 0) -> NDArray[np.int64]:
    """Memory for a record as machine code has it, and for so many integers behind it."""
    return np.zeros(slots_of(kind) + integers, dtype=np.int64)


def address(array: NDArray[Any]) -> int:
    """Where the numbers of a contiguous array are, in a fifth of the time that ``array.ctypes`` takes.

    Raises:
        TypeError: it is not contiguous, or of other numbers than machine code takes.

    """
    if not array.flags.c_contiguous or array.itemsize != EIGHT:
        raise TypeError(array.dtype)
    if array.size and array.flags.writeable:
        buffer: Any = array
        return addressof(c_char.from_buffer(buffer))
    return int(array.ctypes.data)


def put(memory: Any, kind: type, /, **values: Any) -> None:
    """Let fields of a record be numbers, arrays and other records: in memory their addresses.

    ``memory`` is a record of interpreted text, or an array that machine code takes for one. Raises TypeError as
    `address` does.
    """
    if isinstance(memory, np.ndarray):
        places = slots_by_name(kind)
        for name, value in values.items():
            memory[places[name]] = value if isinstance(value, int) else address(value)
    else:
        for name, value in values.items():
            setattr(memory, name, value.reshape(-1) if isinstance(value, np.ndarray) else value)


def inside(memory: Any, kind: type, name: str) -> Any:
    """The record that lies inside of another one, as `put` takes it."""
    return memory[slot(kind, name) :] if isinstance(memory, np.ndarray) else getattr(memory, name)
