"""Where names of variables are looked up: a chain of scopes, innermost first. Functions have another namespace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from mbm.language import faults
from mbm.language.values import Scope, Value
from mbm.text.types import MbmError, Span
from mbm.values import dataclass


@contextmanager
def opened(names: list[str], name: str, span: Span) -> Iterator[None]:
    """A name is being evaluated inside, one more of ``names``.

    Raises:
        MbmError: it is one of them: its definition needs itself.

    """
    if name in names:
        raise MbmError(faults.circular_definition(span, (*names[names.index(name) :], name)))
    names.append(name)
    try:
        yield
    finally:
        names.pop()


@dataclass(frozen=True, slots=True, eq=False)
class EmptyScope:
    """The outermost scope: nothing."""

    def lookup(self, name: str, span: Span) -> Value | None:
        """Nothing is known here."""
        return None

    def names(self) -> Iterator[str]:
        """No names."""
        return iter(())

    def columns(self) -> None:
        """No row is at hand."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalScope:
    """Names bound by ``let``, ``lambda``, parameters and ``for`` over those of ``parent``."""

    variables: Mapping[str, Value]
    parent: Scope

    def lookup(self, name: str, span: Span) -> Value | None:
        """The innermost binding. Not recursive: a long `let*` nests as many scopes as it has names."""
        scope: Scope = self
        while isinstance(scope, LocalScope):
            value = scope.variables.get(name)
            if value is not None:
                return value
            scope = scope.parent
        return scope.lookup(name, span)

    def names(self) -> Iterator[str]:
        """The names bound here, then those around."""
        scope: Scope = self
        while isinstance(scope, LocalScope):
            yield from scope.variables
            scope = scope.parent
        yield from scope.names()

    def columns(self) -> tuple[str, tuple[str, ...]] | None:
        """Those of the scope around."""
        scope: Scope = self
        while isinstance(scope, LocalScope):
            scope = scope.parent
        return scope.columns()
