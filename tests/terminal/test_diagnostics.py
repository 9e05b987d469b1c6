"""What is wrong with a problem or its data is said in mbm's words: texts of the file in it are parts of one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

import mbm
from mbm.text.render import as_json, render
from mbm.text.types import LONGEST_MESSAGE, Code, DataPlace, Diagnostic, Label, MbmError, Source, Span
from tests.terminal.hostile import HOSTILE, NAME, csv_text, literal, objections

N = literal(NAME)
CODE = Code("some-code", "Something is wrong.", "Mend it.")

FIT = "(unknowns (a)) (observe d (= y (* a x)) :sigma 1)"

TWO = "(data d (table (x y) (1 2) (2 4.1)))"

PROBLEMS = [
    f"(problem p (data d (csv {N})) {FIT})",
    f"(problem p (data d ({NAME[0]}csv {N})) {FIT})",
    f"(use {N})",
    f"(problem p (data d (table (x y) (1 2) (1 2 {N}))) {FIT})",
    f"(problem p (data d (table (x y) (1 {N}) (2 3))) {FIT})",
    f"(problem p {TWO} (unknowns (a :unit {N})) (observe d (= y (* a x))))",
    f"(problem p {TWO} (unknowns (a :init {N})) (observe d (= y (* a x))))",
    f"(problem p (data d (table (k x y) ({N} 1 2) ({N} 1 3)) :key k) {FIT})",
    f"(problem p (data f (table (k) (1)) :key k) (data d (table (x y) ({N} 2))) (unknowns (a :per f))"
    " (observe d (= y (a x))))",
    f"(problem p (data f (table (k) ({N}) (b)) :key k) (data d (table (x y) (b 2))) (unknowns (a :per f))"
    f" (observe d (= y (* (a x) (a {literal(NAME + '!')})))))",
    f"(problem p (data d (table (x y) ({N} 2))) {FIT})",
    f"(problem p {TWO} (unknowns (a)) (observe d (= y (* a {N}))))",
    f"(problem p {TWO} {FIT} (constraints (= a {N})))",
    f"(problem p {TWO} {FIT} (constraint {N}))",
    f"(problem p {TWO} {FIT} (derive (b (vector {N}))))",
    f"(problem p (data d (csv {literal('data.csv')}) :key {N}) {FIT})",
    f"(problem p (data d (csv {literal('data.csv')}) :columns (({N} {N} :unit mm))) {FIT})",
    f"(problem p (data d (csv {literal('data.csv')}) :with ({N} {N})) {FIT})",
    f"(problem p {N} {N} {TWO} {FIT} ({N}))",
    f"(problem p {TWO} (unknowns (a :doc {N} :init 1) (b :init 1)) (observe d (= y (* a x b))))",
    f"(problem p (data f (table (k) ({N}) (b)) :key k) (data d (table (x y) (b 2))) (unknowns (a :per f) (c))"
    " (observe d (= y (+ c (a x)))))",
    f"(problem p (data f (table (k) ({N})) :key k) (data d (table (x y) ({N} 2))) (unknowns (a :per f :in (0 1)))"
    " (observe d (= y (a x))))",
    f"(frobnicate {N})",
    f'"{NAME}',
    f"(a{NAME}",
    f"; {HOSTILE}",
    HOSTILE,
]

FILES = {
    "keys.csv": csv_text([["x", "y", "k"], ["1", "2", HOSTILE], ["1", "2", HOSTILE]]),
    "twice.csv": csv_text([[NAME, NAME, "y"], ["1", "2", "3"]]),
    "short.csv": csv_text([["x", "y", HOSTILE], ["1", "2"]]),
    "long.csv": csv_text([["x", HOSTILE], ["1", "2", HOSTILE]]),
    "text.csv": csv_text([["x", "y"], ["1", HOSTILE], ["1", "2"]]),
    "quotes.csv": f'x,y\n"1{HOSTILE}"2,3\n',
    "odd.json": f'{{"x": [1], "y": [2], "{NAME[:3].encode("unicode_escape").decode()}": {{}}}}',
    "bad.json": f'{{"x": [1], "{HOSTILE}',
    "track.tum": f"1 2 3 4 5 6 7 8\n1 2 3 {NAME} 5 6 7 8\n",
    "graph.g2o": f"VERTEX_SE2 0 0 0 0\n{NAME.replace(' ', '')} 1 2 3\n",
    "bundle.txt": f"1 1 {HOSTILE}",
    "no.npz": HOSTILE,
    "no.parquet": HOSTILE,
    "no.csv.gz": HOSTILE,
    f"odd.{NAME}".replace("/", ""): "x,y\n1,2\n",
}


@pytest.fixture
def wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """What is said of a problem, if a terminal may be shown it: in Python, and as people read it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data.csv").write_text("x,y\n1,2\n2,4\n", encoding="utf-8")

    def call(text: str) -> str:
        said = []
        try:
            result = mbm.loads(text).solve()
        except MbmError as error:
            assert objections(str(error)) == objections(repr(error)) == []
            found = error.diagnostics
        else:
            said.append(str(result))
            found = (*result.result.diagnostics, *result.first.diagnostics)
        for diagnostic in found:
            said += [render(diagnostic), repr(diagnostic), f"{diagnostic.message} {diagnostic.hint}"]
            assert objections(render(diagnostic, color=True), color=True) == []
        assert [objections(each) for each in said] == [[]] * len(said)
        return "\n".join(said)

    return call


@pytest.mark.parametrize("text", PROBLEMS, ids=range(len(PROBLEMS)))
def test_problems(text: str, wrong: Callable[[str], str]) -> None:
    said = wrong(text)
    assert "error[" in said or "warning[" in said or "not determined" in said


@pytest.mark.parametrize("name", FILES, ids=range(len(FILES)))
def test_data(name: str, wrong: Callable[[str], str]) -> None:
    Path(name).write_text(FILES[name], encoding="utf-8", newline="")
    ending = Path(name).suffixes[0][1:]
    part = {"txt": "cameras", "g2o": "vertices"}.get(ending)
    path = literal(name) if part is None else f"{literal(name)} :{part}"
    source = f"({'bal' if ending == 'txt' else ending} {path})" if ending.isascii() else path
    key = ':key "k"' if name == "keys.csv" else ""
    assert "error[" in wrong(f"(problem p (data d {source} {key} :columns ((y :unit mm))) {FIT})")


def test_arguments_of_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    problem = mbm.loads("(problem p (data d (table (x y) (1 2) (2 4))) (unknowns (a)) (observe d (= y (* a x))))")
    calls: list[Callable[[], object]] = [
        lambda: mbm.load(NAME),
        lambda: mbm.load("x\ud800.mbm"),
        lambda: problem.named(NAME).solve(),
        lambda: problem.solve(data={NAME: {"x": [1]}}),
        lambda: problem.solve(data={"d": {NAME: [1], "x": [[1]]}}),
        lambda: problem.solve(data={"d": {"x": [HOSTILE], "y": [1]}}),
        lambda: problem.solve(constants={NAME: 1}),
        lambda: problem.solve(constants={"a": NAME}),
        lambda: problem.solve(init={NAME: 1}),
        lambda: problem.solve(init={"a": NAME}),
        lambda: problem.solve(method=NAME),
        lambda: problem.solve(backend=NAME),
        lambda: problem.simulate(noise={NAME: 1}),
        lambda: problem.simulate(measured={NAME: ["x"]}),
        lambda: problem.compile().estimator(NAME),
    ]
    for call in calls:
        with pytest.raises(MbmError) as caught:
            call()
        assert objections(str(caught.value)) == []
        assert all(objections(render(diagnostic)) == [] for diagnostic in caught.value.diagnostics)


@given(st.text(), st.text(), st.text(), st.booleans())
def test_any_text_at_any_place(text: str, name: str, line: str, color: bool) -> None:
    """Also where a constructor forgets to look: whatever a diagnostic is made of, it is one line."""
    source = Source(f"a{name}", line)
    span = Span(source=source, start=len(line) // 2, end=len(line))
    labels = (Label(span, text), Label(DataPlace(file=name, row=1, column=text), text))
    made = Diagnostic(code=CODE, message=text, place=span, hint=text, labels=labels)
    assert objections(render(made, color=color), color=color) == []
    assert objections(str(MbmError(made))) == []
    assert as_json(made)["file"] == f"a{name}"
    in_data = Diagnostic(code=CODE, message=text, place=DataPlace(file=name, column=line))
    assert render(in_data, color=color).count("\n") == 2  # the place, and how to mend it


def test_messages_are_not_endless() -> None:
    text = "x" * 10**6
    made = Diagnostic(code=CODE, message=text, hint=text, labels=(Label(DataPlace(file="d"), text),))
    assert len(render(made)) < 4 * LONGEST_MESSAGE


def test_a_line_of_marks_that_take_no_room_is_cut() -> None:
    source = Source("a.mbm", "(a " + "\N{COMBINING ACUTE ACCENT}" * 10**5 + " b)")
    span = Span(source=source, start=len(source.text) - 2, end=len(source.text) - 1)
    assert len(render(Diagnostic(code=CODE, message="here", place=span))) < 2000
