"""How to solve: what ``(solve …)`` says, as a value."""

from __future__ import annotations

from dataclasses import dataclass

from mbm.problem.types import Method


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """``tolerance`` bounds the relative offset: the next step in standard deviations of the estimates."""

    method: Method = Method.AUTO
    max_iterations: int = 100
    tolerance: float = 1e-10
