"""Lets the test modules import the helpers beside them, however pytest is started; reads the solver once for all."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import pytest

ROOT = str(Path(__file__).parents[2])
if ROOT not in sys.path:
    sys.path.insert(0, ROOT)


@pytest.fixture(scope="session", autouse=True)
def _solver_is_read_once() -> Iterator[None]:
    """Many problems ask for the same functions of the solver; to read and to print them is most of an emission."""
    from mbm.emit.c import files
    from mbm.emit.python import module
    from mbm.emit.routines import modules
    from mbm.machine import from_python
    from mbm.machine.definitions import Definitions

    made, read = modules.emitted_module, Definitions()
    known = functools.cache(lambda called, fixed: made(called, dict(fixed)))

    def again(called: Iterable[str], fixed: Mapping[str, int] = MappingProxyType({})) -> object:
        return known(tuple(called), tuple(sorted(fixed.items())))

    def printed(text: Callable[[object], str]) -> Callable[[object], str]:
        texts: dict[int, str] = {}  # by modules that `known` keeps
        return lambda one: texts[id(one)] if id(one) in texts else texts.setdefault(id(one), text(one))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(from_python, "Definitions", lambda: read)
        for text in (files, module):
            patch.setattr(text, "emitted_module", again)
            patch.setattr(text, "module_text", printed(text.module_text))
        yield
