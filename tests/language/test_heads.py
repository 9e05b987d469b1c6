"""LANGUAGE §1, names and heads: what a list means, by what stands first."""

from __future__ import annotations

import re

import numpy as np
import pytest

from mbm.language.values import Builtin
from mbm.shapes.vocabulary import vocabulary
from mbm.text.types import MbmError


def test_a_function_is_called_although_a_variable_has_its_name(lisp):
    assert lisp("(sin sin)", sin=0.5) == np.sin(0.5)


def test_a_variable_that_holds_a_function_is_called(lisp):
    assert lisp("(let ((twice (lambda (x) (* 2 x)))) (twice a))", a=3.0) == 6.0


def test_vectors_and_matrices_are_indexed_from_one(lisp):
    v, m = [1.0, 2.0, 3.0], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert lisp("(v 1)", v=v) == 1.0
    assert lisp("(m 2 3)", m=m) == 6.0
    np.testing.assert_array_equal(lisp("(m 2)", m=m), [4.0, 5.0, 6.0])
    assert lisp("(m (+ 1 1) 1)", m=m) == 4.0


def test_lists_are_indexed_and_what_they_hold_goes_on(lisp):
    assert lisp("(let ((l (list [1 2] [3 4]))) (l 2 1))") == 3.0


def test_a_head_that_is_a_list_is_judged_by_its_value(lisp):
    assert lisp("((normalize v) 2)", v=[3.0, 4.0]) == 0.8
    assert lisp("((lambda (x) (+ x 1)) a)", a=2.0) == 3.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(0 0 h)", [0, 0, 7]),
        ("((- x) h 0)", [-2, 7, 0]),
        ("(x h 0)", [2, 7, 0]),
        ("(1/2 h)", [0.5, 7]),
        ("(pi 1)", [np.pi, 1]),
        ("[x (+ x 1)]", [2, 3]),
        ("[[1 x] [h 4]]", [[1, 2], [7, 4]]),
    ],
)
def test_anything_else_is_a_paren_vector(lisp, text, expected):
    np.testing.assert_array_equal(lisp(text, x=2.0, h=7.0), expected)


def test_a_list_of_vectors_begins_with_an_index_so_brackets_make_matrices(lisp):
    assert lisp.fault("((x 0) (0 h))", x=2.0, h=7.0) == ("wrong-kind", "(0 h)")
    np.testing.assert_array_equal(lisp("[(x 0) (0 h)]", x=2.0, h=7.0), [[2, 0], [0, 7]])


def test_the_names_of_the_classic_examples_are_ordinary(lisp):
    np.testing.assert_array_equal(lisp("(f t p)", f=1.0, t=2.0, p=3.0), [1, 2, 3])
    np.testing.assert_array_equal(lisp("[e nil]", e=1.0, nil=2.0), [1, 2])


@pytest.mark.parametrize("head", ["(pose2 0 0 x)", "(rot-x x)", '"text"', ":key"])
def test_poses_rotations_and_texts_cannot_be_heads(lisp, head):
    assert lisp.fault(f"({head} 1)", x=1.0) == ("bad-head", head)


def test_an_unknown_head_is_an_error_never_a_vector(lisp):
    assert lisp.fault("(xx 0 0)", x=1.0) == ("unknown-name", "xx")


def test_a_function_name_in_argument_position_denotes_the_function(lisp):
    assert lisp("(reduce + (list 1 2 x))", x=4.0) == 7.0
    assert lisp("(apply atan2 (list x 1))", x=1.0) == np.arctan2(1, 1)


def test_functions_given_as_values_say_what_is_wrong_at_the_call(lisp):
    assert lisp("(map norm (list [3 4] [6 8]))") == [5.0, 10.0]
    assert lisp("(map < (list 1 3) (list 2 2))") == [True, False]
    assert lisp.fault("(map norm (list [3 4] 1))") == ("wrong-kind", "(map norm (list [3 4] 1))")
    assert lisp.fault("(map not (list true 1))") == ("not-a-condition", "(map not (list true 1))")
    assert lisp.fault("(map atan2 (list 1))") == ("wrong-arity", "(map atan2 (list 1))")


def test_a_macro_is_no_function_value(lisp):
    assert lisp.fault("(map twice (list 1 2))", "(defmacro twice (x) `(* 2 ,x))") == ("wrong-kind", "twice")


def test_the_definition_of_the_user_shadows_the_built_in_one(lisp):
    assert lisp("(sqrt 9)", "(defun sqrt (x) (* 2 x))") == 18.0


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("(v 0)", ("bad-index", "0")),
        ("(v 4)", ("bad-index", "4")),
        ("(v 1.5)", ("wrong-kind", "1.5")),
        ("(v)", ("bad-index", "(v)")),
        ("(m 1 9)", ("bad-index", "9")),
        ("(v 1 1)", ("bad-index", "(v 1 1)")),
        ("(v n)", ("not-static", "n")),
    ],
)
def test_indices_that_pick_nothing(lisp, text, fault):
    assert lisp.fault(text, v=[1.0, 2.0, 3.0], m=[[1.0, 2.0]], n=1.0) == fault


def test_a_quotient_that_is_whole_may_index(lisp):
    assert lisp("(v (/ 4 2))", v=[1.0, 2.0]) == 2.0


@pytest.mark.parametrize(
    ("name", "hint"), [("-x", "(- x)"), ("x/2", "(/ x 2)"), ("x*y", "(* x y)"), ("x-y", "(- x y)")]
)
def test_arithmetic_as_elsewhere_gets_its_lisp(lisp, name, hint):
    with pytest.raises(MbmError) as caught:
        lisp.value(name, numbers={"x": 1.0, "y": 2.0})
    assert caught.value.diagnostics[0].hint == f"write `{hint}`"


@pytest.mark.parametrize(("form", "hint"), [("(a - 3)", "`(- …)`"), ("(+ a sin)", "`(sin …)`")])
def test_a_function_behind_its_arguments_is_told_to_stand_first(lisp, form, hint):
    with pytest.raises(MbmError) as caught:
        lisp(form, a=1.0)
    assert caught.value.diagnostics[0].hint == f"a function stands first in a list: {hint}"


def test_a_choice_of_extrema_is_told_to_stand_first_with_its_number(lisp):
    with pytest.raises(MbmError) as caught:
        lisp("(+ a (extrema (curve (s 0 1) [s (* s s)]) 1))", a=1.0)
    assert caught.value.diagnostics[0].hint == "a function stands first in a list: `((extrema C 1) n)`"


def test_a_misspelt_name_with_a_hyphen_is_no_subtraction(lisp):
    with pytest.raises(MbmError) as caught:
        lisp.value("focal-lenght", numbers={"focal-length": 1.0})
    assert caught.value.diagnostics[0].hint == "did you mean `focal-length`?"


PLAIN = [
    each
    for each in vocabulary().functions.values()
    if isinstance(each, Builtin) and "…" not in each.usage and " or " not in each.usage
]


@pytest.mark.parametrize("function", PLAIN, ids=lambda each: each.name)
def test_functions_take_as_many_arguments_as_their_usage_shows(lisp, function):
    words = re.sub(r"\[[^]]*\]", "[]", function.usage).strip("()").split()[1:]
    assert (function.minimum, function.maximum) == (len([each for each in words if each != "[]"]), len(words))
    too_many = f"({function.name} {'1 ' * (len(words) + 1)})"
    assert lisp.fault(too_many) == ("wrong-arity", too_many)
