"""Code that evaluates kernels over tables: what was compiled for speed is not left for what was not."""

from __future__ import annotations

from threading import Thread
from types import SimpleNamespace

import pytest

from mbm.kernels.backends import native
from mbm.kernels.native.kernels import EVALUATIONS, FAST, MANY


def test_what_is_compiled_in_no_time_does_not_replace_what_is_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread with many rows comes while another compiles for few."""
    tables = native._Tables(None)
    monkeypatch.setattr(native, "fetched", lambda *_, **__: None)
    monkeypatch.setattr(native, "_SIGNATURE", lambda level: level)
    many = Thread(target=tables.run, args=(MANY * EVALUATIONS,))

    def kept(name: str, text: object, store: object, level: int, *, compact: bool) -> SimpleNamespace:
        if level != FAST:
            many.start()
            many.join(0.1)  # in vain, if it waits for this one
        return SimpleNamespace(address=lambda _: level)

    monkeypatch.setattr(native, "kept", kept)
    tables.run(1)
    many.join()
    assert tables.run(1) == FAST
