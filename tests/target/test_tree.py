"""The tree in its targets: a solver's text as Python, compiled from C, and lowered to LLVM gives the same numbers."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from math import isfinite, sqrt

import numpy as np
import pytest

from mbm.target import c
from mbm.target.from_python import (
    ConstantReals,
    Integer,
    NotInTargetLanguageError,
    Real,
    Reals,
    module_of,
)


def cholesky(n: Integer, a: Reals) -> Integer:
    """The lower triangle of a in place; the number of the first row (from 1) that is not positive, else 0."""
    for j in range(n):
        total = a[j * n + j]
        for k in range(j):
            total -= a[j * n + k] * a[j * n + k]
        if not (total > 0.0) or not isfinite(total):
            return j + 1
        root = sqrt(total)
        a[j * n + j] = root
        for i in range(j + 1, n):
            value = a[i * n + j]
            for k in range(j):
                value -= a[i * n + k] * a[j * n + k]
            a[i * n + j] = value / root
    return 0


def walk(n: Integer, x: ConstantReals, out: Reals) -> Real:
    """A bit of everything: loops left early, branches, integers, calls, arrays from an element on."""
    total = 0.0
    count = 0
    i = 0
    while i < n:
        i += 1
        if x[i - 1] < 0.0 and count % 3 != 2:
            count += 1
            continue
        if x[i - 1] > 90.0 or count // 4 >= 5:
            break
        total += max(x[i - 1], 0.5) * float(i) - min(x[i - 1], 0.25)
    for k in range(2, n):
        if x[k] != x[k - 1] or not i >= 0:
            out[k] = -x[k] * (total - (x[k] - 1.0) / (x[k] + 300.0))
        else:
            out[k] = total
    put(out[1:], float(count))
    return total


def put(where: Reals, value: Real) -> None:
    """Two numbers."""
    where[0] = value
    where[1] = -value


MODULE = module_of("sample", [cholesky, put, walk], public=["cholesky", "walk"])
X = np.array([1.0, -2.0, 0.1, 0.1, -3.0, 7.0, -1.0, -4.0, -4.0, 2.5, 99.0, 3.0])


@pytest.fixture(scope="module")
def by_c(tmp_path_factory):
    """The library that the C compiler makes of the printed text, with every warning an error."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler here")
    folder = tmp_path_factory.mktemp("c")
    source = folder / "sample.c"
    heads = "".join(f"{c.declaration(f)};\n" for f in MODULE.functions if f.public)
    source.write_text(c.PRELUDE + heads + c.text(MODULE))
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-pedantic", "-Werror", "-shared", "-fPIC", "-Wno-unused-function"]
    subprocess.run([compiler, *flags, str(source), "-o", str(folder / "s.so"), "-lm"], check=True)
    return ctypes.CDLL(str(folder / "s.so"))


@pytest.fixture(scope="module")
def by_llvm():
    """What llvmlite makes of the lowered tree."""
    binding = pytest.importorskip("llvmlite.binding")
    from llvmlite import ir

    from mbm.target.llvm import lower_into

    target = ir.Module("sample")
    target.triple = binding.get_default_triple()
    lower_into(target, MODULE)
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    parsed = binding.parse_assembly(str(target))
    parsed.verify()
    machine = binding.Target.from_default_triple().create_target_machine(opt=2)
    engine = binding.create_mcjit_compiler(parsed, machine)
    engine.finalize_object()
    yield engine


def called(library, name, result, *arguments):
    """Call a function by its address or from a library."""
    kinds = [ctypes.c_int64 if isinstance(a, int) else ctypes.c_void_p for a in arguments]
    values = [a if isinstance(a, int) else a.ctypes.data for a in arguments]
    if isinstance(library, ctypes.CDLL):
        function = getattr(library, name)
        function.restype, function.argtypes = result, kinds
    else:
        function = ctypes.CFUNCTYPE(result, *kinds)(library.get_function_address(name))
    return function(*values)


@pytest.mark.parametrize("target", ["by_c", "by_llvm"])
def test_targets_give_what_python_gives(target, request):
    library = request.getfixturevalue(target)
    matrix = np.array([[4.0, 2, 1], [2, 5, 3], [1, 3, 6]])
    found = matrix.copy()
    assert called(library, "cholesky", ctypes.c_int64, 3, found) == 0
    np.testing.assert_allclose(np.tril(found), np.linalg.cholesky(matrix), rtol=1e-15)
    assert called(library, "cholesky", ctypes.c_int64, 3, np.ones((3, 3))) == 2
    assert called(library, "cholesky", ctypes.c_int64, 1, np.full(1, np.nan)) == 1
    there, here = np.zeros(len(X)), np.zeros(len(X))
    assert called(library, "walk", ctypes.c_double, len(X), X, there) == walk(len(X), X, here)
    np.testing.assert_array_equal(there, here)


def test_the_printed_text_reads_as_written():
    text = c.text(MODULE)
    assert "static void put(double *where, double value)" in text
    assert "total = total - a[j * n + k] * a[j * n + k];" in text
    assert "out[k] = -x[k] * (total - (x[k] - 1.0) / (x[k] + 300.0));" in text


def with_strings(n: Integer) -> Integer:
    """Not in the language."""
    return len("n") + n


def with_mixed(n: Integer) -> Real:
    """An integer is no real."""
    return n * 2.0


@pytest.mark.parametrize("wrong", [with_strings, with_mixed])
def test_other_python_is_refused(wrong):
    with pytest.raises(NotInTargetLanguageError):
        module_of("wrong", [wrong])
