"""Frozen values: `dataclass` as in the standard library, but nothing is worked out before somebody needs it.

The stages hand on several hundred kinds of values, and a small solve uses a few of them. A class is made with its
slots and no more; its fields are described when they are asked for, and ``__init__`` is compiled for a class that is
called `OFTEN`: compiling the methods of all classes took half of a warm start, and describing their fields a tenth.
Fields, ``replace``, ``fields`` and ``match`` work as with `dataclasses.dataclass`, which type checkers take this for;
`replace` of this module takes half the time, for what each small solve does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, Field, FrozenInstanceError, field, replace as standard_replace
from operator import attrgetter
from types import MemberDescriptorType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass, replace as replace
else:

    def dataclass(*, frozen: bool = False, slots: bool = False, kw_only: bool = False, eq: bool = True) -> Any:
        """A class decorator with these options of `dataclasses.dataclass`.

        Every annotation of the class is a field of its own; bases with fields are made by this decorator too.
        """
        return lambda cls: _made(cls, frozen=frozen, slots=slots, kw_only=kw_only, eq=eq)

    def replace(value: Any, /, **changes: Any) -> Any:
        """The value with other fields, as `dataclasses.replace` makes it, of a class that is made by `dataclass`."""
        return value.__replace__(**changes)


T = TypeVar("T")


def once(make: Callable[[], T]) -> Callable[[], T]:
    """What ``make`` makes when it is first called; a function made like that takes a seventh of `functools.cache`."""
    made: list[T] = []

    def found() -> T:
        if not made:
            made.append(make())
        return made[0]

    return found


OFTEN = 32
"""So many calls of ``__init__`` go field by field before it is compiled, which takes as long as some fifty of them.
``__replace__`` likewise."""


def is_frozen(cls: type) -> bool:
    """Whether ``cls`` was made by `dataclass` with ``frozen=True``."""
    return bool(getattr(cls, "__setattr__") == _refused_assignment)  # noqa: B009 - as it stands in the class


class _Description:
    """The fields of a class, its own and those of its bases, from what stands in its body."""

    __slots__ = ("_all", "_own", "body", "cls", "kw_only")

    def __init__(self, cls: type, body: dict[str, Any], kw_only: bool) -> None:
        """``body`` holds each own field's default or `Field`, MISSING where there is neither."""
        self.cls, self.body, self.kw_only = cls, body, kw_only
        self._own: dict[str, Field[Any]] | None = None
        self._all: dict[str, Field[Any]] | None = None

    @property
    def own(self) -> dict[str, Field[Any]]:
        """Those of the class itself, by name."""
        if self._own is None:
            self._own = {name: _named(value, name, self.kw_only) for name, value in self.body.items()}
        return self._own

    @property
    def all(self) -> dict[str, Field[Any]]:
        """Those of the bases, then those of the class; one of the same name stands where the first one stood."""
        if self._all is None:
            described = [vars(base).get("__described__") for base in reversed(self.cls.__mro__)]
            self._all = {name: part for each in described if each is not None for name, part in each.own.items()}
        return self._all

    def standard(self) -> dict[str, Any]:
        """What `dataclasses` keeps with the class, by attribute, made by itself from a class of the same body."""
        from dataclasses import dataclass as standard

        body = {
            "__annotations__": vars(self.cls).get("__annotations__", {}),
            "__module__": self.cls.__module__,
            "__doc__": "else the signature would be worked out to become it",
            **self.own,
        }
        alone: type = standard(init=False, repr=False, eq=False, kw_only=self.kw_only)(
            type(self.cls.__name__, (), body)
        )
        return {
            "__dataclass_fields__": self.all,  # the fields of `alone` are these, and know now what they are
            "__dataclass_params__": vars(alone)["__dataclass_params__"],
        }


def _named(value: Any, name: str, kw_only: bool) -> Field[Any]:
    """The field ``name`` with its default, if ``value`` is one."""
    part: Field[Any] = value if isinstance(value, Field) else field(default=value)
    part.name = name
    if part.kw_only is MISSING:
        part.kw_only = kw_only
    return part


class _Later:
    """An attribute of a class that the `dataclasses` module, or a ``match``, asks for."""

    __slots__ = ("description", "name")

    def __init__(self, description: _Description, name: str) -> None:
        self.description, self.name = description, name

    def __get__(self, _instance: object, _owner: type) -> Any:
        """The attribute, which stands in the class from now on."""
        cls = self.description.cls
        if self.name == "__match_args__":
            parts = self.description.all.values()
            setattr(cls, self.name, tuple(part.name for part in parts if part.init and not part.kw_only))
        else:
            for base in cls.__mro__[:0:-1]:  # their fields are among those of the class
                getattr(base, "__dataclass_fields__", None)
            for name, value in self.description.standard().items():
                setattr(cls, name, value)
        return vars(cls)[self.name]


def _made(cls: type, *, frozen: bool, slots: bool, kw_only: bool, eq: bool) -> type:
    """The class with its fields, and with methods that write themselves."""
    own = vars(cls)
    body = {name: own.get(name, MISSING) for name in own.get("__annotations__", ())}
    named: dict[str, Any] = {"__init__": _first_init, "__repr__": _repr, "__replace__": _first_replace}
    if frozen:
        named.update(__setattr__=_refused_assignment, __delattr__=_refused_deletion)
    if frozen and slots:
        named.update(__getstate__=_state, __setstate__=_set_state)
    if eq:
        named["__eq__"] = _first_eq
    methods = {name: method for name, method in named.items() if name not in own}
    if eq and own.get("__hash__") is None:
        methods["__hash__"] = _first_hash if frozen else None
    if slots:
        cls = _slotted(cls, tuple(body), methods)
    else:
        _unslotted(cls, body, methods)
    description = _Description(cls, body, kw_only)
    cls.__described__ = description  # type: ignore[attr-defined]
    for name in ("__dataclass_fields__", "__dataclass_params__", "__match_args__"):
        setattr(cls, name, _Later(description, name))
    return cls


def _slotted(cls: type, names: tuple[str, ...], methods: dict[str, Any]) -> type:
    """The same class anew with a slot for each field."""
    namespace = dict(vars(cls))
    inherited = {slot for base in cls.__mro__[1:] for slot in getattr(base, "__slots__", ())}
    for name in (*names, "__dict__", "__weakref__"):
        namespace.pop(name, None)
    namespace.update(methods)
    namespace["__slots__"] = tuple(name for name in names if name not in inherited)
    made = type(cls)(cls.__name__, cls.__bases__, namespace)
    made.__qualname__ = cls.__qualname__
    return made


def _unslotted(cls: type, body: dict[str, Any], methods: dict[str, Any]) -> None:
    """Methods, and defaults as attributes of the class, put into the class itself."""
    for name, value in body.items():
        default = value.default if isinstance(value, Field) else value
        if default is not MISSING:
            setattr(cls, name, default)
        elif isinstance(value, Field):
            delattr(cls, name)
    for name, method in methods.items():
        setattr(cls, name, method)


def _owner(cls: type, name: str, first: object) -> type:
    """The class in the order of inheritance whose method ``name`` is still to be made."""
    return next(base for base in cls.__mro__ if vars(base).get(name) is first)


def _fields(cls: Any) -> list[Field[Any]]:
    return list(cls.__described__.all.values())


def _put(cls: type, name: str, method: Any) -> Any:
    """The function as the method ``name`` of ``cls``."""
    method.__name__, method.__qualname__ = name, f"{cls.__qualname__}.{name}"
    setattr(cls, name, method)
    return method


def _first_init(self: Any, /, *arguments: Any, **named: Any) -> None:
    """Make ``__init__``, and call it."""
    cls = _owner(type(self), "__init__", _first_init)
    _put(cls, "__init__", _plain_init(cls))(self, *arguments, **named)


def _plain_init(cls: type) -> Callable[..., Any]:
    """``__init__`` field by field. It compiles itself when it was called `OFTEN`, or when an argument is wrong."""
    parts = [(part.name, part.init, part.default, part.default_factory) for part in _fields(cls)]
    order = [part.name for part in _fields(cls) if part.init and not part.kw_only]
    put = object.__setattr__ if is_frozen(cls) else setattr
    ends = hasattr(cls, "__post_init__")
    calls = 0

    def plain(self: Any, /, *arguments: Any, **named: Any) -> Any:
        nonlocal calls
        calls += 1
        given = dict(zip(order, arguments, strict=False))
        if calls > OFTEN or len(arguments) > len(order) or not given.keys().isdisjoint(named):
            return _compiled_init(cls)(self, *arguments, **named)
        given.update(named)
        for name, init, default, make in parts:
            if init and name in given:
                value = given.pop(name)
            elif make is not MISSING:
                value = make()
            elif not init:
                continue
            else:
                value = default
            if value is MISSING:
                return _compiled_init(cls)(self, *arguments, **named)
            put(self, name, value)
        if given:
            return _compiled_init(cls)(self, *arguments, **named)
        if ends:
            self.__post_init__()
        return None

    return plain


def _compiled_init(cls: type) -> Any:
    """``__init__`` as one would write it, which it is from now on."""
    frozen = is_frozen(cls)
    names: dict[str, Any] = {"MISSING": MISSING, "put": object.__setattr__}
    plain: list[str] = []
    keyword: list[str] = []
    body: list[str] = []
    for part in _fields(cls):
        value = part.name
        if part.default_factory is not MISSING:
            names[f"make_{part.name}"] = part.default_factory
            made = f"make_{part.name}()"
            value = f"{made} if {part.name} is MISSING else {part.name}" if part.init else made
        elif not part.init:
            continue
        if part.init:
            default = part.default_factory is not MISSING or part.default is not MISSING
            names[f"default_{part.name}"] = MISSING if part.default_factory is not MISSING else part.default
            parameter = f"{part.name}=default_{part.name}" if default else part.name
            (keyword if part.kw_only else plain).append(parameter)
        slot = getattr(cls, part.name, None)
        if frozen and isinstance(slot, MemberDescriptorType):
            names[f"put_{part.name}"] = slot.__set__  # half of the time that `object.__setattr__` takes
            body.append(f"put_{part.name}(self, {value})")
        else:
            body.append(f"put(self, {part.name!r}, {value})" if frozen else f"self.{part.name} = {value}")
    if hasattr(cls, "__post_init__"):
        body.append("self.__post_init__()")
    parameters = ", ".join(["self", *plain, *(["*", *keyword] if keyword else [])])
    exec(f"def __init__({parameters}):\n " + "\n ".join(body or ["pass"]), names)  # noqa: S102 - names of fields
    return _put(cls, "__init__", names["__init__"])


def _first_replace(self: Any, /, **changes: Any) -> Any:
    """Make ``__replace__``, which `copy.replace` of Python 3.13 calls too, and call it."""
    cls = _owner(type(self), "__replace__", _first_replace)
    calls = 0

    def plain(self: Any, /, **changes: Any) -> Any:
        nonlocal calls
        calls += 1
        return standard_replace(self, **changes) if calls <= OFTEN else _compiled_replace(cls)(self, **changes)

    return _put(cls, "__replace__", plain)(self, **changes)


def _compiled_replace(cls: type) -> Any:
    """``__replace__`` as one would write it, which it is from now on."""
    names = [part.name for part in _fields(cls) if part.init]
    parameters = "".join(f", {name}=MISSING" for name in names)
    values = ", ".join(f"{name}=self.{name} if {name} is MISSING else {name}" for name in names)
    known: dict[str, Any] = {"MISSING": MISSING}
    text = f"def __replace__(self, /{', *' if names else ''}{parameters}):\n return self.__class__({values})"
    exec(text, known)  # noqa: S102 - names of fields
    return _put(cls, "__replace__", known["__replace__"])


def _compared(cls: type) -> Callable[[Any], tuple[Any, ...]]:
    """What makes the tuple of the values that are compared."""
    names = [part.name for part in _fields(cls) if part.compare]
    if len(names) > 1:
        return attrgetter(*names)
    return lambda value: tuple(getattr(value, name) for name in names)


def _first_eq(self: Any, other: object) -> Any:
    """Make ``__eq__``, and call it."""
    cls = _owner(type(self), "__eq__", _first_eq)
    compared = _compared(cls)

    def equal(self: Any, other: object) -> Any:
        return compared(self) == compared(other) if other.__class__ is self.__class__ else NotImplemented

    return _put(cls, "__eq__", equal)(self, other)


def _first_hash(self: Any) -> int:
    """Make ``__hash__``, and call it."""
    cls = _owner(type(self), "__hash__", _first_hash)
    compared = _compared(cls)

    def hashed(self: Any) -> int:
        return hash(compared(self))

    return int(_put(cls, "__hash__", hashed)(self))


def _repr(self: Any) -> str:
    shown = ", ".join(f"{part.name}={getattr(self, part.name)!r}" for part in _fields(type(self)) if part.repr)
    return f"{type(self).__qualname__}({shown})"


def _refused_assignment(self: Any, name: str, value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _refused_deletion(self: Any, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _state(self: Any) -> list[object]:
    return [getattr(self, name) for name in type(self).__described__.all]


def _set_state(self: Any, state: list[object]) -> None:
    for name, value in zip(type(self).__described__.all, state, strict=True):
        object.__setattr__(self, name, value)
