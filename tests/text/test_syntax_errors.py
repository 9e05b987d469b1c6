"""Every code of the text stage: what raises it, where it points, and that nothing else follows from it."""

import pytest

from mbm.text import faults
from mbm.text.characters import LARGEST_TEXT
from mbm.text.faults import MOST_FAULTS
from mbm.text.reader import read
from mbm.text.types import Code, MbmError, Source


def diagnostics_of(text):
    with pytest.raises(MbmError) as caught:
        read(Source("t.mbm", text))
    return caught.value.diagnostics


def found(text):
    return [(d.code.name, d.place.line, d.place.column, d.place.length) for d in diagnostics_of(text)]


CASES = {
    "unclosed-bracket": ("(a (b c)", [(1, 1, 1)]),
    "surplus-bracket": ("(a))\n(b)", [(1, 4, 1)]),
    "mismatched-bracket": ("(a [b c) d)", [(1, 8, 1)]),
    "too-deeply-nested": ("(" * 20_000, [(1, 201, 1)]),
    "bad-number": ("(12abc$ 3..4 1/2/3 5-3)", [(1, 2, 6), (1, 9, 4), (1, 14, 5), (1, 20, 3)]),
    "zero-denominator": ("(1/0 -3/00m)", [(1, 2, 3), (1, 6, 6)]),
    "number-out-of-range": (
        f"(1e999 1e-999 {'9' * 320} {'9' * 5000})",
        [(1, 2, 5), (1, 8, 6), (1, 15, 320), (1, 336, 5000)],
    ),
    "unterminated-string": ('(a "b', [(1, 4, 1)]),
    "unknown-escape": (r'"C:\data\q"', [(1, 4, 2), (1, 9, 2)]),
    "unterminated-comment": ("(a #| #| |# ", [(1, 4, 2)]),
    "stray-character": ("{a} b$c a:b # \u200b", [(1, 1, 1), (1, 6, 1), (1, 10, 1), (1, 13, 1), (1, 15, 1)]),
    "unexpected-comma": ("(1, 2)", [(1, 3, 1)]),
    "empty-keyword": ("(a : :5)", [(1, 4, 1), (1, 6, 2)]),
    "nothing-to-quote": ("(a ')", [(1, 4, 1)]),
    "not-text": ("(a \0)", [(1, 4, 1)]),
}


@pytest.mark.parametrize("code", CASES)
def test_each_code_points_at_its_place_and_comes_alone(code):
    text, places = CASES[code]
    assert found(text) == [(code, *place) for place in places]


def test_every_code_of_the_stage_has_a_test():
    codes = {value.name for value in vars(faults).values() if isinstance(value, Code)}
    elsewhere = {"text-too-large", "too-long-to-print", "more-faults", "missing-extra"}
    assert codes == CASES.keys() | elsewhere


def test_independent_errors_are_reported_together_in_order():
    text = '(a 3..4)\n(b , "\\q")\n(c))\n(d [)\n(e'
    assert [code for code, *_place in found(text)] == [
        "bad-number",
        "unexpected-comma",
        "unknown-escape",
        "surplus-bracket",
        "mismatched-bracket",
        "unclosed-bracket",
    ]


@pytest.mark.parametrize(
    ("text", "mend"),
    [
        ("(k :unit 1/s)", "`s^-1`"),
        ("(k :unit\n  1/m^2/s)", "`m^-2*s^-1`"),
        ("(= 2/s k)", "`2s^-1`"),
        ("(= 0.5/m*K k)", "`0.5m^-1*K`"),
    ],
)
def test_a_unit_below_the_line_is_shown_as_it_is_written(text, mend):
    (diagnostic,) = diagnostics_of(text)
    assert diagnostic.hint == f"a unit below the line is written {mend}"


def test_an_unclosed_bracket_is_looked_for_by_the_layout():
    (diagnostic,) = diagnostics_of('(problem x\n  (data d (csv "a")\n  (unknowns (b :init 1)))\n')
    assert (diagnostic.place.line, diagnostic.place.column) == (2, 3)
    (label,) = diagnostic.labels
    assert (label.place.line, label.place.column) == (3, 3)


def test_a_form_in_column_one_shows_where_a_bracket_was_forgotten():
    (first, second) = diagnostics_of("(defun f (x)\n  (+ x 1)\n(defun g (x)\n  (+ x 2))\n(h")
    assert (first.place.line, first.labels[0].place.line) == (1, 3)
    assert (second.place.line, second.labels) == (5, ())


def test_brackets_in_an_open_string_are_not_missed():
    assert [code for code, *_place in found('(a (b "c))\n(d)')] == ["unterminated-string"]


def test_an_earlier_string_over_several_lines_is_named_as_the_possible_culprit():
    (diagnostic,) = diagnostics_of('(csv "a.csv)\n(b "c")')
    assert diagnostic.place.line == 2
    assert diagnostic.labels[0].place.line == 1


def test_a_mismatched_bracket_names_the_opening_one():
    (diagnostic,) = diagnostics_of("(a [b c) d)")
    assert diagnostic.labels[0].place.column == 4
    assert diagnostic.hint == "write `]`"


def test_a_unit_below_the_line_is_spelt_out():
    assert "5s^-1" in diagnostics_of("5/s")[0].hint


def test_twenty_thousand_quotes_are_one_error():
    assert found("'" * 20_000) == [("too-deeply-nested", 1, 201, 1)]


def test_very_many_faults_are_counted_not_listed():
    diagnostics = diagnostics_of("$ " * 1000)
    assert len(diagnostics) == MOST_FAULTS + 1
    assert diagnostics[-1].code is faults.MORE_FAULTS
    assert str(1000 - MOST_FAULTS) in diagnostics[-1].message


def test_half_a_surrogate_pair_is_no_text():
    assert found("(a \ud800)") == [("not-text", 1, 4, 1)]


def test_a_text_beyond_the_limit_is_refused():
    (diagnostic,) = diagnostics_of(" " * (LARGEST_TEXT + 1))
    assert diagnostic.code is faults.TEXT_TOO_LARGE


@pytest.mark.parametrize(
    ("text", "around"), [("(a (b c", ", nor is another"), ("(a (b [c", ", nor are 2 others"), ("(a", "")]
)
def test_other_brackets_that_are_open_are_counted(text: str, around: str) -> None:
    (diagnostic,) = diagnostics_of(text)
    assert diagnostic.message.partition("is never closed")[2] == (f"{around} around it" if around else "")
