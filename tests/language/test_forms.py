"""LANGUAGE §2: special forms, functions, quasi-quotation, macros, lists."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from mbm.language.special import value_form
from mbm.language.values import StaticColumnNeeded
from mbm.text.printer import print_form
from mbm.text.reader import read
from mbm.text.types import MbmError, Source


def test_let_binds_in_parallel_and_let_star_in_sequence(lisp):
    assert lisp("(let ((a b) (b a)) (- a b))", a=1.0, b=10.0) == 9.0
    assert lisp("(let* ((a b) (b a)) (- a b))", a=1.0, b=10.0) == 0.0
    assert lisp("(let* ((a 1) (a (+ a 1)) (a (* a 3))) a)") == 6.0


def test_the_last_form_of_a_body_is_its_value(lisp):
    assert lisp("(let ((a 1)) 5 (+ a 1))") == 2.0
    assert lisp("(f 2)", '(defun f (x) "doc" (sin x) (* 3 x))') == 6.0


def test_closures_keep_the_scope_they_were_made_in(lisp):
    assert lisp("(let ((add (let ((n 10)) (lambda (x) (+ x n)))) (n 99)) (add 1))") == 11.0
    assert lisp("((adder 3) 4)", "(defun adder (n) (lambda (x) (+ x n)))") == 7.0
    assert lisp("(let* ((f (lambda () a)) (a 5)) (f))", a=1.0) == 1.0


@pytest.mark.parametrize(("last", "there"), [(1, "(> a 0)"), (2, "(< a a)")])
def test_sums_are_of_numbers_or_vectors(lisp, last, there):
    assert lisp.fault(f"(sum (i 1 {last}) {there})", a=1.0) == ("wrong-kind", there)


def test_functions_see_the_file_not_their_caller(lisp):
    assert lisp.fault("(let ((hidden 1)) (f))", "(defun f () hidden)")[0] == "unknown-name"


def test_optional_and_key_parameters(lisp):
    definition = "(defun f (a &optional (b (* 2 a)) (c (+ a b)) &key (:tag d 7) e) (list a b c d e))"
    assert lisp("(f 1 :e 0)", definition) == [1, 2, 3, 7, 0]
    assert lisp("(f 1 5 :tag 9 :e 8)", definition) == [1, 5, 6, 9, 8]
    assert lisp("(f 1 5 6 :e 8 :tag 9)", definition) == [1, 5, 6, 9, 8]
    assert lisp.fault("(f 1)", definition)[0] == "bad-form"
    assert lisp.fault("(f 1 :tog 2 :e 1)", definition) == ("bad-form", ":tog")
    assert lisp.fault("(f)", definition)[0] == "wrong-arity"
    assert lisp.fault("(f 1 2 3 4 :e 1)", definition)[0] == "wrong-arity"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("`(a ,(+ 1 2) ,@(list 4 5))", "(a 3 4 5)"),
        ("`(a `(b ,(c ,(+ 1 2))))", "(a `(b ,(c 3)))"),  # R7RS, 4.2.8
        ("`(a `(b ,,(+ 1 2) ,c))", "(a `(b ,3 ,c))"),
        ("`[1 ,(/ 1 2)]", "[1 1/2]"),
        ("`(,@(list) x)", "(x)"),
        ('`(f ,\'(g 1) ,true ,"t" ,5mm)', '(f (g 1) true "t" 0.005m)'),
        ("'(a . b)", "(a . b)"),
    ],
)
def test_quasi_quotation(lisp, text, expected):
    # `list` takes forms as data, so the quoted form arrives unevaluated in it
    (value,) = lisp.value(f"(list {text})").items
    form = value_form(value, read(Source("s", "x"))[0].span)
    assert print_form(form) == expected


def test_forms_that_arrive_are_evaluated_where_they_arrive(lisp):
    definitions = "(defun model () '(* a x))"
    assert lisp("(+ 1 (model))", definitions, a=2.0, x=3.0) == 7.0
    assert lisp("(let ((x 10)) (+ 1 (model)))", definitions, a=2.0, x=3.0) == 21.0


def test_a_fault_in_a_form_that_arrived_names_both_places(lisp):
    with pytest.raises(MbmError) as caught:
        lisp.value("(+ 1 (model))", "(defun model () '(* a lost))", {"a": 1.0})
    diagnostic = caught.value.diagnostics[0]
    assert diagnostic.place.text == "lost"
    assert [label.place.text for label in diagnostic.labels] == ["(model)"]


def test_macros_take_forms_and_stand_for_forms(lisp):
    definitions = "(defmacro swap-difference (a b) `(- ,b ,a)) (defmacro unless (c x y) `(if ,c ,y ,x))"
    assert lisp("(swap-difference (+ a 1) 10)", definitions, a=2.0) == 7.0
    assert lisp("(unless false 1 (/ 1 0))", definitions) == 1.0


def test_conditions_that_are_known_select_and_skip_the_rest(lisp):
    assert lisp("(if (< 1 2) a (/ 1 0))", a=5.0) == 5.0
    assert lisp("(cond ((> 1 2) lost) ((= 1 1) a) (else lost))", a=5.0) == 5.0
    assert lisp('(if (= "left" "right") lost a)', a=5.0) == 5.0


@pytest.mark.parametrize(("a", "expected"), [(-2.0, -20.0), (0.0, 0.0), (3.0, 9.0)])
def test_conditions_on_unknowns_are_piecewise(lisp, a, expected):
    text = "(cond ((< a 0) (* 10 a)) ((= a 0) 0) (else (* a a)))"
    assert lisp(text, a=a) == expected
    np.testing.assert_array_equal(lisp("(if (< a 0) [a 1] [1 a])", a=a), [a, 1] if a < 0 else [1, a])


def test_cond_without_a_last_resort(lisp):
    assert lisp.fault("(cond ((< a 0) 1))", a=1.0)[0] == "bad-form"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(< 1 2 3)", True), ("(< 1 3 3)", False), ("(<= 1 3 3)", True), ("(> 3 2 2)", False), ("(>= 3 2 2)", True),
        ("(= 1 1 1)", True), ('(= "a" "a")', True), ("(and)", True), ("(or)", False), ("(not false)", True),
        ("(and true false)", False), ("(or false true)", True), ("(finite 1)", True), ("(= true false)", False),
    ],
)  # fmt: skip
def test_comparison_and_logic_of_known_values(lisp, text, expected):
    assert lisp(text) is expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(range 2 5)", [2, 3, 4, 5]),
        ("(range 2 1)", []),
        ("(append (list 1) (list) [2 3])", [1, 2, 3]),
        ("(length [[1 2] [3 4]])", 2.0),
        ("(map (lambda (x y) (* x y)) (list 1 2) (list 3 4))", [3, 8]),
        ("(map - [1 2])", [-1, -2]),
        ("(reduce - (list 10 1 2))", 7.0),
        ("(reduce - (list 1 2) 10)", 7.0),
        ("(reduce + (list) 0)", 0.0),
        ("(apply + 1 2 (list 3 4))", 10.0),
        ("(sum (i 1 4) (* i i))", 30.0),
        ("(sum (i 1 0) i)", 0.0),
    ],
)
def test_lists(lisp, text, expected):
    assert lisp(text) == expected


def test_sums_of_vectors(lisp):
    np.testing.assert_array_equal(lisp("(sum (i 1 3) [i (* i x)])", x=2.0), [6, 12])


def test_a_list_of_numbers_is_a_vector_where_one_is_wanted(lisp):
    assert lisp("(norm (list 3 x))", x=4.0) == 5.0


def test_reduce_of_nothing_needs_a_start(lisp):
    assert lisp.fault("(reduce + (list))")[0] == "bad-form"


def test_constants_are_lazy_and_may_stand_in_any_order(lisp):
    definitions = "(defconst b (* 2 a)) (defconst a 3) (defconst broken (/ 1 0))"
    assert lisp("b", definitions) == 6.0
    assert lisp.fault("broken", definitions) == ("undefined-value", "(/ 1 0)")


def test_a_circle_of_constants(lisp):
    assert lisp.fault("a", "(defconst a (+ b 1)) (defconst b (* a 2))") == ("circular-definition", "a")


@pytest.mark.parametrize("name", ["if", "let", "lambda", "quote", "sum"])
def test_special_forms_cannot_be_defined(lisp, name):
    assert lisp.fault("1", f"(defun {name} (x) x)") == ("duplicate-definition", name)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("(if 1 2)", "bad-form"), ("(let)", "bad-form"), ("(let ((1 2)) 3)", "bad-form"), ("(lambda (x))", "bad-form"),
        ("(let ((a 1) (a 2)) a)", "duplicate-definition"),
        ("(sum (i 1) i)", "bad-form"), ("(quote)", "bad-form"), ("(cond)", "bad-form"),
        ("(lambda ((x)) x)", "bad-form"),
        ("(lambda (x x) x)", "duplicate-definition"), ("(if a 1 2)", "not-a-condition"), ("(range 1 a)", "not-static"),
        ("(map (lambda (x y) x) (list 1) (list 1 2))", "length-clash"), ("(map 1 (list 1))", "wrong-kind"),
        ("(length 1)", "wrong-kind"), ('(+ 1 "2")', "wrong-kind"), ("(+)", "wrong-arity"), ("(1m2)", "unknown-unit"),
        ("(- [1 2] [1 2 3])", "length-clash"), ("(* [[1]] [[1]])", "length-clash"), ("[[1 2] [3]]", "length-clash"),
        ("[1 [2]]", "wrong-kind"), ("(+ true 1)", "wrong-kind"), ("(and 1)", "not-a-condition"),
        ('(= "a" 1)', "wrong-kind"), ("(if (< a 1) [1 2] [1])", "length-clash"), ("(if (< a 1) true 1)", "wrong-kind"),
        ("(sample t x 1)", "unknown-name"), ("(silhouette 1 2)", "wrong-kind"), ("(extrema 1 2)", "wrong-kind"),
    ],
)  # fmt: skip
def test_what_is_not_built_right(lisp, text, code):
    assert lisp.fault(text, a=1.0)[0] == code


ATOMS = st.sampled_from(["1", "-2", "0.5", "1/3", "5mm", "x", "v", "true", '"t"', ":k", "pi", "lost", "0"])
HEADS = st.sampled_from(
    [
        "+", "-", "*", "/", "^", "sin", "sqrt", "atan2", "norm", "dot", "cross", "@", "list", "append", "length",
        "range", "map", "reduce", "apply", "if", "cond", "let", "lambda", "sum", "quote", "quasiquote", "unquote", "=",
        "<", "and",
        "not", "v", "x", "f", "m", "euler", "pose3", "transform", "rotate", "trans", "box", "vertex", "project", "det",
        "outer", "identity", "mod", "min", "quaternion", "axis-angle", "compose", "perse", "feature", "origin",
    ]
)  # fmt: skip
FORMS = st.recursive(
    ATOMS,
    lambda inner: st.one_of(
        st.tuples(HEADS, st.lists(inner, max_size=4)).map(lambda t: f"({t[0]} {' '.join(t[1])})"),
        st.lists(inner, max_size=3).map(lambda items: f"[{' '.join(items)}]"),
        st.lists(inner, max_size=3).map(lambda items: f"({' '.join(items)})"),
        inner.map(lambda form: f"'{form}"),
        inner.map(lambda form: f"`(a ,{form})"),
    ),
    max_leaves=12,
)


@pytest.mark.parametrize("text", ["(det (outer [] []))", "(@ [[]] [1])", "(transpose [[]])", "(list `(a ,[[]]))"])
def test_empty_matrices_are_no_accident(lisp, text):
    try:
        lisp.value(text)
    except MbmError as error:
        assert error.diagnostics[0].code.name == "length-clash"


@settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(FORMS)
def test_whatever_is_written_gives_a_value_or_a_diagnostic(lisp, text):
    definitions = "(defun f (a &optional (b 1) &key (:k c 2)) (list a b c)) (defmacro m (a) `(+ ,a ,a))"
    try:
        lisp.value(text, definitions, {"x": 1.0, "v": [1.0, 2.0, 3.0]})
    except MbmError as error:
        assert error.diagnostics
        assert all(d.place is not None for d in error.diagnostics)
    except StaticColumnNeeded:
        pytest.fail("there are no columns here")


def test_operators_take_lists_of_numbers_as_vectors(lisp):
    assert lisp("(+ (list 1 2) [3 4])").tolist() == [4.0, 6.0]
    assert lisp("(* 2 (list 1 2))").tolist() == [2.0, 4.0]
    assert lisp.fault("(+ 1 (rot2 2))")[0] == "wrong-kind"


def test_functions_of_lists_take_quoted_forms_as_data(lisp):
    assert lisp("(reduce (lambda (n form) (+ n 1)) '(no names here) 0)") == 3.0
    assert lisp("(length (append '(no names) '(here)))") == 3.0
    assert lisp("(length (map (lambda (form) 1) '(no names here)))") == 3.0


def test_quantities_of_one_dimension_are_compared(lisp):
    assert lisp("(if (< 1mm 2m) 1 2)") == 1.0
    assert lisp("(if (>= 1mm 2m) 1 2)") == 2.0


def test_a_text_at_the_end_of_a_function_is_its_value(lisp):
    assert lisp("(f 2)", "(defun f (x) (sin x) (* 3 x))") == 6.0
    assert lisp.value("(f 2)", '(defun f (x) "a value")') == "a value"


def test_a_wrong_call_shows_the_parameters_with_their_defaults(lisp):
    with pytest.raises(MbmError) as caught:
        lisp.value("(f)", "(defun f (a &optional (b (* 2 a)) c &key (:tag d 7)) a)")
    (fault,) = caught.value.diagnostics
    assert "(f a [b = (* 2 a)] [c] [:tag d])" in f"{fault.message} {fault.hint}"
