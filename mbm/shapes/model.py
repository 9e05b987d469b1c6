"""Calling a model: arguments bound, declarations evaluated, shapes described."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from mbm.language import faults as language_faults
from mbm.language.parameters import Parameters, bind
from mbm.language.program import MODEL_USAGE, ModelDefinition
from mbm.language.scope import LocalScope
from mbm.language.values import Call, Callable_, Evaluator, Scope, Value
from mbm.shapes.description import Site, describe_shapes
from mbm.shapes.identity import Identities
from mbm.shapes.opaque import is_opaque
from mbm.shapes.preamble import read_preamble
from mbm.shapes.types import ModelCall, ModelFunction, Shape
from mbm.text.types import Form, MbmError, Span


class ModelLog:
    """Which models a compilation used: what the problem needs to join the models' constraints to its own.

    ``calls`` holds one call for each distinct model-with-arguments, in the order of first use. ``quoted`` holds the
    model forms that ``get-vertex-from-model`` was given: evaluated in the problem's scope, they are logged as calls.
    """

    def __init__(self) -> None:
        self.calls: list[ModelCall] = []
        self.quoted: list[Form] = []

    def note_quoted(self, form: Form) -> None:
        """Keep a quoted model, once."""
        if form not in self.quoted:
            self.quoted.append(form)


class Model(ModelFunction):
    """A model of the user as a function. It remembers its shapes: equal arguments give one and the same shape."""

    def __init__(self, definition: ModelDefinition, scope: Scope, log: ModelLog | None = None) -> None:
        self._definition = definition
        self._scope = scope
        self._built: dict[Hashable, Shape] = {}
        self._identities = Identities()
        self.log = log

    @property
    def name(self) -> str:
        """The model's name."""
        return self._definition.name

    @property
    def parameters(self) -> Parameters:
        """Its argument block."""
        return self._definition.parameters

    @property
    def from_library(self) -> bool:
        """Never: the library has a class of its own."""
        return False

    def call(self, call: Call) -> Value:
        """The shape for evaluated arguments."""
        return self.build(call.evaluator, arrived_arguments(call), call.span)

    def build(self, evaluator: Evaluator, arguments: tuple[Value, ...], span: Span) -> Shape:
        """The shape for ``arguments``, evaluated before if they have been met before.

        Raises:
            MbmError: arguments that do not fit, or a body that describes no shape.
            StaticColumnNeeded: the value of a data column decides what the shape is.

        """
        bound = bind(evaluator, self.parameters, arguments, name=self.name, span=span, scope=self._scope)
        key = tuple((name, self._identities.key(value)) for name, value in bound.variables.items())
        shape = self._built.get(key)
        if shape is None:
            content = call_model(evaluator, self._definition, bound, span)
            shape = self._built[key] = Shape(content=content, span=span)
            if self.log is not None and not any(is_opaque(v) for v in bound.variables.values()):
                self.log.calls.append(content)
        return shape


def call_model(evaluator: Evaluator, definition: ModelDefinition, bound: LocalScope, span: Span) -> ModelCall:
    """The node of one call; ``bound`` holds the parameters."""
    preamble = read_preamble(evaluator, definition.body, bound)
    if not preamble.shapes:
        message = f"the model `{definition.name}` has no shape"
        raise MbmError(language_faults.bad_form(definition.span, message, MODEL_USAGE))
    site = Site(evaluator=evaluator, scope=preamble.scope, names={})
    return ModelCall(
        name=definition.name,
        arguments=bound.variables,
        arrays=preamble.arrays,
        constraints=preamble.constraints,
        children=describe_shapes(preamble.shapes, site),
        span=span,
    )


def arrived_arguments(call: Call) -> tuple[Value, ...]:
    """The arguments of a call of a model; quoted forms are evaluated where they arrived."""
    at = call.forms if len(call.forms) == len(call.arguments) else (call.form,) * len(call.arguments)
    return tuple([call.evaluator.arrived(v, f, call.scope) for v, f in zip(call.arguments, at, strict=True)])


def make_model(definition: ModelDefinition, scope: Scope) -> Callable_:
    """The function that a model definition makes in ``scope``."""
    return Model(definition, scope)


def model_maker(log: ModelLog) -> Callable[[ModelDefinition, Scope], Callable_]:
    """``make_model`` that notes in ``log`` which models are used."""
    return lambda definition, scope: Model(definition, scope, log)
