"""What a terminal may be shown of a text, and how many columns it takes there."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from mbm.text.shown import Paint, Style, cell_width, cut, joined, one_line, printable

SPACES = "\t\n\v\f\r\x1c\x85\xa0\u2028\u2029\u3000"
"""White space of Unicode that is no blank: each stands where one character of a line may stand."""

OTHERS = "\x00\x07\x08\x1b\x7f\x80\x9b\u200b\u200e\u202e\u2066\ufeff\ud800\U000e0041\U000f0000"


@given(st.text(st.characters()))
def test_a_part_of_a_line_is_printable_and_as_long_as_the_text(text: str) -> None:
    shown = one_line(text)
    assert shown.isprintable()
    assert len(shown) == len(text)
    assert one_line(shown) == shown
    assert all(a == b for a, b in zip(text, shown, strict=True) if a.isprintable())


def test_white_space_becomes_blanks_and_what_else_is_not_printable_a_mark() -> None:
    assert one_line(SPACES) == " " * len(SPACES)
    assert one_line(OTHERS) == "\N{REPLACEMENT CHARACTER}" * len(OTHERS)
    assert one_line("größe 日本 ± “…” é👍") == "größe 日本 ± “…” é👍"


@pytest.mark.parametrize(("text", "shown"), [("", ""), ("abcd", "abcd"), ("abcde", "abc…"), ("a\x1b\nde", "a\ufffd …")])
def test_long_texts_are_cut(text: str, shown: str) -> None:
    assert cut(text, 4) == shown


@given(st.lists(st.text(st.characters()), max_size=4), st.booleans())
def test_lines_stay_lines(lines: list[str], color: bool) -> None:
    text = joined(lines, color=color)
    assert text.count("\n") == max(len(lines) - 1, 0)
    assert all(line.isprintable() for line in text.split("\n"))


@given(st.text(st.characters()), st.sampled_from(list(Style)))
def test_paint_makes_a_part_of_a_line_and_the_last_look_leaves_it(text: str, style: Style) -> None:
    painted = Paint(color=True)(text, style)
    assert painted == (f"\x1b[{style.value}m{one_line(text)}\x1b[0m" if text else "")
    assert printable(painted, color=True) == painted
    assert Paint(color=False)(text, style) == printable(one_line(text)) == one_line(text)


def test_the_last_look_keeps_lines_and_without_colours_no_colours() -> None:
    assert printable("a\n\x1b[1mb\x1b[0m\x1b[31m\n", color=True) == "a\n\x1b[1mb\x1b[0m\ufffd[31m\n"
    assert printable("a\n\x1b[1mb\r\n") == "a\n\ufffd[1mb \n"


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("abc", 3),
        ("größe ± µm", 10),
        ("日本語", 6),
        ("ｶﾅ", 2),  # half-width katakana
        ("Ａ", 2),  # full-width letter
        ("e\u0301", 1),  # combining acute accent
        ("क्षि", 3),  # Devanagari: of four characters, the virama takes no column, and the vowel sign one
        ("\u1112\u1161\u11ab", 2),  # Korean, letter by letter: one syllable
        ("한", 2),
        ("👍", 2),
        ("☺\ufe0f", 1),  # a variation selector
    ],
)
def test_columns_of_a_terminal(text: str, columns: int) -> None:
    """As terminals count them by Unicode's own tables: UAX #11 for width, general category Mn for marks."""
    assert cell_width(text) == columns
