"""A program opened with the whole vocabulary, and numbers out of what it describes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Column, Component, Constant, LiteralMember
from mbm.language.limits import Limits, recursion_room
from mbm.language.scope import LocalScope
from mbm.language.session import open_session, read_program
from mbm.language.values import Array, FamilyValue, Value
from mbm.shapes.model import ModelLog, model_maker
from mbm.shapes.types import Line, Plane
from mbm.shapes.vocabulary import vocabulary
from mbm.text.reader import read
from mbm.text.types import Diagnostic, Form, MbmError, Source


class Opened:
    """The definitions of ``text``; ``variables`` are those of the place where forms are evaluated."""

    def __init__(self, text: str, variables: Mapping[str, Value]) -> None:
        words = vocabulary()
        limits = Limits()
        program = read_program(
            Source("models.mbm", text),
            Path("models.mbm"),
            sandbox=None,
            limits=limits,
            reserved=frozenset(words.special_forms),
        )
        self.log = ModelLog()
        self.session = open_session(program, words, model_maker(self.log), limits)
        self.scope = LocalScope(dict(variables), self.session.scope)
        self.session.evaluator.world = self.scope

    def form(self, text: str) -> Form:
        return read(Source("place", text))[0]

    def value(self, text: str) -> Value:
        with recursion_room(self.session.evaluator.budget.limits):
            return self.session.evaluator.evaluate(self.form(text), self.scope)

    def wanted(self, text: str) -> Value:
        return self.session.evaluator.wanted(self.form(text), self.scope)

    def numbers(self, value: Value | str, at: Mapping[object, float] | None = None) -> np.ndarray:
        """Coordinates: shape (3,) of a point, (n, 3) of a line or plane. ``at`` holds the unknowns."""
        if isinstance(value, str):
            value = self.wanted(value)
        if isinstance(value, Line):
            return np.array([self.numbers(p, at) for p in (value.start, value.end)])
        if isinstance(value, Plane):
            return np.array([self.numbers(p, at) for p in value.points])
        assert isinstance(value, Array), value
        known = dict(at or {})

        def lookup(leaf: object) -> float:
            if isinstance(leaf, Constant):
                return leaf.value
            assert isinstance(leaf, Component)
            key = leaf.member.key if isinstance(leaf.member, LiteralMember) else None
            return known[(leaf.unknown, key) if key is not None else leaf.unknown]

        return np.array(evaluate(value.elements, lookup), dtype=float)

    def fault(self, text: str) -> Diagnostic:
        """The one diagnostic that evaluating ``text`` ends with."""
        with pytest.raises(MbmError) as caught:
            self.value(text)
        (diagnostic,) = caught.value.diagnostics
        return diagnostic


@pytest.fixture
def opened():
    def open_text(text: str = "", **variables: Value) -> Opened:
        return Opened(text, variables)

    return open_text


@pytest.fixture
def unknowns():
    """Scalar unknowns by name."""
    return lambda *names: {name: Component(name) for name in names}


@pytest.fixture
def family():
    """A family of angles, one for each key."""

    def make(name: str, keys: tuple[str, ...]) -> FamilyValue:
        def member(key: object) -> Component:
            assert not isinstance(key, Column)
            return Component(name, member=LiteralMember(key=key), angle=True)

        return FamilyValue(name, frozenset(keys), member)

    return make


DESK = """
(desk (x y r h &optional (dx 0.03) (dy 0.03))
  (declare (x2 (- (/ x 2) dx)) (y2 (- (/ y 2) dy))
           (array leg (leg1 leg2 leg3 leg4))
           (array legpos ((x2 y2 0) ((- x2) y2 0) ((- x2) (- y2) 0) (x2 (- y2) 0))))
  (board (trans (0 0 h) (rectangular x y)))
  (for (i 1 4)
    ((leg i) (trans (legpos i) (cylinder r h)))))
"""
"""Fig. 5 of Oyama & Tachi 1989, verbatim."""

DESK_AS_MEANT = DESK.replace("(/ x 2)", "x").replace("(/ y 2)", "y")
"""The legs dx, dy in from the edges of a board whose half sides are x, y."""


@pytest.fixture
def desk_text():
    return {"literal": DESK, "fixed": DESK_AS_MEANT}
