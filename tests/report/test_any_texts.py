"""Results in which every text is any text: the table has the lines that mbm writes, and no others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from itertools import count
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from mbm.report.table import table
from mbm.report.types import Result
from tests.terminal.hostile import HOSTILE, objections

fixtures = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)


def with_texts(value: Any, text: Callable[[], str]) -> Any:
    """The same value with ``text()`` in the place of each text in it, names of keys and clauses too."""
    if isinstance(value, str) and not isinstance(value, Enum):
        return text()
    if isinstance(value, Mapping):
        return {with_texts(name, text): with_texts(entry, text) for name, entry in value.items()}
    if isinstance(value, tuple):
        return tuple(with_texts(entry, text) for entry in value)
    if is_dataclass(value) and not isinstance(value, type):
        parts = {part.name: getattr(value, part.name) for part in fields(value) if part.init}
        return replace(value, **{name: with_texts(part, text) for name, part in parts.items()})
    return value


@pytest.fixture(params=["tag_result", "epochs"])
def result(request: pytest.FixtureRequest) -> Any:
    """One solve, and several."""
    return request.getfixturevalue(request.param)


def tables(result: Result, *, color: bool, width: int = 80) -> str:
    return "".join(table(result, width=width, color=color, full=full) for full in (False, True))


@pytest.mark.parametrize("color", [False, True])
@fixtures
@given(texts=st.lists(st.text(st.characters()), min_size=1))
def test_any_texts(result: Result, color: bool, texts: list[str]) -> None:
    number = count()

    def text() -> str:
        """One of the texts, told apart from the others, as names are."""
        place = next(number)
        return f"{texts[place % len(texts)]}{place}"

    assert objections(tables(with_texts(result, text), color=color), color=color) == []


@pytest.mark.parametrize("color", [False, True])
def test_no_text_makes_a_line_of_its_own(result: Result, color: bool) -> None:
    """As many lines as with a word in its place, where sentences have all the room that they want."""
    number = count()
    lines = [
        tables(with_texts(result, lambda word=word: f"{word}{next(number)}"), color=color, width=10**5).count("\n")
        for word in (HOSTILE, "word")
    ]
    assert lines[0] == lines[1] > 10
    shown = tables(with_texts(result, lambda: f"{HOSTILE}{next(number)}"), color=color)
    assert objections(shown, color=color) == []
