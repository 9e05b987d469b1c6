"""``(interval :contract C :width W :boxes n)``: what a ``:method`` asks of interval methods."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite
from types import MappingProxyType

from mbm.expression.dimension import NONE as DIMENSIONLESS
from mbm.expression.nodes import Apply, Constant, Number, nearest
from mbm.language import faults as language_faults
from mbm.language.coerce import integer, static_number
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.enclosing import Contractor, Enclosing
from mbm.problem.options import split_options
from mbm.problem.reading.declarations import Declaration
from mbm.problem.zero_points import stated_difference
from mbm.text.types import Form, MbmError, Sequence, Symbol

USAGE = ":method (interval [:contract forward | hc4 | hull] [:width 1% | ((unknown width)…)] [:boxes n])"
LARGEST_LIMIT = 10_000_000


def read_enclosing(work: Workspace, form: Form | None, declarations: Iterable[Declaration]) -> Enclosing | None:
    """What is asked of interval methods; None where ``form`` is another method, or none.

    Raises:
        MbmError: an option is wrong.

    """
    if not (isinstance(form, Sequence) and form.head == "interval"):
        return None
    options = split_options(form.items[1:], form.span, owner="`interval`", known=("contract", "width", "boxes"))
    if options.positional:
        wrong = "`interval` takes options only"
        raise MbmError(language_faults.bad_form(options.positional[0].span, wrong, USAGE))
    contractor, boxes = Contractor.HC4, Enclosing().boxes
    if (given := options.get("contract")) is not None:
        contractor = _contractor(given)
    if (given := options.get("boxes")) is not None:
        boxes = integer(work.evaluator.wanted(given, work.scope), given.span, "`:boxes` (a whole number)")
        if not 1 <= boxes <= LARGEST_LIMIT:
            wrong = f"`:boxes` should lie in 1 … {LARGEST_LIMIT}"
            raise MbmError(language_faults.bad_form(given.span, wrong, USAGE))
    width = options.get("width")
    if width is None:
        return Enclosing(contractor=contractor, boxes=boxes)
    if isinstance(width, Sequence) and width.items and isinstance(width.items[0], Sequence):
        return Enclosing(contractor=contractor, widths=_widths(work, width, declarations), boxes=boxes)
    return Enclosing(contractor=contractor, fraction=_fraction(work, width), boxes=boxes)


def _contractor(form: Form) -> Contractor:
    name = form.name if isinstance(form, Symbol) else form.span.text
    found = next((c for c in Contractor if c.value == name), None)
    if found is None:
        raise MbmError(language_faults.bad_form(form.span, f"`{name}` is no contractor", USAGE))
    return found


def _fraction(work: Workspace, form: Form) -> float:
    given = work.evaluator.wanted(form, work.scope)
    value = nearest(static_number(given, form.span))
    measured = isinstance(given, Number | Constant) and given.dimension not in (None, DIMENSIONLESS)
    if measured or not 0.0 < value <= 1.0:
        wrong = "`:width` is a part of each box above 0 and up to 100%, or a width for each unknown"
        raise MbmError(language_faults.bad_form(form.span, wrong, USAGE))
    return value


def _widths(work: Workspace, form: Sequence, declarations: Iterable[Declaration]) -> Mapping[str, tuple[Number, ...]]:
    """The widths by unknown, in SI: one number for each coordinate."""
    known = {d.name.name: d for d in declarations}
    found: dict[str, tuple[Number, ...]] = {}
    for item in form.items:
        if not (isinstance(item, Sequence) and len(item.items) == 2 and isinstance(item.items[0], Symbol)):
            raise MbmError(language_faults.bad_form(item.span, "a width is (unknown width)", USAGE))
        name, stated = item.items[0].name, item.items[1]
        declaration = known.get(name)
        if declaration is None:
            raise MbmError(language_faults.bad_form(item.items[0].span, f"`{name}` is no unknown", USAGE))
        if name in found:
            raise MbmError(language_faults.bad_form(item.span, f"`{name}` has two widths", USAGE))
        shape = declaration.shape if not declaration.dimension else (declaration.manifold.tangent,)
        elements = shaped(work.evaluator.wanted(stated, work.scope), shape, stated.span)
        found[name] = tuple(_width(element, stated) for element in elements)
    return MappingProxyType(found)


def _width(element: object, form: Form) -> Number:
    value = nearest(static_number(element, form.span))  # type: ignore[arg-type]
    if isinstance(element, Number | Constant | Apply):
        stated_difference(element, form.span)
    if not (isfinite(value) and value > 0.0):
        raise MbmError(language_faults.bad_form(form.span, "a width is a number above 0", USAGE))
    dimension = element.dimension if isinstance(element, Number | Constant) else None
    return Number(value, dimension, form.span)
