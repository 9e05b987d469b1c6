"""Lets the test modules import the helpers beside them, however pytest is started; reads the solver once for all."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import pytest

ROOT = str(Path(__file__).parents[2])
if ROOT not in sys.path:
    sys.path.insert(0, ROOT)


@pytest.fixture(scope="session", autouse=True)
def _solver_is_read_once() -> Iterator[None]:
    """Many problems ask for the same functions of the solver, and reading them takes most of an emission's time."""
    from mbm.emit.c import files
    from mbm.emit.python import module
    from mbm.emit.routines import modules

    made = modules.emitted_module
    known = functools.cache(lambda called, fixed: made(called, dict(fixed)))

    def again(called: Iterable[str], fixed: Mapping[str, int] = MappingProxyType({})) -> object:
        return known(tuple(called), tuple(sorted(fixed.items())))

    with pytest.MonkeyPatch.context() as patch:
        for text in (files, module):
            patch.setattr(text, "emitted_module", again)
        yield
