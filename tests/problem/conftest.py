"""Problems as texts, solved; and what they answer when they are wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mbm
from mbm.text.types import Diagnostic, MbmError


@pytest.fixture
def solve() -> Callable[..., Any]:
    def call(text: str, name: str | None = None, **given: Any) -> Any:
        problem = mbm.loads(text)
        return (problem.named(name) if name else problem).solve(**given)

    return call


@pytest.fixture
def estimate(solve: Callable[..., Any]) -> Callable[..., Any]:
    """The estimate of an unknown as an array (a scalar has no dimensions)."""

    def call(text: str, unknown: str = "a", **given: Any) -> Any:
        return np.asarray(solve(text, **given)[unknown].value)

    return call


@pytest.fixture
def faults() -> Callable[..., tuple[Diagnostic, ...]]:
    def call(text: str, name: str | None = None, **given: Any) -> tuple[Diagnostic, ...]:
        with pytest.raises(MbmError) as caught:
            problem = mbm.loads(text)
            (problem.named(name) if name else problem).solve(**given)
        return caught.value.diagnostics

    return call
