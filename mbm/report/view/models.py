"""The models of a file, or those of calls from outside, with numbers for all their arguments: as solids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from mbm.language.curves import CurveValue
from mbm.language.functions import Definition, Optional, Parameters
from mbm.language.limits import Limits, recursion_room
from mbm.language.session import Program, Session, open_session
from mbm.language.values import Callable_, Vocabulary
from mbm.problem import faults as problem_faults
from mbm.report.view import faults
from mbm.report.view.solids import solid_of
from mbm.report.view.types import Solid
from mbm.shapes.model import make_model
from mbm.shapes.types import CurveNode, ModelFunction, Shape
from mbm.text.printer import print_form
from mbm.text.reader import read
from mbm.text.types import Diagnostic, Form, MbmError, Source

MOST_MODELS = 12
"""Models of one picture."""


def library_of(functions: Mapping[str, Callable_ | None]) -> frozenset[str]:
    """The models of the package that no definition of the user hides."""
    return frozenset(n for n, f in functions.items() if isinstance(f, ModelFunction) and f.from_library)


def solids_of_forms(program: Program, vocabulary: Vocabulary, limits: Limits, forms: Sequence[str]) -> list[Solid]:
    """The shapes that ``forms``, such as ``(box 3 2 1)``, make with the definitions of a file.

    Raises:
        MbmError: a form is wrong, or makes no shape.

    """
    session = open_session(program, vocabulary, make_model, limits)
    found: list[Solid] = []
    with recursion_room(limits):
        for text in forms:
            found += [_solid(session, form, text) for form in read(Source("--model", text))]
    if not found:
        raise MbmError(faults.nothing_to_draw("`--model` is empty", "give a call: `(box 3 2 1)`"))
    if len(found) > MOST_MODELS:
        raise MbmError(faults.too_much_to_draw(f"{MOST_MODELS} models"))
    return found


def solids_of_definitions(
    program: Program, vocabulary: Vocabulary, limits: Limits, given: Mapping[str, str]
) -> list[Solid]:
    """Every model of a file with its defaults, or the values ``given`` by argument; those without values are left out.

    Raises:
        MbmError: no model has values, a name that is no argument, or a definition that is wrong.

    """
    models = tuple(program.models.values())
    if not models:
        raise MbmError(faults.nothing_to_draw("the file defines no model", 'give one: `--model "(box 3 2 1)"`'))
    known = [name for model in models for name in _names(model.parameters)]
    for name in given:
        if name not in known:
            raise MbmError(problem_faults.unknown_override(name, tuple(dict.fromkeys(known))))
    complete = [m for m in models if not _missing(m.parameters, given)]
    if not complete:
        raise MbmError(*(_incomplete(model, given) for model in models))
    calls = [_call(model, given) for model in complete[:MOST_MODELS]]
    return solids_of_forms(program, vocabulary, limits, calls)


def _solid(session: Session, form: Form, text: str) -> Solid:
    session.evaluator.budget.reset(form.span)
    value = session.evaluator.wanted(form, session.scope)
    if isinstance(value, CurveValue):
        value = Shape(content=CurveNode(curve=value, span=form.span), span=form.span)
    if not isinstance(value, Shape):
        raise MbmError(faults.no_shape(text, form.span))
    return solid_of(value, text, library_of(session.functions))


def _incomplete(model: Definition, given: Mapping[str, str]) -> Diagnostic:
    usage = model.parameters.usage(model.name)
    return faults.model_without_values(model.name, _missing(model.parameters, given), usage, model.span)


def _names(parameters: Parameters) -> Iterator[str]:
    yield from parameters.required
    yield from (each.name for each in (*parameters.optional, *parameters.keys))


def _missing(parameters: Parameters, given: Mapping[str, str]) -> tuple[str, ...]:
    lacking = [each.name for each in (*parameters.optional, *parameters.keys) if each.default is None]
    return tuple(name for name in (*parameters.required, *lacking) if name not in given)


def _call(model: Definition, given: Mapping[str, str]) -> str:
    """The call of a model with values from outside, and defaults as they are written where there are none."""
    parameters = model.parameters
    items = [given[name] for name in parameters.required]
    stated = [k for k, each in enumerate(parameters.optional) if each.name in given]
    items += [_value(each, given) for each in parameters.optional[: stated[-1] + 1 if stated else 0]]
    items += [f":{key.tag} {given[key.name]}" for key in parameters.keys if key.name in given]
    return f"({' '.join([model.name, *items])})"


def _value(parameter: Optional, given: Mapping[str, str]) -> str:
    if parameter.name in given:
        return given[parameter.name]
    return "" if parameter.default is None else print_form(parameter.default)
