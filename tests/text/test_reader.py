"""Characters → forms: what the reader makes of sound text."""

from fractions import Fraction

import pytest

from mbm.text.reader import read
from mbm.text.types import Bracket, Keyword, MbmError, Numeral, Sequence, Source, Symbol, Text


def read_one(text):
    (form,) = read(Source("t.mbm", text))
    return form


@pytest.mark.parametrize(
    ("written", "value", "unit"),
    [
        ("12", 12, None),
        ("-3.5", -3.5, None),
        (".5", 0.5, None),
        ("-.5", -0.5, None),
        ("+5", 5, None),
        ("5.", 5.0, None),
        ("2.5e-3", 0.0025, None),
        ("1E3", 1000.0, None),
        ("1/3", Fraction(1, 3), None),
        ("-2/6", Fraction(-1, 3), None),
        ("4/2", 2, None),
        ("5mm", 5, "mm"),
        ("20deg", 20, "deg"),
        ("0.3m/s", 0.3, "m/s"),
        ("40deg/s^2", 40, "deg/s^2"),
        ("9.80665m/s^2", 9.80665, "m/s^2"),
        ("1/3m", Fraction(1, 3), "m"),
        ("2e3m", 2000.0, "m"),
        ("5em", 5, "em"),
        ("50%", 50, "%"),
        ("3s^-1", 3, "s^-1"),
        ("2deg/s^0.5", 2, "deg/s^0.5"),
        ("7µm", 7, "µm"),
        ("2N*m", 2, "N*m"),
    ],
)
def test_numbers_are_read_exactly_with_their_unit_as_text(written, value, unit):
    form = read_one(written)
    assert isinstance(form, Numeral)
    assert (form.value, type(form.value), form.unit) == (value, type(value), unit)
    assert form.span.text == written


@pytest.mark.parametrize(
    "name", ["x", "+", "-", "-x", "...", "x/2", ".x", "->", "vio.x", "r2", "a@b", "θ", "<=", "&optional", "let*", "%"]
)
def test_names_are_symbols(name):
    assert read_one(name) == Symbol(name=name, span=read_one(name).span)


def test_names_keep_their_case():
    assert [form.name for form in read(Source("t", "k K"))] == ["k", "K"]


def test_strings_have_their_escapes_resolved():
    form = read_one(r'"a\"b\\c\nd\te"')
    assert isinstance(form, Text)
    assert form.value == 'a"b\\c\nd\te'


def test_a_string_may_run_over_lines():
    assert read_one('"a\nb"').value == "a\nb"


def test_keywords_are_named_without_the_colon():
    form = read_one(":max-iterations")
    assert isinstance(form, Keyword)
    assert form.name == "max-iterations"


@pytest.mark.parametrize(
    ("written", "head"), [("'x", "quote"), ("`x", "quasiquote"), ("`,x", "unquote"), ("`(,@x)", "unquote-splicing")]
)
def test_quotes_read_as_lists_that_span_prefix_and_form(written, head):
    form = read_one(written)
    while form.head != head:
        form = form.items[1] if form.head else form.items[0]
    assert form.bracket is Bracket.ROUND
    assert form.items[1].name == "x"
    assert form.span.text == written[-form.span.length - written.endswith(")") :].removesuffix(")")


def test_lists_and_vectors_keep_their_brackets_and_spans():
    form = read_one("(a [b  c] ())")
    assert form.span.text == "(a [b  c] ())"
    assert [item.span.text for item in form.items] == ["a", "[b  c]", "()"]
    assert form.items[1].bracket is Bracket.SQUARE
    assert isinstance(form.items[2], Sequence)
    assert form.items[2].items == ()


def test_places_count_from_one():
    inner = read_one("(a\n  ; remark\n  (b c))").items[1]
    assert (inner.span.line, inner.span.column, inner.span.length) == (3, 3, 5)


def test_comments_are_no_forms_and_blocks_nest():
    forms = read(Source("t", '; (\n a #| ( #| " |# ; |# b;c\n"; #| no comment |#"'))
    assert [form.span.text for form in forms] == ["a", "b", '"; #| no comment |#"']


def test_a_comment_ends_a_word():
    assert [form.span.text for form in read(Source("t", "5mm;x\na#|c|#b"))] == ["5mm", "a", "b"]


def test_commas_may_stand_inside_quasi_quotation_at_any_depth():
    assert read_one("`(a (b ,c) ,@(d `(e ,f)))").head == "quasiquote"


def test_empty_text_has_no_forms():
    assert read(Source("t", " ; nothing\n#| at all |#\n")) == ()


def test_two_hundred_levels_are_read():
    form = read_one("(" * 200 + ")" * 200)
    depth = 0
    while isinstance(form, Sequence):
        depth, form = depth + 1, form.items[0] if form.items else None
    assert depth == 200


def test_a_file_with_windows_line_breaks_reads_alike():
    plain = "(a ; c\n b)\n(c)"
    assert read(Source("t", plain.replace("\n", "\r\n"))) == read(Source("t", plain))


@pytest.mark.parametrize("tail", ["x_", "..", "#", "e", "/"])
def test_rows_of_digits_are_read_once(tail):
    # Half a million digits: where each is given back and tried again, this does not end within hours.
    with pytest.raises(MbmError):
        read(Source(name="p.mbm", text="(" + "9" * 500_000 + tail + ")"))
