"""Lets the test modules import the helpers beside them, however pytest is started; reads the solver once for all."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = str(Path(__file__).parents[2])
if ROOT not in sys.path:
    sys.path.insert(0, ROOT)


@pytest.fixture(scope="session", autouse=True)
def _solver_is_read_once() -> Iterator[None]:
    """The functions of the solver are the same for all problems, and reading them takes most of an emission's time."""
    from mbm.emit.routines import modules

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(modules, "library", functools.cache(modules.library))
        yield
