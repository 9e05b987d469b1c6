"""The layout of `mbm fmt`, by example."""

from pathlib import Path

import pytest

from mbm.text.formatter import format_text
from mbm.text.types import MbmError, Source


def formatted(text):
    return format_text(Source("t.mbm", text))


def kept(text):
    """The text comes out as it went in."""
    return formatted(text) == text


def test_a_problem_in_good_layout_is_kept():
    assert kept(
        ";; Ultrasonic tags.\n"
        "(problem tags\n"
        '  (data receivers (csv "receivers.csv") :key id)               ; id, x, y, z\n'
        '  (data ranges (csv "ranges.csv") :with (receivers receiver))  ; epoch, receiver, range\n'
        "  (unknowns (p (vector 3) :unit m))\n"
        "  (observe ranges\n"
        "    (= range (distance p [receivers.x receivers.y receivers.z]))\n"
        "    :sigma 5mm)\n"
        "\n"
        "  (constraints (<= 0m (p 3) 2.7m))\n"
        "  (solve :robust (lmeds :trials 200)))\n"
    )


def test_chains_of_shapes_go_on_two_columns_right_of_where_their_line_begins():
    assert kept(
        "(defmodel arm (phi th ps bend)\n"
        "  (rotate (phi th ps)\n"
        "    (bone (cylinder 3cm 30cm))\n"
        "    (elbow (trans (30cm 0 0) (rotate (0 0 bend)\n"
        "      (bone (cylinder 3cm 26cm))\n"
        "      (wrist (trans (26cm 0 0) (sphere 4cm))))))))\n"
    )


def test_indentation_and_spaces_are_set_right():
    assert formatted("(problem   p\n(unknowns\n   (a)(b)\n)\n      (observe (- a\n b)  :sigma   2))") == (
        "(problem p\n  (unknowns\n    (a) (b))\n  (observe (- a b) :sigma 2))\n"
    )


def test_expressions_are_joined_where_they_fit():
    assert formatted("(defconst x (+ 1\n   (* 2\n 3)))") == "(defconst x (+ 1 (* 2 3)))\n"


def test_long_calls_break_under_their_first_argument():
    first, second = "a" * 50, "b" * 50
    assert formatted(f"(defconst x (+ ({first} 1) ({second} 2)))") == (
        f"(defconst x (+ ({first} 1)\n               ({second} 2)))\n"
    )


def test_options_stay_with_their_values():
    entry = '(unknown-with-a-long-name (vector 3) :init [1 2 3] :sigma 5mm :in (1m 20m) :unit m :doc "a text of words")'
    lines = formatted(f"(problem p (unknowns {entry}))").splitlines()
    assert not [line for line in lines if line.endswith((":init", ":sigma", ":in", ":unit", ":doc"))]
    assert max(map(len, lines)) <= 100


def test_short_entries_are_filled_into_lines():
    entries = " ".join(f"(k{number})" for number in range(40))
    lines = formatted(f"(problem p (unknowns {entries}))").splitlines()
    assert lines[:2] == ["(problem p", "  (unknowns"]
    assert len(lines) == 2 + 3  # 40 entries of 4 or 5 columns and a space, in lines of 96
    assert max(map(len, lines)) <= 100


def test_the_authors_lines_of_a_clause_stay():
    assert kept("(problem p\n  (unknowns\n    (fx) (fy) (cx) (cy)\n    (T (pose 3))))\n")


def test_at_most_one_blank_line_stays():
    assert formatted("(a)\n\n\n\n(b)\n(problem p\n\n\n  (x)\n\n\n  (y)\n\n)") == (
        "(a)\n\n(b)\n\n(problem p\n\n  (x)\n\n  (y))\n"
    )


def test_comments_of_every_kind_stay():
    assert formatted("; top\n(a) ; end\n#| block |#\n(problem p ; of p\n ; own\n (b #| in |# c)\n ; last\n )") == (
        "; top\n(a)  ; end\n#| block |#\n(problem p  ; of p\n  ; own\n  (b #| in |# c)\n  ; last\n  )\n"
    )


def test_a_comment_behind_the_last_item_moves_behind_the_bracket():
    assert formatted("(problem p\n  (constants (a 1) ; one\n  ))") == "(problem p\n  (constants (a 1)))  ; one\n"


def test_comments_of_neighbouring_lines_share_a_column():
    assert formatted('(problem p\n  (data a (csv "a")) ; A\n  (data bcd (csv "b")) ; B\n  (x))') == (
        '(problem p\n  (data a (csv "a"))    ; A\n  (data bcd (csv "b"))  ; B\n  (x))\n'
    )


def test_strings_and_numbers_are_printed_as_written():
    assert kept('(f "a\n   b" +.50e+2 1/3m \'x `(y ,z ,@w))\n')


@pytest.mark.parametrize(
    ("written", "printed"),
    [
        ("(observe t (= (1 2) (trans (0 0 h) v)))", "(observe t (= [1 2] (trans [0 0 h] v)))"),
        ("(observe t (- x (0 (1 2))) :sigma (1 2))", "(observe t (- x [0 [1 2]]) :sigma [1 2])"),
        ("(observe t (let ((q (0 1))) q))", "(observe t (let ((q [0 1])) q))"),
        ("(unknowns (c (vector 2) :init (0 0)))", "(unknowns (c (vector 2) :init [0 0]))"),
        ("(derive (d (norm (1 x))))", "(derive (d (norm [1 x])))"),
        ("(constraints (for (i 1 2) (<= (0 0) v)))", "(constraints (for (i 1 2) (<= [0 0] v)))"),
    ],
)
def test_literal_vectors_in_problems_are_printed_with_square_brackets(written, printed):
    assert formatted(f"(problem p {written})") == f"(problem p {printed})\n"


@pytest.mark.parametrize(
    "clause",
    [
        "(unknowns (c :in (0 1) :start (2 3)))",
        "(constants (k0 800))",
        "(data t (table (a b) (1 2) (3 4)))",
        "(camera cam :focal (820 820) :center (320 240))",
        "(observe t (= x '(1 2)))",
        "(observe t (= x `(1 2)))",
        "(observe t (= x (my-macro (1 2))))",
        "(observe t (= y x) :errors ((x 1)))",
        "(observe t (= x (trans (a b c) v)))",
        "(observe t (= x ((- x2) y2 0)))",
        "(solve :starts (given (1 2)))",
    ],
)
def test_what_is_no_vector_beyond_doubt_is_kept(clause):
    assert kept(f"(problem p {clause})\n")


def test_models_and_functions_keep_what_was_written():
    assert kept("(defmodel m (x)\n  (trans (0 0 1) (box 1 2 3)))\n")
    assert kept("(defun f (x) (norm (1 2 x)))\n")


def test_a_redefined_function_is_not_trusted_with_vectors():
    assert kept("(defmacro norm (x) x)\n(problem p (observe (norm (1 2))))\n")


def test_text_with_errors_is_refused():
    with pytest.raises(MbmError):
        formatted("(a")


def test_empty_text_stays_empty():
    assert formatted("\n\n") == ""


def test_very_deep_forms_are_formatted():
    text = "(f a\n" * 190 + ")" * 190
    assert formatted(formatted(text)) == formatted(text)


@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parents[2] / "problems").rglob("*.mbm")), ids=lambda path: path.name
)
def test_the_problems_that_come_with_mbm_format_once_and_for_all(path):
    once = formatted(path.read_text(encoding="utf-8"))
    assert formatted(once) == once


def test_lines_stand_below_an_argument_only_beside_the_head():
    """Where the first clause of `cond` goes to a line of its own, a second layout changes nothing."""
    clause = "((and (< first-name second-name) (not (< third-name fourth-name))) (+ first-name second-name third-name))"
    text = formatted(f"(problem p (observe d (= y (cond {clause} (true (+ a b))))))")
    assert formatted(text) == text
    line = next(line for line in text.splitlines() if "((and" in line)
    head = next(line for line in text.splitlines() if "(cond" in line)
    assert line.index("((and") == head.index("(cond") + 2


def test_a_last_argument_opens_beside_others_only_if_these_are_on_one_line():
    clause = "(det [(transform (pose2 (first-name 1) a a) [b b]) (rotate (rot2 (second-name 1)) [b -1])])"
    for rest in ("1 1", "1 (sin (+ a b))"):
        text = formatted(f"(problem p (observe d (= y a)) (constraints (normal {clause} {rest})))")
        assert formatted(text) == text


def test_arguments_below_their_head_are_indented_by_two():
    """Found by random problems: a second layout moved what stands below `(list` under an argument that is not there."""
    first = formatted(
        "(problem p (observe d (= y (reduce + (list (cond ((and (< a a) (not (< a readings.x)))"
        " (apply + (map (lambda (a) a) (range 1 3)))) (true (+ a a))) (+ (+ a a) (+ a a))) (+ (+ a a) (+ a a))))"
        " (= y (norm [a b])) :sigma 1))"
    )
    assert kept(first)
    lines = first.splitlines()
    opened = next(number for number, line in enumerate(lines) if line.endswith("(list"))
    below = lines[opened + 1]
    assert len(below) - len(below.lstrip()) == lines[opened].index("(list") + 2


@pytest.mark.parametrize(("longer", "lines"), [(0, 1), (1, 2)])
def test_a_line_may_be_a_hundred_columns_long(longer, lines):
    name = "x" * (100 - len("(defun f (a) (* a ))") + longer)
    text = formatted(f"(defun f (a) (* a {name}))")
    assert len(text.splitlines()) == lines
    assert max(map(len, text.splitlines())) <= 100


def test_a_list_at_the_top_with_one_list_in_it_is_laid_out_as_a_model():
    part = "(trans (1 0 0) " + " ".join(["(sphere 1)"] * 12) + ")"
    lines = formatted(f"(camera {part})").splitlines()
    assert lines[0] == "(camera"
    assert [len(line) - len(line.lstrip()) for line in lines[1:]] == [2, 4]


def test_what_repeats_shapes_keeps_its_range_on_its_line():
    assert formatted(f"(defmodel m () (for (i 1 3) (trans (1 0 0) (sphere {'1' * 60})) (sphere 2)))") == (
        f"(defmodel m ()\n  (for (i 1 3)\n    (trans (1 0 0) (sphere {'1' * 60}))\n    (sphere 2)))\n"
    )
