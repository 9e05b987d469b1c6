"""Forms evaluated outside of any problem: with numbers that fold, and with unknowns that do not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Component
from mbm.language.limits import Limits, recursion_room
from mbm.language.scope import LocalScope
from mbm.language.session import open_session, read_program
from mbm.language.values import SCALARS, Array, ListValue, PoseValue, RotationValue, Value
from mbm.shapes.model import make_model
from mbm.shapes.vocabulary import vocabulary
from mbm.text.reader import read
from mbm.text.types import MbmError, Source


class Lisp:
    """``lisp("(+ a 1)", a=2.0)`` is 3.0; unknowns stand for the named numbers, so that nothing folds."""

    def value(
        self, text: str, definitions: str = "", numbers: Mapping[str, Any] | None = None, path: Path | None = None
    ) -> Value:
        words, limits = vocabulary(), Limits()
        program = read_program(
            Source("definitions.mbm", definitions),
            path or Path("definitions.mbm"),
            sandbox=None,
            limits=limits,
            reserved=frozenset(words.special_forms),
        )
        session = open_session(program, words, make_model, limits)
        scope = LocalScope({k: unknown(k, v) for k, v in (numbers or {}).items()}, session.scope)
        value: Value = ListValue(())
        with recursion_room(limits):
            for form in read(Source("form", text)):
                value = session.evaluator.wanted(form, scope)
        return value

    def __call__(self, text: str, definitions: str = "", **numbers: Any) -> Any:
        return plain(self.value(text, definitions, numbers), numbers)

    def fault(self, text: str, definitions: str = "", **numbers: Any) -> tuple[str, str]:
        """The code of the error that a form answers with, and the text that it points at."""
        with pytest.raises(MbmError) as caught:
            self.value(text, definitions, numbers)
        diagnostic = caught.value.diagnostics[0]
        return diagnostic.code.name, diagnostic.place.text  # type: ignore[union-attr]


def unknown(name: str, number: Any) -> Value:
    shape = np.shape(number)
    if not shape:
        return Component(name)
    return Array(shape, tuple(Component(name, tuple(i + 1 for i in index)) for index in np.ndindex(shape)))


def plain(value: Value, numbers: Mapping[str, Any]) -> Any:
    """Numbers, arrays and nested lists of Python."""

    def leaf(node: Any) -> float:
        return float(np.asarray(numbers[node.unknown])[tuple(i - 1 for i in node.index)])

    if isinstance(value, SCALARS):
        return float(evaluate((value,), leaf)[0])
    if isinstance(value, Array):
        return np.array([float(v) for v in evaluate(value.elements, leaf)]).reshape(value.shape)
    if isinstance(value, ListValue):
        return [plain(item, numbers) for item in value.items]
    if isinstance(value, RotationValue):
        return plain(value.matrix, numbers)
    if isinstance(value, PoseValue):
        size = len(value.translation)
        scale = 1.0 if value.scale is None else plain(value.scale, numbers)
        offset = plain(Array((size,), value.translation), numbers)
        return np.column_stack([scale * plain(value.rotation, numbers), offset])
    return value


@pytest.fixture
def lisp() -> Lisp:
    return Lisp()
