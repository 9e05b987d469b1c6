"""A plugin of pytest that writes down which functions of mbm each test calls, and how long the test takes.

Each worker writes a file of its own, with its name behind that of the file.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

VARIABLE = "MBM_CALLS"
"""Environment variable with the beginning of the names of the files to write."""
WORKER = "PYTEST_XDIST_WORKER"
"""That of pytest-xdist with the name of a worker."""
ROOT = Path(__file__).parents[2]


class Calls:
    """Listens to calls while a test runs; those of other threads are not heard."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._found: dict[str, dict[str, Any]] = {}
        self._inside = str(ROOT / "mbm") + os.sep

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        called: set[tuple[str, int]] = set()
        inside = self._inside

        def hear(frame: FrameType, event: str, _argument: object) -> None:
            if event == "call" and frame.f_code.co_filename.startswith(inside):
                called.add((frame.f_code.co_filename, frame.f_code.co_firstlineno))

        begin = time.perf_counter()
        sys.setprofile(hear)
        try:
            return (yield)
        finally:
            sys.setprofile(None)
            places = sorted(f"{Path(name).relative_to(ROOT).as_posix()}:{line}" for name, line in called)
            self._found[item.nodeid] = {"seconds": time.perf_counter() - begin, "calls": places}

    def pytest_sessionfinish(self) -> None:
        self._path.write_text(json.dumps(self._found), encoding="utf-8")


def pytest_configure(config: pytest.Config) -> None:
    if VARIABLE in os.environ and (WORKER in os.environ or not config.getoption("numprocesses", None)):
        config.pluginmanager.register(Calls(Path(f"{os.environ[VARIABLE]}.{os.environ.get(WORKER, 'alone')}")))
