"""Images of machine code: what they say, what they refuse, and LLVM's own linker beside them."""

from __future__ import annotations

import ctypes
import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from mbm.kernels.native import engine, image
from mbm.kernels.native.image import MAGIC, DamagedImageError, Image, Loaded, UnsupportedObjectError, linked, read
from mbm.machine.vectors import VECTORISED

pytestmark = pytest.mark.skipif(not image.supported(), reason="images run on Linux on x86-64")

IR = """
declare double @erf(double)
declare double @hypot(double, double)
@table = private constant [3 x double] [double 1.5, double 2.5, double 4.5]
define internal double @inner(double %x) noinline { %y = call double @erf(double %x)
 ret double %y }
define double @outer(double %x, i64 %k) { %y = call double @inner(double %x)
 %p = getelementptr [3 x double], ptr @table, i64 0, i64 %k
 %t = load double, ptr %p
 %h = call double @hypot(double %y, double %t)
 ret double %h }
define i64 @chosen(i64 %k) {
 switch i64 %k, label %other [ i64 0, label %a i64 1, label %b i64 2, label %c i64 3, label %d i64 4, label %e ]
a: ret i64 11
b: ret i64 7
c: ret i64 -5
d: ret i64 100
e: ret i64 3
other: ret i64 0 }
define double @alone(double %x) { %y = fmul double %x, 3.25
 ret double %y }
"""


def outer(address):
    return ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double, ctypes.c_int64)(address)


@pytest.mark.parametrize("by_llvm", [False, True])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_constants_calls_and_jumps(level, by_llvm, monkeypatch):
    if by_llvm:
        monkeypatch.setattr(image, "supported", lambda: False)
    library = engine.compiled(IR, None, level)
    found = outer(library.address("outer"))
    for k, number in enumerate((1.5, 2.5, 4.5)):
        assert found(0.75, k) == math.hypot(math.erf(0.75), number)
    chosen = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(library.address("chosen"))
    assert [chosen(k) for k in range(-1, 6)] == [0, 11, 7, -5, 100, 3, 0]


def made(text=IR, level=1):
    return linked(engine._object_code(text, level))


def test_an_image_comes_back_as_it_was_written():
    whole = made()
    again = read(whole.written())
    assert again == whole
    assert set(whole.imports) == {"erf", "hypot"}
    assert {"outer", "chosen", "alone"} <= set(whole.exports)
    assert "inner" not in whole.exports
    loaded = Loaded(again)
    assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(loaded.address("alone"))(2.0) == 6.5
    with pytest.raises(DamagedImageError):
        loaded.address("inner")


@pytest.mark.parametrize(
    "spoil",
    [
        lambda c: c[:-1],
        lambda c: c[:20],
        lambda c: b"x" + c[1:],
        lambda c: c.replace(b"exports", b"exparts", 1),
        lambda c: c.replace(b"exports ", b"exports x", 1),
        lambda c: c.replace(b"exports ", b"exports", 1),
    ],
)
def test_what_is_not_whole_is_refused(spoil):
    with pytest.raises(DamagedImageError):
        read(spoil(made().written()))


@pytest.mark.parametrize(
    "places", ["imports 99999999 sin", "imports 1 sin", "imports -1 sin", "exports 8 f", "exports -1 f"]
)
def test_places_outside_are_refused(places):
    """Eight bytes of code: an address stands at 0 or nowhere, a function begins before the end."""
    with pytest.raises(DamagedImageError):
        read(MAGIC + places.encode() + b"\n8\n\n" + bytes(8))
    assert read(MAGIC + b"exports 7 f\nimports 0 sin\n8\n\n" + bytes(8)).exports == {"f": 7}


def test_calls_of_what_is_not_there_are_refused():
    with pytest.raises(DamagedImageError, match="nowhere_at_all"):
        Loaded(Image(code=bytes(32), exports={}, imports={"nowhere_at_all": 8}))


def test_variables_are_left_to_llvm():
    text = "@v = global double 1.0\ndefine double @f() { %x = load double, ptr @v\n ret double %x }"
    with pytest.raises(UnsupportedObjectError):
        made(text)
    library = engine.compiled(text, None)
    assert ctypes.CFUNCTYPE(ctypes.c_double)(library.address("f"))() == 1.0


def test_code_that_is_no_elf_is_left_to_llvm():
    with pytest.raises(UnsupportedObjectError):
        linked(b"\xcf\xfa\xed\xfe" + bytes(100))


def test_images_lie_where_they_are_not_written_to():
    loaded = Loaded(made())
    start = loaded.address("alone")
    for line in Path("/proc/self/maps").read_text("utf-8").splitlines():
        low, high = (int(part, 16) for part in line.split()[0].split("-"))
        if low <= start < high:
            assert line.split()[1][:3] == "r-x"
            return
    raise AssertionError


vector_library, described = engine.vector_library.__wrapped__, engine.described.__wrapped__
"""As of a process that has not asked for them yet."""


def test_the_vector_library_is_what_the_processor_runs(monkeypatch, tmp_path):
    found = engine.vector_library()
    if not found.functions:
        pytest.skip("there is no vector library here")
    assert {"sin", "cos", "exp", "log", "pow"} <= found.functions <= {o.value for o in VECTORISED}
    kind = f"<{found.width} x double>"
    symbol = found.name("exp", 1)
    text = f"""declare {kind} @{symbol}({kind})
    define void @f(ptr %x) {{ %a = load {kind}, ptr %x, align 8
     %b = call {kind} @{symbol}({kind} %a)
     store {kind} %b, ptr %x, align 8
     ret void }}"""
    x = np.linspace(-1, 1, found.width)
    wanted = np.exp(x)
    library = engine.compiled(text, None)
    ctypes.CFUNCTYPE(None, ctypes.c_void_p)(library.address("f"))(x.ctypes.data)
    np.testing.assert_allclose(x, wanted, rtol=1e-15)  # four units in the last place
    told = tmp_path / "cpuinfo"
    for flags, width, functions, fused in (("sse4_1", 2, True, False), ("fma", 4, False, True), ("", 4, False, False)):
        told.write_text(f"processor : 0\nflags\t: fpu {flags}\n\nprocessor : 1\nflags : avx2 fma\n")
        monkeypatch.setattr(engine, "_CPUINFO", told)
        found = vector_library()
        assert (found.width, bool(found.functions), found.fused) == (width, functions, fused)


def test_the_description_names_features(monkeypatch, tmp_path):
    told = tmp_path / "cpuinfo"
    monkeypatch.setattr(engine, "_CPUINFO", told)
    # Where the kernel tells nothing LLVM does: what was made for one processor must not be found by another.
    assert "+sse2" in described()
    assert not vector_library().functions
    told.write_text("processor : 0\nmodel name : A\nflags : avx2\n")
    one = described()
    told.write_text("processor : 0\nmodel name : A\nflags : avx2 fma\n")
    assert described() != one
    monkeypatch.setattr(image, "supported", lambda: False)
    assert described().count("\n") == 2
    assert not vector_library().functions
