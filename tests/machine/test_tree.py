"""The tree in its targets: a text as Python, printed as Python, compiled from C, lowered to LLVM: the same numbers."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from math import (
    acos,
    acosh,
    asin,
    asinh,
    atan,
    atan2,
    atanh,
    ceil,
    copysign,
    cos,
    cosh,
    erf,
    exp,
    expm1,
    fabs,
    floor,
    fmod,
    hypot,
    isfinite,
    log,
    log1p,
    pow,  # noqa: A004
    remainder,
    sin,
    sinh,
    sqrt,
    tan,
    tanh,
)

import numpy as np
import pytest
from numpy import fmax, fmin

from mbm.machine import c, python
from mbm.machine.from_python import NotInTargetLanguageError, module_of
from mbm.machine.tree import Assign, For, If, Literal, Name, Primitive, Type
from mbm.machine.words import ConstantReals, Integer, Real, Reals, call_kernel, distinct_arrays


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


@distinct_arrays
def functions(n: Integer, x: ConstantReals, out: Reals) -> None:
    """Every function of one argument, and of two; choices, and poles on the way."""
    for i in range(n):
        v = x[i]
        w = v - 2.0 if v > 0.25 or not v > -0.25 else 0.5
        out[i] = tan(v) + asin(v / 100.0) + acos(v / 100.0) + atan(v) + sinh(v / 9.0) + cosh(v / 9.0) + tanh(v)
        out[i] += asinh(v) + acosh(1.0 + v * v) + atanh(v / 100.0) + log1p(fabs(v)) + expm1(v / 9.0) + erf(v)
        out[i] += exp(v / 9.0) + sin(v) + cos(v) + sqrt(fabs(v)) + log(fabs(v)) + floor(v) + ceil(v / 2.0)
        out[n + i] = pow(fabs(v), w) + hypot(v, w) + fmod(v, 0.75) + remainder(v, 0.75) + atan2(v, w)
        out[n + i] += fmin(v, w) - 2.0 * fmax(v, w) + copysign(v, -w)
        out[2 * n + i] = 1.0 / (v - 1.0) if v != -3.0 else -1.0


def brackets(n: Integer, m: Integer, x: ConstantReals, out: Reals) -> None:
    """Operators of one rank on the right of one another: brackets that must stay."""
    out[0] = float(n * (m % 3))
    out[1] = float(n * (m // 3))
    out[2] = float(n % (m % 4))
    out[3] = float(n // (m // 4))
    out[4] = float(n - (m - 3))
    out[5] = float((n * m) % 7 + (n + m) % 5)
    out[6] = x[0] / (x[1] / x[2])
    out[7] = x[0] - (x[1] - x[2])
    out[8] = x[0] * (x[1] - x[2]) / (x[1] + x[2])


def comparisons(n: Integer, x: ConstantReals, out: Reals) -> None:
    """All comparisons of all pairs: with what is no number, only `!=` holds."""
    for i in range(n):
        for k in range(n):
            found = 0.0
            if x[i] < x[k]:
                found += 1.0
            if x[i] <= x[k]:
                found += 2.0
            if x[i] > x[k]:
                found += 4.0
            if x[i] >= x[k]:
                found += 8.0
            if x[i] == x[k]:
                found += 16.0
            if x[i] != x[k]:
                found += 32.0
            out[i * n + k] = found


def entry(t1: Real, b1: Real, place: Integer, x: Reals) -> Real:
    """Parameters that change, names that a target may use itself, and branches none of which goes on."""
    t2 = t1 + b1
    for entry in range(place):
        for b2 in range(entry, place):
            t2 = t2 + t1 * float(b2 - entry)
            x[0] += float(b2)
        t1 = t1 - 0.5
    place = place - 1
    if t1 < b1:
        if place > 2:
            return t2 - b1
        else:  # noqa: RET505 - a branch none of whose ends goes on
            return t2 + float(place)
    if t1 == b1:
        t2 = -t2
        return t2 if place > 0 else b1
    return t1


MODULE = module_of("sample", [cholesky, walk, functions, brackets, comparisons, entry])
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
    text = heads + c.text(MODULE)
    source.write_text(c.prelude(text) + text)
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-pedantic", "-Werror", "-shared", "-fPIC", "-Wno-unused-function"]
    subprocess.run([compiler, *flags, str(source), "-o", str(folder / "s.so"), "-lm"], check=True)
    return ctypes.CDLL(str(folder / "s.so"))


@pytest.fixture(scope="module")
def by_llvm():
    """What llvmlite makes of the lowered tree."""
    binding = pytest.importorskip("llvmlite.binding")
    from mbm.machine import llvm

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    parsed = binding.parse_assembly(llvm.text(MODULE))
    parsed.triple = binding.get_default_triple()
    parsed.verify()
    machine = binding.Target.from_default_triple().create_target_machine(opt=2)
    engine = binding.create_mcjit_compiler(parsed, machine)
    engine.finalize_object()
    yield engine


@pytest.fixture(scope="module")
def by_python():
    """The printed Python, run."""
    names = {}
    exec(python.PRELUDE + python.text(MODULE), names)  # noqa: S102 - its own text
    return names


def called(library, name, result, *arguments):
    """Call a function by its address, from a library, or from a module."""
    if isinstance(library, dict):
        with np.errstate(all="ignore"):
            return library[name](*(a if isinstance(a, int) else a.ravel() for a in arguments))
    kinds = [ctypes.c_int64 if isinstance(a, int) else ctypes.c_void_p for a in arguments]
    values = [a if isinstance(a, int) else a.ctypes.data for a in arguments]
    if isinstance(library, ctypes.CDLL):
        function = getattr(library, name)
        function.restype, function.argtypes = result, kinds
    else:
        function = ctypes.CFUNCTYPE(result, *kinds)(library.get_function_address(name))
    return function(*values)


TARGETS = pytest.mark.parametrize("target", ["by_c", "by_llvm", "by_python"])


@TARGETS
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


@TARGETS
def test_functions_in_all_targets(target, request):
    library = request.getfixturevalue(target)
    x = X[X != 1.0]
    there, here = np.zeros(3 * len(x)), np.zeros(3 * len(x))
    called(library, "functions", None, len(x), x, there)
    functions(len(x), x, here)
    # Two libraries of functions, each good to a unit or two in the last place, and sums of twenty of them.
    np.testing.assert_allclose(there, here, rtol=1e-14, atol=1e-13)
    called(library, "functions", None, 1, np.ones(1), there)
    assert there[2] == np.inf  # nothing is raised at a pole


@TARGETS
def test_comparisons_with_what_is_no_number(target, request):
    x, found, wanted = np.array([np.nan, -1.0, 2.0, np.inf]), np.zeros(16), np.zeros(16)
    called(request.getfixturevalue(target), "comparisons", None, 4, x, found)
    comparisons(4, x, wanted)
    np.testing.assert_array_equal(found, wanted)
    assert wanted[:4].tolist() == [32.0] * 4


@TARGETS
@pytest.mark.parametrize("begin", [0.25, 3.5, 5.0, 9.0, -0.0])
@pytest.mark.parametrize("place", [0, 3, 6])
def test_names_and_branches_of_all_kinds(target, begin, place, request):
    library, found, wanted = request.getfixturevalue(target), np.zeros(1), np.zeros(1)
    if isinstance(library, dict):
        value = library["entry"](begin, 3.5, place, found)
    else:
        where = library.entry if target == "by_c" else library.get_function_address("entry")
        kinds = (ctypes.c_double, ctypes.c_double, ctypes.c_int64, ctypes.c_void_p)
        function = ctypes.CFUNCTYPE(ctypes.c_double, *kinds)
        address = ctypes.cast(where, ctypes.c_void_p).value if target == "by_c" else where
        value = function(address)(begin, 3.5, place, found.ctypes.data)
    assert value == entry(begin, 3.5, place, wanted)
    assert found[0] == wanted[0]


@TARGETS
def test_brackets_stay(target, request):
    found, wanted = np.zeros(9), np.zeros(9)
    called(request.getfixturevalue(target), "brackets", None, 23, 11, np.array([7.0, 0.3, 0.11]), found)
    brackets(23, 11, np.array([7.0, 0.3, 0.11]), wanted)
    np.testing.assert_array_equal(found, wanted)


def test_the_printed_text_reads_as_written():
    text = c.text(MODULE)
    assert "static void put(double *where, double value)" in text
    assert "total = total - a[j * n + k] * a[j * n + k];" in text
    assert "out[k] = -x[k] * (total - (x[k] - 1.0) / (x[k] + 300.0));" in text

    text = python.text(MODULE)
    assert "def put(where, value):" in text
    assert "            total -= a[j * n + k] * a[j * n + k]\n" in text
    assert "        if not total > 0.0 or not isfinite(total):\n" in text
    assert "total = float64(0.0)" in text
    assert "out[k] = -x[k] * (total - (x[k] - 1.0) / (x[k] + 300.0))" in text
    assert "static void functions(" not in text
    assert "void functions(long n, const double *restrict x, double *restrict out)" in c.text(MODULE)


LANES = 4


def laned(n: Integer, x: ConstantReals, out: Reals) -> None:
    """A text for lanes."""
    for i in range(n):
        for lane in range(LANES):
            if LANES == 4:
                out[i * LANES + lane] = x[i * LANES + lane]
            else:
                out[i * LANES + lane] = 2.0 * x[(i // LANES) * LANES + lane % LANES]


def test_constants_given_at_reading_decide_what_they_can():
    body = module_of("lanes", [laned]).functions[0].body
    assert isinstance(body[0], For)
    assert isinstance(body[0].body[0], For)
    assert not isinstance(body[0].body[0].body[0], If)
    text = c.text(module_of("lanes", [laned], constants={"LANES": 1}))
    assert "out[i] = 2.0 * x[i];" in text
    assert "lane" not in text.replace("lanes", "").replace("laned", "")


def with_kernel(address: Integer, x: ConstantReals, out: Reals) -> None:
    """Calls what begins at an address."""
    call_kernel(address, x, out, 1)


def test_kernels_are_called_by_address():
    module = module_of("kernels", [with_kernel])
    signature = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double), ctypes.c_int64)

    @signature
    def kernel(inputs, outputs, blocks):
        outputs[0] = 2 * inputs[0] + blocks

    address = ctypes.cast(kernel, ctypes.c_void_p).value
    out = np.zeros(1)
    with_kernel(address, np.full(1, 3.0), out)
    assert out[0] == 7.0
    engine = pytest.importorskip("mbm.kernels.native.engine")
    pytest.importorskip("llvmlite")
    from mbm.machine import llvm

    library = engine.compiled(llvm.text(module), None)
    out[:] = 0
    function = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)(library.address("with_kernel"))
    x = np.full(1, 3.0)
    function(address, x.ctypes.data, out.ctypes.data)
    assert out[0] == 7.0
    assert "call_kernel(address, x, out, 1L);" in c.text(module)


def test_literals_and_primitives_have_types():
    assert [Literal(1).type, Literal(1.0).type] == [Type.INTEGER, Type.REAL]
    name = Name("x", Type.REAL)
    assert Primitive("isfinite", (name,)).type is Type.INTEGER
    assert Assign(name, Literal(1.0)).value.type is Type.REAL


def with_strings(n: Integer) -> Integer:
    """Not in the language."""
    return len("n") + n


def with_mixed(n: Integer) -> Real:
    """An integer is no real."""
    return n * 2.0


def with_moved_stop(n: Integer) -> Integer:
    """Python takes the end of a range once, C each time."""
    found = 0
    for _i in range(n if found == 0 else 0):
        found = 1
    return found


def with_skipped_steps(n: Integer) -> Integer:
    """Python goes on from its own count, C from the variable."""
    found = 0
    for i in range(n):
        i += 1
        found += i
    return found


@pytest.mark.parametrize("wrong", [with_strings, with_mixed, with_moved_stop, with_skipped_steps])
def test_other_python_is_refused(wrong):
    with pytest.raises(NotInTargetLanguageError):
        module_of("wrong", [wrong])
