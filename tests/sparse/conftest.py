"""Every way in which the routines for blocks run."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import pytest

from mbm.kernels.native import engine
from mbm.kernels.store import standard_store
from mbm.kernels.types import MachineCode
from mbm.sparse import arithmetic, routines, system

WAYS = {"dense": {}, "fronts": {"NARROW": 0, "WIDE": 0}, "filled": {"NARROW": 0, "FULL": 0.0}}
"""How what an elimination leaves is held."""


@pytest.fixture(params=WAYS, ids=list(WAYS))
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    for name, value in WAYS[request.param].items():
        monkeypatch.setattr(system, name, value)
    if request.param == "filled":
        monkeypatch.setattr(arithmetic, "NARROW", 0)  # by rows of blocks, as for large matrices
    return request.param


def _light() -> MachineCode:
    return MachineCode(store=standard_store())


@pytest.fixture(params=["light", "fast", "threads", "python"])
def backend(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> MachineCode | None:
    """Code that is made at once, code that runs fast, by one thread and by three, and the text run as Python."""
    if request.param == "python":
        monkeypatch.setattr(engine, "hindrance", lambda _store: "not here")
        return None
    if find_spec("llvmlite") is None:
        pytest.skip("llvmlite is not installed")
    if request.param != "light":
        monkeypatch.setattr(routines, "WORTH", 0)
    if request.param == "threads":
        monkeypatch.setattr(arithmetic, "HEAVY", 0)
        monkeypatch.setattr(arithmetic, "processors", lambda: 3)
    return _light()


@pytest.fixture
def heavy(monkeypatch: pytest.MonkeyPatch) -> Callable[[], MachineCode]:
    """A backend for which all work is heavy: so many threads share it as are asked for."""
    if find_spec("llvmlite") is None:
        pytest.skip("llvmlite is not installed")
    monkeypatch.setattr(arithmetic, "HEAVY", 0)
    return _light
