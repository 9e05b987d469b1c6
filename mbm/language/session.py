"""An evaluator for the definitions of a program: the vocabulary, the models and the user's functions in one table."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

from mbm.language.evaluator import FormEvaluator
from mbm.language.functions import bind_definition
from mbm.language.limits import Limits
from mbm.language.program import ConstantDefinition, ModelDefinition, Program
from mbm.language.scope import opened
from mbm.language.values import Callable_, Evaluator, Macro, Scope, Value, Vocabulary
from mbm.text.types import Span
from mbm.values import dataclass

ModelMaker = Callable[[ModelDefinition, Scope], Callable_]


class GlobalScope:
    """The ``defconst`` names, each evaluated when first needed."""

    def __init__(self, evaluator: Evaluator, constants: Mapping[str, ConstantDefinition]) -> None:
        self._evaluator = evaluator
        self._constants = constants
        self._values: dict[str, Value] = {}
        self._open: list[str] = []

    def lookup(self, name: str, span: Span) -> Value | None:
        """The value of a constant."""
        if name in self._values:
            return self._values[name]
        definition = self._constants.get(name)
        if definition is None:
            return None
        with opened(self._open, name, span):
            value = self._values[name] = self._evaluator.wanted(definition.form, self)
        return value

    def names(self) -> Iterator[str]:
        """The constants' names."""
        return iter(self._constants)

    def columns(self) -> None:
        """No row is at hand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadFile:
    """A file that a form named: its path as messages print it, where that leads, and the digest of its bytes."""

    path: Path
    resolved: Path
    sha256: str


class FileReader(Macro):
    """A function whose value stands in a file that its call names."""

    __slots__ = ()

    @abstractmethod
    def within(self, program: Program, read: list[ReadFile]) -> Callable_:
        """The function where the forms of ``program`` are evaluated; files are added to ``read``."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """What forms at top level are evaluated with; ``functions`` is the evaluator's own table.

    ``read`` are the files that forms have named so far.
    """

    evaluator: Evaluator
    scope: Scope
    functions: dict[str, Callable_]
    read: list[ReadFile]

    def define(self, function: Callable_) -> None:
        """Add a function that the problem defines itself; it shadows one of the file."""
        self.functions[function.name] = function


def open_session(
    program: Program,
    vocabulary: Vocabulary,
    make_model: ModelMaker,
    limits: Limits,
    *,
    make_world: Callable[[Scope], Scope] | None = None,
) -> Session:
    """An evaluator that knows the program's functions and models; they shadow built-in ones.

    ``make_world`` makes the scope of the problem being compiled over that of the file.
    """
    read: list[ReadFile] = []
    functions: dict[str, Callable_] = {
        name: function.within(program, read) if isinstance(function, FileReader) else function
        for name, function in vocabulary.functions.items()
    }
    evaluator = FormEvaluator(
        Vocabulary(
            special_forms=vocabulary.special_forms,
            functions=MappingProxyType(functions),
            not_yet=vocabulary.not_yet,
            late=vocabulary.late,
        ),
        limits,
    )
    scope = GlobalScope(evaluator, program.constants)
    if make_world is not None:
        evaluator.world = make_world(scope)
    for definition in program.functions.values():
        functions[definition.name] = bind_definition(definition, scope)
    for model in program.models.values():
        functions[model.name] = make_model(model, scope)
    return Session(evaluator, scope, functions, read)
