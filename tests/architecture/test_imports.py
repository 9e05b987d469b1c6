"""Who imports whom, types included: no cycles among the modules; the contracts proper are import-linter's."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.architecture.reading import FILES, ROOT, facts

MODULES = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in FILES}


def _imported(path: Path) -> set[str]:
    """The modules of the house that a module imports, wherever it does, also for the type checker alone."""
    found = set()
    for module, names in facts(path).imports:
        whole = [f"{module}.{name}" for name in names]
        found |= {each if each in MODULES else module for each in whole} or {module}
    return found & MODULES.keys()


def test_no_cycles() -> None:
    """The package itself offers the API lazily, to those outside; nobody inside imports from it."""
    graph = {name: _imported(path) for name, path in MODULES.items() if name != "mbm"}
    try:
        order = tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" → ".join(error.args[1]))
    assert len(order) >= len(graph)


def test_relative_imports_are_not_used() -> None:
    """So that a reader, and this test, see the whole name."""
    assert not [name for name, path in MODULES.items() if facts(path).relative]


def test_nobody_inside_uses_the_front_door() -> None:
    """``from mbm import compiler`` names a module; ``from mbm import Problem`` would go round through the API."""
    inside = {name for name, path in MODULES.items() if name != "mbm" and "mbm" in _imported(path)}
    assert not inside
