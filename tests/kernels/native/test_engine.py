"""Machine code from IR, from the store, and from what only claims to be it."""

from __future__ import annotations

import ctypes
import gc
import subprocess
import sys

import pytest

pytest.importorskip("llvmlite")

from mbm.kernels.native import engine, image
from mbm.kernels.native.engine import KIND, NotCompilingError, compiled, kept
from mbm.kernels.store import Store

IR = """
declare double @cbrt(double)
define double @twice(double %x) { %y = fadd double %x, %x
 ret double %y }
define double @root(double %x) { %y = call double @cbrt(double %x)
 ret double %y }
"""


class Shelf:
    """A store in memory that counts."""

    def __init__(self):
        self.held = {}
        self.puts = 0

    def get(self, kind, key):
        return self.held.get((kind, key))

    def put(self, kind, key, content):
        self.puts += 1
        self.held[kind, key] = content


def call(library, name, value):
    return ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(library.address(name))(value)


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_functions_run_and_reach_the_c_library(level):
    library = compiled(IR, None, level)
    assert call(library, "twice", 1.25) == 2.5
    assert call(library, "root", 27.0) == pytest.approx(3.0, rel=1e-15)


def test_what_is_in_the_store_is_not_compiled_again():
    shelf = Shelf()
    compiled(IR, shelf)
    asked = []
    again = compiled(IR, shelf)
    assert call(again, "twice", 3.0) == 6.0
    assert shelf.puts == 1
    first = kept("a name", lambda: asked.append(1) or IR, shelf)
    second = kept("a name", lambda: asked.append(1) or IR, shelf)
    assert call(first, "twice", 1.0) == call(second, "twice", 1.0) == 2.0
    assert (len(asked), shelf.puts) == (1, 2)


def test_levels_and_processors_are_kept_apart(monkeypatch):
    shelf = Shelf()
    for level in (0, 1, 2):
        compiled(IR, shelf, level)
    assert len(shelf.held) == 3
    before = engine.described()
    monkeypatch.setattr(engine, "described", lambda: before + " avx1024")
    compiled(IR, shelf, 0)
    assert len(shelf.held) == 4


@pytest.mark.parametrize(
    "spoil",
    [lambda code: b"", lambda code: b"no object code", lambda code: code[: len(code) // 3], lambda code: code[::-1]],
    ids=["empty", "text", "cut", "reversed"],
)
def test_what_is_no_object_code_is_made_anew(spoil):
    shelf = Shelf()
    compiled(IR, shelf)
    ((place, code),) = shelf.held.items()
    shelf.held[place] = spoil(code)
    assert call(compiled(IR, shelf), "twice", 3.0) == 6.0
    assert shelf.held[place] == code


def test_a_damaged_entry_of_the_store_is_not_run(tmp_path):
    store = Store(directory=tmp_path / "store")
    compiled(IR, store)
    (entry,) = store.entries()
    assert entry.kind == KIND
    content = bytearray(entry.path.read_bytes())
    content[-100] ^= 1
    entry.path.write_bytes(content)
    assert store.get(KIND, entry.path.stem) is None
    assert call(compiled(IR, store), "twice", 3.0) == 6.0
    assert store.get(KIND, next(iter(store.entries())).path.stem) is not None


def test_functions_outlive_other_libraries():
    libraries = [compiled(IR, None, 0) for _ in range(20)]
    last = libraries[7]
    addresses = {library.address("twice") for library in libraries}
    assert len(addresses) == 20
    del libraries
    gc.collect()
    assert call(last, "twice", 4.0) == 8.0


@pytest.mark.parametrize("text", ["define nonsense", "define double @f(double %x) { ret double %y }"])
def test_wrong_ir_is_an_internal_fault(text):
    with pytest.raises(NotCompilingError):
        compiled(text, None)


def test_names_that_are_not_there():
    with pytest.raises(NotCompilingError, match="absent"):
        compiled(IR, None).address("absent")
    unlinked = "declare void @nowhere_at_all()\ndefine void @f() { call void @nowhere_at_all()\n ret void }"
    with pytest.raises(NotCompilingError):
        compiled(unlinked, None).address("f")


def test_without_llvmlite_none_is_available(monkeypatch):
    assert engine.available()
    for name in [n for n in sys.modules if n.split(".")[0] == "llvmlite"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    assert not engine.available()


@pytest.mark.parametrize(
    ("version", "there"), [("0.43.0", False), ("0.44.1", True), ("1.0.0", True), ("of ours", True)]
)
def test_an_llvmlite_that_is_too_old_is_none(version, there, monkeypatch):
    monkeypatch.setattr(engine, "_version", lambda: f"version_version = '{version}'")
    assert engine.available() is there


def test_an_llvmlite_that_does_not_load_is_none(monkeypatch, tmp_path):
    """Its Python files are there, its library is not: what it says is passed on, and nothing is kept of the trial."""
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    store = Store(directory=tmp_path / "store")
    assert "llvmlite does not work" in engine.hindrance(store)
    assert not store.entries()


def test_the_trial_is_made_once_for_each_library(monkeypatch, tmp_path):
    """What was tried is not loaded again; another library in its place is tried anew."""
    if not image.supported():
        pytest.skip("images run on Linux on x86-64")
    store = Store(directory=tmp_path / "store")
    assert engine.hindrance(store) is None
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    assert engine.hindrance(store) is None
    monkeypatch.setattr(engine, "_files", lambda: "of another build")
    assert "llvmlite does not work" in engine.hindrance(store)


def test_where_memory_may_not_be_executed_none_is_available(monkeypatch):
    monkeypatch.setattr(image, "executable", lambda: False)
    monkeypatch.setattr(image, "supported", lambda: True)
    assert not engine.available()


def test_what_is_kept_is_loaded_without_llvmlite(tmp_path):
    """A second process: the warm start."""
    if not image.supported():
        pytest.skip("images run on Linux on x86-64")
    store = Store(directory=tmp_path / "store")
    compiled(IR, store, 1)
    assert engine.hindrance(store) is None
    code = f"""
import ctypes, sys
from pathlib import Path
from mbm.kernels.native.engine import compiled, hindrance
from mbm.kernels.native.engine import vector_library
from mbm.kernels.store import Store
store = Store(directory=Path({str(store.directory)!r}))
assert hindrance(store) is None
vector_library()
library = compiled({IR!r}, store, 1)
assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(library.address("twice"))(4.0) == 8.0
assert not any(name.split(".")[0] == "llvmlite" for name in sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
