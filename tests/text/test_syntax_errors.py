"""Every code of the text stage: what raises it, where it points, and that nothing else follows from it."""

import pytest

from mbm.text import faults
from mbm.text.files import LARGEST_TEXT, read_file
from mbm.text.reader import MOST_FAULTS, read
from mbm.text.types import Code, DataPlace, MbmError, Source


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
    elsewhere = {"missing-file", "not-a-file", "unreadable-file", "text-too-large", "more-faults", "missing-extra"}
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


def file_diagnostic(path):
    with pytest.raises(MbmError) as caught:
        read_file(path, "f.mbm")
    (diagnostic,) = caught.value.diagnostics
    return diagnostic


def test_a_missing_file(tmp_path):
    diagnostic = file_diagnostic(tmp_path / "none.mbm")
    assert diagnostic.code is faults.MISSING_FILE
    assert diagnostic.place == DataPlace(file="f.mbm")


def test_a_directory(tmp_path):
    assert file_diagnostic(tmp_path).code is faults.NOT_A_FILE


@pytest.mark.parametrize("name", ["a\0b", "a" * 5000])
def test_a_name_that_no_file_can_have(tmp_path, name):
    assert file_diagnostic(tmp_path / name).code is faults.UNREADABLE_FILE


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "binary.mbm"
    path.write_bytes(b"(a\n b \xff\xfe)")
    diagnostic = file_diagnostic(path)
    assert diagnostic.code is faults.NOT_TEXT
    assert (diagnostic.place.line, diagnostic.place.column) == (2, 4)


def test_a_file_with_nul_characters(tmp_path):
    path = tmp_path / "nul.mbm"
    path.write_bytes(b"(a)\n\0\0")
    assert file_diagnostic(path).code is faults.NOT_TEXT


def test_a_file_beyond_the_limit(tmp_path):
    path = tmp_path / "large.mbm"
    path.write_bytes(b" " * (LARGEST_TEXT + 1))
    assert file_diagnostic(path).code is faults.TEXT_TOO_LARGE


def test_an_error_points_at_the_form_that_asked_for_the_file(tmp_path):
    (form,) = read(Source("main.mbm", '\n(use "x.mbm")'))
    with pytest.raises(MbmError) as caught:
        read_file(tmp_path / "x.mbm", "x.mbm", form.span)
    assert caught.value.diagnostics[0].place == form.span


def test_a_byte_order_mark_and_windows_line_breaks_are_allowed(tmp_path):
    path = tmp_path / "windows.mbm"
    path.write_bytes(b"\xef\xbb\xbf(a\r\n b)\r\n")
    assert read_file(path, "w").text == "(a\n b)\n"
