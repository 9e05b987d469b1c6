"""Constraints blocks: kept with each distinct call of a model."""

from __future__ import annotations

from mbm.expression.nodes import Apply
from mbm.problem.reading.constraints import calls_with_constraints
from mbm.text.printer import print_form

TEXT = """
(defmodel top (x y)
  (declare (ratio (/ x y)))
  (constraints (normal ratio 1.6 0.1) (<= 0 x 2))
  (rectangular x y))
(defmodel room (x y) (left (top x y)) (right (trans (3 0 0) (top x y))) (small (top 1 y)))
"""


def test_once_for_every_distinct_model_with_arguments(opened, unknowns):
    room = opened(TEXT, **unknowns("x", "y"))
    shape = room.value("(room x y)")
    calls = calls_with_constraints([shape, room.value("(top x y)"), room.value("(trans [0 0 1] (top x y))")])
    assert [call.name for call in calls] == ["top", "top"]
    assert [call.name for call in room.log.calls] == ["top", "top", "room"]


def test_of_several_shapes_those_of_the_first_come_first(opened, unknowns):
    room = opened(TEXT, **unknowns("x", "y"))
    shapes = [room.value(f"(top {size} y)") for size in ("3", "x", "y")]
    calls = calls_with_constraints([shapes[0], room.value("(room x y)"), shapes[2]])
    assert len(calls) == 4
    assert [calls[place] is shapes[k].content for place, k in ((0, 0), (1, 1), (3, 2))] == [True] * 3


def test_they_are_evaluated_in_the_scope_of_their_call(opened, unknowns):
    room = opened(TEXT, **unknowns("x", "y"))
    (call,) = calls_with_constraints([room.value("(top x y)")])
    normal, chain = call.constraints
    assert (normal.kind, [print_form(f) for f in normal.forms]) == ("normal", ["ratio", "1.6", "0.1"])
    assert (chain.kind, len(chain.forms)) == ("<=", 3)
    ratio = room.session.evaluator.wanted(normal.forms[0], normal.scope)
    assert isinstance(ratio, Apply)
    assert [leaf.unknown for leaf in ratio.arguments] == ["x", "y"]


def test_a_quoted_model_is_logged_as_its_form(opened, unknowns):
    room = opened(TEXT, **unknowns("x", "y"))
    for _ in range(2):
        room.value("(get-vertex-from-model '(top x y) '(top (vertex 1)))")
    assert [print_form(form) for form in room.log.quoted] == ["(top x y)"]
    assert room.log.calls == []
    room.session.evaluator.wanted(room.log.quoted[0], room.scope)
    assert [call.name for call in room.log.calls] == ["top"]
