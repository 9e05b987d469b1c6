"""Every text of a blueprint replaced by one of any characters: the code in the files that are made stays the same.

So no place in a generator can let a text out, whatever it is called; and the generators see no text that is not
`Foreign`.
"""

from __future__ import annotations

import ast
import csv
import functools
import io
import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, example, given, settings, strategies as st

import mbm
from mbm.emit import targets
from mbm.emit.foreign import Foreign
from mbm.emit.identifiers import identifier
from mbm.emit.types import Blueprint, Target
from mbm.kernels.serialised import BoundRows
from mbm.kernels.types import Kernel
from mbm.machine.program import Program
from tests.emit.hostile import TEXT, written_problem
from tests.emit.making import emitted, run
from tests.emit.scanning import complaints, pieces
from tests.emit.shapes import SHAPES
from tests.emit.test_texts import TEXTS

NAMES = ("derived", "distinct", "keys", "startless", "rim")
"""Shapes that between them have all kinds of texts: families, keys, statics, filters, solves, consensus."""

OURS = Path(targets.__file__).parent
ESCAPING = {
    "c/text.py", "casadi/files.py", "data_files.py", "foreign.py", "identifiers.py", "markdown.py", "python/text.py",
}  # fmt: skip
"""The only files that look into a `Foreign`."""


@functools.cache
def blueprint(name: str) -> Blueprint:
    """What the generators are given for a shape."""
    return drafted(mbm.loads(SHAPES[name]))


def drafted(problem) -> Blueprint:
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(targets, "files_of", lambda made, target: found.append(made) or ())
        emitted(problem, "c")
    return found[0]


def mapped(value, text: Callable[[str], str]):
    """The value with other texts; what is no text of the problem stays."""
    if isinstance(value, Foreign):
        return Foreign(text(value.unescaped))
    if isinstance(value, tuple):
        return tuple(mapped(each, text) for each in value)
    if isinstance(value, Mapping):
        return {mapped(key, text): mapped(held, text) for key, held in value.items()}
    if is_dataclass(value) and not isinstance(value, Kernel | Program | BoundRows):
        return replace(value, **{f.name: mapped(getattr(value, f.name), text) for f in fields(value) if f.init})
    return value


def texts_of(value) -> Iterator[str]:
    """All texts that are foreign."""
    found: list[str] = []
    mapped(value, lambda text: found.append(text) or text)
    return iter(dict.fromkeys(found))


def plain_texts(value, path: str = "") -> Iterator[tuple[str, str]]:
    """All texts that are not, with where they stand."""
    if isinstance(value, str):
        yield path, value
    elif isinstance(value, tuple | frozenset):
        for each in value:
            yield from plain_texts(each, path)
    elif isinstance(value, Mapping):
        for key, held in value.items():
            yield from plain_texts(key, path)
            yield from plain_texts(held, path)
    elif is_dataclass(value) and not isinstance(value, Foreign | Kernel | Program | BoundRows):
        for each in fields(value):
            yield from plain_texts(getattr(value, each.name), f"{path}.{each.name}")


@functools.cache
def plain_files(name: str, target: Target) -> dict[str, str]:
    return files(blueprint(name), target)


def files(made: Blueprint, target: Target) -> dict[str, str]:
    return {file.path: file.content.decode() for file in targets.files_of(made, target)}


def code_of(text: str) -> list[tuple[str, str | bytes]]:
    """Strings and tokens."""
    return [(kind, piece) for kind, piece in pieces(text) if kind != "comment"]


def same_c(text: str, plain: str, text_of: Callable[[str], str]) -> None:
    """The same tokens in the same order; strings are those of mbm, or those of the problem as they now are."""
    assert not complaints(text)
    for (kind, piece), (wanted, expected) in zip(code_of(text), code_of(plain), strict=True):
        assert kind == wanted
        if kind == "string":
            assert piece in (expected, text_of(expected.decode()).encode())
        else:
            assert piece == expected


def tree_of(source: str) -> str:
    """The tree of a module without what strings hold."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = ""
    return ast.dump(tree)


def same_python(text: str, plain: str) -> None:
    """The same tree but for what strings hold; what stands between empty lines is a whole for itself.

    A text of blanks may leave one more empty line in a docstring: then the whole is looked at.
    """
    parts, expected = text.split("\n\n\n"), plain.split("\n\n\n")
    if len(parts) != len(expected):
        parts, expected = [text], [plain]
    for part, own in zip(parts, expected, strict=True):
        assert part == own or tree_of(part) == tree_of(own)


def same_json(found, wanted) -> None:
    """The same objects and lists but for what texts are."""
    assert type(found) is type(wanted)
    if isinstance(found, dict | list):
        assert len(found) == len(wanted)
        if isinstance(found, dict):
            found, wanted = found.values(), wanted.values()
        for a, b in zip(found, wanted, strict=True):
            same_json(a, b)
    elif not isinstance(found, str):
        assert found == wanted


def same_readme(text: str, plain: str) -> None:
    """The same lines of code, headings and lists."""
    assert list(kinds_of_lines(text)) == list(kinds_of_lines(plain))
    assert all(line.isprintable() for line in text.split("\n"))


def kinds_of_lines(readme: str) -> Iterator[str]:
    """What a reader of Markdown takes each line for: a fence is closed by as many backticks as opened it."""
    fence = ""
    for line in readme.split("\n"):
        if fence:
            closed = line.strip() == fence
            yield "end" if closed else "code"
            fence = "" if closed else fence
        elif line.startswith("```"):
            fence = re.match("`+", line)[0]
            yield f"begin {line[len(fence) :]}"
        else:
            yield re.match(r"(#+ |\* | {4}|)", line)[0]


def same_csv(text: str, plain: str, text_of: Callable[[str], str]) -> None:
    found, wanted = (list(csv.reader(io.StringIO(each, newline=""))) for each in (text, plain))
    assert found == [
        [cell if cell == own else text_of(cell) for cell, own in zip(a, b, strict=True)]
        for a, b in zip(wanted, found, strict=True)
    ]


def check(name: str, target: Target, text_of: Callable[[str], str]) -> dict[str, str]:
    """The files with other texts, against those with the texts of the shape."""
    made, plain = files(mapped(blueprint(name), text_of), target), plain_files(name, target)
    assert list(made) == list(plain)
    for path, text in made.items():
        if text == plain[path]:
            continue
        if path.endswith((".c", ".h")):
            same_c(text, plain[path], text_of)
        elif path.endswith(".py"):
            same_python(text, plain[path])
        elif path.endswith(".json"):
            same_json(json.loads(text), json.loads(plain[path]))
        elif path.endswith(".md"):
            same_readme(text, plain[path])
        elif path.endswith(".csv"):
            same_csv(text, plain[path], text_of)
        else:
            pytest.fail(f"{path} differs")
    return made


def different(made: Blueprint, chosen: list[str]) -> Callable[[str], str]:
    """Each text of a blueprint → a hostile one, each another; what is empty stays so.

    Names of inputs become names of variables, and their length decides what is written into one expression: these keep
    their letters, and get signs behind them.
    """
    cases = (*(c for _, c in made.cases), *(c for d in made.derived for c in d.cases))
    inputs = {name for case in cases for name in texts_of(case.input_names)}
    inputs |= {name for table in made.tables for name in texts_of(tuple(c.name for c in table.columns))}
    inputs |= set(texts_of(tuple(constant.name for constant in made.constants)))
    given = {}
    for i, text in enumerate(filter(None, texts_of(made))):
        other = chosen[i % len(chosen)] or "?"
        if text in inputs:
            other = text + "".join(sign for sign in other if identifier(f"a{sign}") == "a")
        given[text] = other if other not in given.values() else f"{other}{'!' * i}"
    return lambda text: given.get(text, text)


@settings(max_examples=4, phases=(Phase.explicit, Phase.generate), suppress_health_check=[HealthCheck.too_slow])
@pytest.mark.parametrize("target", list(Target))
@pytest.mark.parametrize("name", NAMES)
@given(chosen=st.lists(TEXTS.filter(lambda text: "\0" not in text), min_size=1, max_size=6))
@example(chosen=[TEXT])
def test_texts_change_no_code(name, target, chosen):
    check(name, target, different(blueprint(name), chosen))


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")
@pytest.mark.parametrize("name", NAMES[:3])
def test_the_compiler_warns_of_no_text(name, tmp_path):
    texts = [TEXT, "*/", "/*", "??/", "\\", "**//", '"', "%n", "//", "\u202e"]
    made = check(name, Target.C, different(blueprint(name), texts))
    for path, text in made.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8", newline="")
    flags = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only")
    sources = [path for path in made if path.endswith(".c")]
    checked = run("cc", *flags, *sources, folder=tmp_path)
    assert checked.returncode == 0, checked.stderr[:3000]


def test_what_generators_are_given_has_every_text_of_the_problem_as_a_foreign_one(tmp_path):
    """But for identifiers, which are made of letters and digits."""
    made = drafted(mbm.load(written_problem(tmp_path)))
    assert sum("*//*//**" in text for text in texts_of(made)) > 20
    for path, text in plain_texts(made):
        assert re.fullmatch(r"[\w.-]*", text), path


def test_nobody_else_looks_into_a_foreign_text():
    for path in sorted(OURS.rglob("*.py")):
        name = path.relative_to(OURS).as_posix()
        source = path.read_text(encoding="utf-8")
        assert name in ESCAPING or ".unescaped" not in source, name
        # the unknowns and tables of a kernel have their names as the problem has them: `SlotPlace` has them as foreign
        if "/" in name:
            assert not re.search(r"kernel\.(name|variables|tangents|parameters|charts|span)\b", source), name
