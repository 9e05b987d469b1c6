"""Diagnostic → excerpt and dictionary, in the layout of the contract."""

import re

from mbm.text.render import as_json, render
from mbm.text.types import Code, DataPlace, Diagnostic, Label, Severity, Source, Span

CODE = Code("unknown-name", "A name that is not defined.", "Define it.")


def at(source, words):
    start = source.text.index(words)
    return Span(source=source, start=start, end=start + len(words))


def diagnostic(place, hint=None, **more):
    return Diagnostic(code=CODE, message="`rotat` is no name here", place=place, hint=hint, **more)


def carets(rendered):
    """The excerpt's source line from where the carets begin to where they end."""
    lines = rendered.splitlines()
    under = next(line for line in lines if "^" in line)
    above = lines[lines.index(under) - 1]
    return above[under.index("^") : under.rindex("^") + 1]


def test_the_layout_of_the_contract():
    source = Source("desk.mbm", "\n" * 13 + "  (board (trans (rotat 0 0 h) (rectangular x y)))\n")
    shown = render(
        Diagnostic(
            code=CODE,
            message="`rotat` is not a function, a model or a variable here",
            place=at(source, "rotat"),
            hint="did you mean `rotate`?",
        )
    )
    assert shown == "\n".join(
        [
            "error[unknown-name]: `rotat` is not a function, a model or a variable here",
            "  --> desk.mbm:14:18",
            "   |",
            "14 |   (board (trans (rotat 0 0 h) (rectangular x y)))",
            "   |                  ^^^^^ did you mean `rotate`?",
        ]
    )


def test_a_long_hint_stands_on_a_line_of_its_own():
    source = Source("a.mbm", "(rotat)")
    hint = "this hint is far too long to stand behind the carets of an excerpt, as anyone can see"
    lines = render(diagnostic(at(source, "rotat"), hint)).splitlines()
    assert lines[-2:] == ["   |  ^^^^^", f"   = help: {hint}"]


def test_a_place_in_data_names_row_and_column():
    shown = render(diagnostic(DataPlace(file="ranges.csv", row=17, column="range")))
    assert shown.splitlines()[1:] == ["  --> ranges.csv:17 (column range)", "   = help: define it"]


def test_a_warning_without_a_place_is_one_line():
    assert render(diagnostic(None, severity=Severity.WARNING)) == "warning[unknown-name]: `rotat` is no name here"


def test_labels_are_further_excerpts():
    source = Source("a.mbm", "(let x)\n(rotat)")
    shown = render(diagnostic(at(source, "rotat"), labels=(Label(at(source, "let"), "defined here"),)))
    assert shown.splitlines()[-4:] == ["  --> a.mbm:1:2", "   |", " 1 | (let x)", "   |  --- defined here"]


def test_long_lines_are_cut_around_the_place():
    source = Source("a.mbm", "(" + "before " * 40 + "rotat " + "after " * 40 + ")")
    shown = render(diagnostic(at(source, "rotat")))
    assert max(map(len, shown.splitlines())) <= 100
    assert carets(shown) == "rotat"
    assert shown.count("…") == 2


def test_a_place_wider_than_the_window_is_cut():
    source = Source("a.mbm", "(" + "x" * 500 + ")")
    assert max(map(len, render(diagnostic(at(source, "x" * 500))).splitlines())) <= 101  # one caret for the ellipsis


def test_tabs_do_not_displace_the_carets():
    assert carets(render(diagnostic(at(Source("a.mbm", "\t(\trotat)"), "rotat")))) == "rotat"


def test_wide_characters_take_two_columns():
    lines = render(diagnostic(at(Source("a.mbm", "(日本 rotat)"), "rotat"))).splitlines()
    assert lines[-1].index("^") == lines[-2].index("rotat") + 2


def test_a_place_of_several_lines_is_underlined_on_its_first():
    assert carets(render(diagnostic(at(Source("a.mbm", "(a (b\n c) d)"), "(b\n c)")))) == "(b"


def test_the_end_of_a_text_has_one_caret():
    source = Source("a.mbm", "(a\n")
    lines = render(diagnostic(Span(source=source, start=3, end=3))).splitlines()
    assert lines[1:] == ["  --> a.mbm:2:1", "   |", " 2 |", "   | ^ define it"]


def test_control_characters_never_reach_the_terminal():
    source = Source("a\x1b[2J.mbm", '(rotat "\x1b[31m\x07")')
    shown = render(diagnostic(at(source, "rotat")))
    assert "\x1b" not in shown
    assert "\x07" not in shown


def test_colour_changes_no_words():
    made = diagnostic(at(Source("a.mbm", "(rotat)"), "rotat"), "try `rotate`")
    coloured = render(made, color=True)
    assert coloured != render(made)
    assert re.sub("\x1b\\[[0-9;]*m", "", coloured) == render(made)


def test_the_dictionary_of_a_place_in_a_text():
    made = diagnostic(at(Source("a.mbm", "(a\n rotat)"), "rotat"), "try `rotate`")
    assert as_json(made) == {
        "severity": "error",
        "code": "unknown-name",
        "message": "`rotat` is no name here",
        "file": "a.mbm",
        "line": 2,
        "column": 2,
        "length": 5,
        "hint": "try `rotate`",
    }


def test_the_dictionary_of_a_place_in_data():
    document = as_json(diagnostic(DataPlace(file="r.csv", row=17, column="range")))
    assert {key: document[key] for key in ("file", "line", "column", "length", "row", "column_name")} == {
        "file": "r.csv",
        "line": 17,
        "column": None,
        "length": None,
        "row": 17,
        "column_name": "range",
    }


def test_the_dictionary_without_a_place():
    assert as_json(diagnostic(None))["file"] is None
