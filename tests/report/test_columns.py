"""Columns of plain tables: widths as terminals count them, and texts of files that stay within their cells."""

from __future__ import annotations

import textwrap

import pytest
from hypothesis import given, strategies as st

from mbm.report.columns import LONGEST_CELL, aligned, fitting, left, right, wrapped
from mbm.text.shown import cell_width

TEXTS = st.lists(st.text(st.characters(), max_size=150), min_size=1, max_size=5)


@given(TEXTS)
def test_cells_are_printable_and_of_one_width(texts: list[str]) -> None:
    for cells in (left(texts), right(texts), aligned(texts)):
        assert all(cell.isprintable() for cell in cells)
        assert len({cell_width(cell) for cell in cells}) == 1
        assert max(map(len, cells)) <= 2 * LONGEST_CELL + 20


def test_wide_characters_and_marks_do_not_displace_what_follows() -> None:
    assert left(["日本", "e\u0301", "abcde"]) == ["日本 ", "e\u0301    ", "abcde"]
    assert right(["日本", "e\u0301", "abcde"]) == [" 日本", "    e\u0301", "abcde"]


def test_points_stand_below_one_another() -> None:
    lines = ["  1.5      ", "-20        ", " (3.25)e+05", "           "]
    assert aligned(["1.5", "-20", "(3.25)e+05", ""]) == lines


@given(st.lists(st.text("abc.", min_size=1, max_size=12), min_size=1, max_size=30), st.integers(20, 60))
def test_sentences_break_where_pythons_own_wrapping_breaks_them(words: list[str], widest: int) -> None:
    text = " ".join(words)
    assert wrapped(text, widest) == textwrap.wrap(text, widest, subsequent_indent="    ", break_on_hyphens=False)


@given(st.text(st.characters(), max_size=300), st.integers(10, 60))
def test_no_line_is_too_wide_or_begins_as_one_of_ours(text: str, widest: int) -> None:
    lines = wrapped(text, widest)
    assert all(cell_width(line) <= widest and line.isprintable() for line in lines)
    assert all(line.startswith("    ") for line in lines[1:])


def test_long_words_and_no_words() -> None:
    assert wrapped("", 20) == [""]
    assert wrapped("a " + "b" * 20, 10) == ["a", "    bbbbbb", "    bbbbbb", "    bbbbbb", "    bb"]
    assert wrapped("日本語日本語", 8) == ["日本語日", "    本語"]


@pytest.mark.parametrize(("room", "shown"), [(4, "a\ufffd日"), (3, "a\ufffd…"), (1, "…")])
def test_a_text_is_cut_to_the_room_there_is(room: int, shown: str) -> None:
    assert fitting("a\x1b日", room) == shown
