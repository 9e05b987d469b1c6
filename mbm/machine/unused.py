"""What constants have left without a use: locals that nothing reads, and what is only assigned to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any

from mbm.machine.kinds import Member, Record, Records
from mbm.machine.tree import Assign, Call, For, Function, If, Module, Name, Perform, Statement, While


def without_unused(module: Module) -> Module:
    """The module without them."""
    return replace(module, functions=tuple(map(_function, module.functions)))


def names_read(body: tuple[Statement, ...]) -> frozenset[str]:
    """The names whose values are read, or whose elements are written."""
    return frozenset(_read(body))


def _function(function: Function) -> Function:
    """Again and again: an assignment that goes may have been the last to read another local."""
    found = function
    while True:
        read = names_read(found.body)
        unread = {local.name for local in found.locals} - read - _kept(found.body)
        if not unread:
            return found
        body = _block(found.body, unread)
        found = replace(found, body=body, locals=tuple(v for v in found.locals if v.name not in unread))


def _block(body: tuple[Statement, ...], unread: set[str]) -> tuple[Statement, ...]:
    found: list[Statement] = []
    for node in body:
        match node:
            case Assign(target=Name(name=name)) if name in unread:
                found += [Perform(node.value)] if isinstance(node.value, Call) else []
            case For() | While():
                found.append(replace(node, body=_block(node.body, unread)))
            case If():
                then, otherwise = _block(node.then, unread), _block(node.otherwise, unread)
                found.append(replace(node, then=then, otherwise=otherwise))
            case _:
                found.append(node)
    return tuple(found)


def _kept(body: tuple[Statement, ...]) -> set[str]:
    """Locals that count, and those that hold what is made of what a call answers."""
    found: set[str] = set()
    for node in nodes(body):
        if isinstance(node, For):
            found.add(node.variable.name)
        elif isinstance(node, Assign) and isinstance(node.target, Name):
            inside = () if isinstance(node.value, Call) else nodes(node.value)
            found.update({node.target.name} if any(isinstance(each, Call) for each in inside) else ())
    return found


def _read(node: object) -> Iterator[str]:
    left: list[Any] = [node]
    while left:
        each = left.pop()
        if isinstance(each, tuple):
            left.extend(each)
        elif isinstance(each, Name):
            yield each.name
        elif isinstance(each, Assign) and isinstance(each.target, Name):
            left.append(each.value)
        elif isinstance(each, For):
            left.extend((each.start, each.stop, each.body))
        else:
            left.extend(getattr(each, name) for name in _parts(each.__class__))


def nodes(node: object) -> Iterator[Any]:
    """A statement or an expression, or several, with all inside."""
    left: list[Any] = [node]
    while left:
        each = left.pop()
        if isinstance(each, tuple):
            left.extend(each)
            continue
        yield each
        for name in _parts(each.__class__):
            part = getattr(each, name)
            if _parts(part.__class__) or isinstance(part, tuple):
                left.append(part)


@cache
def _parts(kind: Any) -> tuple[str, ...]:
    """The names of what statements and expressions of a kind are made of; none of what is neither."""
    if issubclass(kind, Member | Record | Records) or not is_dataclass(kind):
        return ()
    return tuple(one.name for one in fields(kind))
