"""Frozen values: `dataclass` as in the standard library, but methods are written when they are first called.

The stages hand on several hundred kinds of values, and a small solve uses a few of them: writing and compiling
``__init__``, ``__repr__``, ``__eq__`` and ``__hash__`` of all of them took half of the time of a warm start. Fields,
``replace``, ``fields`` and ``match`` work as with `dataclasses.dataclass`, which type checkers take this for.
"""

from __future__ import annotations

from dataclasses import MISSING, FrozenInstanceError
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(*, frozen: bool = False, slots: bool = False, kw_only: bool = False, eq: bool = True) -> Any:
        """A class decorator with these options of `dataclasses.dataclass`."""
        return lambda cls: _made(cls, frozen=frozen, slots=slots, kw_only=kw_only, eq=eq)


def is_frozen(cls: type) -> bool:
    """Whether ``cls`` was made by `dataclass` with ``frozen=True``."""
    return bool(getattr(cls, "__setattr__") == _refused_assignment)  # noqa: B009 - as it stands in the class


def _made(cls: type, *, frozen: bool, slots: bool, kw_only: bool, eq: bool) -> type:
    """The class with its fields, and with methods that write themselves."""
    from dataclasses import dataclass as standard

    own = vars(cls)
    document = cls.__doc__
    cls.__doc__ = document or ""  # else the signature would be worked out to become the documentation
    cls = standard(init=False, repr=False, eq=False, kw_only=kw_only)(cls)
    cls.__doc__ = document
    named: dict[str, Any] = {"__init__": _first_init, "__repr__": _repr}
    if frozen:
        named.update(__setattr__=_refused_assignment, __delattr__=_refused_deletion)
    if frozen and slots:
        named.update(__getstate__=_state, __setstate__=_set_state)
    if eq:
        named["__eq__"] = _first_eq
    explicit = {name for name in named if name in own}
    methods = {name: method for name, method in named.items() if name not in explicit}
    if eq and own.get("__hash__") is None:
        methods["__hash__"] = _first_hash if frozen else None
    if slots:
        return _slotted(cls, methods)
    for name, method in methods.items():
        setattr(cls, name, method)
    return cls


def _slotted(cls: type, methods: dict[str, Any]) -> type:
    """The same class anew with a slot for each field."""
    namespace = dict(vars(cls))
    names = tuple(getattr(cls, "__dataclass_fields__"))  # noqa: B009 - not known to be one
    inherited = {slot for base in cls.__mro__[1:] for slot in getattr(base, "__slots__", ())}
    for name in (*names, "__dict__", "__weakref__"):
        namespace.pop(name, None)
    namespace.update(methods)
    namespace["__slots__"] = tuple(name for name in names if name not in inherited)
    made = type(cls)(cls.__name__, cls.__bases__, namespace)
    made.__qualname__ = cls.__qualname__
    return made


def _owner(cls: type, name: str, first: object) -> type:
    """The class in the order of inheritance whose method ``name`` is still to be written."""
    return next(base for base in cls.__mro__ if vars(base).get(name) is first)


def _fields(cls: type) -> tuple[Any, ...]:
    from dataclasses import fields

    return fields(cls)


def _written(cls: type, name: str, text: str, names: dict[str, Any]) -> Any:
    """The function ``name`` that ``text`` defines, as a method of ``cls``."""
    exec(text, names)  # noqa: S102 - text of this module over the names of fields
    method = names[name]
    method.__qualname__ = f"{cls.__qualname__}.{name}"
    setattr(cls, name, method)
    return method


def _first_init(self: Any, /, *arguments: Any, **named: Any) -> None:
    """Write ``__init__``, and call it."""
    cls = _owner(type(self), "__init__", _first_init)
    frozen = is_frozen(cls)
    names: dict[str, Any] = {"MISSING": MISSING, "put": object.__setattr__}
    plain: list[str] = []
    keyword: list[str] = []
    body: list[str] = []
    for field in _fields(cls):
        value = field.name
        if field.default_factory is not MISSING:
            names[f"make_{field.name}"] = field.default_factory
            made = f"make_{field.name}()"
            value = f"{made} if {field.name} is MISSING else {field.name}" if field.init else made
        elif not field.init:
            continue
        if field.init:
            default = field.default_factory is not MISSING or field.default is not MISSING
            names[f"default_{field.name}"] = MISSING if field.default_factory is not MISSING else field.default
            parameter = f"{field.name}=default_{field.name}" if default else field.name
            (keyword if field.kw_only else plain).append(parameter)
        body.append(f"put(self, {field.name!r}, {value})" if frozen else f"self.{field.name} = {value}")
    if hasattr(cls, "__post_init__"):
        body.append("self.__post_init__()")
    parameters = ", ".join(["self", *plain, *(["*", *keyword] if keyword else [])])
    text = f"def __init__({parameters}):\n " + "\n ".join(body or ["pass"])
    _written(cls, "__init__", text, names)(self, *arguments, **named)


def _compared(cls: type, name: str) -> str:
    return "(" + "".join(f"{name}.{field.name}, " for field in _fields(cls) if field.compare) + ")"


def _first_eq(self: Any, other: object) -> Any:
    """Write ``__eq__``, and call it."""
    cls = _owner(type(self), "__eq__", _first_eq)
    text = (
        "def __eq__(self, other):\n if other.__class__ is not self.__class__:\n  return NotImplemented\n"
        f" return {_compared(cls, 'self')} == {_compared(cls, 'other')}"
    )
    return _written(cls, "__eq__", text, {})(self, other)


def _first_hash(self: Any) -> int:
    """Write ``__hash__``, and call it."""
    cls = _owner(type(self), "__hash__", _first_hash)
    text = f"def __hash__(self):\n return hash({_compared(cls, 'self')})"
    return int(_written(cls, "__hash__", text, {})(self))


def _repr(self: Any) -> str:
    shown = ", ".join(f"{field.name}={getattr(self, field.name)!r}" for field in _fields(type(self)) if field.repr)
    return f"{type(self).__qualname__}({shown})"


def _refused_assignment(self: Any, name: str, value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _refused_deletion(self: Any, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _state(self: Any) -> list[object]:
    return [getattr(self, field.name) for field in _fields(type(self))]


def _set_state(self: Any, state: list[object]) -> None:
    for field, value in zip(_fields(type(self)), state, strict=True):
        object.__setattr__(self, field.name, value)
