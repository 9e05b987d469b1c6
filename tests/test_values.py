"""`mbm.values.dataclass` does what `dataclasses.dataclass` does."""

from __future__ import annotations

import copy
import pickle
from dataclasses import FrozenInstanceError, dataclass, field, fields, is_dataclass, replace

import pytest

from mbm import values


def pair(options, namespace):
    """The same class made by the standard library and by ours; ``namespace`` makes its body anew for each."""
    return [decorate(**options)(type("Thing", (), namespace())) for decorate in (dataclass, values.dataclass)]


def body():
    return {
        "__annotations__": {"a": "int", "b": "list[int]", "c": "str", "hidden": "int"},
        "__module__": __name__,
        "b": field(default_factory=list),
        "c": "x",
        "hidden": field(default=3, compare=False, repr=False),
    }


OPTIONS = [
    {"frozen": frozen, "slots": slots, "kw_only": kw_only, "eq": eq}
    for frozen in (True, False)
    for slots in (True, False)
    for kw_only in (True, False)
    for eq in (True, False)
]


@pytest.mark.parametrize("options", OPTIONS)
def test_values_behave_as_those_of_the_standard_library(options):
    theirs, ours = pair(options, body)
    for cls in (theirs, ours):
        first, second, other = cls(a=1), cls(a=1, hidden=4), cls(a=2, b=[1])
        assert (first == second) is options["eq"]
        assert first != other
        assert is_dataclass(cls)
        assert [f.name for f in fields(cls)] == ["a", "b", "c", "hidden"]
        assert first.b == []
        assert first.b is not second.b
        assert replace(other, c="y").c == "y"
        assert repr(other) == "Thing(a=2, b=[1], c='x')"
        assert cls.__match_args__ == (() if options["kw_only"] else ("a", "b", "c", "hidden"))
        assert hasattr(first, "__dict__") is not options["slots"]
        assert copy.copy(other).b is other.b
        for wrong in ({}, {"a": 1, "z": 2}):
            with pytest.raises(TypeError):
                cls(**wrong)
        if options["kw_only"]:
            with pytest.raises(TypeError):
                cls(1)
        else:
            assert cls(1, [2], "z").c == "z"
        if options["frozen"]:
            with pytest.raises(FrozenInstanceError):
                first.a = 2
            with pytest.raises(FrozenInstanceError):
                del first.a
        else:
            first.a = 7
            assert first.a == 7
    assert values.is_frozen(ours) is options["frozen"]
    assert not values.is_frozen(theirs)


def test_hashes_follow_equality():
    def namespace():
        return {
            "__annotations__": {"a": "int", "b": "str"},
            "__module__": __name__,
            "b": field(default="", compare=False),
        }

    for cls in pair({"frozen": True, "slots": True}, namespace):
        assert hash(cls(1, "x")) == hash(cls(1, "y"))
        assert {cls(1, "x"): 5}[cls(1, "z")] == 5
    for cls in pair({"slots": True}, namespace):
        with pytest.raises(TypeError):
            hash(cls(1))


@values.dataclass(frozen=True, slots=True)
class Base:
    a: int

    def doubled(self) -> int:
        return 2 * self.a


@values.dataclass(frozen=True, slots=True, kw_only=True)
class Derived(Base):
    b: int = 2
    c: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "c", self.a + self.b)


def test_inheritance_post_init_pickles_and_patterns():
    value = Derived(1, b=5)
    assert (value.c, value.doubled(), repr(value)) == (6, 2, "Derived(a=1, b=5, c=6)")
    assert pickle.loads(pickle.dumps(value)) == value  # noqa: S301 - of this test
    assert Base(1) != value
    match Base(4):
        case Base(found):
            assert found == 4
    with pytest.raises(AttributeError):
        object.__setattr__(value, "d", 1)
    assert Derived(3).c == 5


@pytest.mark.parametrize("options", OPTIONS)
def test_calls_that_are_compiled_do_as_those_before(options):
    """``__init__`` is compiled after some calls; what is made, and what is refused, stays the same."""
    theirs, ours = pair(options, body)
    for number in range(values.OFTEN + 3):
        for arguments in ({"a": number}, {"a": number, "b": [number]}, {"a": number, "hidden": 5, "c": "z"}):
            made, expected = ours(**arguments), theirs(**arguments)
            assert [getattr(made, f.name) for f in fields(ours)] == [getattr(expected, f.name) for f in fields(theirs)]
    _, fresh = pair(options, body)
    for wrong in ({}, {"a": 1, "z": 2}, {"a": 1, "b": values.MISSING, "x": 3}):
        with pytest.raises(TypeError) as refused:
            fresh(**wrong)
        with pytest.raises(TypeError) as expected:
            theirs(**wrong)
        assert str(refused.value) == str(expected.value)


@pytest.mark.parametrize("options", OPTIONS)
def test_values_with_other_fields_are_those_of_the_standard_library(options):
    """``__replace__`` is compiled after some calls, and then does the same."""
    theirs, ours = pair(options, body)
    begun, expected = ours(a=1, hidden=4), theirs(a=1, hidden=4)
    for number in range(values.OFTEN + 3):
        for changes in ({}, {"a": number}, {"b": [number], "c": "z"}):
            made, other = values.replace(begun, **changes), replace(expected, **changes)
            assert type(made) is ours
            assert made is not begun
            assert made.b is changes.get("b", begun.b)
            assert (made.a, made.c, made.hidden) == (other.a, other.c, other.hidden)
        with pytest.raises(TypeError):
            values.replace(begun, z=2)


def test_a_value_of_a_subclass_stays_one_with_other_fields():
    """Those of its base are replaced, before the method is compiled and after; what ends ``__init__`` is done again."""

    @values.dataclass(frozen=True, slots=True)
    class Base:
        a: int

    @values.dataclass(frozen=True, slots=True)
    class Derived(Base):
        b: int
        total: int = field(init=False)

        def __post_init__(self):
            object.__setattr__(self, "total", self.a + self.b)

    for number in range(values.OFTEN + 3):
        assert values.replace(Base(1), a=number) == Base(number)
        found = values.replace(Derived(1, 2), a=number)
        assert (type(found), found.a, found.b, found.total) == (Derived, number, 2, number + 2)


def test_what_is_made_once_is_made_when_it_is_asked_for():
    calls = []
    found = values.once(lambda: calls.append(1))
    assert not calls
    assert (found(), found(), calls) == (None, None, [1])


@pytest.mark.parametrize("options", OPTIONS)
def test_what_dataclasses_keeps_of_a_class_is_the_same(options):
    theirs, ours = pair(options, body)
    for mine, other in zip(fields(ours), fields(theirs), strict=True):
        for name in ("name", "type", "default", "init", "repr", "compare", "kw_only"):
            assert getattr(mine, name) == getattr(other, name)


def test_fields_of_bases_come_first():
    assert [(f.name, f.kw_only) for f in fields(Derived)] == [("a", False), ("b", True), ("c", True)]
    assert Derived.__match_args__ == ("a",)
    with pytest.raises(TypeError):
        Derived(1, 2)
    with pytest.raises(TypeError):
        Derived(1, a=2)
