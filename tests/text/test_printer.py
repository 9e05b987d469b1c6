"""Form → text: one line that reads back to an equal form."""

from fractions import Fraction

import pytest

from mbm.text import build
from mbm.text.printer import print_form
from mbm.text.reader import read
from mbm.text.types import Bracket, Keyword, Source, Span

NOWHERE = Span(source=Source("t", ""), start=0, end=0)


@pytest.mark.parametrize(
    "text",
    [
        '(a [b 1] :k "x\\"\\\\\\n\\ty")',
        "10",
        "10.0",
        "1/3m",
        "-0.5e-07",
        "'(x `(y ,z ,@w))",
        "(unquote x)",
        "`(unquote-splicing)",
        "`, @x",
        "()",
    ],
)
def test_printed_forms_read_back(text):
    (form,) = read(Source("t", text))
    (again,) = read(Source("t", print_form(form)))
    assert again == form


@pytest.mark.parametrize(
    ("value", "unit", "printed"),
    [
        (10, None, "10"),
        (10.0, None, "10.0"),
        (Fraction(1, 3), "m", "1/3m"),
        (0.1, "m/s", "0.1m/s"),
        (1e22, None, "1e+22"),
    ],
)
def test_numbers_print_with_every_digit(value, unit, printed):
    assert print_form(build.numeral(value, NOWHERE, unit)) == printed


def test_the_form_of_the_paper_prints_as_written():
    text = "(subvv 2 (perse (trans (list xg yg zg) (rotate (list f t p) x))) (list 10.0 -10.0))"
    (form,) = read(Source("t", text))
    assert print_form(form) == text


def test_quotes_print_as_prefixes():
    quoted = build.call(
        "quasiquote", [build.sequence([build.call("unquote", [build.symbol("x", NOWHERE)], NOWHERE)], NOWHERE)], NOWHERE
    )
    assert print_form(quoted) == "`(,x)"


def test_a_comma_form_outside_quasi_quotation_is_spelt_out():
    assert print_form(build.call("unquote", [build.symbol("x", NOWHERE)], NOWHERE)) == "(unquote x)"


def test_built_forms_of_any_depth_print():
    form = build.sequence([], NOWHERE, Bracket.SQUARE)
    for _level in range(5000):
        form = build.sequence([form], NOWHERE)
    assert print_form(form) == "(" * 5000 + "[]" + ")" * 5000


def test_built_atoms():
    form = build.sequence([Keyword(name="k", span=NOWHERE), build.text('a"b', NOWHERE)], NOWHERE)
    assert print_form(form) == '(:k "a\\"b")'
