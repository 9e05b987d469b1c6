"""Expressions from text: what the language makes of a form whose free names are columns of a table ``t``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mbm import compiler
from mbm.expression.nodes import Column, Expression
from mbm.language.limits import recursion_room
from mbm.language.scope import LocalScope
from mbm.language.session import open_session
from mbm.registry.standard import standard_registry
from mbm.shapes.model import make_model
from mbm.text.reader import read
from mbm.text.types import Source

REGISTRY = standard_registry()
SESSION = open_session(
    compiler.read(Source("empty", ""), Path("empty"), REGISTRY), REGISTRY.vocabulary(), make_model, REGISTRY.limits
)


def expression(text: str, variables: Mapping[str, Expression] | None = None) -> Expression:
    """The value of a form; ``x``, ``y``, ``z`` are columns unless ``variables`` says otherwise."""
    (form,) = read(Source("form", text))
    names = {"x": COLUMNS["x"], "y": COLUMNS["y"], "z": COLUMNS["z"], **(variables or {})}
    with recursion_room(REGISTRY.limits):
        return SESSION.evaluator.wanted(form, LocalScope(names, SESSION.scope))


COLUMNS = {name: Column("t", name) for name in "xyz"}
