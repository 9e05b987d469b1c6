"""A plugin of pytest that writes down which functions of mbm each test calls, and how long the test takes.

Functions say by themselves that they are called: a statement is put before their first one when a module is read. That
costs a fifth of what the tests take, where a profile function more than doubles it. Each worker writes a file of its
own, with its name behind that of the file. Calls in other processes are not heard.
"""

from __future__ import annotations

import ast
import builtins
import json
import os
import sys
import time
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

import pytest

VARIABLE = "MBM_CALLS"
"""Environment variable with the beginning of the names of the files to write."""
WORKER = "PYTEST_XDIST_WORKER"
"""That of pytest-xdist with the name of a worker."""
ROOT = Path(__file__).parents[2]
INSIDE = str(ROOT / "mbm") + os.sep
HEARD = "__heard_by_tests__"
"""The name under which functions find what they say their place to."""


class Saying(ast.NodeTransformer):
    """Functions whose first statement, behind their documentation, says where they stand."""

    def __init__(self, file: str) -> None:
        self._file = file

    def _saying(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> ast.AST:
        self.generic_visit(node)
        first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        place = ast.Constant(f"{self._file}:{first}")
        say = ast.Expr(ast.Call(ast.Name(HEARD, ast.Load()), [place], []))
        node.body.insert(1 if ast.get_docstring(node, clean=False) is not None else 0, ast.copy_location(say, node))
        return node

    visit_FunctionDef = visit_AsyncFunctionDef = _saying  # noqa: N815 - what `ast` calls them


def compiled(loader: SourceFileLoader, data: Any, path: Any, *, _optimize: int = -1) -> CodeType:
    """A module as Python makes it, one of mbm with functions that say their place."""
    tree = ast.parse(data, path)
    if str(path).startswith(INSIDE):
        tree = Saying(Path(path).relative_to(ROOT).as_posix()).visit(tree)
    code: CodeType = compile(ast.fix_missing_locations(tree), path, "exec", dont_inherit=True, optimize=_optimize)
    return code


class Calls:
    """Listens while a test runs; forgets tests that fail, which could not notice anything."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._found: dict[str, dict[str, Any]] = {}
        self._failed: set[str] = set()
        self._called: set[str] = set()
        setattr(builtins, HEARD, self._called.add)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._called.clear()
        begin = time.perf_counter()
        try:
            return (yield)
        finally:
            self._found[item.nodeid] = {"seconds": time.perf_counter() - begin, "calls": sorted(self._called)}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        kept = {name: entry for name, entry in self._found.items() if name not in self._failed}
        self._path.write_text(json.dumps(kept), encoding="utf-8")


if VARIABLE in os.environ:  # before any module of mbm is read, which `conftest.py` begins with
    sys.pycache_prefix = os.environ[VARIABLE] + ".compiled"
    SourceFileLoader.source_to_code = compiled  # type: ignore[method-assign]
    setattr(builtins, HEARD, lambda _place: None)


def pytest_configure(config: pytest.Config) -> None:
    if VARIABLE in os.environ and (WORKER in os.environ or not config.getoption("numprocesses", None)):
        config.pluginmanager.register(Calls(Path(f"{os.environ[VARIABLE]}.{os.environ.get(WORKER, 'alone')}")))
