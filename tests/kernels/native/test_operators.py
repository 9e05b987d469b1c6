"""Every operator as machine code: against exact arithmetic, and against IEEE 754 where numbers are special."""

from __future__ import annotations

import ctypes
import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest

pytest.importorskip("llvmlite")

from mbm.kernels.native.engine import compiled, kept, vector_library
from mbm.machine import straight_line
from mbm.machine.kinds import LANES
from mbm.machine.program import Instruction, Operator, Program
from mbm.machine.vector_text import Text

ULPS = 4
"""Units in the last place that libmvec's manual allows its functions; the C library keeps to two."""

UNARY = {
    Operator.EXP: (mpmath.exp, np.exp),
    Operator.LOG: (mpmath.log, np.log),
    Operator.SIN: (mpmath.sin, np.sin),
    Operator.COS: (mpmath.cos, np.cos),
    Operator.TAN: (mpmath.tan, np.tan),
    Operator.ASIN: (mpmath.asin, np.arcsin),
    Operator.ACOS: (mpmath.acos, np.arccos),
    Operator.ATAN: (mpmath.atan, np.arctan),
    Operator.SINH: (mpmath.sinh, np.sinh),
    Operator.COSH: (mpmath.cosh, np.cosh),
    Operator.TANH: (mpmath.tanh, np.tanh),
    Operator.ASINH: (mpmath.asinh, np.arcsinh),
    Operator.ACOSH: (mpmath.acosh, np.arccosh),
    Operator.ATANH: (mpmath.atanh, np.arctanh),
    Operator.LOG1P: (mpmath.log1p, np.log1p),
    Operator.EXPM1: (mpmath.expm1, np.expm1),
    Operator.ERF: (mpmath.erf, np.vectorize(math.erf)),
}
BINARY = {
    Operator.POW: (mpmath.power, np.power),
    Operator.ATAN2: (mpmath.atan2, np.arctan2),
    Operator.HYPOT: (mpmath.hypot, np.hypot),
}


def truth(function):
    return lambda *arguments: function(*arguments).astype(float)


def remainder(a, b):
    """The IEEE remainder; NaN where Python refuses it."""
    found = []
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        try:
            found.append(math.remainder(x, y))
        except ValueError:
            found.append(np.nan)
    return np.array(found)


EXACT = {
    Operator.ADD: np.add,
    Operator.SUB: np.subtract,
    Operator.MUL: np.multiply,
    Operator.DIV: np.divide,
    Operator.NEG: np.negative,
    Operator.SQRT: np.sqrt,
    Operator.SQUARE: np.square,
    Operator.TWICE: lambda a: 2 * a,
    Operator.RECIPROCAL: lambda a: 1 / a,
    Operator.LESS: truth(np.less),
    Operator.LESS_EQUAL: truth(np.less_equal),
    Operator.EQUAL: truth(np.equal),
    Operator.NOT_EQUAL: truth(np.not_equal),
    Operator.NOT: truth(np.logical_not),
    Operator.AND: truth(np.logical_and),
    Operator.OR: truth(np.logical_or),
    Operator.SELECT: lambda test, value: np.where(test != 0, value, 0.0),
    Operator.FLOOR: np.floor,
    Operator.CEIL: np.ceil,
    Operator.FMOD: np.fmod,
    Operator.REMAINDER: remainder,
    Operator.ABS: np.abs,
    Operator.SIGN: lambda a: np.where(a == 0, a, np.sign(a)),
    Operator.COPYSIGN: np.copysign,
    Operator.MIN: np.fmin,
    Operator.MAX: np.fmax,
}
"""Operators that IEEE 754 or C define to the last bit."""

SPECIAL = np.array(
    [0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 1.5, -1.5, 2.0, -2.0, 2.5, 3.0, -3.0, 1e-5, 1e22, -1e22, 1e308, -1e308, 5e-324,
     -5e-324, 2.2e-308, 709.0, 710.0, -745.0, -746.0, np.inf, -np.inf, np.nan]
)  # fmt: skip
PAIRS = np.array([(a, b) for a in SPECIAL for b in SPECIAL])
LIBRARIES = ("vectors", "half vectors", "C library", "straight line", "straight line, C library")
TOGETHER = 5
"""Calls of one function in a straight line: a vector of four, and one that is left."""


ONE_ARGUMENT = {*UNARY, Operator.TWICE, Operator.RECIPROCAL, Operator.NOT, Operator.SIGN}


def arity(operator):
    return 1 if operator in ONE_ARGUMENT or getattr(EXACT.get(operator), "nin", 2) == 1 else 2


def single(operator, times=1):
    """A program of one instruction, or of the same one for several sets of inputs."""
    count = arity(operator)
    inputs = range(count * times)
    each = [tuple(inputs[k * count : (k + 1) * count]) for k in range(times)]
    return Program(
        values=(count + 1) * times,
        inputs=tuple(inputs),
        constants=(),
        instructions=tuple(Instruction(len(inputs) + k, operator, own) for k, own in enumerate(each)),
        outputs=tuple(range(len(inputs), len(inputs) + times)),
    )


@pytest.fixture(scope="module", params=LIBRARIES)
def library(request):
    """All operators, by what there is for elementary functions: whole vectors, vectors of two, or one by one."""
    found = vector_library()
    if "C library" not in request.param and not found.functions:
        pytest.skip("there is no vector library here")
    if request.param == "half vectors":
        found = replace(found, prefix="_ZGVbN2", width=2)
    if request.param.startswith("straight line"):
        text = Text(found if request.param == "straight line" else None)
        for operator in Operator:
            straight_line.function(f"op_{operator.value}", single(operator, TOGETHER), arity(operator), TOGETHER, text)
        return in_lines, kept(text.module(), text.module, None, 2, loops=False)
    programs = {f"op_{operator.value}": single(operator) for operator in Operator}
    given = None if request.param == "C library" else found
    return in_blocks, compiled(straight_line.module_of(programs, given), None, 1)


def evaluated(library, operator, *columns):
    """The operator for columns of numbers."""
    way, code = library
    return way(code.address(f"op_{operator.value}"), columns)


def in_lines(address, columns):
    """Some at a time: those of the first are the point, the others the data."""
    rows = len(columns[0])
    table = np.zeros((rows + -rows % TOGETHER, len(columns)))
    table[:rows] = np.column_stack(columns)
    outputs = np.empty(len(table))
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64)(address)
    for first in range(0, len(table), TOGETHER):
        point = table[first : first + TOGETHER].ravel()
        data = point[len(columns) :]
        call(point.ctypes.data, data.ctypes.data, outputs[first:].ctypes.data, TOGETHER)
    return outputs[:rows]


def in_blocks(address, columns):
    """Blocks of rows, of which the last is padded."""
    rows = len(columns[0])
    blocks = -(-rows // LANES)
    table = np.zeros((blocks * LANES, len(columns)))
    table[:rows] = np.column_stack(columns)
    inputs = np.ascontiguousarray(table.reshape(blocks, LANES, -1).transpose(0, 2, 1))
    outputs = np.empty((blocks, 1, LANES))
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
    call(address)(inputs.ctypes.data, outputs.ctypes.data, blocks)
    return outputs.reshape(-1)[:rows]


def domain(operator, random, count):
    """Arguments of both signs and many magnitudes for which the function is defined."""
    wide = np.exp(random.uniform(-40, 40, count)) * random.choice([-1.0, 1.0], count)
    near = random.uniform(-3, 3, count)
    both = np.concatenate([near, wide])
    match operator:
        case Operator.ASIN | Operator.ACOS | Operator.ATANH:
            return np.concatenate([near / 3, np.minimum(1 / (1 + abs(wide)), 1 - 1e-12)])
        case Operator.ACOSH:
            return 1 + abs(both)
        case Operator.LOG:
            return abs(both)
        case Operator.LOG1P:
            return np.concatenate([near[near > -1], abs(wide)])
        case Operator.EXP | Operator.EXPM1 | Operator.SINH | Operator.COSH:
            return np.clip(both, -700, 700)
    return both


def check_ulps(found, wanted, arguments):
    for got, exact, given in zip(found, wanted, arguments, strict=True):
        near = np.spacing(abs(float(exact))) if exact else 5e-324
        assert abs(mpmath.mpf(float(got)) - exact) <= ULPS * mpmath.mpf(float(near)), (given, got, float(exact))


@pytest.mark.parametrize("operator", UNARY, ids=str)
def test_functions_of_one_argument(operator, library):
    x = domain(operator, np.random.default_rng(7), 300)
    with mpmath.workprec(160):
        check_ulps(evaluated(library, operator, x), [UNARY[operator][0](mpmath.mpf(v)) for v in x], x)


@pytest.mark.parametrize("operator", BINARY, ids=str)
def test_functions_of_two_arguments(operator, library):
    random = np.random.default_rng(8)
    x = domain(operator, random, 300)
    y = np.concatenate([random.uniform(-3, 3, 300), random.uniform(-12, 12, 300)])
    x = abs(x) if operator is Operator.POW else x
    with mpmath.workprec(160):
        exact = [BINARY[operator][0](mpmath.mpf(a), mpmath.mpf(b)) for a, b in zip(x, y, strict=True)]
        check_ulps(evaluated(library, operator, x, y), exact, zip(x, y, strict=True))


@pytest.mark.parametrize("operator", [*UNARY, *BINARY], ids=str)
def test_special_values_of_functions(operator, library):
    """Poles, infinities, signs of zero, NaN: as Annex F of C has them, which NumPy follows."""
    columns = (SPECIAL,) if operator in UNARY else (PAIRS[:, 0], PAIRS[:, 1])
    found = evaluated(library, operator, *columns)
    with np.errstate(all="ignore"):
        wanted = {**UNARY, **BINARY}[operator][1](*columns)
    # Between the special ones stand ordinary results: two functions of a few units in the last place each; beside the
    # smallest numbers a unit is a large part of them.
    np.testing.assert_allclose(found, wanted, rtol=2 * ULPS * 2.3e-16, atol=2e-323)
    zero = wanted == 0
    np.testing.assert_array_equal(np.signbit(found[zero]), np.signbit(wanted[zero]))


@pytest.mark.parametrize("operator", EXACT, ids=str)
def test_operations_to_the_last_bit(operator, library):
    columns = (SPECIAL,) if arity(operator) == 1 else (PAIRS[:, 0], PAIRS[:, 1])
    random = np.random.default_rng(9).normal(0, 10, (len(columns), 400))
    columns = [np.concatenate([c, r]) for c, r in zip(columns, random, strict=True)]
    found = evaluated(library, operator, *columns)
    with np.errstate(all="ignore"):
        wanted = EXACT[operator](*columns)
    np.testing.assert_array_equal(found, wanted)
    # Which of two zeros of different sign is the greater is left open by C.
    zero = (wanted == 0) & (operator not in (Operator.MIN, Operator.MAX))
    np.testing.assert_array_equal(np.signbit(found[zero]), np.signbit(wanted[zero]))


def test_no_operator_is_left_out():
    assert set(Operator) == {*UNARY, *BINARY, *EXACT}


def test_truths_add_up_and_masks_combine():
    """(a < b) + (a ≤ b), and where neither holds nor b is zero, a: comparisons used as numbers and as conditions."""
    program = Program(
        values=9,
        inputs=(0, 1, -1),
        constants=((2, 10.0),),
        instructions=(
            Instruction(3, Operator.LESS, (0, 1)),
            Instruction(4, Operator.LESS_EQUAL, (0, 1)),
            Instruction(5, Operator.ADD, (3, 4)),
            Instruction(6, Operator.OR, (4, 1)),
            Instruction(7, Operator.NOT, (6,)),
            Instruction(8, Operator.SELECT, (7, 0)),
        ),
        outputs=(5, 8, -1, 2, 7),
    )
    library = compiled(straight_line.module_of({"f": program}, None), None, 0)
    inputs = np.array([[1.0, 2.0, 2.0, 3.0], [2.0, 2.0, 1.0, 0.0], [np.nan] * 4])
    outputs = np.empty((5, 4))
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
    call(library.address("f"))(inputs.ctypes.data, outputs.ctypes.data, 1)
    wanted = np.array([[2, 1, 0, 0], [0, 0, 0, 3], [0] * 4, [10] * 4, [0, 0, 0, 1]])
    np.testing.assert_array_equal(outputs, wanted)
    text = Text(None)
    straight_line.function("f", program, 3, 5, text)
    library = compiled(text.module(), None, 0)
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64)(library.address("f"))
    for row, line in zip(np.ascontiguousarray(inputs.T), wanted.T, strict=True):
        target = np.empty(5)
        call(row.ctypes.data, row.ctypes.data, target.ctypes.data, 5)
        np.testing.assert_array_equal(target, line)
