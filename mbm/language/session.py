"""A file and the files it uses, sorted into definitions; and an evaluator for the definitions of a program."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from pathlib import Path
from types import MappingProxyType

from mbm.files.faults import too_many_files
from mbm.files.reading import read_file
from mbm.language import faults
from mbm.language.evaluator import FormEvaluator
from mbm.language.functions import Definition, bind_definition, parse_definition, parse_parameters
from mbm.language.limits import Limits, resolved_inside
from mbm.language.scope import opened
from mbm.language.values import Callable_, Evaluator, Macro, Scope, Value, Vocabulary
from mbm.text import faults as text_faults
from mbm.text.characters import LARGEST_TEXT, MOST_WORDS, words_in
from mbm.text.faults import MOST_FAULTS, worth_reading
from mbm.text.reader import read
from mbm.text.types import Bracket, Diagnostic, Form, Keyword, MbmError, Sequence, Source, Span, Symbol, Text
from mbm.values import dataclass

RESERVED = (
    "problem",
    "use",
    "import",
    "include",
    "export",
    "defun",
    "defmodel",
    "defconst",
    "defmacro",
    "data",
    "unit",
    "test",
)
"""Heads that a top-level list may have without defining a model."""

_NOT_YET = {
    "import": "modules",
    "include": "modules",
    "export": "modules",
    "data": "shared tables",
    "unit": "units of the user",
    "test": "tests in files",
}
MODEL_USAGE = "(name (argument…) [(declare …)] [(constraints …)] shape…) or (defmodel name (argument…) …)"
PROBLEM_USAGE = '(problem name [:like OTHER] "doc" clause…)'


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantDefinition:
    """A ``defconst`` as read."""

    name: str
    form: Form
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class ProblemDefinition:
    """A ``problem`` as read; ``like`` names the problem whose clauses it takes over."""

    name: str
    doc: str
    like: Symbol | None
    clauses: tuple[Sequence, ...]
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class UsedFile:
    """A file that a ``use`` names: its path as messages print it, where that leads, links followed, and its text.

    ``source`` is None where the same file had been read before.
    """

    path: Path
    resolved: Path
    source: Source | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """The definitions of a file and of all files it uses. ``base`` is the folder that paths are relative to.

    No file outside of ``sandbox`` is read, if there is one.
    """

    source: Source
    used: tuple[UsedFile, ...] = ()
    base: Path = field(default_factory=Path)
    sandbox: Path | None = None
    functions: Mapping[str, Definition] = field(default_factory=dict)
    models: Mapping[str, Definition] = field(default_factory=dict)
    constants: Mapping[str, ConstantDefinition] = field(default_factory=dict)
    problems: Mapping[str, ProblemDefinition] = field(default_factory=dict)


def read_program(
    source: Source, path: Path, *, sandbox: Path | None, limits: Limits, reserved: frozenset[str]
) -> Program:
    """Read ``source`` (which stands at ``path``) and the files it uses.

    Args:
        source: the text.
        path: where it stands; ``use`` is relative to its folder.
        sandbox: a folder that no file read may lie outside of, or None.
        limits: how many files may be used.
        reserved: names of special forms, which nobody may define.

    Raises:
        MbmError: all syntax errors and duplicate definitions found.

    """
    reader = _ProgramReader(sandbox=sandbox, limits=limits, reserved=reserved)
    reader.take(source, path, ())
    if reader.diagnostics:
        raise MbmError(*reader.diagnostics)
    return Program(
        source=source,
        used=tuple(reader.used),
        base=path.parent,
        sandbox=sandbox,
        functions=reader.functions,
        models=reader.models,
        constants=reader.constants,
        problems=reader.problems,
    )


class _ProgramReader:
    def __init__(self, *, sandbox: Path | None, limits: Limits, reserved: frozenset[str]) -> None:
        self.sandbox = sandbox
        self.limits = limits
        self.reserved = reserved
        self.functions: dict[str, Definition] = {}
        self.models: dict[str, Definition] = {}
        self.constants: dict[str, ConstantDefinition] = {}
        self.problems: dict[str, ProblemDefinition] = {}
        self.diagnostics: list[Diagnostic] = []
        self.used: list[UsedFile] = []
        self._places: dict[tuple[str, str], Span] = {}
        self._done: set[Path] = set()
        self._words = self._length = 0

    def take(self, source: Source, path: Path, chain: tuple[Path, ...]) -> None:
        """The definitions of one file; those it uses first."""
        resolved = path.resolve()
        self._done.add(resolved)
        self._length += len(source.text)
        if self._length > LARGEST_TEXT and chain:
            raise MbmError(text_faults.too_long_in_all(Span(source=source, start=0, end=0), LARGEST_TEXT))
        try:
            forms = read(source)
        except MbmError as error:
            self.diagnostics.extend(error.diagnostics)
            return
        self._words += words_in(source.text)
        if self._words > MOST_WORDS and chain:
            raise MbmError(text_faults.too_many_words_in_all(Span(source=source, start=0, end=0), MOST_WORDS))
        for form in forms:
            try:
                self._top_level(form, path, (*chain, resolved))
            except MbmError as error:
                self.diagnostics.extend(error.diagnostics)
            if len(self.diagnostics) > MOST_FAULTS:
                raise MbmError(*worth_reading(self.diagnostics, ended=True))

    def _top_level(self, form: Form, path: Path, chain: tuple[Path, ...]) -> None:
        if not isinstance(form, Sequence) or form.bracket is not Bracket.ROUND or form.head is None:
            raise MbmError(faults.bad_top_level(form.span))
        match form.head:
            case "use":
                self._use(form, path, chain)
            case "defun" | "defmacro":
                definition = parse_definition(form)
                self._claim("function", definition.name, definition.span)
                self.functions[definition.name] = definition
            case "defconst":
                self._constant(form)
            case "problem":
                definition_of_problem = parse_problem(form)
                self._claim("problem", definition_of_problem.name, definition_of_problem.span)
                self.problems[definition_of_problem.name] = definition_of_problem
            case "defmodel":
                self._model(form, form.items[1:])
            case head if head in _NOT_YET:
                raise MbmError(faults.not_available_yet(form.items[0].span, f"`{head}` at top level", _NOT_YET[head]))
            case head:
                if len(form.items) < 2 or not isinstance(form.items[1], Sequence):
                    raise MbmError(faults.bad_top_level(form.items[0].span, head, RESERVED))
                self._model(form, form.items)

    def _claim(self, space: str, name: str, span: Span) -> None:
        if name in self.reserved and space == "function":
            raise MbmError(faults.reserved_name(span, name))
        other = self._places.get((space, name))
        if other is not None:
            raise MbmError(faults.duplicate_definition(span, name, other))
        self._places[space, name] = span

    def _constant(self, form: Sequence) -> None:
        usage = "(defconst name form)"
        if len(form.items) != 3 or not isinstance(form.items[1], Symbol):
            raise MbmError(faults.bad_form(form.span, "this `defconst` is not complete", usage))
        name = form.items[1]
        self._claim("variable", name.name, name.span)
        self.constants[name.name] = ConstantDefinition(name=name.name, form=form.items[2], span=name.span)

    def _model(self, form: Sequence, items: tuple[Form, ...]) -> None:
        if len(items) < 2 or not isinstance(items[0], Symbol):
            raise MbmError(faults.bad_form(form.span, "this model is not complete", MODEL_USAGE))
        name = items[0]
        body = items[2:]
        doc = ""
        if body and isinstance(body[0], Text):
            doc, body = body[0].value, body[1:]
        if not body:
            raise MbmError(faults.bad_form(form.span, f"the model `{name.name}` has no shape", MODEL_USAGE))
        parameters = parse_parameters(items[1], name.name)
        self._claim("function", name.name, name.span)
        self.models[name.name] = Definition(name=name.name, parameters=parameters, doc=doc, body=body, span=name.span)

    def _use(self, form: Sequence, path: Path, chain: tuple[Path, ...]) -> None:
        if len(form.items) != 2 or not isinstance(form.items[1], Text):
            raise MbmError(faults.bad_form(form.span, "`use` takes one path", '(use "models/furniture.mbm")'))
        written = form.items[1]
        target = path.parent / written.value
        resolved = resolved_inside(self.sandbox, target, written)
        if resolved in chain:
            raise MbmError(faults.circular_use(written.span, written.value))
        if resolved in self._done:
            self.used.append(UsedFile(path=target, resolved=resolved, source=None))
            return
        if len(self._done) >= self.limits.files:
            raise MbmError(too_many_files(form.span, self.limits.files))
        try:
            used = read_file(target, str(target), written.span)
        except MbmError as error:
            raise MbmError(*(faults.used_here(d, written.span) for d in error.diagnostics)) from None
        self.used.append(UsedFile(path=target, resolved=resolved, source=used))
        self.take(used, target, chain)


def parse_problem(form: Sequence) -> ProblemDefinition:
    """Read ``(problem name [:like OTHER] "doc" clause…)``."""
    items = form.items[1:]
    if not items or not isinstance(items[0], Symbol):
        raise MbmError(faults.bad_form(form.span, "a problem begins with its name", PROBLEM_USAGE))
    name, rest = items[0], items[1:]
    doc = ""
    like: Symbol | None = None
    clauses: list[Sequence] = []
    position = 0
    while position < len(rest):
        item = rest[position]
        if isinstance(item, Keyword) and item.name == "like" and position + 1 < len(rest):
            other = rest[position + 1]
            if not isinstance(other, Symbol):
                raise MbmError(faults.bad_form(other.span, "`:like` takes the name of a problem", PROBLEM_USAGE))
            like = other
            position += 2
            continue
        if isinstance(item, Text) and not clauses and not doc:
            doc = item.value
        elif isinstance(item, Sequence) and item.bracket is Bracket.ROUND and item.head is not None:
            clauses.append(item)
        else:
            raise MbmError(faults.bad_form(item.span, "a clause is a list with a name in front", PROBLEM_USAGE))
        position += 1
    return ProblemDefinition(name=name.name, doc=doc, like=like, clauses=tuple(clauses), span=name.span)


ModelMaker = Callable[[Definition, Scope], Callable_]


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
