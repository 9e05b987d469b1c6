"""What notebooks show of results: well-formed, escaped, with the doubts."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

import mbm

LINE = """(problem p "doc" (data d (table (k x y) {rows})) (unknowns (a :doc "<script>alert(1)</script> & more") (b))
  (observe d (= y (+ a (* b x))) :sigma 0.1){extra})"""
ROWS = "(1 0 1.0) (1 1 2.1) (1 2 2.9) (2 0 1.0) (2 1 3.1) (2 2 4.9)"


def shown(extra="", rows=ROWS, text=LINE):
    result = mbm.loads(text.format(rows=rows, extra=extra)).solve()
    return result, result._repr_html_()


def parsed(html):
    return ElementTree.fromstring(html)  # noqa: S314 - made by mbm, and meant to be well-formed


def test_a_table_of_estimates():
    result, html = shown(rows="(1 0 1.0) (1 1 2.1) (1 2 2.9)")
    root = parsed(html)
    rows = [[cell.text or "" for cell in row] for row in root.iter("tr")]
    assert rows[0][:4] == ["name", "value", "unit", "95 % interval"]
    assert [row[0] for row in rows[1:]] == ["a", "b"]
    low, high = result["b"].interval()
    assert rows[2][3] == f"{low:.3f} … {high:.3f}"
    assert "±" in rows[2][1]


def test_doubts_stand_below_it():
    _, html = shown()
    doubts = [each for each in parsed(html).iter("p") if each.get("class") == "doubt"]
    assert any("times as large as the stated noise" in "".join(each.itertext()) for each in doubts)
    _, html = shown(rows="(1 1 1.0) (1 1 1.1)")
    said = " ".join("".join(each.itertext()) for each in parsed(html).iter("p"))
    assert "unobservable" in said


def test_many_solves_have_a_line_each():
    _, html = shown(" (for-each k)")
    rows = [[cell.text or "" for cell in row] for row in parsed(html).iter("tr")]
    assert rows[0][:2] == ["k", "status"]
    assert [row[:2] for row in rows[1:]] == [["1", "converged"], ["2", "converged"]]


@pytest.mark.parametrize("extra", ["", " (for-each k)"])
def test_texts_of_the_problem_are_no_markup(extra):
    _, html = shown(extra)
    assert "<script" not in html
    assert "http" not in html
    parsed(html)


def test_light_and_dark_are_those_of_the_notebook():
    """No colour of text or ground of its own, so that both show it."""
    _, html = shown()
    style = html.partition("<style>")[2].partition("</style>")[0]
    colours = [line for line in style.splitlines() if "color:" in line.replace("border-", "")]
    assert all("color: inherit" in line for line in colours), colours
