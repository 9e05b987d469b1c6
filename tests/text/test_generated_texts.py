"""Properties that hold of every text: generated forms with comments, and noise."""

import re

from hypothesis import given, settings, strategies as st

from mbm.files.reading import read_file
from mbm.text.comments import find_comments
from mbm.text.formatter import format_text
from mbm.text.printer import print_form
from mbm.text.reader import read
from mbm.text.render import as_json, render
from mbm.text.types import MbmError, Numeral, Sequence, Source, Symbol

HEADS = re.findall(
    r"\S+",
    "problem data unknowns observe constraints derive solve states defun defmodel let let* lambda cond if for trans "
    "rotate table leg f + = list declare",
)
NAMES = [
    *HEADS,
    "x",
    "-x",
    "...",
    "a-name-of-some-length",
    "a-much-longer-name-of-fifty-columns-that-fills-lines",
    "&key",
    "@x",
    "θ",
]
SPACES = [" ", " ", " ", " ", "\n", "\n  ", "\n\n\n", " ; c\n", "\n; own\n", " ;c\n\n", " #| b |# ", "\n#| b\n  c |#\n"]

numbers = st.one_of(
    st.integers(-(10**20), 10**20).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.tuples(st.integers(-99, 99), st.integers(1, 99)).map(lambda pair: f"{pair[0]}/{pair[1]}"),
)
units = st.sampled_from(["", "m", "m/s^2", "%", "deg"])
strings = st.text(st.sampled_from('ab (;#|"\\\n\t'), max_size=6).map(
    lambda value: '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
)
atoms = st.one_of(
    st.sampled_from(NAMES),
    st.tuples(numbers, units).map("".join),
    st.sampled_from([":sigma", ":in", ":init"]),
    strings,
)
spaces = st.sampled_from(SPACES)


def _listed(draw_from):
    return st.tuples(
        st.sampled_from([("(", ")"), ("(", ")"), ("(", ")"), ("[", "]")]),
        st.one_of(st.just(""), spaces),
        st.lists(st.tuples(draw_from, spaces).map("".join), max_size=8),
    ).map(lambda parts: parts[0][0] + parts[1] + "".join(parts[2]) + parts[0][1])


def _quoted(draw_from):
    return st.tuples(st.sampled_from(["'", "`", "`, ", "`' ; c\n,"]), draw_from).map("".join)


texts_of_forms = st.recursive(
    atoms, lambda inner: st.one_of(_listed(inner), _listed(inner), _quoted(inner)), max_leaves=40
)
texts = st.lists(st.tuples(texts_of_forms, spaces).map("".join), max_size=6).map("".join)
noise = st.text(
    st.one_of(st.sampled_from("()[]'`,@\"\\;#|:+-./0123456789eEmx%^ \n\t\r\0"), st.characters()), max_size=60
)


def kinds(form):
    """The form with the types of its numbers, for 10 equals 10.0; the kind of brackets is left out."""
    if isinstance(form, Sequence):
        return tuple(kinds(item) for item in form.items)
    if isinstance(form, Numeral):
        return (type(form.value).__name__, form.value, form.unit)
    return form


def all_numbers(forms):
    return [item for form in forms for item in (all_numbers(form.items) if isinstance(form, Sequence) else [form])]


@given(texts)
def test_printed_forms_read_back(text):
    for form in read(Source("t", text)):
        (again,) = read(Source("t", print_form(form)))
        assert again == form
        assert kinds(again) == kinds(form)


@given(texts)
def test_spans_read_back_to_their_forms(text):
    for form in read(Source("t", text)):
        assert read(Source("t", form.span.text)) == (form,)


@given(texts)
def test_formatting_keeps_meaning_and_comments_and_changes_nothing_the_second_time(text):
    source = Source("t", text)
    once = Source("t", format_text(source))
    assert [kinds(form) for form in read(once)] == [kinds(form) for form in read(source)]
    assert [comment.span.text for comment in find_comments(once)] == [
        comment.span.text for comment in find_comments(source)
    ]
    assert format_text(once) == once.text
    outside = re.sub(r'"(?:\\.|[^"\\])*"|#\|.*?\|#', "#", once.text, flags=re.DOTALL)
    assert not re.search(r"[ \t]\n|\n\n\n", outside)


@settings(max_examples=300)
@given(noise)
def test_noise_is_read_or_refused_with_places_inside_the_text(text):
    try:
        read(Source("t", text))
    except MbmError as error:
        assert error.diagnostics
        for diagnostic in error.diagnostics:
            assert 0 <= diagnostic.place.start <= diagnostic.place.end <= len(text)
            assert diagnostic.code.name in render(diagnostic)
            assert as_json(diagnostic)["line"] >= 1


@given(texts, st.data())
def test_a_text_with_one_character_removed_is_read_or_refused(text, data):
    place = data.draw(st.integers(0, len(text)))
    damaged = text[:place] + text[place + 1 :]
    try:
        forms = read(Source("t", damaged))
    except MbmError as error:
        assert error.diagnostics
    else:
        assert all(form.span.text for form in forms)


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "noise.mbm"
    path.write_bytes(content)
    try:
        forms = read(read_file(path, "noise.mbm"))
    except MbmError as error:
        assert error.diagnostics
    else:
        assert all(isinstance(atom.name, str) for atom in all_numbers(forms) if isinstance(atom, Symbol))
