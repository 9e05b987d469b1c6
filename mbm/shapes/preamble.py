"""What stands before the shapes in a model's body: declarations and constraints."""

from __future__ import annotations

from dataclasses import field

from mbm.language import faults as language_faults
from mbm.language.scope import LocalScope
from mbm.language.values import Evaluator, ListValue, Scope, Value
from mbm.shapes import faults
from mbm.shapes.types import ModelConstraint
from mbm.text.suggest import closest
from mbm.text.types import Form, MbmError, Sequence, Symbol
from mbm.values import dataclass

CONSTRAINT_TYPES = ("=", ">", "<", ">=", "<=", "normal", "uniform")
_DECLARE_USAGE = "(declare (name form)… (array name (element…))…)"
_FEWEST_FORMS = {"normal": 3, "uniform": 3}


@dataclass(frozen=True, slots=True, kw_only=True)
class Preamble:
    """The scope that the shapes are read in, the arrays declared, the constraints, and the shapes' forms."""

    scope: Scope = field(repr=False)
    arrays: dict[str, ListValue]
    constraints: tuple[ModelConstraint, ...]
    shapes: tuple[Form, ...]


def read_preamble(evaluator: Evaluator, body: tuple[Form, ...], scope: Scope) -> Preamble:
    """Evaluate ``declare``, where later names see earlier ones, and keep ``constraints`` as forms."""
    arrays: dict[str, ListValue] = {}
    blocks: list[Sequence] = []
    position = 0
    for form in body:
        head = form.head if isinstance(form, Sequence) else None
        if not isinstance(form, Sequence) or head not in ("declare", "constraints"):
            break
        if head == "declare":
            for item in form.items[1:]:
                scope = _declared(evaluator, item, scope, arrays)
        else:
            blocks.append(form)
        position += 1
    for form in body[position:]:
        if isinstance(form, Sequence) and form.head in ("declare", "constraints"):
            raise MbmError(
                language_faults.bad_form(
                    form.span, f"`{form.head}` stands before the shapes", "(name (argument…) (declare …) shape…)"
                )
            )
    constraints = tuple(_constraint(item, scope) for block in blocks for item in block.items[1:])
    return Preamble(scope=scope, arrays=arrays, constraints=constraints, shapes=body[position:])


def _declared(evaluator: Evaluator, item: Form, scope: Scope, arrays: dict[str, ListValue]) -> Scope:
    items = item.items if isinstance(item, Sequence) else ()
    if len(items) == 2 and isinstance(items[0], Symbol):
        arrays.pop(items[0].name, None)
        return LocalScope({items[0].name: evaluator.wanted(items[1], scope)}, scope)
    if len(items) == 3 and isinstance(item, Sequence) and item.head == "array":
        name, elements = items[1], items[2]
        if isinstance(name, Symbol) and isinstance(elements, Sequence):
            evaluator.budget.check_length(len(elements.items), elements)
            array = ListValue(tuple([_element(evaluator, e, scope) for e in elements.items]))
            arrays[name.name] = array
            return LocalScope({name.name: array}, scope)
    raise MbmError(language_faults.bad_form(item.span, "a declaration is (name form) or (array …)", _DECLARE_USAGE))


def _element(evaluator: Evaluator, form: Form, scope: Scope) -> Value:
    """An element of an array; a name that is no variable stands for itself: it names a part."""
    if isinstance(form, Symbol) and form.name != "pi" and scope.lookup(form.name, form.span) is None:
        return form
    return evaluator.wanted(form, scope)


def _constraint(form: Form, scope: Scope) -> ModelConstraint:
    kind = form.head if isinstance(form, Sequence) else None
    if not isinstance(form, Sequence) or kind is None:
        raise MbmError(faults.bad_constraint(form.span, "a constraint is a list with its type in front"))
    if kind not in CONSTRAINT_TYPES:
        message = f"`{kind}` is no type of constraint"
        raise MbmError(faults.bad_constraint(form.items[0].span, message, closest(kind, CONSTRAINT_TYPES)))
    fewest = _FEWEST_FORMS.get(kind, 2)
    if len(form.items) - 1 < fewest:
        raise MbmError(faults.bad_constraint(form.span, f"`{kind}` wants at least {fewest} forms"))
    return ModelConstraint(kind=kind, forms=form.items[1:], scope=scope, span=form.span)
