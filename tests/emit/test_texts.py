"""The functions that put foreign text into C, Python, JSON, Markdown and CSV, for texts of any characters."""

from __future__ import annotations

import ast
import csv
import html
import io
import json
import re
import shutil
import tokenize

import pytest
from hypothesis import example, given, settings, strategies as st

from mbm.emit.c import text as c
from mbm.emit.casadi.files import document
from mbm.emit.data_files import field
from mbm.emit.foreign import Foreign, told
from mbm.emit.identifiers import Identifiers, identifier
from mbm.emit.markdown import code, fenced, prose
from mbm.emit.python import text as python
from tests.emit.hostile import KEYS, NAME, TEXT
from tests.emit.making import run
from tests.emit.scanning import complaints, pieces

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

PARTS = (
    "*/", "/*", "//", "**//", "/*/", '"""', "'''", '"', "'", "\\", "\\\\", "\n", "\r", "\t", "\0", "%", "%n", "{", "}",
    "$(", ")", "`", "```", "~~~", "??/", "??", "?", "#", "<!--", "-->", "<b>", "&amp;", "](x)", "|", "=", "+", "-", "@",
    "\x1b[2J", "\x7f", "\x85", "\x9b", "\u200e", "\u202e", "\u2028", "\u2029", "\u2066", "\ufeff", "é", "ω", "中", "a",
    " ", "  ", "1.", "coding: utf-7",
)  # fmt: skip
TEXTS = st.one_of(
    st.lists(st.sampled_from(PARTS), max_size=12).map("".join),
    st.text(st.characters(exclude_categories=("Cs",)), max_size=40),
)
"""What means something somewhere, in any order; and any characters but halves of surrogate pairs, which are refused."""

hostile = settings(max_examples=300)


@hostile
@given(text=TEXTS)
@example(text=TEXT)
@example(text="x" * 10000)
def test_a_remark_of_c_is_one_comment_on_one_line(text):
    made = c.remark("before ", Foreign(text), " after")
    assert "\n" not in made
    found = pieces(f"{made}int x;\n")
    assert [kind for kind, _ in found] == ["comment", "code", "code", "code"]
    assert not complaints(f"{made}int x;\n")


@hostile
@given(texts=st.lists(TEXTS, min_size=1, max_size=4))
@example(texts=["ends with \\", "/ goes on"])
@example(texts=["word " * 60 + "\\ " + "word " * 60])
def test_a_comment_of_c_is_one_comment(texts):
    made = c.comment(["own words", *map(Foreign, texts)]) + "\nint x;\n"
    assert [kind for kind, _ in pieces(made)] == ["comment", "code", "code", "code"]
    assert not complaints(made)


@hostile
@given(text=TEXTS)
@example(text=TEXT)
@example(text="é" * 2047)
def test_a_string_of_c_is_the_text(text):
    made = c.literal(Foreign(text))
    assert made.isascii()
    assert not complaints(f"f({made});\n")
    ((kind, value),) = pieces(made)
    assert (kind, value) == ("string", text.encode())


def test_a_long_string_of_c_is_an_array():
    made = c.literal("é" * 2048)
    assert not complaints(made)
    numbers = [int(each, 8) for each in re.findall(r"'\\([0-7]{3})'", made)]
    assert bytes(numbers) == ("é" * 2048).encode()


@needs_compiler
def test_the_compiler_reads_what_the_scanner_reads(tmp_path):
    texts = [TEXT, NAME, *KEYS, *PARTS, *(a + b for a in PARTS for b in PARTS), "é" * 3000, "x" * 4095]
    texts = [text for text in texts if "\0" not in text]
    lines = ["#include <stdio.h>", "#include <string.h>", "int main(void)", "{", "    int wrong = 0;"]
    for text in texts:
        own = ", ".join(str(byte) for byte in (*text.encode(), 0))
        lines += ["    {", f"        static const unsigned char own[] = {{{own}}};    {c.remark(Foreign(text))}"]
        lines += [c.comment(["own words", Foreign(text), Foreign(text)])]
        lines += [f"        wrong += strcmp((const char *)own, {c.literal(Foreign(text))}) != 0;", "    }"]
    lines += ['    printf("%d\\n", wrong);', "    return 0;", "}", ""]
    (tmp_path / "main.c").write_text("\n".join(lines), encoding="utf-8")
    flags = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
    made = run("cc", *flags, "-o", "main", "main.c", folder=tmp_path)
    assert made.returncode == 0, made.stderr[:2000]
    assert run("./main", folder=tmp_path).stdout == "0\n"


@hostile
@given(text=TEXTS)
@example(text=TEXT)
@example(text="\ud800")
def test_python_reads_strings_back_and_passes_comments_over(text):
    made = python.literal("", Foreign(text))
    assert ast.literal_eval(made) == text
    assert "\n" not in made
    source = f"x = 1  {python.remark(Foreign(text))}\n"
    assert ast.dump(ast.parse(source)) == ast.dump(ast.parse("x = 1\n"))
    kinds = [t.type for t in tokenize.generate_tokens(io.StringIO(source, newline="").readline)]
    assert kinds.count(tokenize.COMMENT) == 1
    assert compile(source.encode("utf-8", "replace"), "x.py", "exec")


@hostile
@given(texts=st.lists(TEXTS, min_size=1, max_size=4))
@example(texts=["ends with \\"])
@example(texts=['ends with "'])
@example(texts=["a", "# coding: utf-7"])
def test_documentation_of_python_is_one_string(texts):
    made = python.docstring(map(Foreign, texts))
    tree = ast.parse("\n".join(["def f():", *made, "    return 1"]))
    (function,) = tree.body
    assert [type(each) for each in function.body] == [ast.Expr, ast.Return]
    said = "".join(ast.get_docstring(function, clean=False).split())
    assert said.isprintable()
    wanted = "".join(each for text in texts for each in text if each.isprintable() and not each.isspace())
    assert "".join(each for each in said if each != "\N{REPLACEMENT CHARACTER}") == wanted.replace("\ufffd", "")


@hostile
@given(text=TEXTS)
@example(text=TEXT)
@example(text="\ud800")
def test_json_holds_the_text_and_nothing_that_is_not_printable(text):
    made = document({Foreign(text): [Foreign(text), 1.5]})
    assert made.endswith("\n")
    assert made[:-1].isprintable()
    assert json.loads(made) == {text: [text, 1.5]}


@hostile
@given(text=TEXTS)
@example(text=TEXT)
def test_prose_of_a_readme_is_a_paragraph_without_markup(text):
    made = prose(Foreign(text))
    assert made == "" or made.isprintable()
    assert not re.search(r"(?<!\\)(?:\\\\)*[`*_\[\]|~$#]", made)
    assert not re.search("[<>]|&(?!(?:amp|lt|gt);)", made)
    assert not re.match(r"\d*[-+=:.)]", made)
    read = html.unescape(re.sub(r"\\([!-/:-@\[-`{-~])", r"\1", made))
    plain = "".join(c if c.isprintable() else " " if c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)
    assert re.sub(r"\s|\ufffd", "", read) == re.sub(r"\s|\ufffd", "", plain)


@hostile
@given(text=TEXTS)
@example(text="`")
@example(text="")
def test_code_of_a_readme_ends_where_it_should(text):
    made = code(Foreign(text))
    ticks = re.match("`+", made)[0] if text.strip("`") else made[: made.index(" ")]
    inner = made[len(ticks) : -len(ticks)]
    assert made.startswith(ticks)
    assert made.endswith(ticks)
    assert made.isprintable()
    assert ticks not in re.findall("`+", inner)


@hostile
@given(texts=st.lists(TEXTS, max_size=5))
def test_a_fence_of_a_readme_is_closed_by_its_own_end_only(texts):
    first, *lines, last = fenced(map(Foreign, texts), "sh")
    assert len(lines) == len(texts)
    assert first == f"{last}sh"
    assert re.fullmatch("`{3,}", last)
    assert not any(line.strip().startswith(last) or last in line for line in lines)
    assert all(line.isprintable() for line in lines)


@hostile
@given(texts=st.lists(TEXTS.filter(lambda text: "\0" not in text), min_size=1, max_size=4))
def test_cells_of_data_are_read_again(texts):
    line = ",".join(field(Foreign(text)) for text in texts) + "\n"
    assert list(csv.reader(io.StringIO(line, newline=""))) == [texts]
    assert not line.startswith("\ufeff")


@hostile
@given(text=st.one_of(TEXTS, st.text(max_size=300)))
@example(text="ཀ་-")
@example(text="\N{TIBETAN LETTER -A}x")
def test_a_name_is_one_that_every_language_and_file_system_takes(text):
    assert re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,100}", identifier(Foreign(text)))
    assert "__" not in identifier(text)


@hostile
@given(texts=st.lists(TEXTS, max_size=20))
def test_no_name_is_given_twice(texts):
    names = Identifiers()
    made = [names.made(Foreign(text), "file.{lower}") for text in texts]
    assert len({each.lower() for each in made}) == len(texts)


@pytest.mark.parametrize("made", [c.remark, lambda text: c.comment([text]), python.remark, prose, code])
def test_readers_get_the_beginning_of_a_long_text(made):
    short, long = made(Foreign("long " * 900)), made(Foreign("long " * 10**6))
    assert "long" in short
    assert "…" not in short
    assert "…" in long
    assert len(long) < 1.3 * len(short)


def test_foreign_text_does_not_get_into_a_text_by_itself():
    foreign = told("a", Foreign("*/"))
    assert foreign == Foreign("a*/")
    for careless in (str, "{}".format, lambda text: f"{text}", lambda text: "".join([text]), lambda text: "" + text):
        with pytest.raises(TypeError):
            careless(foreign)
    assert "*/" not in f"{foreign!r}"
