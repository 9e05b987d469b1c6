"""The library of models that comes with the package: ``library/<name>.mbm``, each read when it is first called."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path

from mbm.language.evaluator import FormEvaluator
from mbm.language.functions import Definition, Parameters, bind
from mbm.language.limits import Limits
from mbm.language.scope import EmptyScope, scalar
from mbm.language.session import read_program
from mbm.language.values import Call, Evaluator, Value, Vocabulary
from mbm.shapes.model import arrived_arguments, call_model
from mbm.shapes.types import ModelFunction, Shape
from mbm.text.types import Source

LIBRARY_NAMES = (
    *("rectangular", "disk", "box", "prism", "cylinder", "cone", "frustum", "sphere"),
    *("tube", "ellipsoid", "torus", "grid"),
)
"""The models there are, each in a file of its name."""


@cache
def library_definition(name: str) -> Definition:
    """A model of the library as read; its ``doc`` says what the feature numbers are."""
    file = f"{name}.mbm"
    text = (files("mbm.shapes") / "library" / file).read_text(encoding="utf-8")
    program = read_program(
        Source(f"library/{file}", text), Path(file), sandbox=None, limits=Limits(), reserved=frozenset()
    )
    return program.models[name]


class LibraryModel(ModelFunction):
    """A model of the library as a function. Its body is evaluated with ``vocabulary``, whatever the user defines."""

    def __init__(self, name: str, vocabulary: Vocabulary) -> None:
        self._name = name
        self._vocabulary = vocabulary

    @property
    def name(self) -> str:
        """The model's name."""
        return self._name

    @property
    def parameters(self) -> Parameters:
        """Its argument block."""
        return library_definition(self._name).parameters

    @property
    def doc(self) -> str:
        """What it describes, and its feature numbers."""
        return library_definition(self._name).doc

    @property
    def from_library(self) -> bool:
        """Always."""
        return True

    def call(self, call: Call) -> Value:
        """The shape for evaluated arguments, which are numbers.

        Raises:
            MbmError: too few or too many arguments, or one that is no number.

        """
        definition = library_definition(self._name)
        at = call.forms if len(call.forms) == len(call.arguments) else (call.form,) * len(call.arguments)
        given = arrived_arguments(call)
        bound = bind(call.evaluator, definition.parameters, given, name=self._name, span=call.span, scope=EmptyScope())
        for value, form in zip(given, at, strict=True):
            scalar(value, form.span)
        return Shape(content=call_model(self._home(call.evaluator), definition, bound, call.span), span=call.span)

    def _home(self, evaluator: Evaluator) -> Evaluator:
        """An evaluator of the library's own words that shares the budget of ``evaluator``."""
        home = FormEvaluator(self._vocabulary, evaluator.budget.limits)
        home.world, home.budget, home.warnings = evaluator.world, evaluator.budget, evaluator.warnings
        return home


def library_models(vocabulary: Vocabulary) -> dict[str, LibraryModel]:
    """The library as functions; ``vocabulary`` is what its files are written in."""
    return {name: LibraryModel(name, vocabulary) for name in LIBRARY_NAMES}
