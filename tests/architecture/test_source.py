"""Habits of the house that no linter holds: sizes, docstrings, no leftovers, nothing of anybody's machine."""

from __future__ import annotations

import re
from collections.abc import Iterator

from tests.architecture.reading import FILES, ROOT, facts

LONGEST_FILE = 400
LONGEST_FUNCTION = 70
LONGEST_PACKAGE_FILE = 50
LEFTOVERS = re.compile(r"\b(?:TO[D]O|FIX[M]E|XX[X])\b")
DOCSTRING = re.compile(r'(?:#.*\n|\s)*r?"""')
MACHINE_PATHS = re.compile(r"(?<![\w.)])/(?:home|root|work|Users|opt|tmp)/\w")
"""Absolute paths of somebody's computer; examples in documents use relative ones."""


def _python(*folders: str) -> Iterator[tuple[str, str]]:
    """Names and texts of the Python files below folders of the checkout."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def _written() -> Iterator[tuple[str, str]]:
    """Names and texts of everything that people write and others read."""
    endings = {".py", ".md", ".mbm", ".lark", ".json", ".csv", ".toml"}
    folders = ("mbm", "tests", "benchmarks", "problems", "docs", "grammar")
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in endings]
    paths += [path for path in ROOT.iterdir() if path.suffix in {".md", ".toml"}]
    for path in (*paths, ROOT / "Makefile", ROOT / ".ci" / "run"):
        if path.is_file():
            yield path.relative_to(ROOT).as_posix(), path.read_bytes().decode("utf-8", errors="replace")


def test_there_is_something_to_look_at() -> None:
    assert len(list(_python("mbm"))) > 100
    assert len(list(_written())) > 200


def test_files_are_short() -> None:
    lines = {name: len(text.splitlines()) for name, text in _python("mbm", "tests", "benchmarks", "problems", "docs")}
    assert not {name: count for name, count in lines.items() if count > LONGEST_FILE}


def test_functions_are_short() -> None:
    assert any(facts(path).functions for path in FILES)
    assert not [
        (path, name, size) for path in FILES for name, size in facts(path).functions if size >= LONGEST_FUNCTION
    ]


def test_every_module_says_what_it_is() -> None:
    silent = [
        name
        for name, text in _python("mbm", "tests", "benchmarks", "problems", "docs")
        if text.strip() and not DOCSTRING.match(text)
    ]
    assert not silent


def test_packages_say_what_they_make_and_little_else() -> None:
    lines = {name: len(text.splitlines()) for name, text in _python("mbm") if name.endswith("__init__.py")}
    assert not {name: count for name, count in lines.items() if not 0 < count <= LONGEST_PACKAGE_FILE}


def test_nothing_is_validated_by_assert() -> None:
    """``python -O`` drops assertions; those that tell the type checker what holds anyway are marked."""
    bare = [
        f"{path}:{line}"
        for path in FILES
        for line in facts(path).assertions
        if "noqa: S101 - " not in path.read_text("utf-8").splitlines()[line - 1]
    ]
    assert not bare


def test_nothing_is_left_over() -> None:
    assert not {name: LEFTOVERS.findall(text) for name, text in _written() if LEFTOVERS.search(text)}


def test_nothing_is_of_somebodys_machine() -> None:
    assert not {name: MACHINE_PATHS.findall(text) for name, text in _written() if MACHINE_PATHS.search(text)}


def test_units_are_left_through_their_scale() -> None:
    """A number in degC is no factor times SI: whoever takes a unit's factor forgets its zero, and `Scale` does not."""
    taken = re.compile(r"\bunit\.factor\b|parse_unit\([^)]*\)\.factor\b")
    found = [name for name, text in _python("mbm") if name != "mbm/expression/units.py" and taken.search(text)]
    assert not found, found
